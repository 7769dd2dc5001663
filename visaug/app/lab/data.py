"""Curves and maps as the page draws them, of views and of a picture of the user's own: values, no drawings."""

import base64
import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from visaug.augment import SensorNoise
from visaug.augment.files import add_noise
from visaug.augment.image_io import Picture, read_picture
from visaug.augment.preview import middle
from visaug.camera import Camera
from visaug.core.errors import naming
from visaug.core.wording import label_text
from visaug.frames.limits import lower_limit
from visaug.statistics.view import ViewPlot

LARGEST_MAP = 640  # pixels on a side; a larger map is sent as means of squares


def view_data(title: str, measured: ViewPlot, modelled: ViewPlot | None) -> dict[str, Any]:
    """A view of the measured and of the modelled frames."""
    content: dict[str, Any] = {"title": title, "names": ["measured", "modelled"], "curves": [], "maps": []}
    content |= {name: getattr(measured, name) for name in ("x_label", "y_label", "log_x", "log_y")}
    content["marks"] = [list(span) for span in measured.marks]
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
    height, width, channels = (*arrays[0].shape, 1)[:3]
    values = [base64.b64encode(a.astype("<f4").tobytes()).decode() for a in arrays]
    size = {"height": height, "width": width, "channels": channels, "step": step}
    return {"title": title, **size, "values": values}


def _aligned(label: str, measured: tuple[Any, Any], modelled: tuple[Any, Any]) -> dict[str, Any]:
    """Both curves over the union of their positions; None where one has no finite value."""
    tables = []
    for curve in (measured, modelled):
        points = zip(*(np.asarray(values, float).tolist() for values in curve), strict=True)
        known = (point for point in points if math.isfinite(point[0]))  # others cannot be drawn
        tables.append({x: float(f"{y:.7g}") if math.isfinite(y) else None for x, y in known})
    union = sorted({*tables[0], *tables[1]})
    return {"label": label, "x": union, "y": [[table.get(x) for x in union] for table in tables]}


def _reduced(image: np.ndarray, step: int) -> np.ndarray:
    if step == 1:
        return image
    rows, columns = (np.arange(0, n, step) for n in image.shape[:2])
    whole = np.stack([image, np.ones_like(image)])  # the mean of a square at an edge is that of fewer pixels
    sums, counts = np.add.reduceat(np.add.reduceat(whole, rows, 1), columns, 2)
    return sums / counts


@dataclass(frozen=True)
class OwnPicture:
    """A picture that was uploaded, with the name of its file, and a key that is another for every content."""

    name: str
    picture: Picture
    key: str

    @classmethod
    def read(cls, name: str, content: bytes) -> "OwnPicture":
        """Reads a picture of any format that `visaug augment` takes; the suffix of the name tells which."""
        name = Path(name).name
        with TemporaryDirectory(prefix="visaug-lab-") as folder:
            path = Path(folder) / f"picture{Path(name).suffix.lower()}"
            path.write_bytes(content)
            # Noise on so many takes some seconds and 2 GB.
            most, expected = 16_000_000, "at most 16 million; `visaug augment` takes larger pictures"
            with naming(name), lower_limit(most, expected):
                picture = read_picture(path)
        return cls(name, picture, hashlib.blake2b(content, digest_size=8).hexdigest())

    def through(self, camera: Camera, seed: int, exposure: float = 1.0) -> dict[str, Any]:
        """The middle of the picture before and after a camera, pixel by pixel, in the picture's own values.

        The camera takes the whole picture, with a fraction of the saturation exposure from 1e-6 to 1; the result is as bright as
        the picture. The same seed gives the same noise.
        """
        noise = SensorNoise(camera, exposure=exposure)
        with naming(self.name):
            taken = add_noise(self.picture, noise, seed)
        window = middle(self.picture, LARGEST_MAP, LARGEST_MAP)
        both = self.picture, taken
        before, after = (p.pixels[window][..., 0 if p.colours == 1 else slice(p.colours)] for p in both)
        height, width = self.picture.pixels.shape[:2]
        part = "" if before.shape[:2] == (height, width) else f", the middle of {height} x {width} pixels"
        kind = "sRGB" if self.picture.transfer == "srgb" else "linear in light"
        dtype = self.picture.pixels.dtype
        white = 1.0 if dtype.kind == "f" else float(np.iinfo(dtype).max)
        return {
            "title": f"{self.name}{part}; taken for {kind} ({self.picture.reason})",
            "names": ["before", "after"],
            "y_label": f"{white:g} is white",
            "white": white,
            "is_light": dtype.kind == "f",
            "curves": [],
            "maps": [map_data(self.name, before, after)],
        }
