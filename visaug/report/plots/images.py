"""Images side by side, each with its own labelled scale."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from visaug.report.plots.style import blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_images(
    images: Sequence[np.ndarray],
    titles: Sequence[str],
    *,
    columns: int = 4,
    limits: tuple[float, float] | None = None,
) -> "Figure":
    """A grid of images of one size.

    Args:
        images: (H, W) or (H, W, 3) arrays.
        titles: one for each image.
        columns: images in a row.
        limits: values shown as black and white; by default 1st and 99th percentile of all images together.
    """
    if limits is None:
        everything = np.concatenate([np.asarray(image, float).ravel() for image in images])
        low, high = np.percentile(everything, [1, 99])
        limits = (float(low), float(high) if high > low else float(low) + 1)
    with styled():
        figure, cells = image_grid(images, columns, 0.32)
        for axes, image, title in zip(cells, images, titles):
            axes.imshow(image, cmap="gray", vmin=limits[0], vmax=limits[1])
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


def plot_components(
    images: Sequence[np.ndarray], titles: Sequence[str], unit: str, columns: int = 4
) -> "Figure":
    """Noise components, each on its own scale of three standard deviations, which the title states."""
    with styled():
        figure, cells = image_grid(images, columns, 0.48)
        for axes, image, title in zip(cells, images, titles):
            spread = float(np.std(image)) or 1.0
            axes.imshow(image - np.mean(image), cmap="RdBu_r", vmin=-3 * spread, vmax=3 * spread)
            axes.set_title(f"{title}\nσ = {np.std(image):.3g} {unit}", fontsize=8.5)
    return figure
