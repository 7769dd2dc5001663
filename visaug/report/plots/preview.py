"""A contact sheet: one picture through several cameras, pixel by pixel."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from visaug.augment.preview import LEVELS, NoiseSample, liveliest
from visaug.report.plots.style import blank, plain, styled

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure


def plot_preview(title: str, given: "np.ndarray", samples: Sequence[NoiseSample]) -> "Figure":
    """Crops at 1:1, a part of each at 4x, and the noise's standard deviation at five levels.
    `title`: of the sheet.
    `given`: crop of the picture as it is, (H, W, 3) uint8.
    `samples`: the same crop by camera.
    To be saved at the figure's own resolution (`figure.dpi`), so that a pixel of the picture is one of the sheet.
    """
    dpi = 100
    # pixels: title; between crops; above for name and conditions, below for the noise
    head_of_all, gap, head, foot = 52, 16, 40, 40
    zoom, part_rows, part_columns = 4, 45, 80  # of the magnified part
    part = liveliest(given, part_rows, part_columns)
    height, width = given.shape[:2]
    low = zoom * (part[0].stop - part[0].start)  # height of the magnified part
    cell = max(width, zoom * part_columns, 330)
    columns = 2 if len(samples) == 3 else min(3, len(samples) + 1)
    rows = -(-(len(samples) + 1) // columns)
    tile = head + height + gap // 2 + low + foot + gap
    wide, high = gap + columns * (cell + gap), head_of_all + rows * tile
    with styled():
        figure = blank(wide / dpi, high / dpi, "none", dpi=dpi)

        def write(x: int, y: int, text: str, size: float, family: str = "DejaVu Sans") -> None:
            figure.text(x / wide, 1 - y / high, text, fontsize=size, family=family)

        for line, text in enumerate(title.splitlines()):
            write(gap, 20 + 17 * line, plain(text), 9.5)
        for number, one in enumerate([NoiseSample("as given", given, ()), *samples]):
            left = gap + number % columns * (cell + gap)
            top = head_of_all + number // columns * tile + head
            write(left, top - 22, plain(one.name), 9)
            write(left, top - 7, plain(one.conditions), 8)
            figure.figimage(one.crop, left, high - top - height)
            magnified = one.crop[part].repeat(zoom, 0).repeat(zoom, 1)
            below = top + height + gap // 2 + low
            figure.figimage(magnified, left, high - below)
            if one.sigma:
                levels = "   ".join(f"{level:>5d}" for level in LEVELS)
                noise = "   ".join(f"{value:5.2f}" for value in one.sigma)
                write(left, below + 15, f"level  {levels}", 8.5, "DejaVu Sans Mono")
                write(left, below + 29, f"noise  {noise}", 8.5, "DejaVu Sans Mono")
    return figure
