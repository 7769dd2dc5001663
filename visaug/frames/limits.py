"""How large a picture may claim to be, and pictures opened by Pillow and tifffile within these limits.

A file of a few bytes can claim any size. Above the limit it is refused before memory is asked for; VISAUG_MAX_PIXELS raises
the limit for sensors that are larger.
"""

import os
import struct
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from math import prod
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from visaug.core.errors import InputError
from visaug.core.extras import extra

if TYPE_CHECKING:
    from PIL.Image import Image

_lower: ContextVar[tuple[int, str] | None] = ContextVar("lower", default=None)
MAX_PIXELS = 500_000_000  # above the largest sensors that are sold, of 411 million
VARIABLE = "VISAUG_MAX_PIXELS"
PILLOW_FORMATS = ("PNG", "JPEG", "BMP", "PPM")
_pillow = threading.Lock()  # Pillow's own limit is a global


def max_pixels() -> int:
    """The largest number of values in one picture."""
    given = os.environ.get(VARIABLE)
    if given is None:
        return MAX_PIXELS
    if not given.isascii() or not given.isdigit() or len(given) > 15 or int(given) < 1:
        raise InputError(f"{given!r} is not a limit", field=VARIABLE, expected="a whole number of pixels")
    return int(given)


def check_axes(shape: Sequence[int], file: Path | str) -> None:
    """Refuse a shape with an axis that is not a positive whole number."""
    if not all(type(n) is int and n > 0 for n in shape):
        raise InputError(f"has shape {tuple(shape)}", file=file, expected="axes of 1 or more")


Index = tuple[int | slice, ...]  # of an array, its leading axes first; a slice takes an axis whole


def chosen_array(names: Sequence[str], key: str | None, file: Path, what: str) -> str:
    """The array that is asked for, or the only one in a file; `what` it is called there."""
    name = key or (names[0] if len(names) == 1 else None)
    if name is None or name not in names:
        problem = f"holds no {what} {key!r}" if key else f"holds several {what}s"
        raise InputError(problem, file=file, expected=f"one of {', '.join(names[:20])} after a #")
    return name


def outside(index: Index, shape: Sequence[int], file: Path) -> InputError:
    """The error of an index that a shape does not have."""
    return InputError(f"index {list(index)} is outside shape {tuple(shape)}", file=file)


def check_numbers(dtype: np.dtype, file: Path | str, field: str | None = None) -> None:
    """Refuse pixels that are no real numbers."""
    if dtype.kind not in "uif":
        raise InputError(f"holds {dtype}", file=file, field=field, expected="integers or floats in DN")


def check_index(index: Index, shape: Sequence[int], file: Path | str, key: str | None) -> None:
    """Refuse an index outside an array of this shape."""
    wrong = any(isinstance(i, int) and not 0 <= i < n for i, n in zip(index, shape, strict=False))
    if wrong or len(index) > len(shape):
        said = [":" if isinstance(i, slice) else i for i in index]
        raise InputError(f"index {said} is outside the array of shape {tuple(shape)}", file=file, field=key)


def check_shape(shape: Sequence[int], file: Path | str) -> None:
    """Refuse a shape that is none, or has more values than `max_pixels`, or pixels than `lower_limit` allows."""
    check_axes(shape, file)
    lower = _lower.get()
    if lower is not None and prod(sorted(shape)[-2:]) > lower[0]:
        raise InputError(f"has {shape[0]} x {shape[1]} pixels", file=file, expected=lower[1])
    if prod(shape) > max_pixels():
        expected = f"at most {max_pixels()}; set {VARIABLE} to read larger pictures"
        raise InputError(f"claims {' x '.join(map(str, shape))} values", file=file, expected=expected)


@contextmanager
def lower_limit(pixels: int, expected: str) -> Iterator[None]:
    """Pictures of more pixels are refused inside by what their heads say; `expected` is what the message says was expected."""
    token = _lower.set((pixels, expected))
    try:
        yield
    finally:
        _lower.reset(token)


@contextmanager
def pillow_image(
    path: Path, formats: tuple[str, ...] = PILLOW_FORMATS, content: IO[bytes] | None = None
) -> "Iterator[Image]":
    """An opened picture of one of the formats, its size checked and its pixels not yet read; `content` replaces the file's."""
    from PIL import Image

    with _pillow:
        before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            image = Image.open(path if content is None else content, formats=formats)
        finally:
            Image.MAX_IMAGE_PIXELS = before
    with image:
        check_shape((image.height, image.width), path)
        yield image


@contextmanager
def opened_tiff(path: Path) -> Iterator[Any]:
    """The `tifffile.TiffFile` of a file; one whose pages follow one another in a circle is refused."""
    with extra(path):
        import tifffile

    with tifffile.TiffFile(path) as file:
        _check_pages(file, path)
        yield file


def _check_pages(file: Any, path: Path) -> None:
    """Each page names the place of the next; tifffile follows a circle until memory is full."""
    tiff, handle = file.tiff, file.filehandle
    seen: set[int] = set()
    try:
        at = file.pages.first.offset
        while 0 < at < handle.size and at not in seen:
            seen.add(at)
            handle.seek(at)
            (tags,) = struct.unpack(tiff.tagnoformat, handle.read(tiff.tagnosize))
            if tags > 4096:  # tifffile takes a page with more for the end of the file
                return
            handle.seek(tags * tiff.tagsize, 1)
            (at,) = struct.unpack(tiff.offsetformat, handle.read(tiff.offsetsize))
    except (IndexError, struct.error, OSError):
        return  # there is no page, or the file ends before the chain, as tifffile notices
    if at in seen:
        problem = "is damaged: its pages follow one another in a circle"
        raise InputError(problem, file=path, expected="a page after the last one, or none")
