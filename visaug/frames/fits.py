"""FITS: conditions of the frames from the headers of a file, and their pixels.

Keywords: the FITS standard 4.0 (Pence et al., A&A 524 (2010) A42), the conventions of NOAO/IRAF mosaics (DETSEC,
TRIMSEC, BIASSEC) and of amateur programs (MaxIm DL, N.I.N.A., INDI: GAIN, OFFSET, READOUTM, BAYERPAT, CCD-TEMP).
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug.frames.kinds import is_master, kind_of
from visaug.frames.limits import check_shape
from visaug.frames.record import MOSAICS, Window
from visaug.frames.table import iso_seconds

SUFFIXES = (".fits", ".fit", ".fts", ".fits.fz", ".fit.fz", ".fits.gz", ".fit.gz", ".fts.gz")
_KIND = ("IMAGETYP", "OBSTYPE", "FRAME", "FRAMETYP", "IMAGTYPE")
_EXPOSURE = ("EXPTIME", "EXPOSURE", "EXP_TIME")
_TEMPERATURE = ("CCD-TEMP", "CCD_TEMP", "CCDTEMP", "DET-TEMP", "SET-TEMP")
_SETTING = ("GAIN", "OFFSET", "READOUTM", "READMODE", "ISOSPEED")
_FILTER = ("FILTER", "FILTER1", "INSFILTE")
_COMBINED = ("NCOMBINE", "STACKCNT", "NIMAGES")
_BITS = ("BITDEPTH", "ADCBITS")
_NO_FRAMES = ("MASK", "UNCERT", "DQ", "ERR", "VAR", "WHT", "WGT", "PSFIMAGE")  # parts beside the pixels


@dataclass(frozen=True)
class Layout:
    """How the pixels of one FITS image become a frame.

    Attributes:
        kept: rows and columns that see light (TRIMSEC), None for all.
        overscan: text of BIASSEC where the file has one.
        flipped: whether rows, columns run against the detector's (a DETSEC that falls).
        window: where the frame lies on the detector, None where it is all of it.
    """

    kept: Window | None
    overscan: str
    flipped: tuple[bool, bool]
    window: Window | None


def fits_frames(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Every frame of a file as (name behind ``#``, facts of its header); a plain file has one, named ``""``.

    The slices of a cube are ``[0]``, ``[1]``; the images of several extensions carry the extension's name.

    Raises:
        InputError: not readable, without an image, or a header whose cells make no sense.
    """
    found = []
    with _opened(path) as units:
        images = _images(units, path)
        for unit in images:
            key = "" if len(images) == 1 else _name(unit, units)
            header = _whole_header(units, unit)
            facts = _facts(header, path)
            if key:
                facts["setting"] = " ".join(filter(None, (facts.get("setting"), f"AMP={key}")))
                facts["amplifier"] = key
            layout = _layout(header, unit.shape)
            facts["window"], facts["overscan"] = layout.window, layout.overscan
            if len(unit.shape) == 2 or unit.shape[:-2] == (1,):
                found.append((key, facts))
            elif len(unit.shape) == 3:
                found += [(f"{key}[{i}]", dict(facts)) for i in range(unit.shape[0])]
            else:
                raise InputError(f"has shape {unit.shape}", file=path, expected="an image or a stack of them")
    return found


def read_fits(path: Path, key: str | None = None, index: tuple[int, ...] = ()) -> np.ndarray:
    """Pixels of one image, scaled by BZERO and BSCALE, overscan cut off, in the detector's directions.

    Args:
        path: the file.
        key: name or number of the extension; needed where several hold images.
        index: which slice of a cube.
    """
    with _opened(path) as units:
        images = _images(units, path)
        chosen = [u for u in images if key is None or key in (_name(u, units), str(_number(u, units)))]
        if len(chosen) != 1:
            names = ", ".join(_name(u, units) for u in images)
            raise InputError(
                f"holds no image {key!r}" if key else "holds several images",
                file=path,
                expected=f"one of {names} after a #",
            )
        unit = chosen[0]
        layout = _layout(_whole_header(units, unit), unit.shape)
        if len(index) > max(len(unit.shape) - 2, 0) or any(
            not 0 <= i < n for i, n in zip(index, unit.shape, strict=False)
        ):
            raise InputError(f"index {list(index)} is outside shape {unit.shape}", file=path)
        check_shape([int(n) for n in unit.shape[len(index) :]], path)
        data = unit.section[index] if index else unit.data
        pixels = np.asarray(data)
    if layout.kept is not None:
        r0, r1, c0, c1 = layout.kept
        pixels = pixels[..., r0:r1, c0:c1]
    pixels = pixels[..., :: -1 if layout.flipped[0] else 1, :: -1 if layout.flipped[1] else 1]
    return pixels.astype(pixels.dtype.newbyteorder("="), copy=False)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    from astropy.io import fits

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of missing padding; missing pixels raise
            with fits.open(path, memmap=False) as units:
                yield units
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("no such file", file=path) from None
    except Exception as error:  # astropy raises many kinds for damaged files
        raise InputError(f"cannot be read ({error}); truncated, or not a FITS file", file=path) from None


def _images(units: Any, path: Path) -> list[Any]:
    """The units that hold frames: no masks, uncertainties, tables or thumbnails in colour."""
    found = [
        u
        for u in units
        if u.is_image
        and u.header.get("NAXIS", 0) >= 2
        and u.name.upper() not in _NO_FRAMES
        and all(n > 0 for n in u.shape)
    ]
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


def _facts(header: Any, path: Path) -> dict[str, Any]:
    kind_text = next((str(header[k]).strip() for k in _KIND if str(header.get(k, "")).strip()), "")
    facts: dict[str, Any] = {"kind": kind_of(kind_text), "kind_text": kind_text}
    facts["exposure_s"] = _float(header, path, *_EXPOSURE)
    facts["temperature_c"] = _float(header, path, *_TEMPERATURE)
    facts["gain_db"] = _float(header, path, "GAIN_DB", "GAINDB")
    facts["photons"] = _float(header, path, "PHOTONS")
    settings = [f"{k}={_plain(header[k])}" for k in _SETTING if str(header.get(k, "")).strip()]
    settings += [
        f"{k}={_plain(header[k])}" for k in ("XBINNING", "YBINNING") if header.get(k, 1) not in (1, "1")
    ]
    facts["setting"] = " ".join(settings) or None
    if facts["kind"] in ("flat", "scene"):
        facts["filter"] = next(
            (str(header[k]).strip() for k in _FILTER if str(header.get(k, "")).strip()), None
        )
    count = _float(header, path, *_COMBINED)
    facts["combined"] = int(count) if count and count > 1 else 0 if is_master(kind_text) else 1
    facts["bayer"] = _mosaic(header)
    bits = _float(header, path, *_BITS)
    facts["bit_depth"] = int(bits) if bits else None
    facts["time_s"] = iso_seconds(str(header.get("DATE-OBS", "")))
    return facts


def _plain(value: Any) -> str:
    """A header's value as one word; 120 and 120.0 are one setting."""
    if isinstance(value, float) and value == int(value):
        value = int(value)
    return "_".join(str(value).split())


def _float(header: Any, path: Path, *names: str) -> float | None:
    for name in names:
        if header.get(name) not in (None, "") and not _undefined(header[name]):
            try:
                return float(header[name])
            except (TypeError, ValueError):
                raise InputError(f"{header[name]!r} is not a number", file=path, field=name) from None
    return None


def _undefined(value: Any) -> bool:
    return type(value).__name__ == "Undefined"


def _mosaic(header: Any) -> str | None:
    """Colours at the image's own pixel (0, 0), from BAYERPAT and the offsets XBAYROFF, YBAYROFF."""
    pattern = str(header.get("BAYERPAT", "")).strip().upper()
    if pattern not in MOSAICS:
        return None
    rows = np.array(list(pattern)).reshape(2, 2)
    for axis, key in ((1, "XBAYROFF"), (0, "YBAYROFF")):
        try:
            rows = np.roll(rows, -int(header.get(key, 0)), axis)
        except (TypeError, ValueError):
            continue
    return "".join(rows.ravel())


def _section(text: Any) -> tuple[Window, tuple[bool, bool]] | None:
    """``[x0:x1,y0:y1]``, counted from 1, as rows and columns; and whether rows, columns fall."""
    match = re.fullmatch(r"\s*\[\s*(\d+):(\d+)\s*,\s*(\d+):(\d+)\s*\]\s*", str(text))
    if match is None:
        return None
    x0, x1, y0, y1 = (int(n) for n in match.groups())
    window = (min(y0, y1) - 1, max(y0, y1), min(x0, x1) - 1, max(x0, x1))
    return window, (y0 > y1, x0 > x1)


def _layout(header: Any, shape: tuple[int, ...]) -> Layout:
    height, width = shape[-2:]
    trim = _section(header.get("TRIMSEC")) or _section(header.get("DATASEC"))
    kept = None
    if trim is not None:
        r0, r1, c0, c1 = trim[0]
        if r1 <= height and c1 <= width and (r1 - r0, c1 - c0) != (height, width):
            kept = trim[0]
            height, width = r1 - r0, c1 - c0
    place = _section(header.get("DETSEC"))
    window, flipped = None, (False, False)
    if place is not None and (place[0][1] - place[0][0], place[0][3] - place[0][2]) == (height, width):
        whole = _section(header.get("DETSIZE"))
        window, flipped = (None if whole is not None and whole[0] == place[0] else place[0]), place[1]
    elif place is None:
        window = _subframe(header, height, width)
    return Layout(kept, str(header.get("BIASSEC", "")).strip(), flipped, window)


def _subframe(header: Any, height: int, width: int) -> Window | None:
    """The window of a camera program's subframe (XORGSUBF, YORGSUBF, in pixels as binned)."""
    try:
        column, row = int(header.get("XORGSUBF", 0)), int(header.get("YORGSUBF", 0))
    except (TypeError, ValueError):
        return None
    return (row, row + height, column, column + width) if (row > 0 or column > 0) else None
