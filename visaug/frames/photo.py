"""Raw photographs (DNG, CR2, CR3, NEF, ARW, ...): the sensor's own values through LibRaw (extra `raw`)."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.frames.limits import check_shape
from visaug.frames.record import MOSAICS

SUFFIXES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".rw2", ".raf", ".pef")


def read_photo(path: Path) -> np.ndarray:
    """(H, W) values as the converter gave them, black level included, masked borders cut off."""
    with _opened(path) as raw:
        return np.array(raw.raw_image_visible)


def describe_photo(path: Path) -> dict[str, Any]:
    """Mosaic at the visible pixel (0, 0), None where it is none of 2 x 2, and bits of the white level."""
    with _opened(path) as raw:
        letters = raw.color_desc.decode("ascii", "replace")
        colours = np.asarray(raw.raw_colors_visible[:2, :2]).ravel()
        pattern = "".join(letters[c] for c in colours if c < len(letters))
        white = int(raw.white_level)
    return {"bayer": pattern if pattern in MOSAICS else None, "bit_depth": white.bit_length() or None}


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    with extra(path):
        import rawpy
    try:
        with rawpy.imread(str(path)) as raw:
            sizes = raw.sizes
            check_shape((sizes.raw_height, sizes.raw_width), path)
            if raw.raw_image_visible.ndim != 2:
                raise InputError("holds several colours per pixel", file=path, expected="one value per pixel")
            yield raw
    except InputError:
        raise
    except Exception as error:  # LibRaw raises many kinds
        said = error.args[0] if error.args else error
        said = said.decode("ascii", "replace") if isinstance(said, bytes) else error
        raise InputError(f"cannot be read ({said}); truncated, or not a raw photograph", file=path) from None
