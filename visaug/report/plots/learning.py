"""What training shows: curves, images, predictions, and how long things took."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from visaug.report.plots.style import MEASURED, MODELLED, SOFT, THIRD, blank, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ARM_COLOURS = (SOFT, MODELLED, MEASURED, THIRD, "#7c3aed", "#b45309", "#0f766e")


def plot_training(
    curves: Mapping[str, Sequence[Mapping[str, Sequence[float]]]], quantities: Mapping[str, str]
) -> "Figure":
    """Quantities against the epoch, one panel each, one colour for each arm and one line for each of its seeds.
    `curves`: arm -> seeds -> quantity -> a value for each epoch, counted from 1.
    `quantities`: quantity -> label of its axis.
    """
    with styled():
        figure = blank(8.0, 3.2)
        panels = figure.subplots(1, len(quantities), squeeze=False)[0]
        for axes, (quantity, label) in zip(panels, quantities.items()):
            for (arm, seeds), colour in zip(curves.items(), ARM_COLOURS * 4):
                shown = [values[quantity] for values in seeds if quantity in values]
                for number, values in enumerate(shown):
                    epochs = np.arange(1, len(values) + 1)
                    axes.plot(epochs, values, color=colour, linewidth=1, label="_" * bool(number) + arm)
            axes.set(xlabel="epoch", ylabel=label)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, ncols=4, loc="outside upper center")
    return figure


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


def plot_predictions(
    images: Sequence[np.ndarray],
    keypoints_true: Sequence[np.ndarray],
    keypoints_predicted: Sequence[np.ndarray | None],
    boxes_true: Sequence[np.ndarray],
    boxes_predicted: Sequence[np.ndarray | None],
    titles: Sequence[str],
) -> "Figure":
    """Truth and prediction on test images.

    Args:
        images: (H, W) each.
        keypoints_true, keypoints_predicted: (n, 2) x, y in pixels; None where nothing was found.
        boxes_true, boxes_predicted: (4,) left, top, right, bottom in pixels.
        titles: one for each image, such as its OKS.
    """
    from matplotlib.patches import Rectangle

    true, predicted = "#4ade80", "#fb923c"  # green, orange
    with styled():
        figure, cells = image_grid(images, 4, 0.3, 0.25)
        shown = zip(cells, images, keypoints_true, keypoints_predicted, boxes_true, boxes_predicted, titles)
        for axes, image, points, found, box, found_box, title in shown:
            axes.imshow(image, cmap="gray")
            for corners, colour in ((box, true), (found_box, predicted)):
                if corners is not None:
                    size = corners[2] - corners[0], corners[3] - corners[1]
                    axes.add_patch(Rectangle(corners[:2], *size, fill=False, edgecolor=colour, linewidth=1))
            marker = {"s": 14, "facecolors": "none", "edgecolors": true, "linewidths": 1}
            axes.scatter(*np.asarray(points).T, **marker, label="truth")
            if found is not None:
                lines = [points[:, 0], found[:, 0]], [points[:, 1], found[:, 1]]
                axes.plot(*lines, color=predicted, linewidth=0.6, alpha=0.8)
                marker = {"s": 10, "marker": "x", "color": predicted, "linewidths": 1}
                axes.scatter(*np.asarray(found).T, **marker, label="predicted")
            axes.set(xlim=(0, image.shape[1]), ylim=(image.shape[0], 0))
            axes.set_title(title, fontsize=8.5)
        handles, labels = cells[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=2, fontsize=8.5)
    return figure


def plot_timing(parts: Mapping[str, float]) -> "Figure":
    names = list(parts)[::-1]
    with styled():
        figure = blank(8.0, 0.7 + 0.3 * len(names))
        axes = figure.subplots()
        axes.barh(range(len(names)), [parts[name] for name in names], color=MODELLED, height=0.62)
        axes.set_yticks(range(len(names)), names)
        beside = {"textcoords": "offset points", "xytext": (4, -3), "fontsize": 8.5}
        for i, name in enumerate(names):
            axes.annotate(f"{parts[name]:.0f} s", (parts[name], i), **beside)
        axes.set_xlabel("seconds")
        axes.margins(x=0.1)
        axes.grid(axis="y", visible=False)
    return figure
