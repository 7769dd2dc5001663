"""Defective columns, rows and clusters."""

import torch
import torch.nn.functional as F

from visaug.effects.effect import Effect, Parameter, Stage, Strength, choice

MOST_PX = 5  # side of a cluster


class LineDefects(Effect):
    """A broken line driver, a blocked or leaking column, or a damaged group of pixels.

    Dead: no signal, the black level in every frame. Bright: a constant excess, exponentially distributed over the defects.
    Unstable: an offset that is new in every frame. A cluster is a square of `size_px` pixels; `density` is then the share of
    pixels at which one begins.
    """

    name = "line_defects"
    proposed = False  # its confusion with similar effects has not been counted
    stage = Stage.READOUT
    order = 35
    aliases = ("dead column", "bright column", "bad rows", "defect clusters", "blinking line")
    summary = "A few columns, rows or clusters are dead, bright or unstable."
    equation = """V <- 0 (dead), V + level e (bright), V + level n (unstable) in a share `density` of the
    lines; e ~ Exp(1) per camera, n ~ N(0, 1) in every frame"""
    source = """classes of data sheets (dead, bright, clusters); after J. Janesick, Scientific Charge-Coupled
    Devices (SPIE 2001), column defects; exponential levels: assumed"""
    separates = """average many frames and plot the row and column means: defective lines are outliers of the
    Gaussian dsnu distribution; unstable lines have a larger temporal variance than their neighbours"""
    differentiable = False
    why_not = "whether a line is defective is discrete; image and level have gradients elsewhere"
    density = Strength(
        0.003,
        unit="share of lines",
        high=0.5,
        trials=(0.01, 0.04),
        source="grades of datasheets: 0 to 10 lines of a sensor",
    )
    level_e = Parameter(
        10.0, "e-", 0.0, 1e6, "of bright and unstable lines; several times the read noise", trials=(5.0, 20.0)
    )
    size_px = Parameter(
        3.0, "px", 1.0, MOST_PX, "datasheets: clusters of 2 to 5 pixels", integer=True, of=("clusters",)
    )
    kind = choice(("bright", "dead", "unstable"), "classes of datasheets")
    shape = choice(("columns", "rows", "clusters"), "classes of datasheets")

    def apply(self, signal, p, stream, context):
        vary = {"columns": "column", "rows": "row"}.get(p.shape, "pixel")
        fixed = stream.fixed
        where = fixed.fork("where")
        if p.shape == "clusters":
            hit = _clusters(where, p.density, p.size_px.round(), context.window)
        else:
            hit = where.uniform(vary) < p.density
        if p.kind == "dead":
            return torch.where(hit, 0.0, signal)
        own = stream.normal(vary) if p.kind == "unstable" else -torch.log(fixed.fork("level").uniform(vary))
        return signal + p.level_e * own * hit

    def moments(self, mean, p, context):
        if p.shape == "clusters":
            return None  # those that begin in one another overlap
        share, square = p.density, p.level_e**2
        if p.kind == "dead":
            return mean * (1 - share), mean**2 * share * (1 - share)
        if p.kind == "unstable":
            return mean, share * square
        return mean + share * p.level_e, square * (2 * share - share**2)


def _clusters(where, density, size, window):
    """Which pixels lie in a square that begins at a seed above and left of them, (B or 1, C, H, W)."""
    starts = [max(0, side.start - MOST_PX + 1) for side in window]
    seeds = where.over(*(range(s, side.stop) for s, side in zip(starts, window))).uniform() < density
    above, left = (MOST_PX - 1 - (side.start - s) for s, side in zip(starts, window))
    seeds = F.pad(seeds, (left, 0, above, 0))
    rows, columns = map(len, window)
    hit = torch.zeros_like(seeds[..., :rows, :columns])
    for down in range(MOST_PX):
        for across in range(MOST_PX):
            reach = size > max(down, across)
            begun = seeds[..., MOST_PX - 1 - down :, MOST_PX - 1 - across :][..., :rows, :columns]
            hit = hit | (begun & reach)
    return hit
