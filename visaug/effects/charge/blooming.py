"""Blooming."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice

DEEPEST_E = 1e9  # in place of an unlimited full well
LEAST = 0.02  # share of the excess that is seen beside it: less may be a blur, a lag or noise
MOST_STEPS = 500  # from pixel to pixel; fills a disc of about 600 wells, in which charge walks a dozen pixels
SETTLED_E = 1e-3  # charge per pixel that is no longer followed


class Blooming(Effect):
    """Charge above the full well flows into the first wells with free capacity.

    The fraction `share` of the excess flows and the rest is drained (an anti-blooming gate). Channel stops of a CCD keep it in
    the `column`, up and down which it flows. Each direction is a queue: the flow past a pixel,
    w_i = max(0, w_(i-1) + excess_i - room_i), is the running sum minus its running minimum. With `isotropic` no side is
    preferred: every full pixel passes a quarter of what it receives to each of its four neighbours, so that a point source
    fills a disc. Charge that leaves the sensor, or that has found no room after 500 pixels, is lost. Requires a camera with a
    full well.
    """

    name = "blooming"
    stage = Stage.CHARGE
    order = 70  # before the clipping at full well, order 80
    local = False
    aliases = ("overflow", "bleeding", "vertical streak", "halo of saturated pixels")
    summary = "Charge above the full well spills to neighbours, in the column or on all sides."
    equation = "N_i <- N_i - share (N_i - full well)+ + what neighbours' overflow fills into N_i < full well"
    source = """J. Janesick, Scientific Charge-Coupled Devices (SPIE, 2001), on blooming; isotropic: the
    divisible sandpile of L. Levine and Y. Peres, Potential Analysis 30 (2009) 1"""
    separates = """image a bright spot below and above the full well: blooming occurs only above it; smear
    does not require a full well"""
    share = Strength(0.5, "fraction", 0.0, 1.0, "1: no anti-blooming drain", trials=(0.2, 0.8, 1.0))
    upward = Parameter(
        0.5,
        unit="fraction",
        high=1.0,
        trials=(0.2, 0.8),
        source="fraction that flows to lower row numbers",
        of=("column",),
    )
    spread = choice(("column", "isotropic"), "column: CCDs; isotropic: pixels without channel stops")

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
        if p.spread == "isotropic":
            charge = signal.double()  # sums go beyond what float32 counts
            excess, room = (charge - full_well).clamp_min(0), (full_well - charge).clamp_min(0)
            running, room = torch.broadcast_tensors(p.share * excess, room)
            # in other images nothing moves
            hit = (running > 0).flatten(1).any(1) & (room > 0).flatten(1).any(1)
            filled = torch.zeros_like(room).index_put((hit,), _taken_up(running[hit], room[hit]))
            return (charge - running + filled).to(signal.dtype)
        columns = signal.transpose(-1, -2)  # (B, C, W, H)
        hit = (columns > full_well).any(-1)  # all other columns stay as they are
        well, share, upward = (value.expand(*hit.shape, 1)[hit] for value in (full_well, p.share, p.upward))
        charge = columns[hit].double()  # (columns hit, H)
        running = share * (charge - well).clamp_min(0)
        room = (well - charge).clamp_min(0)
        down = _filled(running * (1 - upward), room)
        up = _filled((running * upward).flip(-1), (room - down).flip(-1)).flip(-1)
        bloomed = (charge + (down + up - running)).to(signal.dtype)
        return columns.index_put((hit,), bloomed).transpose(-1, -2).contiguous()

    def moments(self, mean, p, context):
        over = (mean - context.full_well_e.clamp_max(DEEPEST_E)).clamp_min(0)
        return mean - p.share * over, torch.zeros_like(mean)  # above the full well there is room nowhere


def _filled(excess, room):
    """How much of an excess that runs towards higher rows each pixel takes up, (columns, H)."""
    total = (excess - room).cumsum(-1)
    passing = total - total.cummin(-1).values.clamp_max(0)
    arriving = F.pad(passing, (1, 0))[..., :-1]
    return torch.minimum(arriving + excess, room)


def _taken_up(running, room):
    """How much of an excess that walks from pixel to pixel, to all four sides alike, each pixel takes up."""
    left = room
    for step in range(MOST_STEPS if len(room) else 0):
        if step % 8 == 0 and (float(running.detach().max()) < SETTLED_E or float(left.detach().max()) <= 0):
            break
        padded = F.pad(running, (1, 1, 1, 1))
        sides = padded[..., 1:-1, :-2], padded[..., 1:-1, 2:], padded[..., :-2, 1:-1], padded[..., 2:, 1:-1]
        running = (sides[0] + sides[1] + sides[2] + sides[3]) / 4
        taken = torch.minimum(running, left)
        running, left = running - taken, left - taken
    return room - left
