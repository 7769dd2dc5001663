"""Whether a picture's values are linear in light or encoded, from its file.

The first of these that is there decides: ICC profile; PNG's cICP, sRGB and gAMA chunks; EXIF's colour space. Without
any, colour of 8 bit is sRGB, as every camera, browser and renderer writes it; everything else (gray of 8 bit, 16 bit,
floats) is linear, as scientific and machine-vision cameras and renderers' linear outputs are. Every encoding that is
not linear (AdobeRGB, BT.709, a gamma of 2.2) is taken as sRGB's, which they resemble.
"""

import struct
from dataclasses import dataclass

import numpy as np

LINEAR, SRGB = "linear", "srgb"


@dataclass(frozen=True)
class Hints:
    """Information in a file on its encoding; None where there is none.

    Attributes:
        icc: the ICC profile.
        cicp: transfer characteristics by ITU-T H.273.
        srgb: whether there is an sRGB chunk.
        gamma: of the file, as PNG has it: 1.0 is linear, 0.45455 is that of sRGB.
        exif_space: EXIF's ColorSpace; 1 is sRGB, 65535 is undefined.
    """

    icc: bytes | None = None
    cicp: int | None = None
    srgb: bool = False
    gamma: float | None = None
    exif_space: int | None = None


def transfer_of(hints: Hints, dtype: np.dtype, colours: int) -> tuple[str, str]:
    """("linear" or "srgb", the reason for messages)."""
    linear_code = 8  # ITU-T H.273, table 3; the others are like sRGB
    if hints.cicp in (linear_code, 1, 4, 5, 6, 13, 14, 15):
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
    if kind == b"para":
        return struct.unpack_from(">i", profile, offset + 12)[0] / 65536
    return None
