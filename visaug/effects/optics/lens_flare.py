"""Lens flare."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage, Strength
from visaug.effects.optics.spread import PROFILES, gaussian_blur, halo, once_for_equals


class LensFlare(Effect):
    """Light reflected between lens surfaces forms ghosts: defocused copies, mirrored and scaled.

    Surfaces scatter further light into a halo around the source. The light is taken from the source, so the total is
    conserved except for what falls outside the sensor. Reflection is linear; `threshold_photons` excludes the dimmer parts
    of a scene.
    """

    name = "lens_flare"
    stage = Stage.OPTICS
    order = 20
    local = False
    aliases = ("ghosting", "ghosts", "flare", "stray light", "glare")
    summary = "Reflections between lens surfaces produce ghosts and a halo around bright sources."
    equation = """mu_p <- mu_p - (g + h) s + g ghost(s) + h halo(s), s = max(0, mu_p - threshold), ghost(s)(x)
    = s(-x/m) / m^2"""
    source = "M. Hullin et al., ACM TOG 30 (2011) 108"
    separates = (
        """place a bright source at several positions: ghosts move opposite to it, veiling glare does not"""
    )
    ghost_share = Strength(
        0.01, "fraction", 0.0, 0.5, "uncoated surfaces reflect 4 % each", trials=(0.01, 0.05)
    )
    halo_share = Strength(0.02, "fraction", 0.0, 0.5, "a dusty or scratched lens", trials=(0.02, 0.08))
    ghost_scale = Parameter(1.23, "1", 0.3, 5.0, "size of the first ghost", trials=(0.83, 1.57))
    ghost_blur_px = Parameter(2.0, "px", 0.0, 50.0, "ghosts are defocused", trials=(2.0, 8.0))
    halo_width_px = Parameter(8.0, "px", 3.0, 1e3, "decay length", trials=(5.0, 15.0, 50.0, 150.0))
    halo_profile = Parameter("exponential", options=PROFILES, source="as for veiling_glare")
    threshold_photons = Parameter(0.0, "photons", 0.0, 1e9, "only light above it flares; 0: all light")
    surround = Parameter(
        1.0,
        "1",
        0.0,
        100.0,
        "of the halo: light beyond the frame over that of the scene's mirror image; 0: black",
        unknown=1.0,
    )
    special_cases = (({"ghost_share": 0.0}, "veiling_glare"),)

    @once_for_equals
    def apply(self, signal, p, stream, context):
        source = (signal - p.threshold_photons).clamp_min(0)
        flare = p.halo_share * (halo(source, p.halo_width_px, p.halo_profile, p.surround) - source)
        flare = flare - p.ghost_share * source
        blurred = gaussian_blur(source, p.ghost_blur_px, p.ghost_blur_px)
        ghosts = ((1.0, 0.7), (1.8, 0.3))  # size relative to `ghost_scale`, and share of the ghosts' light
        for size, share in ghosts:
            flare = flare + p.ghost_share * share * self._ghost(blurred, p.ghost_scale * size, context)
        return signal + flare

    @staticmethod
    def _ghost(source, scale, context):
        """The source mirrored at the sensor's centre, `scale` times as large, as far as the window goes."""
        axes = []
        places = (context.columns(source).flatten(), context.rows(source).flatten())
        for place, full in zip(places, reversed(context.resolution)):
            wanted = (full - 1) / 2 - (place - (full - 1) / 2) / scale.view(-1, 1)  # px on the sensor, (B, n)
            axes.append((wanted - place[0] + 0.5) / len(place) * 2 - 1)  # -1 to 1 across the window
        x, y = axes
        grid = torch.stack(torch.broadcast_tensors(x.unsqueeze(1), y.unsqueeze(2)), -1)
        grid = grid.to(source.dtype).expand(len(source), -1, -1, -1)
        return F.grid_sample(source, grid, align_corners=False) / scale**2
