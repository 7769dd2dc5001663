"""FITS: the images of a file, their headers and their pixels."""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError, readable
from visaug.core.extras import extra
from visaug.frames.keywords import Header
from visaug.frames.layout import layout_of
from visaug.frames.limits import check_shape, outside

SUFFIXES = (".fits", ".fit", ".fts", ".fits.fz", ".fit.fz", ".fits.gz", ".fit.gz", ".fts.gz")
_NO_FRAMES = ("MASK", "UNCERT", "DQ", "ERR", "VAR", "WHT", "WGT", "PSFIMAGE")  # parts beside the pixels


def fits_frames(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Every frame of a file as (name behind ``#``, facts of its header); a plain file has one, named ``""``.

    The slices of a cube are ``[0]``, ``[1]``; the images of several extensions carry the extension's name.
    """
    found = []
    with _opened(path) as units:
        images = _images(units, path)
        for unit in images:
            key = "" if len(images) == 1 else _name(unit, units)
            header = _whole_header(units, unit)
            facts = Header(header, {c.keyword: c.comment for c in header.cards}, path).facts()
            facts["colour"] = _colour(header, unit.shape)
            if key:
                facts["setting"] = " ".join(filter(None, (facts.get("setting"), f"AMP={key}")))
            layout_of(header, unit.shape).tell(facts)
            if len(unit.shape) == 2 or unit.shape[:-2] == (1,):
                found.append((key, facts))
            elif len(unit.shape) == 3:
                found += [(f"{key}[{i}]", {**facts, "plane": i}) for i in range(unit.shape[0])]
            else:
                raise InputError(f"has shape {unit.shape}", file=path, expected="an image or a stack of them")
    return found


def read_fits(path: Path, key: str | None, index: tuple[int, ...]) -> np.ndarray:
    """Pixels of one image, scaled by BZERO and BSCALE, overscan cut off, in the detector's directions.

    `key` is the name or number of the extension, needed where several hold images; `index` chooses a slice of a cube.
    """
    with _opened(path) as units:
        images = _images(units, path)
        chosen = [u for u in images if key is None or key in (_name(u, units), str(_number(u, units)))]
        if len(chosen) != 1:
            problem = f"holds no image {key!r}" if key else "holds several images"
            expected = f"one of {', '.join(_name(u, units) for u in images)} after a #"
            raise InputError(problem, file=path, expected=expected)
        unit = chosen[0]
        layout = layout_of(_whole_header(units, unit), unit.shape)
        there = all(0 <= i < n for i, n in zip(index, unit.shape, strict=False))
        if not there or len(index) > max(len(unit.shape) - 2, 0):
            raise outside(index, unit.shape, path)
        check_shape([int(n) for n in unit.shape[len(index) :]], path)
        pixels = layout.cut(np.asarray(unit.section[index] if index else unit.data))
    pixels = pixels[..., :: -1 if layout.flipped[0] else 1, :: -1 if layout.flipped[1] else 1]
    return pixels.astype(pixels.dtype.newbyteorder("="), copy=False)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    with extra(path):
        from astropy.io import fits

    with readable(path, "truncated, or not a FITS file"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of missing padding; missing pixels raise
        with fits.open(path, memmap=False) as units:
            yield units


def _images(units: Any, path: Path) -> list[Any]:
    """The units that hold frames: no masks, uncertainties, tables or thumbnails in colour."""
    pictures = (u for u in units if u.is_image and u.name.upper() not in _NO_FRAMES)
    found = [u for u in pictures if u.header.get("NAXIS", 0) >= 2 and all(n > 0 for n in u.shape)]
    if not found:
        raise InputError("holds no image", file=path)
    return found


def _number(unit: Any, units: Any) -> int:
    return next(n for n, u in enumerate(units) if u is unit)


def _name(unit: Any, units: Any) -> str:
    names = [u.name for u in units]
    usable = unit.name and names.count(unit.name) == 1 and not re.search(r"[\[\]#,]", unit.name)
    return unit.name if usable else str(_number(unit, units))


def _whole_header(units: Any, unit: Any) -> Any:
    """The image's header over the primary one's, which holds what the extensions have in common."""
    if unit is units[0]:
        return unit.header
    header = units[0].header.copy()
    header.update(unit.header)
    return header


def _colour(header: Any, shape: tuple[int, ...]) -> bool | None:
    """Whether three planes are red, green and blue, None where the header does not say."""
    if len(shape) != 3 or shape[0] != 3:
        return False
    axis = str(header.get("CTYPE3", "")).upper()
    return any(word in axis for word in ("RGB", "COLO", "BAND")) if axis else None
