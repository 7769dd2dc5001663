"""A picture in memory, whatever the file it came from."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from visaug.augment.image_io.transfer import Hints, transfer_of
from visaug.core.errors import InputError


@dataclass
class Picture:
    """A picture in memory.

    Attributes:
        pixels: (H, W, C) uint8, uint16 or float; C is 1 (gray), 2 (gray, alpha), 3 (colour) or 4 (colour, alpha).
        transfer: "linear" or "srgb": how pixel values follow the light.
        reason: how `transfer` was determined, for messages.
        keep: (H, W) bool, True where a pixel holds no light (a transparent colour, GDAL's no-data value) and must
            keep its value; None where there is no such pixel.
        key: the pixel value that `keep` stands for; no other pixel may get it.
        extras: what is written back unchanged: colour profile, EXIF block, tags, compression.
    """

    pixels: np.ndarray
    transfer: str = "linear"
    reason: str = ""
    keep: np.ndarray | None = None
    key: tuple[float, ...] | None = None
    extras: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def encoded(cls, pixels: np.ndarray, hints: Hints, **more: Any) -> "Picture":
        """A picture whose transfer function the hints of its file tell; `more` are other attributes."""
        picture = cls(pixels, **more)
        picture.transfer, picture.reason = transfer_of(hints, pixels.dtype, picture.colours)
        return picture

    @property
    def colours(self) -> int:
        """Number of channels that light made: without alpha."""
        channels = self.pixels.shape[2]
        return channels - 1 if channels in (2, 4) else channels

    @property
    def light(self) -> np.ndarray:
        """(N, colours) values of the pixels that hold light."""
        light = self.pixels[..., : self.colours]
        return light.reshape(-1, self.colours) if self.keep is None else light[~self.keep]

    def with_pixels(self, pixels: np.ndarray) -> "Picture":
        """The same picture with other colours; pixels that hold no light keep theirs."""
        if self.keep is not None:
            if self.key is not None:
                pixels = self._off_key(pixels)
            pixels = np.where(self.keep[..., None], self.pixels, pixels)
        return Picture(pixels, self.transfer, self.reason, self.keep, self.key, self.extras)

    def _off_key(self, pixels: np.ndarray) -> np.ndarray:
        """No pixel becomes transparent by chance: one step aside in the first channel."""
        key = np.array(self.key, dtype=pixels.dtype)
        hit = (pixels[..., : len(key)] == key).all(-1)
        pixels[hit, 0] = key[0] - 1 if key[0] > 0 else key[0] + 1
        return pixels


def three_axes(pixels: np.ndarray) -> np.ndarray:
    """(H, W) as (H, W, 1)."""
    return pixels[..., None] if pixels.ndim == 2 else pixels


def check_single(count: int, what: str, path: Path) -> None:
    """Refuse a file that holds several pictures."""
    if count != 1:
        raise InputError(f"holds {count} {what}", file=path, expected="a single picture in a file")
