"""Curves and maps as the page draws them: measured and modelled values, no pictures."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from visaug.augment import VISNoise
from visaug.camera import Camera
from visaug.errors import InputError
from visaug.fingerprint.view import Picture

LARGEST_MAP = 640  # pixels on a side; a larger map is sent as means of squares
LARGEST_PICTURE = 1024  # pixels on a side; a larger picture is made smaller before the camera takes it
MOST_PIXELS = 60_000_000  # of an uploaded picture, before it is decoded


def view_data(title: str, measured: Picture, modelled: Picture | None) -> dict[str, Any]:
    """A view of the measured and of the modelled frames."""
    content: dict[str, Any] = {
        "title": title,
        "names": ["measured", "modelled"],
        "x_label": measured.x_label,
        "y_label": measured.y_label,
        "log_x": measured.log_x,
        "log_y": measured.log_y,
        "curves": [],
        "maps": [],
    }
    beside = modelled or measured
    for i, curve in enumerate(measured.curves):
        other = beside.curves[i] if i < len(beside.curves) else curve
        content["curves"].append(_aligned(curve.label, (curve.x, curve.y), (other.x, other.y)))
    for (name, image), (_, other) in zip(measured.maps, beside.maps, strict=False):
        content["maps"].append(map_data(name, image, other))
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


def through_camera(content: bytes, camera: Camera, seed: int, name: str = "the picture") -> dict[str, Any]:
    """A picture file, clean and as the camera takes it, in [0, 1].

    Raises:
        InputError: no PNG or JPEG picture, or one of too many pixels.
    """
    clean = _decoded(content, name)
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        torch.manual_seed(seed)
        images = torch.from_numpy(clean).reshape(*clean.shape[:2], -1).permute(2, 0, 1)[None]
        taken = VISNoise(camera, transfer="srgb")(images)[0].permute(1, 2, 0).numpy()
    taken = taken if clean.ndim == 3 else taken[..., 0]
    shown = map_data(name, clean, taken)
    return {
        "title": name,
        "names": ["clean", "through the camera"],
        "y_label": "1 is white",
        "curves": [],
        "maps": [shown],
    }


def _decoded(content: bytes, name: str) -> np.ndarray:
    from PIL import Image, UnidentifiedImageError

    expected = "a PNG or JPEG picture"
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as image:
            if image.width * image.height > MOST_PIXELS:
                raise InputError("has too many pixels", file=name, expected=f"at most {MOST_PIXELS}")
            deep = image.mode.startswith("I")
            gray = deep or image.mode in ("1", "L", "LA", "F")
            full = 65535.0 if deep else 255.0
            image.thumbnail((LARGEST_PICTURE, LARGEST_PICTURE))
            array = np.asarray(image if deep else image.convert("L" if gray else "RGB"), np.float32)
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError):
        raise InputError("cannot be read as a picture", file=name, expected=expected) from None
    return np.clip(array / full, 0, 1)


def _aligned(label: str, measured: tuple[Any, Any], modelled: tuple[Any, Any]) -> dict[str, Any]:
    """Both curves over the union of their positions; None where one has no finite value."""
    x = np.union1d(np.asarray(measured[0], float), np.asarray(modelled[0], float))
    columns = []
    for xs, ys in (measured, modelled):
        column: list[float | None] = [None] * len(x)
        for place, y in zip(np.searchsorted(x, np.asarray(xs, float)), np.asarray(ys, float), strict=True):
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
