"""A view of the frames, measured and modelled in the same axes; and which part of the sensor a comparison looked at."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from visaug.core.wording import label_text
from visaug.report.plots.style import MEASURED, MODELLED, SOFT, THIRD, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from visaug.statistics.view import ViewPlot

_LINES = ("-", "--", ":", "-.")
_MARKERS = ("o", "s", "^", "D")
GIVEN, CORRECTED = "camera as given", "corrected camera"


def plot_view(
    measured: "ViewPlot", modelled: "ViewPlot | None" = None, focus: str = "", after: "ViewPlot | None" = None
) -> "Figure":
    """What a view shows of the measured frames and, if given, of the modelled ones, in the same axes.
    `measured`, `modelled`: the same view of both frame sets.
    `after`: the same of the corrected camera; `modelled` is then the camera as given.
    `focus`: words of the statistic that differs most. Where curves have very different ranges each gets axes of its own, that of
    these words first.
    """
    if measured.maps:
        return _plot_maps(measured, modelled, after)
    panels = _panels(measured, focus)
    alone = len(panels) > 1 or len(measured.curves) == 1
    given = modelled, MODELLED, "modelled" if after is None else GIVEN
    # measured ones last, so that they lie on top
    sets = [given, (after, THIRD, CORRECTED), (measured, MEASURED, "measured")]
    with styled():
        figure = blank(8.0 if len(panels) > 1 else 4.7, 3.5)
        grid = figure.subplots(1, len(panels), squeeze=False)[0]
        for axes, chosen in zip(grid, panels, strict=True):
            _draw_panel(axes, measured, sets, chosen, alone)
        grid[0].set_ylabel(textwrap.fill(measured.y_label, 28))
        _legend(figure, grid[0], len(measured.curves) if len(panels) == 1 else 1)
    return figure


def _panels(picture: "ViewPlot", focus: str) -> list[list[int]]:
    """Which curves share axes: all of them, or each alone where one would hide another."""
    curves = picture.curves
    spans = [float(np.ptp(np.asarray(c.y, float)[np.isfinite(c.y)])) if len(c.y) else 0.0 for c in curves]
    farther = 4.0  # ratio of ranges from which curves get axes of their own
    apart = not picture.log_y and 1 < len(curves) <= 3 and max(spans) > farther * max(min(spans), 1e-12)
    if not apart:
        return [list(range(len(curves)))]
    said, *labels = ({*text.replace(",", " ").split()} for text in (focus, *(c.label for c in curves)))
    return [[i] for i in sorted(range(len(curves)), key=lambda i: -len(said & labels[i]))]


def _draw_panel(
    axes: Any, measured: "ViewPlot", sets: Sequence[tuple[Any, str, str]], chosen: list[int], alone: bool
) -> None:
    few = 16  # curves of so few points get markers
    for low, high in measured.marks:
        if high > low:
            axes.axvspan(low, high, color=SOFT, alpha=0.16, linewidth=0)
        else:
            axes.axvline(low, color=SOFT, linestyle=":", linewidth=1.2)
    for picture, colour, name in (s for s in sets if s[0] is not None):
        for i in (i for i in chosen if i < len(picture.curves)):
            curve = picture.curves[i]
            y = np.asarray(curve.y, float)
            if picture.log_y:
                y = np.where(y > 0, y, np.nan)
            axes.plot(
                curve.x,
                y,
                color=colour,
                linestyle=_LINES[0 if alone else i % len(_LINES)],
                marker=_MARKERS[0 if alone else i % len(_MARKERS)] if len(y) <= few else None,
                markersize=4,
                linewidth={"measured": 1.2, CORRECTED: 1.6}.get(name, 2.6),
                alpha={"measured": 0.95, CORRECTED: 0.85}.get(name, 0.55),
                label=f"{name}, {label_text(curve.label)}" if curve.label and not alone else name,
            )
    if measured.log_x:
        positive = all(np.min(curve.x, initial=1.0) > 0 for curve in measured.curves)
        axes.set_xscale("log" if positive else "symlog")
    if measured.log_y:
        axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            plain_decades(axis)
    if alone and measured.curves[chosen[0]].label:
        axes.set_title(textwrap.fill(label_text(measured.curves[chosen[0]].label), 40), fontsize=9)
    axes.set(xlabel=measured.x_label)


def plain_decades(axis: Any) -> None:
    """Labels of a logarithmic axis: numbers such as 0.6 or 20 where it covers less than two decades, decades alone elsewhere."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

    low, high = axis.get_view_interval()
    if high < 100 * low:
        few = high < 4 * low  # hardly a tick at 1, 2 or 5: as on a linear axis
        axis.set_major_locator(MaxNLocator(4) if few else LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_minor_formatter(NullFormatter())


def _legend(figure: "Figure", axes: Any, curves: int) -> None:
    """Above the axes, so that it covers no data; for many curves, only which colour is measured."""
    handles, labels = axes.get_legend_handles_labels()
    if curves > 5:
        firsts = [next(i for i, label in enumerate(labels) if label.startswith(who)) for who in _who(labels)]
        handles, labels = [handles[i] for i in firsts], _who(labels)
    width = figure.get_figwidth()  # a legend wider than the figure would squeeze the axes
    # inches of a character of 8 points, and of the line and gaps of an entry of the legend
    character, entry = 0.062, 0.5
    labels = [textwrap.fill(label, int((width - entry) / character)) for label in labels]
    longest = max((len(line) for label in labels for line in label.split("\n")), default=0)
    columns = 2 if 2 * (entry + longest * character) < width else 1
    figure.legend(handles, labels, loc="outside upper left", ncols=columns, fontsize=8)


def _who(labels: list[str]) -> list[str]:
    return list(dict.fromkeys(label.split(",")[0] for label in labels))


def _plot_maps(measured: "ViewPlot", modelled: "ViewPlot | None", after: "ViewPlot | None") -> "Figure":
    """Maps at one scale: measured, modelled and their difference; or measured, of the camera as given and of the corrected one."""
    shown = [("measured", [image for _, image in measured.maps])]
    if modelled is not None:
        beside = [image for _, image in modelled.maps]
        shown.append(("modelled" if after is None else GIVEN, beside))
        if after is None:
            apart = [a - b for a, b in zip(shown[0][1], beside, strict=True)]
            shown.append(("measured - modelled", apart))
        else:
            shown.append((CORRECTED, [image for _, image in after.maps]))
    rows, cell = len(measured.maps), 8.0 / 3
    height, breadth = measured.maps[0][1].shape
    with styled():
        figure = blank(cell * len(shown) + 0.4, rows * (cell * height / breadth + 0.4))
        for row, line in enumerate(figure.subplots(rows, len(shown), squeeze=False)):
            images = [maps[row].ravel() for _, maps in shown[:2]]
            low, high = np.percentile(np.concatenate(images), [1, 99])
            half = (high - low) / 2 or 0.5
            drawn = []
            for axes, (name, maps) in zip(line, shown, strict=True):
                # a difference is centred on 0, at the same scale
                middle = 0.0 if " - " in name else (low + high) / 2
                drawn.append(axes.imshow(maps[row], cmap="cividis", vmin=middle - half, vmax=middle + half))
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set_visible(False)
                axes.set_title(name, fontsize=9)
                if measured.box is not None:  # a part of the map, which is framed
                    height, width = maps[row].shape
                    top, bottom = (height * part for part in measured.box[:2])
                    left, right = (width * part for part in measured.box[2:])
                    place = (left - 0.5, top - 0.5, right - left, bottom - top)
                    axes.add_patch(_box(*place, MEASURED, fill=False, linewidth=1.8))
            label = textwrap.fill(label_text(measured.maps[row][0]), 34)
            figure.colorbar(drawn[0], ax=list(line), label=label, shrink=0.8, pad=0.02)
    return figure


def plot_used(used: Mapping[str, Any]) -> "Figure":
    """The sensor with the windows in which temporal statistics were measured.
    `used`: as `compare --json` and `diagnose --json` hold it; windows are rows and columns r0, r1, c0, c1.
    """
    with styled():
        figure = blank(4.7, 3.8)
        axes = figure.subplots()
        windows = [(used["frame"], MODELLED, f"{used['full_frames']} full frames")]
        others = [window for window in used["windows"] if window != used["frame"]]
        windows += [(w, MEASURED, None if k else "window of all frames used") for k, w in enumerate(others)]
        for (r0, r1, c0, c1), colour, label in windows:
            look = {"facecolor": colour, "alpha": 0.25, "label": label}
            axes.add_patch(_box(c0, r0, c1 - c0, r1 - r0, colour, **look))
        top, bottom, left, right = used["frame"]
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="column, px")
        axes.set_ylabel("row, px")
        axes.grid(False)
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _box(x: float, y: float, width: float, height: float, colour: str, **look: Any):
    from matplotlib.patches import Rectangle

    return Rectangle((x, y), width, height, edgecolor=colour, **look)
