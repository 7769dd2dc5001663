"""Fixed patterns: rows, columns, pixels, slow maps, seams, parity, defects."""

from functools import lru_cache

import numpy as np

from visaug.statistics.conditions import spread
from visaug.statistics.kernels import far_pixels
from visaug.statistics.reduction import block_means, cubics, edges, reach_of_steps
from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views.drawn import (
    NORMAL,
    block_box,
    chosen,
    correlation,
    direction,
    quantiles,
    relative,
    spread_of_lines,
)


def _detrended(profile: np.ndarray) -> np.ndarray:
    """Less the cubic that fits it best."""
    basis = cubics(len(profile))
    return profile - basis @ (basis.T @ profile)


class FixedPattern(View):
    """Variances of the fixed pattern along rows, columns and pixels."""

    name = "fixed_pattern"
    title = "Fixed pattern: rows, columns and pixels"

    def measure(self, data):
        for g in data.groups:
            if g.kind == "scene":
                continue
            for name, (variance, *_) in g.profile_numbers.items():
                yield g.statistic(self.name, f"{name}s", [name], "log DN^2"), np.log(variance + 1e-4)
            yield g.statistic(self.name, "pixels", ["pixel"], "log DN^2"), np.log(g.pattern_variance)
            for name, lag in (("one column on", (0, 1)), ("one row on", (1, 0)), ("diagonal", (1, 1))):
                yield g.statistic(self.name, name, ["pixel"], "correlation"), g.pattern_correlations[lag]

    def draw(self, data, name, group):
        g = chosen(data, group)
        if g is None:
            return None
        unit, word = relative(g)
        if name in ("rows", "columns"):
            lines = name[:-1]
            profile = _detrended((g.pattern_rows if lines == "row" else g.pattern_columns) * unit)
            curve = Curve(np.arange(len(profile)), profile, f"{name}, {g.label}")
            return ViewPlot(self.title, lines, f"{lines} mean less its trend, {word}", (curve,))
        step = {"one column on": (0, 1), "one row on": (1, 0), "diagonal": (1, 1)}.get(name)
        if step:
            way = {(0, 1): "columns", (1, 0): "rows", (1, 1): "rows and columns"}[step]
            curve = correlation(g.pattern_pixels[None], step, g.label)
            return ViewPlot(
                self.title,
                f"distance, {way}",
                "correlation of the fixed pattern",
                (curve,),
                marks=((0.6, 1.4),),
            )
        curve = quantiles(g.pattern_pixels * unit, g.label)
        return ViewPlot(self.title, NORMAL, f"fixed pattern of pixels, {word}", (curve,))


class SmoothMap(View):
    """Slow changes over the field."""

    name = "smooth_map"
    title = "Slow changes over the field"

    def measure(self, data):
        flats = data.of("flat")
        middle = flats[len(flats) * 5 // 8 : len(flats) * 5 // 8 + 1]
        detailed = {id(g) for g in (*data.dark_ends, *middle)}
        for g in data.groups:
            if g.kind == "scene":
                continue
            unit = 100 / max(g.signal, 1.0) if g.kind == "flat" else 1.0
            word = "%" if g.kind == "flat" else "DN"
            parts = 4 if id(g) in detailed else 2
            blocks = block_means(g.calm, *(edges(n, parts) for n in g.calm.shape)) * unit
            for i, row in enumerate(blocks.tolist(), 1):  # pyrefly: ignore[not-iterable]
                for j, value in enumerate(row, 1):
                    name = f"block {i},{j} of {parts}x{parts}"
                    yield g.statistic(self.name, name, ["smooth"], word), value
            yield g.statistic(self.name, "middle against rim", ["smooth"], word), _middle(g.calm) * unit
            for name, (_, slope, *_) in g.profile_numbers.items():
                yield g.statistic(self.name, f"slope over the {name}s", ["smooth"], word), slope * unit

    def draw(self, data, name, group):
        g = chosen(data, group)
        if g is None:
            return None
        unit, word = relative(g)
        image = block_means(g.calm, *(edges(n, min(16, n)) for n in g.calm.shape)) * unit
        return ViewPlot(self.title, maps=((f"{g.label}, {word}", image),), box=block_box(name))


def _middle(pattern: np.ndarray) -> float:
    weight, norm = _bowl(*pattern.shape)
    return float(np.vdot(weight, pattern) / norm)


@lru_cache(maxsize=16)
def _bowl(height: int, width: int) -> tuple[np.ndarray, np.floating]:
    """Falls with the square of the distance from the middle, with mean 0; and the sum of its squares."""
    y, x = (np.linspace(-1, 1, n) for n in (height, width))
    radius = (y[:, None] ** 2 + x[None, :] ** 2) / 2
    bowl = (radius.mean() - radius).astype(np.float32)
    return bowl, np.vdot(bowl, bowl)


class Seams(View):
    """Steps between neighbouring lines, wherever they are, and odd against even lines."""

    name = "seams"
    title = "Steps between halves, odd against even lines"

    def measure(self, data):
        flats = data.of("flat")
        for g in (*data.dark_ends, *spread(flats, 4)):
            unit = 100 / max(g.signal, 1.0) if g.kind == "flat" else 1.0
            word = "%" if g.kind == "flat" else "DN"
            for name, (*_, step, halves, parity) in g.profile_numbers.items():
                yield g.statistic(self.name, f"largest step of {name}s", [name], word), step * unit
                yield g.statistic(self.name, f"halves of {name}s", [name], word), halves * unit
                yield g.statistic(self.name, f"odd against even {name}s", [name], word), parity * unit
            if g.count >= 2:
                left, right, upper, lower = g.noise.halves
                for name, a, b in (("columns", left, right), ("rows", upper, lower)):
                    ratio = float(np.log((b + 1e-4) / (a + 1e-4)))
                    yield (
                        g.statistic(self.name, f"noise of the halves, {name}", ["smooth"], "log ratio"),
                        ratio,
                    )

    def draw(self, data, name, group):
        g = chosen(data, group, 2 if name.startswith("noise") else 1)
        if g is None:
            return None
        if name.startswith("noise"):
            return spread_of_lines(g, self.title, direction(name))
        lines, (unit, word) = direction(name), relative(g)
        profile = (g.pattern_rows if lines == "row" else g.pattern_columns).astype(np.float64) * unit
        fold = 8  # lines, over which odd and even ones are averaged for the picture
        if name.startswith("odd"):
            profile = _detrended(profile)
            folded = [profile[k::fold].mean() for k in range(fold)]
            curve = Curve(np.arange(fold), np.array(folded), f"{lines}s, {g.label}")
            return ViewPlot(
                self.title,
                f"number of the {lines}, modulo {fold}",
                f"mean of these {lines}s, {word}",
                (curve,),
            )
        curve = Curve(np.arange(len(profile)), profile, f"{lines}s, {g.label}")
        at = len(profile) / 2 if name.startswith("halves") else None
        if name.startswith("largest"):
            step = _steps(profile)
            at = float(np.abs(step).argmax() + (len(profile) - len(step) + 1) / 2)
        marks = () if at is None else ((at, at),)
        return ViewPlot(self.title, lines, f"{lines} mean, {word}", (curve,), marks=marks)


def _steps(profile: np.ndarray) -> np.ndarray:
    """Mean of the lines after a place less the mean of those before it."""
    reach = reach_of_steps(len(profile))
    total = np.concatenate([[0.0], np.cumsum(profile)])
    place = np.arange(reach, len(profile) - reach + 1)
    return (total[place + reach] - 2 * total[place] + total[place - reach]) / reach


class Defects(View):
    """Pixels far from their neighbours in the mean frame."""

    name = "defects"
    title = "Pixels far out in the mean frame"

    def measure(self, data):
        for g in (*data.darks, *spread(data.of("flat"), 3)):
            counts = np.zeros(6, np.int64)
            cubes = far_pixels(g.pattern_pixels, g.pattern_scale, counts) / g.pattern_pixels.size
            above, below = (
                dict(zip((4, 7, 15, 50), counts, strict=False)),
                dict(zip((7, 15), counts[4:], strict=True)),
            )
            for limit, high in above.items():
                yield g.statistic(self.name, f"above {limit} scales", ["pixel"], "sqrt count"), np.sqrt(high)
                if limit in below:
                    low = np.sqrt(below[limit])
                    yield g.statistic(self.name, f"below {limit} scales", ["pixel"], "sqrt count"), low
            yield g.statistic(self.name, "skewness within 4 scales", ["pixel"]), cubes
            yield (
                g.statistic(self.name, "scale to deviation", ["pixel"]),
                g.pattern_scale / np.sqrt(g.pattern_variance),
            )

    def draw(self, data, name, group):
        g = chosen(data, group)
        if g is None:
            return None
        if name.startswith(("skewness", "scale")):
            return FixedPattern().draw(data, "pixels", g)
        side = -1 if name.startswith("below") else 1
        ratio = np.sort((side * g.pattern_pixels / g.pattern_scale).ravel())[::-1]
        rank = np.unique(np.geomspace(1, max(ratio.size // 4, 1), 200).astype(int))
        curve = Curve(rank, np.maximum(ratio[rank - 1], 0.1), g.label)
        word = "below" if side < 0 else "above"
        return ViewPlot(
            self.title,
            "rank of the pixel",
            f"distance {word} the neighbours, robust standard deviations",
            (curve,),
            log_x=True,
            log_y=True,
        )
