"""A picture of the user's own, as it is and as a camera takes it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from visaug.app.lab.data import LARGEST_MAP, map_data
from visaug.augment import SensorNoise
from visaug.augment.files import add_noise
from visaug.augment.image_io import Picture, read_picture
from visaug.augment.preview import middle
from visaug.camera import Camera
from visaug.core.errors import InputError, naming
from visaug.frames.limits import lower_limit

LARGEST_FILE = 60_000_000  # bytes
MOST_PIXELS = 16_000_000  # noise on so many takes some seconds and 2 GB
_MOST = f"at most {MOST_PIXELS // 1_000_000} million; `visaug augment` takes larger pictures"


@dataclass(frozen=True)
class OwnPicture:
    """A picture that was uploaded.

    Attributes:
        name: of its file.
        picture: its pixels.
        key: another for every content.
    """

    name: str
    picture: Picture
    key: str

    @classmethod
    def read(cls, name: str, content: bytes) -> "OwnPicture":
        """Reads a picture of any format that `visaug augment` takes; the suffix of the name tells which.

        Raises:
            InputError: another format, a damaged picture, or one of too many pixels.
        """
        name = Path(name).name
        with TemporaryDirectory(prefix="visaug-lab-") as folder:
            path = Path(folder) / f"picture{Path(name).suffix.lower()}"
            path.write_bytes(content)
            try:
                with lower_limit(MOST_PIXELS, _MOST):
                    picture = read_picture(path)
            except InputError as mistake:
                raise InputError(mistake.problem, file=name, expected=mistake.expected) from None
        return cls(name, picture, hashlib.blake2b(content, digest_size=8).hexdigest())

    @property
    def white(self) -> float:
        """The pixel value of white."""
        dtype = self.picture.pixels.dtype
        return 1.0 if dtype.kind == "f" else float(np.iinfo(dtype).max)

    def through(self, camera: Camera, seed: int, exposure: float = 1.0) -> dict[str, Any]:
        """The middle of the picture before and after a camera, pixel by pixel, in the picture's own values.

        The camera takes the whole picture; the same seed gives the same noise.

        Args:
            exposure: fraction of the saturation exposure, from 1e-6 to 1; the result is as bright as the picture.
        """
        noise = SensorNoise(camera, exposure=exposure)
        with naming(self.name):
            taken = add_noise(self.picture, noise, seed)
        window = middle(self.picture, LARGEST_MAP, LARGEST_MAP)
        before, after = (
            p.pixels[window][..., 0 if p.colours == 1 else slice(p.colours)] for p in (self.picture, taken)
        )
        height, width = self.picture.pixels.shape[:2]
        whole = before.shape[:2] == (height, width)
        part = "" if whole else f", the middle of {height} x {width} pixels"
        kind = "sRGB" if self.picture.transfer == "srgb" else "linear in light"
        return {
            "title": f"{self.name}{part}; taken for {kind} ({self.picture.reason})",
            "names": ["before", "after"],
            "y_label": f"{self.white:g} is white",
            "white": self.white,
            "is_light": self.picture.pixels.dtype.kind == "f",
            "curves": [],
            "maps": [map_data(self.name, before, after)],
        }
