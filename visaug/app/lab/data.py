"""Curves and maps as the page draws them: measured and modelled values, no pictures."""

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from visaug.core.wording import label_text
from visaug.statistics.view import ViewPlot

LARGEST_MAP = 640  # pixels on a side; a larger map is sent as means of squares


def view_data(title: str, measured: ViewPlot, modelled: ViewPlot | None) -> dict[str, Any]:
    """A view of the measured and of the modelled frames."""
    content: dict[str, Any] = {
        "title": title,
        "names": ["measured", "modelled"],
        "x_label": measured.x_label,
        "y_label": measured.y_label,
        "log_x": measured.log_x,
        "log_y": measured.log_y,
        "marks": [list(span) for span in measured.marks],
        "curves": [],
        "maps": [],
    }
    beside = modelled or measured
    for i, curve in enumerate(measured.curves):
        other = beside.curves[i] if i < len(beside.curves) else curve
        content["curves"].append(_aligned(label_text(curve.label), (curve.x, curve.y), (other.x, other.y)))
    for (name, image), (_, other) in zip(measured.maps, beside.maps, strict=False):
        content["maps"].append(map_data(label_text(name), image, other))
    return content


def map_data(title: str, first: np.ndarray, second: np.ndarray) -> dict[str, Any]:
    """Two maps (H, W) or pictures (H, W, 3) of one shape, as little-endian float32 in base64.

    `step` is the side of the squares of pixels whose means are sent.
    """
    step = -(-max(first.shape[:2]) // LARGEST_MAP)
    arrays = [_reduced(np.asarray(a, np.float32), step) for a in (first, second)]
    height, width = arrays[0].shape[:2]
    return {
        "title": title,
        "height": height,
        "width": width,
        "channels": arrays[0].shape[2] if arrays[0].ndim == 3 else 1,
        "step": step,
        "values": [base64.b64encode(a.astype("<f4").tobytes()).decode() for a in arrays],
    }


def _aligned(label: str, measured: tuple[Any, Any], modelled: tuple[Any, Any]) -> dict[str, Any]:
    """Both curves over the union of their positions; None where one has no finite value."""
    points = []
    for xs, ys in (measured, modelled):
        xs, ys = np.asarray(xs, float), np.asarray(ys, float)
        there = np.isfinite(xs)  # a position that is not known cannot be drawn
        points.append((xs[there], ys[there]))
    x = np.union1d(points[0][0], points[1][0])
    columns = []
    for xs, ys in points:
        column: list[float | None] = [None] * len(x)
        for place, y in zip(np.searchsorted(x, xs), ys, strict=True):
            column[int(place)] = float(f"{y:.7g}") if np.isfinite(y) else None
        columns.append(column)
    return {"label": label, "x": x.tolist(), "y": columns}


def _reduced(image: np.ndarray, step: int) -> np.ndarray:
    if step == 1:
        return image
    edges: Sequence[np.ndarray] = [np.arange(0, n, step) for n in image.shape[:2]]
    sums = np.add.reduceat(np.add.reduceat(image, edges[0], 0), edges[1], 1)
    counts = [np.minimum(step, n - e) for e, n in zip(edges, image.shape[:2], strict=True)]
    area = np.outer(*counts).astype(np.float32)
    return sums / (area[..., None] if image.ndim == 3 else area)
