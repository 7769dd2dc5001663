""".raw: bare pixels, row by row, 16 bits each or packed, as the file's size and the pixels tell.

Packed formats: GenICam Pixel Format Naming Convention 2.4 (``Mono10p``, ``Mono12p``: the bits of neighbouring pixels
follow one another, lowest first) and GigE Vision 1.2 (``Mono10Packed``, ``Mono12Packed``: two pixels in three bytes,
the low bits of both in the middle one).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError

BYTE_ORDERS = ("little", "big")


@dataclass(frozen=True)
class _Layout:
    """`pixels` pixels lie in `size` bytes; `unpack` takes (n, size) bytes to (n, pixels)."""

    bits: int
    pixels: int
    size: int
    unpack: Callable[[np.ndarray], np.ndarray]


def _lowest_first(bits: int, groups: np.ndarray) -> np.ndarray:
    word = np.zeros(len(groups), np.uint64)
    for n, byte in enumerate(groups.T):
        word |= byte.astype(np.uint64) << np.uint64(8 * n)
    firsts = range(0, 8 * groups.shape[1], bits)
    mask = np.uint64((1 << bits) - 1)
    return np.stack([(word >> np.uint64(first)) & mask for first in firsts], 1).astype(np.uint16)


def _middle_byte(low_bits: int, groups: np.ndarray) -> np.ndarray:
    first, middle, second = groups.astype(np.uint16).T
    low = (1 << low_bits) - 1
    return np.stack([first << low_bits | (middle & low), second << low_bits | (middle >> 4 & low)], 1)


LAYOUTS = {
    "little": _Layout(16, 1, 2, lambda b: b.copy().view("<u2")),
    "big": _Layout(16, 1, 2, lambda b: b.copy().view(">u2").astype(np.uint16)),
    "mono8": _Layout(8, 1, 1, lambda b: b),
    "mono10p": _Layout(10, 4, 5, partial(_lowest_first, 10)),
    "mono12p": _Layout(12, 2, 3, partial(_lowest_first, 12)),
    "mono12packed": _Layout(12, 2, 3, partial(_middle_byte, 4)),
    "mono10packed": _Layout(10, 2, 3, partial(_middle_byte, 2)),
}


def read_raw(path: Path, shape: tuple[int, int] | None, layout: str) -> np.ndarray:
    """(H, W) as stored, uint16 (uint8 of ``mono8``); `layout` one of `LAYOUTS`."""
    if shape is None:
        expected = (
            "the camera's rows and columns (--camera), or a region 0:rows,0:columns in frames.csv, which `visaug frames "
            "--resolution` writes"
        )
        problem = "a .raw file does not contain its size"
        raise InputError(problem, file=path, field="resolution", expected=expected)
    rows, columns = shape
    form = LAYOUTS[layout]
    size, found = _bytes(form, rows * columns), _size(path)
    if found != size:
        what = "is truncated" if found < size else "is too long"
        expected = f"{size} bytes for {rows} x {columns} pixels of {form.bits} bits"
        raise InputError(f"{what}: {found} bytes", file=path, expected=expected)
    groups = np.fromfile(path, np.uint8).reshape(-1, form.size)
    return form.unpack(groups).reshape(-1)[: rows * columns].reshape(rows, columns)


def check_size(path: Path, shape: tuple[int, int]) -> None:
    """Refuse a file that has the size of no layout for this shape."""
    size, (rows, columns) = _size(path), shape
    if all(_bytes(form, rows * columns) != size for form in LAYOUTS.values()):
        problem = f"{size} bytes are no frame of {rows} x {columns} pixels"
        expected = f"{2 * rows * columns} bytes for pixels of 16 bits, or the resolution of the file"
        raise InputError(problem, file=path, field="resolution", expected=expected)


def guess_layout(path: Path, shape: tuple[int, int] | None) -> str:
    """The layout of the file's size in which neighbours are most alike; little endian, as GenICam has it, where both orders of 16
    bits fit, and where no layout has that size. Mono10Packed is known by its free bits.

    Pixels unpacked in a wrong way have their coarsest bits among their finest, so neighbours differ far more.
    """
    size, count = _size(path), None if shape is None else shape[0] * shape[1]
    fitting = [n for n, f in LAYOUTS.items() if count is not None and _bytes(f, count) == size]
    if not fitting or fitting[0] == "little":
        fitting = list(BYTE_ORDERS)
    data = np.fromfile(path, np.uint8, count=30 * 2**16)  # a whole number of groups of any size
    best, least = fitting[0], float("inf")
    for name in fitting:
        form = LAYOUTS[name]
        groups = data[: len(data) // form.size * form.size].reshape(-1, form.size)
        if name == "mono10packed":
            # Ten bits leave these four free in every middle byte, which noise of twelve bits never does.
            return best if (groups[:, 1] & 0b11001100).any() else name
        pixels = form.unpack(groups).reshape(-1).astype(np.int64) / 2.0**form.bits
        unlike = float(np.abs(np.diff(pixels)).mean()) if pixels.size > 1 else 0.0
        if unlike < least:
            best, least = name, unlike
    return best


def unused_low_bits(pixels: np.ndarray) -> int:
    """How many low bits are 0 in every pixel (16 where all pixels are 0); 0 of pixels that are no whole numbers by their type."""
    if pixels.dtype.kind not in "ui":
        return 0
    used = int(np.bitwise_or.reduce(pixels, axis=None))
    return 16 if used == 0 else (used & -used).bit_length() - 1


def _bytes(form: _Layout, count: int) -> int:
    return -(-count // form.pixels) * form.size


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        raise InputError("no such file", file=path) from None
