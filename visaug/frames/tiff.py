"""TIFF files, opened by tifffile."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug.core.extras import extra


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """The `tifffile.TiffFile` of a file.

    Raises:
        InputError: tifffile is missing, or the file's pages follow one another in a circle.
    """
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
        raise InputError(
            "is damaged: its pages follow one another in a circle",
            file=path,
            expected="a page after the last one, or none",
        )
