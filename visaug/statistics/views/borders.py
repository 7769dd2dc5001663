"""What lies at the corners, at the edges and at the seams of the quarters of a sensor, in the mean frame."""

from collections.abc import Iterator

import numpy as np

from visaug.statistics.reduction import GroupData, block_means, edges
from visaug.statistics.view import Curve, Span, View, ViewPlot
from visaug.statistics.views.drawn import block_box, chosen, direction, relative, spread_of_lines

DEPTHS = (1, 2, 4, 8, 16, 32, 64)  # lines of an edge, and sides of a corner, in px
REACH = 16  # lines on either side of a seam
STRONGEST = 4.0  # standard deviations that a pixel counts as at most
FINE = 32  # the same, for places that differ from those around them


class Borders(View):
    """Levels at the rim of the sensor against what lies beside them, places that differ from their neighbours,
    and how noise is spread over the sensor: fixed and, of two frames or more, temporal.

    An edge of `depth` lines stands against as many lines beside it, a corner against the two squares that lie beside it along
    the edges: a slow change over the field, as vignetting is, moves either little.
    """

    name = "borders"
    title = "Corners, edges and seams of quarters"

    def measure(self, data):
        flats = data.of("flat")
        for g in (*data.dark_ends, *flats[len(flats) * 5 // 8 : len(flats) * 5 // 8 + 1]):
            unit, word = (100 / max(g.signal, 1.0), "%") if g.kind == "flat" else (1.0, "DN")
            for name, axes, value in self._levels(g):
                yield g.statistic(self.name, name, axes, word), value * unit
            highest, lowest = _standing_out(g.calm)
            yield g.statistic(self.name, "highest place", ["smooth"], word), highest * unit
            yield g.statistic(self.name, "lowest place", ["smooth"], word), lowest * unit
            for name, value in _blocks(_squares(g.pattern_pixels, g.pattern_variance), g.pattern_variance):
                yield g.statistic(self.name, f"noise of {name}", ["pixel", "smooth"], "log ratio"), value
            if g.count > 1:
                for name, axes, value in _temporal(g):
                    yield g.statistic(self.name, name, ["time", *axes], "log ratio"), value

    @staticmethod
    def _levels(g: GroupData) -> Iterator[tuple[str, list[str], float]]:
        seams = (1, 2, 3)  # quarters of the rows, or columns, behind which another tap may begin
        image = g.calm
        for axis, profile in (("row", g.pattern_rows), ("column", g.pattern_columns)):
            for end, lines in (("first", profile), ("last", profile[::-1])):
                for depth in _depths(len(lines)):
                    value = lines[:depth].mean() - lines[depth : 2 * depth].mean()
                    yield f"{end} {depth} {axis}s", [axis], float(value)
            for quarter in seams:
                place = len(profile) * quarter // 4
                reach = min(REACH, len(profile) // 8)
                step = profile[place : place + reach].mean() - profile[place - reach : place].mean()
                yield f"step of {axis}s at {quarter}/4", [axis], float(step)
        for down, rows in (("first", image), ("last", image[::-1])):
            for across, turned in (("first", rows), ("last", rows[:, ::-1])):
                for depth in _depths(min(image.shape)):
                    beside = (
                        turned[:depth, depth : 2 * depth].mean() + turned[depth : 2 * depth, :depth].mean()
                    )
                    value = turned[:depth, :depth].mean() - beside / 2
                    yield f"corner of {down} rows and {across} columns, {depth} px", ["smooth"], float(value)

    def draw(self, data, name, group):
        g, lines = chosen(data, group, 2 if "temporal" in name else 1), direction(name, "")
        if g is None:
            return None
        unit, word = relative(g)
        if name.startswith("temporal noise of the") and "corner" not in name:
            return spread_of_lines(g, self.title, lines)
        if name.startswith(("row noise", "column noise")):
            means = g.noise_rows if lines == "row" else g.noise_columns
            spread = np.sqrt(((means - means.mean(1, keepdims=True)) ** 2).mean(0))
            curve = Curve(np.arange(len(spread)), spread, f"{lines}s, {g.label}")
            return ViewPlot(self.title, lines, f"deviation of {lines} means over frames, DN", (curve,))
        if "noise of" in name:
            squares = (
                g.noise.limited_squares(STRONGEST)
                if "temporal" in name
                else _squares(g.pattern_pixels, g.pattern_variance) * unit**2
            )
            blocks = np.sqrt(block_means(squares, *(edges(n, min(16, n)) for n in squares.shape)))
            kind = "temporal noise" if "temporal" in name else "fixed pattern"
            word = "DN" if "temporal" in name else word
            return ViewPlot(
                self.title, maps=((f"{kind} of blocks, {g.label}, {word}", blocks),), box=block_box(name)
            )
        if lines and "corner" not in name:
            profile = g.calm.mean(1 if lines == "row" else 0) * unit
            curve = Curve(np.arange(len(profile)), profile, f"{lines}s, {g.label}")
            return ViewPlot(
                self.title, lines, f"{lines} mean, {word}", (curve,), marks=_marked(name, len(profile))
            )
        if name.endswith("place"):
            image = block_means(g.calm, *(edges(n, min(FINE, n)) for n in g.calm.shape)) * unit
            return ViewPlot(self.title, maps=((f"{g.label}, {word}", image),))
        return ViewPlot(self.title, maps=((f"the four corners, {g.label}, {word}", _corners(g.calm) * unit),))


def _marked(name: str, length: int) -> tuple[Span, ...]:
    """The lines that "first 4 rows", "last 8 columns" or "step of rows at 1/4" is about."""
    words = name.split()
    if words[0] == "step":
        place = length * int(words[-1].split("/")[0]) / 4
        return ((place, place),)
    depth = int(words[1])
    return ((-0.5, depth - 0.5),) if words[0] == "first" else ((length - depth - 0.5, length - 0.5),)


def _depths(length: int) -> list[int]:
    return [depth for depth in DEPTHS if 4 * depth <= length]


def _standing_out(image: np.ndarray) -> tuple[float, float]:
    """The most and the least of blocks less the mean of the four around each."""
    parts = [edges(n, min(FINE, n)) for n in image.shape]
    blocks = np.pad(block_means(image, *parts), 1, mode="edge")
    around = (blocks[:-2, 1:-1] + blocks[2:, 1:-1] + blocks[1:-1, :-2] + blocks[1:-1, 2:]) / 4
    apart = blocks[1:-1, 1:-1] - around
    return float(apart.max()), float(apart.min())


def _squares(pixels: np.ndarray, variance: float) -> np.ndarray:
    """Squares; a pixel that stands alone counts as `STRONGEST` standard deviations."""
    near = np.clip(pixels, -STRONGEST * variance**0.5, STRONGEST * variance**0.5)
    near *= near
    return near


def _ratio(mean_square: float, variance: float) -> float:
    return float(np.log(mean_square / variance + 1e-4))


def _blocks(squares: np.ndarray, variance: float) -> Iterator[tuple[str, float]]:
    """Of each block of an image of squares, the logarithm of their mean in units of the variance."""
    blocks = 4  # along rows and along columns, over which noise is compared
    means = block_means(squares, *(edges(n, blocks) for n in squares.shape))
    for (i, j), value in np.ndenumerate(means):
        yield f"block {i + 1},{j + 1} of {blocks}x{blocks}", _ratio(value, variance)


def _temporal(g: GroupData) -> Iterator[tuple[str, list[str], float]]:
    """Temporal noise of blocks, edges and corners, and of the row and column means near the edges, over that of all pixels."""
    variance = g.noise_variance
    squares = g.noise.limited_squares(STRONGEST)
    for name, value in _blocks(squares, variance):
        yield f"temporal noise of {name}", ["smooth"], value
    lines = {"row": (squares.mean(1), g.noise_rows), "column": (squares.mean(0), g.noise_columns)}
    # lines of an edge, and sides of a corner in px, whose temporal noise is compared with that of all pixels
    rim = (4, 16, 64)
    for axis, (profile, means) in lines.items():
        common = ((means - means.mean(1, keepdims=True)).astype(np.float64) ** 2).mean(0)
        for end, step in (("first", 1), ("last", -1)):
            for depth in (d for d in rim if 4 * d <= len(profile)):
                value = _ratio(profile[::step][:depth].mean(), variance)
                yield f"temporal noise of the {end} {depth} {axis}s", [axis], value
            value = _ratio(common[::step][:REACH].mean(), max(float(common.mean()), 1e-12))
            yield f"{axis} noise of the {end} {REACH} {axis}s", [axis], value
    for down, rows in (("first", squares), ("last", squares[::-1])):
        for across, turned in (("first", rows), ("last", rows[:, ::-1])):
            for side in (s for s in rim if 4 * s <= min(squares.shape)):
                value = _ratio(turned[:side, :side].mean(), variance)
                yield (
                    f"temporal noise of the corner of {down} rows and {across} columns, {side} px",
                    ["smooth"],
                    value,
                )


def _corners(image: np.ndarray, side: int = 64) -> np.ndarray:
    """The four corners of an image, put together."""
    side = min(side, *(n // 2 for n in image.shape))
    ends = np.r_[:side, -side:0]
    return image[ends][:, ends]
