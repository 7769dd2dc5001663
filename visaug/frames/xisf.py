"""XISF, the format of PixInsight and N.I.N.A. (specification 1.0): the first image of a monolithic file, as stored."""

import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from visaug.core.errors import InputError, readable
from visaug.frames.keywords import Header
from visaug.frames.layout import layout_of
from visaug.frames.limits import check_shape

SUFFIX = ".xisf"
_TYPES = {"UInt8": "u1", "UInt16": "u2", "UInt32": "u4", "Float32": "f4", "Float64": "f8"}


def xisf_frames(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """The image as (``""``, facts of its FITS keywords); of colours green alone is read."""
    image, header, comments = _head(path)
    channels, *shape = _geometry(image, path)
    facts = Header(header, comments, path).facts()
    layout_of(header, tuple(shape)).tell(facts)
    if channels > 1:
        facts["said"]["colour_planes"] = f"{channels} channels"
    return [("", facts)]


def read_xisf(path: Path) -> np.ndarray:
    """(H, W) pixels of the image, or of its green channel."""
    image, header, _ = _head(path)
    channels, rows, columns = _geometry(image, path)
    order = ">" if image.get("byteOrder") == "big" else "<"
    dtype = np.dtype(order + _TYPES[image.get("sampleFormat", "")])
    place = (image.get("location") or "").split(":")
    if place[0] != "attachment" or len(place) != 3 or not all(n.isdigit() for n in place[1:]):
        raise _other(path, "its pixels lie outside of an attachment")
    with open(path, "rb") as handle:
        handle.seek(int(place[1]))
        data = handle.read(int(place[2]))
    size = channels * rows * columns * dtype.itemsize
    packed = (image.get("compression") or "").split(":")
    if packed[0] in ("zlib", "zlib+sh"):
        try:
            data = zlib.decompressobj().decompress(data, size)
        except zlib.error as error:
            raise InputError(f"cannot be read ({error}); truncated?", file=path) from None
        if packed[0] == "zlib+sh" and len(data) == size:  # bytes of equal weight one behind the other
            data = np.frombuffer(data, np.uint8).reshape(dtype.itemsize, -1).T.tobytes()
    elif packed[0]:
        raise _other(path, f"its compression {packed[0]} is not known here")
    if len(data) != size:
        raise InputError(f"is truncated: {len(data)} of {size} bytes", file=path)
    pixels = np.frombuffer(data, dtype)
    if image.get("pixelStorage", "Planar") == "Normal":
        pixels = np.moveaxis(pixels.reshape(rows, columns, channels), -1, 0)
    pixels = pixels.reshape(channels, rows, columns)[1 if channels > 2 else 0]
    return layout_of(header, pixels.shape).cut(pixels).astype(dtype.newbyteorder("="))


def _head(path: Path) -> tuple[ElementTree.Element, dict[str, Any], dict[str, str]]:
    """The image's element, its FITS keywords and their comments."""
    most_head = 50_000_000  # bytes; an XML head with thumbnails has a few
    with readable(path, "truncated, or not an XISF file"), open(path, "rb") as handle:
        start = handle.read(16)
        length = int.from_bytes(start[8:12], "little")
        if start[:8] != b"XISF0100" or length > most_head:
            raise ValueError("no XISF head")
        text = handle.read(length).rstrip(b"\0")
        if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
            raise ValueError("a head with entities")
        root = ElementTree.fromstring(text)
    image = next((e for e in root.iter() if e.tag.endswith("}Image") or e.tag == "Image"), None)
    if image is None or image.get("sampleFormat") not in _TYPES:
        raise _other(path, "it holds no image of integers or floats")
    header: dict[str, Any] = {}
    comments: dict[str, str] = {}
    for word in (e for e in image.iter() if e.tag.endswith("FITSKeyword")):
        name = word.get("name", "")
        header[name], comments[name] = _value(word.get("value", "")), word.get("comment", "")
    return image, header, comments


def _geometry(image: ElementTree.Element, path: Path) -> tuple[int, int, int]:
    """Channels, rows, columns."""
    parts = (image.get("geometry") or "").split(":")
    if len(parts) != 3 or not all(p.isdigit() for p in parts):
        raise _other(path, f"its geometry is {image.get('geometry')}")
    columns, rows, channels = map(int, parts)
    check_shape((channels, rows, columns), path)
    return channels, rows, columns


def _value(text: str) -> Any:
    text = text.strip()
    if text.startswith("'"):
        return text.strip("'").strip()
    try:
        return float(text)
    except ValueError:
        return {"T": True, "F": False}.get(text, text)


def _other(path: Path, why: str) -> InputError:
    problem = f"is an XISF file that cannot be read: {why}"
    return InputError(problem, file=path, expected="FITS or TIFF; PixInsight and Siril write them")
