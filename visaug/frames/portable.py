"""PGM and 16-bit PNG: the stored numbers. Pillow stretches a PGM of another maximum and cuts gray with alpha to 8 bits."""

import io
import re
import struct
import zlib
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.frames.limits import check_shape

_GAP = rb"(?:\s|#[^\n]*\n)+"
_HEAD = re.compile(
    rb"P([25])%b(\d+)%b(\d+)%b(\d{1,5})(?:#[^\n]*\n)?\s" % (_GAP, _GAP, _GAP)
)  # width, height, maximum
_HEAD_BYTES = 10_000  # comments included


def pgm_bits(path: Path) -> int | None:
    """Bits that a PGM states by its largest value, where that is 2^n - 1 and not all that its data type holds."""
    with open(path, "rb") as handle:
        top = int(_head(handle.read(_HEAD_BYTES), path)[4])
    return None if top in (255, 65535) or top & (top + 1) else top.bit_length()


def read_pgm(path: Path) -> np.ndarray:
    """(H, W) uint8 or uint16, as stored (Netpbm: P5 with the high byte first, P2 in figures)."""
    content = path.read_bytes()
    head = _head(content[:_HEAD_BYTES], path)
    width, height, top = int(head[2]), int(head[3]), int(head[4])
    check_shape((height, width), path)
    stored = np.dtype(np.uint8 if top < 256 else ">u2")
    if head[1] == b"5":
        body = content[head.end() : head.end() + width * height * stored.itemsize]
        pixels = np.frombuffer(body[: len(body) // stored.itemsize * stored.itemsize], stored)
    else:
        try:
            pixels = np.array(content[head.end() :].split()[: width * height], np.int64)
        except (ValueError, OverflowError):
            raise InputError("holds what is no number", file=path, expected="whole DN") from None
    if pixels.size < width * height:
        raise InputError(f"is truncated: {pixels.size} of {width * height} pixels", file=path)
    if pixels.size and not 0 <= pixels.min() <= pixels.max() <= top:
        expected = "at most the maximum in its head"
        raise InputError(f"holds values outside 0 to {top}", file=path, expected=expected)
    return pixels.reshape(height, width).astype(stored.newbyteorder("="))


def _head(content: bytes, path: Path) -> re.Match[bytes]:
    head = _HEAD.match(content)
    if head is None or not 0 < int(head[4]) < 65536 or max(map(len, head.group(2, 3))) > 9:
        expected = "P5 or P2 with a maximum of 1 to 65535"
        raise InputError("is no gray PGM picture", file=path, expected=expected)
    return head


def png_type(path: Path) -> tuple[int, int]:
    """Bits and colour type of a PNG (0 gray, 2 colour, 3 palette, 4 gray with alpha, 6 colour with alpha); zeros for none."""
    with open(path, "rb") as handle:
        head = handle.read(26)
    return (head[24], head[25]) if len(head) == 26 and head[:4] == b"\x89PNG" else (0, 0)


def as_eight_bit_colour(path: Path) -> io.BytesIO:
    """A 16-bit gray PNG with alpha under the head of an 8-bit one of four channels: the high and the low byte of gray, and those of
    alpha. Both have four bytes a pixel, which is all that PNG's filters depend on.
    """
    content = bytearray(path.read_bytes())
    content[24:26] = 8, 6
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    return io.BytesIO(content)
