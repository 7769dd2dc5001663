"""Charge-transfer inefficiency."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice

MOST = 0.9  # share that a transfer may leave behind


class ChargeTransferInefficiency(Effect):
    """Each transfer leaves a fraction of the charge behind, 1 - (1 - share)^n after n transfers, which forms a trail.

    The trail decays exponentially away from the register; what would trail beyond the last pixel goes to the overscan. First
    order: charge of the trail is not captured again, which holds if n share is well below 1.

    A packet of N electrons fills a volume ~ N^beta and meets the traps in it, so it loses the share
    share (N / 1000 e-)^(beta - 1): with `density_exponent` beta below 1 small packets lose relatively more, and a background
    protects them. With 1 the share is the same for all.
    """

    name = "charge_transfer_inefficiency"
    stage = Stage.CHARGE
    order = 85  # the full wells are what is transferred
    local = False
    aliases = ("CTI", "CTE", "deferred charge", "trailing", "smear", "radiation")
    summary = (
        """Each transfer leaves a fraction of the charge behind; trails grow with the number of transfers."""
    )
    equation = """N_i <- (1 - d_i) N_i + (1 - q) sum_k>0 q^(k-1) d_(i-k) N_(i-k), d_i = 1 - (1 - share (N_i /
    1000)^(beta - 1))^n_i, q = exp(-1 / trail)"""
    source = "J. Janesick, Scientific Charge-Coupled Devices (2001); R. Massey et al., MNRAS 401 (2010) 371"
    separates = """image edges near and far from the readout register: the trail grows with the distance,
    image lag does not"""
    share_per_transfer = Strength(
        1e-5, "fraction", 0.0, 0.02, "new CCDs 1e-6, irradiated 1e-4", trials=(1e-4, 6e-4)
    )
    trail_px = Parameter(0.5, "px", 0.1, 50.0, "release time in transfers", trials=(0.5, 3.0, 15.0))
    density_exponent = Parameter(
        1.0,
        high=1.5,
        source="beta; 1: proportional loss; 0.5 to 0.6 in CCDs (A. Short et al., MNRAS 430 (2013) 3078)",
    )
    register = choice(("top", "bottom", "left", "right"), "edge of the sensor to which charge is transferred")

    def apply(self, signal, p, stream, context):
        sideways, far = p.register in ("left", "right"), p.register in ("bottom", "right")
        places = context.columns(signal) if sideways else context.rows(signal)
        length = context.resolution[1 if sideways else 0]
        transfers = length - places if far else places + 1
        reference_e = 1000.0  # charge to which `share_per_transfer` refers
        density = (signal.clamp_min(1) / reference_e) ** (p.density_exponent - 1)
        share = (p.share_per_transfer * density).clamp_max(MOST)
        lost = -torch.expm1(transfers * torch.log1p(-share)) * signal
        axis = -1 if sideways else -2
        late = _trail(lost.flip(axis) if far else lost, torch.exp(-1 / p.trail_px), axis)
        return signal + ((late.flip(axis) if far else late) - lost)


def _shift(signal, by, axis):
    """Shifted towards higher pixel numbers, filled with zeros."""
    padded = F.pad(signal, (by, 0) if axis == -1 else (0, 0, by, 0))
    return padded.narrow(axis, 0, signal.shape[axis])


def _trail(lost, q, axis):
    """(1 - q) sum_k>0 q^(k-1) lost_(i-k) in log2(length) steps: 1 / (1 - qz) = prod 1 + (qz)^(2^j)."""
    late, by, length = _shift(lost, 1, axis) * (1 - q), 1, lost.shape[axis]
    while by < length:
        late, q, by = late + q * _shift(late, by, axis), q * q, 2 * by
    return late
