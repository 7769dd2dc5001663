"""A picture in memory, whatever the file it came from; and whether its values are linear in light or encoded, from its file.

The first of these that is there decides: ICC profile; PNG's cICP, sRGB and gAMA chunks; EXIF's colour space. Without
any, colour of 8 bit is sRGB, as every camera, browser and renderer writes it; everything else (gray of 8 bit, 16 bit,
floats) is linear, as scientific and machine-vision cameras and renderers' linear outputs are. Every encoding that is
not linear (AdobeRGB, BT.709, a gamma of 2.2) is taken as sRGB's, which they resemble.
"""

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError

LINEAR, SRGB = "linear", "srgb"


@dataclass(frozen=True)
class Hints:
    """Information in a file on its encoding; None where there is none."""

    icc: bytes | None = None  # the profile
    cicp: int | None = None  # transfer characteristics by ITU-T H.273
    srgb: bool = False  # whether there is an sRGB chunk
    gamma: float | None = None  # of the file, as PNG has it: 1.0 is linear, 0.45455 is that of sRGB
    exif_space: int | None = None  # EXIF's ColorSpace; 1 is sRGB, 65535 is undefined


def transfer_of(hints: Hints, dtype: np.dtype, colours: int) -> tuple[str, str]:
    """("linear" or "srgb", the reason for messages)."""
    linear_code = 8  # ITU-T H.273, table 3; the others are taken as sRGB, those left out state nothing
    if hints.cicp in (1, *range(4, 19)):
        return (LINEAR if hints.cicp == linear_code else SRGB), "cICP chunk"
    gamma = profile_gamma(hints.icc) if hints.icc else None
    if gamma is not None:
        return (LINEAR if abs(gamma - 1) < 0.05 else SRGB), "ICC profile"
    if hints.srgb:
        return SRGB, "sRGB chunk"
    if hints.gamma:
        return (LINEAR if abs(hints.gamma - 1) < 0.05 else SRGB), "gAMA chunk"
    if hints.exif_space == 1:
        return SRGB, "EXIF colour space"
    if dtype == np.uint8 and colours == 3:
        return SRGB, "8-bit colour"
    depth = "floating point" if dtype.kind == "f" else f"{8 * dtype.itemsize}-bit"
    return LINEAR, depth if dtype.kind == "f" or dtype != np.uint8 else "8-bit gray, not tagged"


def profile_gamma(profile: bytes) -> float | None:
    """Exponent of an ICC profile's curve at mid-range; None where it has none that can be read.

    Source: ICC.1:2022, 7.3 (tag table), 10.6 (curveType), 10.18 (parametricCurveType).
    """
    try:
        (count,) = struct.unpack_from(">I", profile, 128)
        for number in range(min(count, 100)):
            name, offset, _ = struct.unpack_from(">4sII", profile, 132 + 12 * number)
            if name in (b"gTRC", b"kTRC"):
                return _curve_gamma(profile, offset)
    except struct.error:
        pass
    return None


def _curve_gamma(profile: bytes, offset: int) -> float | None:
    kind = profile[offset : offset + 4]
    if kind == b"curv":
        (entries,) = struct.unpack_from(">I", profile, offset + 8)
        if entries == 0:
            return 1.0
        if entries == 1:
            return struct.unpack_from(">H", profile, offset + 12)[0] / 256
        half = (entries - 1) // 2  # the exponent that the table has at mid-range
        (value,) = struct.unpack_from(">H", profile, offset + 12 + 2 * half)
        return float(np.log(max(value, 1) / 65535) / np.log(half / (entries - 1))) if half else 1.0
    return struct.unpack_from(">i", profile, offset + 12)[0] / 65536 if kind == b"para" else None


@dataclass
class Picture:
    """A picture in memory."""

    # (H, W, C) uint8, uint16 or float; C is 1 (gray), 2 (gray, alpha), 3 (colour) or 4 (colour, alpha)
    pixels: np.ndarray
    transfer: str = "linear"  # or "srgb": how pixel values follow the light
    reason: str = ""  # how `transfer` was determined, for messages
    # (H, W) bool, True where a pixel holds no light (a transparent colour, GDAL's no-data value) and must keep its value
    keep: np.ndarray | None = None
    key: tuple[float, ...] | None = None  # the pixel value that `keep` stands for; no other pixel may get it
    # what is written back unchanged: colour profile, EXIF block, tags, compression
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
