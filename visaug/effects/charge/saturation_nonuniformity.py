"""Full well that differs from pixel to pixel."""

import torch

from visaug.effects.effect import Effect, Stage, Strength


class SaturationNonuniformity(Effect):
    """Pixels fill at different levels, and near the full well a part of the charge is lost before it is complete.

    The full well of the camera is that of its deepest pixels; others have up to a few times `spread` less, half-normal and
    drawn once per camera. A soft knee lets charge escape over the barrier as a diode does: within about `knee` of the full
    well the response bends. Requires a camera with a full well.
    """

    name = "saturation_nonuniformity"
    proposed = False  # its confusion with similar effects has not been counted
    stage = Stage.CHARGE
    order = 79  # just before the clipping at the camera's full well
    aliases = ("full well non-uniformity", "fixed pattern noise", "FPN", "soft knee")
    summary = "The full well differs from pixel to pixel, and is reached along a soft knee."
    equation = """N <- N - k ln(1 + exp((N - W_pixel) / k)), k = knee W; knee 0: min(N, W_pixel); W_pixel = W
    (1 - spread |z|), z ~ N(0, 1) per camera"""
    source = """A. Pelamatti et al., IEEE Trans. Electron Devices 62 (2015) 1200 (full well of pinned
    photodiodes, charge that escapes over the barrier); half-normal spread: assumed"""
    separates = """take flats beyond saturation: a fixed pattern in fully saturated frames, and a variance
    that falls before the mean stops; nonlinearity acts at all levels"""
    spread = Strength(0.02, "fraction", 0.0, 0.15, "1 to 5 % of the full well; assumed", trials=(0.01, 0.05))
    knee = Strength(
        0.0,
        unit="fraction",
        high=0.1,
        trials=(0.01, 0.04),
        source="width of the knee; kT / q over the swing of the diode: 25 mV / 1 V",
    )

    def apply(self, signal, p, stream, context):
        deepest_e = 1e9  # in place of an unlimited full well
        well = context.full_well_e.clamp_max(deepest_e)
        over = signal - well * (1 - p.spread * stream.fixed.normal().abs()).clamp_min(0)
        knee = (p.knee * well).clamp_min(1e-9)
        escaped = over.clamp_min(0) + p.knee * well * torch.log1p(torch.exp(-over.abs() / knee))
        return torch.where((p.spread > 0) | (p.knee > 0), signal - escaped, signal)
