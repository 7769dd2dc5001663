"""A view of the fingerprint: measured and modelled in the same axes."""

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
        axes.set(xlabel=measured.x_label, ylabel=measured.y_label)
        handles, labels = axes.get_legend_handles_labels()
        if len(handles) <= 6:
            axes.legend(fontsize=8.5)
        else:
            figure.legend(handles, labels, loc="outside right upper", fontsize=8)
    return figure


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
            linewidth=1.4,
            alpha=0.9,
            label=f"{name}, {curve.label}" if curve.label else name,
        )


def _plot_maps(measured: "Picture", modelled: "Picture | None", width: float) -> "Figure":
    """Maps side by side, measured above modelled, one scale for both."""
    rows = [(measured, "measured")] + ([(modelled, "modelled")] if modelled is not None else [])
    columns = len(measured.maps)
    height, breadth = measured.maps[0][1].shape
    with styled():
        figure = blank(width, len(rows) * (min(width / columns, 4.0) * height / breadth + 0.4))
        grid = figure.subplots(len(rows), columns, squeeze=False)
        for column in range(columns):
            images = [picture.maps[column][1] for picture, _ in rows if column < len(picture.maps)]
            low, high = np.percentile(np.concatenate([image.ravel() for image in images]), [1, 99])
            shown = None
            for axes, (picture, name) in zip(grid[:, column], rows):
                axes.set_axis_off()
                if column < len(picture.maps):
                    title, image = picture.maps[column]
                    shown = axes.imshow(image, cmap="viridis", vmin=low, vmax=high if high > low else low + 1)
                    axes.set_title(f"{name}: {title}", fontsize=9)
            if shown is not None:
                figure.colorbar(
                    shown, ax=list(grid[:, column]), label=measured.y_label, shrink=0.85, pad=0.02
                )
    return figure


def _all_positive(picture: "Picture", axis: str) -> bool:
    return all(np.min(getattr(curve, axis), initial=1.0) > 0 for curve in picture.curves)
