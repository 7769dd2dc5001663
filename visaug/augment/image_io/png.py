"""PNG: what Pillow would drop or cut. Chunks beside the pixels are carried over as they are."""

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from visaug.augment.image_io.picture import Hints, Picture, three_axes
from visaug.augment.image_io.pillow import exif_space
from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.frames.limits import check_shape, pillow_image

SIGNATURE = b"\x89PNG\r\n\x1a\n"
KORNIA_MODES = {1: "mono", 3: "rgb", 4: "rgba"}
OF_THE_PIXELS = {b"sBIT", b"bKGD", b"tRNS"}  # right only while depth and colour type stay
KEPT = {b"cHRM", b"cICP", b"cLLI", b"gAMA", b"iCCP", b"mDCV", b"sRGB", b"pHYs", b"eXIf", b"tEXt", b"zTXt", b"iTXt",
        b"tIME"}  # fmt: skip


class ColourType(IntEnum):
    """Colour types of the header chunk (PNG, 6.1)."""

    GRAY = 0
    COLOUR = 2
    PALETTE = 3
    GRAY_ALPHA = 4
    COLOUR_ALPHA = 6


def read_png(path: Path) -> Picture:
    content = path.read_bytes()
    chunks = list(_chunks(content))
    found = dict(reversed(chunks))  # the first of each name
    if not content.startswith(SIGNATURE) or len(found.get(b"IHDR", b"")) < 13:
        raise ValueError("no PNG header")
    if b"acTL" in found:
        raise InputError("is an animated PNG", file=path, expected="a single picture in a file")
    depth, colour_type = found[b"IHDR"][8], found[b"IHDR"][9]
    pixels = _pixels(path, struct.unpack_from(">II", found[b"IHDR"]), depth, colour_type)
    same_kind = colour_type != ColourType.PALETTE and depth >= 8
    keep, key = None, None
    if same_kind and b"tRNS" in found:
        key = tuple(np.frombuffer(found[b"tRNS"], ">u2").tolist())
        keep = (pixels[..., : len(key)] == np.array(key)).all(-1)
    names = KEPT | OF_THE_PIXELS if same_kind else KEPT
    # Private chunks that are safe to copy when the pixels change (PNG, 5.4) have small letters but for the third.
    kept = [c for c in chunks if c[0] in names or all(c[0][k : k + 1].islower() for k in (0, 1, 3))]
    extras: dict[str, Any] = {"png_chunks": kept, "palette": colour_type == ColourType.PALETTE}
    return Picture.encoded(pixels, _hints(found), keep=keep, key=key, extras=extras)


def write_png(path: Path, picture: Picture) -> None:
    pixels = picture.pixels
    if pixels.dtype == np.uint16 and pixels.shape[2] > 1:
        with extra(path):
            import kornia_rs.io

        mode = KORNIA_MODES[pixels.shape[2]]
        kornia_rs.io.write_image_png_u16(str(path), np.ascontiguousarray(pixels), mode)
    else:
        from PIL import Image

        Image.fromarray(pixels[..., 0] if pixels.shape[2] == 1 else pixels).save(path, format="PNG")
    if kept := picture.extras.get("png_chunks", []):
        content = path.read_bytes()
        head = len(SIGNATURE) + 12 + 13  # the header chunk comes first, with 13 bytes of data
        path.write_bytes(content[:head] + b"".join(_packed(*chunk) for chunk in kept) + content[head:])


def _pixels(path: Path, size: tuple[int, int], depth: int, colour_type: int) -> np.ndarray:
    if depth == 16 and colour_type == ColourType.GRAY_ALPHA:
        expected = "one without alpha, or in colour"
        raise InputError("is a 16-bit gray PNG with alpha", file=path, expected=expected)
    in_colour = colour_type in (ColourType.COLOUR, ColourType.COLOUR_ALPHA)
    if depth == 16 and in_colour:  # Pillow would cut these to 8 bit
        with extra(path):
            import kornia_rs.io

        check_shape(size, path)
        mode = "rgb" if colour_type == ColourType.COLOUR else "rgba"
        return np.asarray(kornia_rs.io.read_image_png_u16(str(path), mode))
    with pillow_image(path, ("PNG",)) as image:
        see_through = "transparency" in image.info
        if colour_type == ColourType.PALETTE:
            image = image.convert("RGBA" if see_through else "RGB")
        elif depth < 8:
            if see_through and depth > 1:
                # Pillow scales the pixels to 8 bit, but not the level that is transparent
                image.info["transparency"] *= 255 // (2**depth - 1)
            image = image.convert("LA" if see_through else "L")
        return three_axes(np.asarray(image))


def _chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """(name, data) of each chunk but the pixels'; a torn file simply ends."""
    place = len(SIGNATURE)
    while place + 12 <= len(content):
        size, name = struct.unpack_from(">I4s", content, place)
        if name != b"IDAT":
            yield name, content[place + 8 : place + 8 + size]
        place += 12 + size


def _packed(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def _hints(found: dict[bytes, bytes]) -> Hints:
    icc = None
    if b"iCCP" in found:
        with suppress(zlib.error):
            icc = zlib.decompressobj().decompress(found[b"iCCP"].partition(b"\0")[2][1:], 1 << 24)
    gamma = struct.unpack(">I", found[b"gAMA"])[0] / 1e5 if len(found.get(b"gAMA", b"")) == 4 else None
    cicp = found[b"cICP"][1] if len(found.get(b"cICP", b"")) == 4 else None
    return Hints(icc, cicp, b"sRGB" in found, gamma, exif_space(found.get(b"eXIf")))
