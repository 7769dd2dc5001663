"""Images side by side, each with its own labelled scale."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from visaug.report.plots.style import blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_images(images: Sequence[np.ndarray], titles: Sequence[str]) -> "Figure":
    """A grid of images of one size, (H, W) or (H, W, 3) in [0, 1], each with its title, four in a row."""
    with styled():
        figure, cells = image_grid(images, 4, 0.32)
        for axes, image, title in zip(cells, images, titles):
            axes.imshow(image, cmap="gray", vmin=0, vmax=1)
            axes.set_title(title, fontsize=9)
    return figure


def image_grid(
    images: Sequence[np.ndarray], columns: int, title: float, more: float = 0.0
) -> "tuple[Figure, list[Axes]]":
    """A figure and its axes for images of one size, with `title` inches above each, and `more` for the whole."""
    rows = -(-len(images) // columns)
    height, breadth = images[0].shape[:2]
    figure = blank(8.0, rows * (8.0 / columns * height / breadth + title) + more)
    cells = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes in cells:
        axes.set_axis_off()
    return figure, cells


def plot_components(images: Sequence[np.ndarray], titles: Sequence[str]) -> "Figure":
    """Noise components in DN, each on its own scale of three standard deviations, which the title states; three in a row."""
    with styled():
        figure, cells = image_grid(images, 3, 0.48)
        for axes, image, title in zip(cells, images, titles):
            spread = float(np.std(image)) or 1.0
            axes.imshow(image - np.mean(image), cmap="RdBu_r", vmin=-3 * spread, vmax=3 * spread)
            axes.set_title(f"{title}\nσ = {np.std(image):.3g} DN", fontsize=8.5)
    return figure
