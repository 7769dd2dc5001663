"""SER video of planetary cameras (Grischa Hahn's format description, version 3): every frame as stored."""

from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug.frames.limits import check_shape

SUFFIX = ".ser"
_HEAD_BYTES = 178
_MOSAICS = {8: "RGGB", 9: "GRBG", 10: "GBRG", 11: "BGGR"}


def _head(path: Path) -> tuple[int, int, tuple[int, int, int]]:
    """Colour number, bits, and (frames, rows, columns)."""
    try:
        with open(path, "rb") as handle:
            head, size = handle.read(_HEAD_BYTES), path.stat().st_size
    except OSError:
        raise InputError("no such file", file=path) from None
    if len(head) < _HEAD_BYTES or not head.startswith(b"LUCAM-RECORDER"):
        raise InputError("cannot be read (no SER head); truncated, or not a SER video", file=path)
    _, colour, _, columns, rows, bits, frames = np.frombuffer(head, "<i4", 7, 14).tolist()
    if colour not in (0, *_MOSAICS):
        expected = "a raw one, gray or a Bayer mosaic"
        raise InputError(f"is a SER video of colour type {colour}", file=path, expected=expected)
    if not 1 <= bits <= 16:
        raise InputError(f"has {bits} bits", file=path, expected="1 to 16")
    check_shape((rows, columns), path)
    if frames < 1 or _HEAD_BYTES + frames * rows * columns * (1 + (bits > 8)) > size:
        raise InputError(f"is truncated: {size} bytes for {frames} frames of {rows} x {columns}", file=path)
    return colour, bits, (frames, rows, columns)


def ser_frames(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Every frame as (name behind ``#``, facts): mosaic and bits."""
    colour, bits, shape = _head(path)
    return [(f"[{i}]", {"bayer": _MOSAICS.get(colour), "bit_depth": bits}) for i in range(shape[0])]


def read_ser(path: Path, index: tuple[int, ...]) -> np.ndarray:
    """Pixels of one frame. The head's mark of the byte order is used both ways; the one whose neighbours are more alike counts."""
    _, bits, shape = _head(path)
    if len(index) != 1 or not 0 <= index[0] < shape[0]:
        expected = "file.ser#[0]"
        raise InputError(f"index {list(index)} is outside {shape[0]} frames", file=path, expected=expected)
    if bits <= 8:
        return np.array(np.memmap(path, np.uint8, "r", _HEAD_BYTES, shape)[index[0]])
    stored = (np.memmap(path, order, "r", _HEAD_BYTES, shape)[index[0]] for order in ("<u2", ">u2"))
    orders = [np.array(frame, np.uint16) for frame in stored]
    return min(orders, key=lambda frame: float(np.abs(np.diff(frame.astype(np.int64), axis=1)).mean()))
