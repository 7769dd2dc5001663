"""Blooming."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage

DEEPEST_E = 1e9  # in place of an unlimited full well
LEAST = 0.02  # share of the excess that is seen beside it: less may be a blur, a lag or noise


class Blooming(Effect):
    """Charge above the full well flows up and down the column into the first wells with free capacity.

    The fraction `share` of the excess flows and the rest is drained (an anti-blooming gate). Each direction is a queue: the
    flow past a pixel, w_i = max(0, w_(i-1) + excess_i - room_i), is the running sum minus its running minimum. Charge that
    reaches an end of the column is lost. Requires a camera with a full well.
    """

    name = "blooming"
    stage = Stage.CHARGE
    order = 70  # before the clipping at full well, order 80
    local = False
    aliases = ("overflow", "bleeding", "vertical streak")
    summary = "Charge above the full well spills to neighbours in the column."
    equation = "N_i <- N_i - share (N_i - full well)+ + what neighbours' overflow fills into N_i < full well"
    source = "J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on blooming"
    separates = (
        "image a bright spot below and above the full well: blooming occurs only above it; smear does not "
        "require a full well"
    )
    share = Parameter(
        0.5,
        unit="fraction",
        high=1.0,
        strength=True,
        trials=(0.2, 0.8, 1.0),
        source="1: no anti-blooming drain",
    )
    upward = Parameter(
        0.5, unit="fraction", high=1.0, trials=(0.2, 0.8), source="fraction that flows to lower row numbers"
    )

    @classmethod
    def looks(cls, seen):
        """Share of the charge above full well that fills the neighbouring wells, and on which side."""
        if len(seen.spilled_e) == 0:
            return []
        excess, up, down = map(float, seen.spilled_e.sum(0).clip(0))
        filled = up + down
        if filled <= LEAST * excess:
            return []
        return [{"share": min(filled / excess, 1.0), "upward": up / filled}]

    def apply(self, signal, p, stream, context):
        full_well = context.full_well_e.clamp_max(DEEPEST_E)
        columns = signal.transpose(-1, -2)  # (B, C, W, H)
        hit = (columns > full_well).any(-1)  # all other columns stay as they are
        well, share, upward = (value.expand(*hit.shape, 1)[hit] for value in (full_well, p.share, p.upward))
        charge = columns[hit].double()  # (columns hit, H); sums along one go beyond what float32 counts
        running = share * (charge - well).clamp_min(0)
        room = (well - charge).clamp_min(0)
        down = _filled(running * (1 - upward), room)
        up = _filled((running * upward).flip(-1), (room - down).flip(-1)).flip(-1)
        bloomed = (charge + (down + up - running)).to(signal.dtype)
        return columns.index_put((hit,), bloomed).transpose(-1, -2).contiguous()


def _filled(excess, room):
    """How much of an excess that runs towards higher rows each pixel takes up, (columns, H)."""
    total = (excess - room).cumsum(-1)
    passing = total - total.cummin(-1).values.clamp_max(0)
    arriving = F.pad(passing, (1, 0))[..., :-1]
    return torch.minimum(arriving + excess, room)
