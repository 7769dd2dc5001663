"""Mono16 .raw: bare 16-bit pixels, row by row. Byte order and the place of the bits are found from
the pixels.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visaug.errors import InputError

BYTE_ORDERS = ("little", "big")


def read_raw(path: Path, shape: tuple[int, int] | None, byte_order: str) -> np.ndarray:
    """(H, W) uint16 as stored, `byte_order` ``little`` or ``big``.

    Raises:
        InputError: no resolution, or a file of another size.
    """
    if shape is None:
        raise InputError(
            "a .raw file does not tell its size",
            file=path,
            field="resolution",
            expected="the camera's rows and columns",
        )
    rows, columns = shape
    try:
        found = path.stat().st_size
    except OSError:
        raise InputError("no such file", file=path) from None
    if found != 2 * rows * columns:
        what = "is truncated" if found < 2 * rows * columns else "is too long"
        raise InputError(
            f"{what}: {found} bytes",
            file=path,
            expected=f"{2 * rows * columns} bytes for {rows} x {columns} pixels of 16 bits",
        )
    return np.fromfile(path, dtype="<u2" if byte_order == "little" else ">u2").reshape(shape)


def guess_byte_order(path: Path) -> str:
    """The order in which neighbours are more alike; little endian, as GenICam has it, where both fit.

    Swapping the bytes of a real picture turns its finest bits into its coarsest, so neighbours differ far
    more.
    """
    try:
        pixels = np.fromfile(path, dtype="<u2", count=2**20).astype(np.int64)
    except OSError:
        raise InputError("no such file", file=path) from None
    swapped = ((pixels & 0xFF) << 8) | (pixels >> 8)
    if pixels.size < 2:
        return "little"
    return "big" if np.abs(np.diff(swapped)).mean() < np.abs(np.diff(pixels)).mean() else "little"


def unused_low_bits(pixels: np.ndarray) -> int:
    """How many low bits are 0 in every pixel (16 where all pixels are 0)."""
    used = int(np.bitwise_or.reduce(pixels, axis=None))
    return 16 if used == 0 else (used & -used).bit_length() - 1
