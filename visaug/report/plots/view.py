"""A view of the fingerprint: measured and modelled in the same axes."""

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from visaug.report.plots.style import MEASURED, MODELLED, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from visaug.fingerprint.view import Picture

_LINES = ("-", "--", ":", "-.")
_MARKERS = ("o", "s", "^", "D")
_FEW = 16  # curves of so few points get markers


def plot_view(measured: "Picture", modelled: "Picture | None" = None, width: float = 8.0) -> "Figure":
    """What a view shows of the measured frames and, if given, of the modelled ones."""
    if measured.maps:
        return _plot_maps(measured, modelled, width)
    with styled():
        figure = blank(width, 3.5 if width > 5 else 3.2)
        axes = figure.subplots()
        # Measured last, so that it lies on top.
        for picture, colour, name in ((modelled, MODELLED, "modelled"), (measured, MEASURED, "measured")):
            if picture is not None:
                _draw_curves(axes, picture, colour, name)
        if measured.log_x:
            axes.set_xscale("log" if _all_positive(measured, "x") else "symlog")
        if measured.log_y:
            axes.set_yscale("log")
        axes.set(xlabel=measured.x_label, ylabel=textwrap.fill(measured.y_label, 28))
        _legend(figure, axes, len(measured.curves))
    return figure


def _legend(figure: "Figure", axes: Any, curves: int) -> None:
    """Within the axes for few curves, above them for some; for many, only who is who."""
    handles, labels = axes.get_legend_handles_labels()
    if curves > 5:
        firsts = [next(i for i, label in enumerate(labels) if label.startswith(who)) for who in _who(labels)]
        handles, labels = [handles[i] for i in firsts], _who(labels)
    if len(handles) <= 4:
        axes.legend(handles, labels, fontsize=8.5)
    else:
        figure.legend(handles, labels, loc="outside upper left", ncols=2, fontsize=8)


def _who(labels: list[str]) -> list[str]:
    return list(dict.fromkeys(label.split(",")[0] for label in labels))


def _draw_curves(axes: Any, picture: "Picture", colour: str, name: str) -> None:
    for i, curve in enumerate(picture.curves):
        y = np.asarray(curve.y, float)
        if picture.log_y:
            y = np.where(y > 0, y, np.nan)
        axes.plot(
            curve.x,
            y,
            color=colour,
            linestyle=_LINES[i % len(_LINES)],
            marker=_MARKERS[i % len(_MARKERS)] if len(y) <= _FEW else None,
            markersize=4,
            linewidth=1.2 if name == "measured" else 2.6,
            alpha=0.95 if name == "measured" else 0.55,
            label=f"{name}, {curve.label}" if curve.label else name,
        )


def _plot_maps(measured: "Picture", modelled: "Picture | None", width: float) -> "Figure":
    """Maps side by side, measured above modelled, one scale for both."""
    rows = [(measured, "measured")] + ([(modelled, "modelled")] if modelled is not None else [])
    columns = len(measured.maps)
    height, breadth = measured.maps[0][1].shape
    cell = min(width / columns, 3.2)
    with styled():
        figure = blank(cell * columns, len(rows) * cell * 0.8 * height / breadth + 0.6)
        grid = figure.subplots(len(rows), columns, squeeze=False)
        for column in range(columns):
            images = [picture.maps[column][1] for picture, _ in rows if column < len(picture.maps)]
            low, high = np.percentile(np.concatenate([image.ravel() for image in images]), [1, 99])
            shown = None
            for row, (axes, (picture, name)) in enumerate(zip(grid[:, column], rows)):
                axes.set(xticks=[], yticks=[], ylabel=name if column == 0 else "")
                axes.spines[:].set_visible(False)
                if column < len(picture.maps):
                    title, image = picture.maps[column]
                    shown = axes.imshow(image, cmap="viridis", vmin=low, vmax=high if high > low else low + 1)
                    if row == 0:
                        axes.set_title(textwrap.fill(title, int(cell * 11)), fontsize=8.5)
            if shown is not None:
                figure.colorbar(shown, ax=list(grid[:, column]), label=measured.y_label, shrink=0.8, pad=0.03)
    return figure


def _all_positive(picture: "Picture", axis: str) -> bool:
    return all(np.min(getattr(curve, axis), initial=1.0) > 0 for curve in picture.curves)
