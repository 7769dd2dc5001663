"""Conditions of frames from the headers of files of every format, without reading the pixels."""

import json
import re
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError, readable
from visaug.frames import fits, pixels, portable, ser, xisf
from visaug.frames.arrays import arrays_in
from visaug.frames.limits import opened_tiff, pillow_image
from visaug.frames.names import kind_of, read_name
from visaug.frames.photo import describe_photo

Facts = dict[str, Any]


def frames_of(path: Path) -> list[tuple[str, Facts]]:
    """Every frame of a file as (name behind ``#``, facts); ``""`` where the file is one frame."""
    suffix = pixels.suffix_of(path)
    for suffixes, read in (
        ((".pgm",), lambda path: [("", {"bit_depth": portable.pgm_bits(path)})]),
        (pixels.FITS, fits.fits_frames),
        ((xisf.SUFFIX,), xisf.xisf_frames),
        ((ser.SUFFIX,), ser.ser_frames),
        (pixels.TIFFS, _tiff),
        (pixels.PHOTOS, _photo),
        (pixels.PICTURES, _exif_of_picture),
        ((*pixels.ARRAYS, *pixels.HDF5), _arrays),
    ):
        if suffix in suffixes:
            return read(path)
    return [("", {})]


def _tiff(path: Path) -> list[tuple[str, Facts]]:
    with readable(path, "truncated, or not a TIFF file"), opened_tiff(path) as file:
        series = file.series[0]
        if _end_of_pixels(series) > file.filehandle.size:
            raise ValueError("pixels beyond its end")
        facts = _exif(_tags(file.pages[0]))
        for text in (file.ome_metadata, file.micromanager_metadata):
            facts.update(_microscope(text))
        shape, axes = series.shape, series.axes
        if "S" in axes and shape[axes.index("S")] > 2:
            facts["said"] = {"colour_planes": f"{shape[axes.index('S')]} samples a pixel"}
    # Rows, columns and colour are the frame; frames run along the other axes, of which channels (several cameras, or
    # colours of the light) are no repetition.
    outer = [(axis, n) for axis, n in zip(axes, shape, strict=True) if axis not in "YXS"]
    if len(shape) - len(outer) - axes.count("S") != 2:
        raise InputError(f"has shape {shape}", file=path, expected="one frame, or one stack of frames")
    if all(n == 1 for _, n in outer):
        return [("", facts)]
    found = []
    for index in np.ndindex(*(n for _, n in outer)):
        places = zip(index, outer, strict=True)
        channels = [f"CHANNEL={i}" for i, (axis, n) in places if axis == "C" and n > 1]
        setting = " ".join(filter(None, (facts.get("setting"), *channels)))
        found.append((f"[{','.join(map(str, index))}]", facts | ({"setting": setting} if setting else {})))
    return found


def _end_of_pixels(series: Any) -> int:
    """Where the pixels end in the file, in bytes; where they do not lie in one piece, those of the first and the last page."""
    if series.dataoffset is not None:
        return series.dataoffset + series.nbytes
    pages = [page for page in (series.pages[0], series.pages[-1]) if page is not None]
    parts = [part for page in pages for part in zip(page.dataoffsets, page.databytecounts, strict=False)]
    return max((offset + count for offset, count in parts), default=0)


def _tags(page: Any) -> dict[str, Any]:
    """EXIF fields of a TIFF page: its own tags and those of its EXIF directory."""
    tags = {tag.name: tag.value for tag in page.tags if tag.count < 1000}
    exif = tags.pop("ExifTag", None)
    return {**tags, **exif} if isinstance(exif, dict) else tags


def _photo(path: Path) -> list[tuple[str, Facts]]:
    """A raw photograph: exposure and ISO from EXIF (most raw formats are TIFF files), mosaic and bits from the raw data."""
    facts: Facts = {}
    with (
        suppress(Exception),
        opened_tiff(path) as file,
    ):  # EXIF of CR3, a format of its own, cannot be read; the rest can
        facts = _exif(_tags(file.pages[0]))
    return [("", {**facts, **describe_photo(path)})]


def _exif_of_picture(path: Path) -> list[tuple[str, Facts]]:
    from PIL import ExifTags

    with readable(path, "truncated or no picture"), pillow_image(path) as picture:
        if picture.format == "PNG":
            picture.load()  # its EXIF may follow the pixels
        exif = picture.getexif()
        tags = {**exif, **exif.get_ifd(ExifTags.IFD.Exif)}
    return [("", _exif({ExifTags.TAGS.get(number, ""): value for number, value in tags.items()}))]


def _exif(tags: dict[str, Any]) -> Facts:
    """Exposure, ISO and time from EXIF fields (CIPA DC-008)."""
    facts: Facts = {}
    exposure = _ratio(tags.get("ExposureTime"))
    if exposure is not None and exposure > 0:
        facts["exposure_s"] = exposure
    iso = tags.get("ISOSpeedRatings", tags.get("PhotographicSensitivity"))
    iso = iso[0] if isinstance(iso, tuple) and iso else iso
    if isinstance(iso, int) and iso > 0:
        facts["setting"] = f"ISO={iso}"
    names = [name for name in ("Model", "BodySerialNumber") if tags.get(name)]
    if names:
        facts["body"] = " ".join(f"{name.upper()}={'_'.join(str(tags[name]).split())}" for name in names)
    text = str(tags.get("DateTimeOriginal", tags.get("DateTime", "")))
    with suppress(ValueError):
        moment = datetime.strptime(text[:19], "%Y:%m:%d %H:%M:%S").replace(tzinfo=timezone.utc)
        fraction = re.sub(r"\D", "", str(tags.get("SubsecTimeOriginal", "")))
        facts["time_s"] = moment.timestamp() + float(f"0.{fraction}0")
    return facts


def _ratio(value: Any) -> float | None:
    try:
        return round(value[0] / value[1], 12) if isinstance(value, tuple) else float(value)
    except (TypeError, ValueError, ZeroDivisionError, IndexError):  # None among others
        return None


def _microscope(found: Any) -> Facts:
    """Exposure of a microscope's TIFF: OME-XML (``ExposureTime``, its unit seconds unless told) or Micro-Manager."""
    if isinstance(found, str):
        match = re.search(r'ExposureTime="([\d.eE+-]+)"', found)
        unit = re.search(r'ExposureTimeUnit="([^"]+)"', found)
        scale = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6}.get(unit[1] if unit else "s")
        value = _ratio(match[1]) if match else None
        return {"exposure_s": value * scale} if value is not None and scale else {}
    if isinstance(found, dict):
        match = re.search(r'"Exposure-ms":\s*"?([\d.]+)', json.dumps(found, default=str))
        return {"exposure_s": float(match[1]) * 1e-3} if match else {}
    return {}


def _arrays(path: Path) -> list[tuple[str, Facts]]:
    """Arrays by name: two axes are a frame, three a stack; an HDF5 data set's attributes are facts by the names of frames.csv's
    columns.
    """
    found: list[tuple[str, Facts]] = []
    arrays = arrays_in(path)
    last = _time_is_last([shape for _, shape, _ in arrays])
    for key, shape, attributes in arrays:
        facts = read_name(key).facts if key else {}
        for name in ("exposure_s", "temperature_c", "gain_db", "photons", "bit_depth"):
            if (value := _ratio(attributes.get(name))) is not None:
                facts[name] = int(value) if name == "bit_depth" else value
        facts.update({n: str(attributes[n]) for n in ("setting", "filter", "bayer") if n in attributes})
        if "kind" in attributes:
            facts["kind"] = kind_of(str(attributes["kind"]))
        if len(shape) == 2:
            found.append((key, facts))
        elif len(shape) == 3 and last:
            facts["said"] = {"stack_axis_assumed": f"{path.name}#{key} of shape {shape}"}
            found += [(f"{key}[:,:,{i}]", dict(facts)) for i in range(shape[2])]
        elif len(shape) == 3:
            found += [(f"{key}[{i}]", dict(facts)) for i in range(shape[0])]
    return found


def _time_is_last(shapes: list[tuple[int, ...]]) -> bool:
    """Whether stacks are (rows, columns, frames), as MATLAB has them.

    Frames of one camera have one size: the arrays of a file, single frames among them, agree in two neighbouring axes. Where
    they agree in both pairs, frames lie along the first axis unless the last is the shortest.
    """
    stacks = [s for s in shapes if len(s) == 3]
    single = {s for s in shapes if len(s) == 2}
    first = len({s[1:] for s in stacks} | single) == 1
    last = len({s[:2] for s in stacks} | single) == 1
    if not stacks or first != last:
        return bool(stacks) and last
    return all(s[2] < min(s[:2]) for s in stacks)
