"""What the pictures of the views share: the group that is shown, profiles, distributions, correlations with distance."""

import re
from collections.abc import Iterable

import numpy as np
from scipy.special import ndtri

from visaug.statistics.reduction import FrameData, GroupData
from visaug.statistics.view import Curve, Span, ViewPlot

# Of the largest temporal variance, below which brighter flats are saturated: EMVA 1288 puts saturation at the maximum.
CLIPPED = 0.8
NORMAL = "quantile of a normal distribution, standard deviations"


def below_saturation(flats: Iterable[GroupData]) -> list[GroupData]:
    """Flats up to the maximum of the temporal variance, and those beyond it whose variance has hardly fallen."""
    ordered = sorted(flats, key=lambda g: g.signal)
    known = [g for g in ordered if g.count >= 2]
    if not known:
        return ordered
    top = max(known, key=lambda g: g.noise_variance)
    clipped = [g for g in known if g.signal >= top.signal and g.noise_variance < CLIPPED * top.noise_variance]
    return [g for g in ordered if not clipped or g.signal < clipped[0].signal]


def chosen(data: FrameData, group: GroupData | None, at_least: int = 1) -> GroupData | None:
    """The group asked for; else the bias frames, or the brightest flats below saturation."""
    if group is not None and group.count >= at_least:
        return group
    others = [*data.darks, *reversed(below_saturation(data.of("flat")))]
    return next((g for g in others if g.count >= at_least), None)


def relative(g: GroupData) -> tuple[float, str]:
    """Factor and unit in which a fixed pattern is given: per cent of the signal of flats, else DN."""
    return (100 / max(g.signal, 1.0), "%") if g.kind == "flat" else (1.0, "DN")


def direction(name: str, other: str = "row") -> str:
    """Along which lines a statistic is measured, by its name: "row" or "column"."""
    words = name.replace(",", " ").split()
    return next((d for d in ("column", "row") if d in words or f"{d}s" in words), other)


def quantiles(values: np.ndarray, label: str) -> Curve:
    """Values against the quantiles of a normal distribution: a straight line for normal values, its slope their deviation."""
    ordered = np.sort(np.asarray(values, np.float64).ravel())
    x = np.linspace(-1, 1, 81) * -ndtri(0.5 / ordered.size)
    share = (np.arange(ordered.size) + 0.5) / ordered.size
    return Curve(x, np.interp(x, ndtri(share), ordered), label)


def correlation(images: np.ndarray, step: tuple[int, int], label: str) -> Curve:
    """Correlation of pixels so many steps apart, of images (n, H, W) less their row and column means."""
    x = images - images.mean(1, keepdims=True) - images.mean(2, keepdims=True)
    x += images.mean((1, 2), keepdims=True)
    height, width = x.shape[1:]
    farthest = max(min(12, height // 4, width // 4), 1)  # px, of the distances over which it is drawn
    values = []
    for distance in range(1, farthest + 1):
        rows, columns = step[0] * distance, step[1] * distance
        a, b = x[:, rows:, columns:], x[:, : height - rows, : width - columns]
        values.append(float(np.vdot(a, b)) / a.size)
    return Curve(np.arange(1, farthest + 1), np.array(values) / max(float((x**2).mean()), 1e-12), label)


def spectrum_marks(name: str, edges: np.ndarray, length: int, at_peak: float) -> tuple[Span, ...]:
    """The frequencies, in cycles per line, that a statistic of a spectrum is about."""
    step = 0.5 / length
    if found := re.search(r"band (\d+)", name):  # the frames may follow
        band = int(found[1])
        if band < len(edges):
            return ((step * (edges[band - 1] + 0.5), step * (edges[band] + 0.5)),)
        return ()
    if "half the sampling" in name:
        return ((0.5 - step, 0.5),)
    return ((at_peak - step, at_peak + step),) if "peak" in name else ()


def condition(groups: list[GroupData]) -> tuple[str, np.ndarray]:
    """What differs among groups of a kind, as the label of an axis and its values: photons, exposure or temperature."""
    parts = [g.group for g in groups]
    ways = [
        ("photons per pixel", [p.photons for p in parts]),
        ("exposure, s", [p.exposure_s for p in parts]),
        ("temperature, °C", [p.temperature_c for p in parts]),
    ]
    known = [(label, np.array(v, float)) for label, v in ways if None not in v]
    return max(known, key=lambda way: len(np.unique(way[1])))


def spread_of_lines(g: GroupData, title: str, lines: str) -> ViewPlot:
    """Temporal noise of each row, or column."""
    residual = g.residual
    noise = np.sqrt(np.einsum("nij,nij->" + ("i" if lines == "row" else "j"), residual, residual))
    noise /= np.sqrt(residual.size / len(noise))
    curve = Curve(np.arange(len(noise)), noise, f"{lines}s, {g.label}")
    return ViewPlot(title, lines, f"temporal noise of the {lines}, DN", (curve,))


def block_box(name: str) -> tuple[float, float, float, float] | None:
    """The place of "block 1,2 of 4x4" as shares of the height and the width; None for other statistics."""
    found = re.search(r"block (\d+),(\d+) of (\d+)x(\d+)", name)
    if found is None:
        return None
    row, column, rows, columns = map(int, found.groups())
    return (row - 1) / rows, row / rows, (column - 1) / columns, column / columns
