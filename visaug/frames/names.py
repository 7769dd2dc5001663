"""Conditions of a frame from the names of its folders and file: ``darks/dark_2s_20C_003.tif``."""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import Any

from visaug.frames.kinds import is_master, kind_of

_NUMBER = r"(?<![\d.,])(?P<value>\d+(?:[.,p]\d+)?)"
_END = r"(?![a-z0-9])"
_UNITS = {"us": 1e-6, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0, "min": 60.0}
_EXPOSURE = re.compile(_NUMBER + r"\s?(?P<unit>us|µs|ms|sec|s|min)" + _END)
_TEMPERATURE = re.compile(r"(?P<sign>-?)" + _NUMBER + r"\s?(?:degc|deg|°c|c)" + _END)
_DECIBELS = re.compile(r"(?P<sign>-?)" + _NUMBER + r"\s?db" + _END)
_PHOTONS = re.compile(_NUMBER + r"\s?(?:ph|photons?)" + _END)
_BITS = re.compile(r"(?<![\d.,a-z])(\d{1,2})\s?-?bits?" + _END)
_SETTING = re.compile(r"(?<![a-z])(gain|offset|iso)[_-]?(\d+)" + r"(?![\d.,]*\s?db)(?![\d])")
_WAVELENGTH = re.compile(r"(?<![\d.,])(\d{3,4})\s?nm" + _END)


def facts_of_name(name: str) -> dict[str, Any]:
    """Conditions by the fields of `FrameRecord`, from a relative path; unknown ones are absent.

    The file's own name wins over its folder's, the nearer folder over the farther. A minus sign counts where no
    letter or digit stands before it: ``dark_-10C`` is below zero; of ``dark-10C``, where the sign may be a dash,
    no temperature is read.

    Examples:
        >>> facts_of_name("darks/2s_-10C/003.fits")
        {'kind': 'dark', 'exposure_s': 2.0, 'temperature_c': -10.0}
    """
    parts = [*PurePath(name).parent.parts, _stem(PurePath(name).name)]
    found: dict[str, Any] = {}
    for part in parts:  # later ones, nearer to the file, replace
        found.update(_of_part(part.lower()))
    return found


def _stem(file: str) -> str:
    """``dark_0.5s`` of ``dark_0.5s.fits.fz``: known endings alone are cut, for a dot may be a decimal point."""
    return re.sub(r"(\.(fits?|fts|fz|gz|tiff?|ome|npy|npz|png|jpe?g|raw|h5|hdf5?|dng|cr[23]|nef|arw|pgm|bmp))+$", "",
                  file, flags=re.IGNORECASE)  # fmt: skip


def _of_part(part: str) -> dict[str, Any]:
    facts: dict[str, Any] = {}
    kind = kind_of(part)
    if kind not in (None, "image"):  # a folder "images" may contain frames of any kind
        facts["kind"] = kind
    if is_master(part):
        facts["combined"] = 0
    if match := _EXPOSURE.search(part):
        facts["exposure_s"] = round(_value(match) * _UNITS[match["unit"]], 12)
    for pattern, field in ((_TEMPERATURE, "temperature_c"), (_DECIBELS, "gain_db")):
        if (match := pattern.search(part)) and (value := _signed(match, part)) is not None:
            facts[field] = value
    if match := _PHOTONS.search(part):
        facts["photons"] = _value(match)
    if match := _BITS.search(part):
        facts["bit_depth"] = int(match[1])
    if match := _WAVELENGTH.search(part):
        facts["filter"] = f"{match[1]} nm"
    if settings := [f"{word.upper()}={value}" for word, value in _SETTING.findall(part)]:
        facts["setting"] = " ".join(settings)
    return facts


def _value(match: re.Match) -> float:
    return float(re.sub("[,p]", ".", match["value"]))


def _signed(match: re.Match, part: str) -> float | None:
    if not match["sign"]:
        return _value(match)
    before = part[: match.start()]
    return None if before and before[-1].isalnum() else -_value(match)
