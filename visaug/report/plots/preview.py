"""A contact sheet: one picture through several cameras, pixel by pixel."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from visaug.augment.preview import LEVELS, Sample
from visaug.core.extras import extra
from visaug.report.plots.style import plain, styled

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

DPI, COLUMNS = 100, 3
GAP, HEAD, FOOT = 16, 24, 40  # pixels: between crops, above for a name, below for the noise


def plot_preview(title: str, given: "np.ndarray", samples: Sequence[Sample]) -> "Figure":
    """Crops at 1:1 with the noise's standard deviation at five levels below each.

    Args:
        title: of the sheet.
        given: crop of the picture as it is, (H, W, 3) uint8.
        samples: the same crop by camera.

    To be saved at the figure's own resolution (`figure.dpi`), so that a pixel of the picture is one of the sheet.
    """
    with extra():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    height, width = given.shape[:2]
    cell = max(width, 330)
    columns = 2 if len(samples) == 3 else min(COLUMNS, len(samples) + 1)
    rows = -(-(len(samples) + 1) // columns)
    wide = GAP + columns * (cell + GAP)
    high = 36 + rows * (HEAD + height + FOOT + GAP)
    with styled():
        figure = Figure(figsize=(wide / DPI, high / DPI), dpi=DPI)
        FigureCanvasAgg(figure)
        figure.text(GAP / wide, 1 - 22 / high, plain(title), fontsize=9.5)
        for number, (name, crop, sigma) in enumerate(
            [("as given", given, None), *((one.name, one.crop, one.sigma) for one in samples)]
        ):
            left = GAP + number % columns * (cell + GAP)
            top = 36 + number // columns * (HEAD + height + FOOT + GAP) + HEAD
            figure.figimage(crop, left, high - top - height)
            figure.text(left / wide, 1 - (top - 7) / high, plain(name), fontsize=9)
            levels = "   ".join(f"{level:>5d}" for level in LEVELS)
            noise = "   ".join(f"{value:5.2f}" for value in sigma) if sigma else ""
            for line, (label, text) in enumerate([("level", levels), ("noise", noise)] if sigma else []):
                y = 1 - (top + height + 15 + 14 * line) / high
                figure.text(left / wide, y, f"{label}  {text}", fontsize=8.5, family="DejaVu Sans Mono")
    return figure
