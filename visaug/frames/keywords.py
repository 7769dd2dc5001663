"""Conditions of a frame from the keywords of its header, as FITS and XISF files have them.

Keywords: the FITS standard 4.0 (Pence et al., A&A 524 (2010) A42), the conventions of NOAO/IRAF mosaics (DETSEC,
TRIMSEC, BIASSEC, ZEROCOR), of ESO (DPR TYPE), LSST (IMGTYPE) and of amateur programs (MaxIm DL, N.I.N.A., INDI, SharpCap:
GAIN, OFFSET, READOUTM, BAYERPAT, ROWORDER, CCD-TEMP, CALSTAT, BLKLEVEL).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug.frames.kinds import is_master, kind_of
from visaug.frames.table import iso_seconds
from visaug.frames.units import celsius, number_or_none, seconds

_KIND = ("IMAGETYP", "IMGTYPE", "IMAGETYPE", "OBSTYPE", "FRAME", "FRAMETYP", "IMAGTYPE", "CALTYPE", "ESO DPR TYPE", "DPR TYPE",
         "PICTTYPE")  # fmt: skip
_EXPOSURE = ("EXPTIME", "EXPOSURE", "EXP_TIME")
_MICROSECONDS = "EXPOINUS"  # ASI cameras
_TEMPERATURE = ("CCD-TEMP", "CCD_TEMP", "CCDTEMP", "DET-TEMP", "DETTEMP", "SET-TEMP")
SETTING_KEYWORDS = (
    "OFFSET",
    "BLKLEVEL",
    "PEDESTAL",
    "READOUTM",
    "READMODE",
    "ISOSPEED",
    "ISO",
    "EMGAIN",
    "PREAMP",
    "GAINMODE",
)
_FILTER = ("FILTER", "FILTER1", "INSFILTE")
_COMBINED = (
    "NCOMBINE",
    "STACKCNT",
    "NIMAGES",
    "SNAPSHOT",
    "COADDS",
    "NCOADDS",
    "NCOADD",
)  # SNAPSHOT: MaxIm DL
_BITS = ("BITDEPTH", "ADCBITS")
_CEILING = ("DATAMAX", "SATURATE", "SATLEVEL")
_BODY = (
    "INSTRUME",
    "SERIAL",
    "SERIALNO",
    "SERIALNB",
    "CAMSERNO",
    "CAM_SN",
    "CAMERASN",
    "CAMERAID",
    "CAMID",
    "DETSER",
)
_CALIBRATED = (
    "ZEROCOR",
    "BIASCOR",
    "BIASCORR",
    "BIASSUB",
    "DARKCOR",
    "DARKCORR",
    "DARKSUB",
    "FLATCOR",
    "FLATCORR",
    "FLATDIV",
)
# PERFORM: still to be done (HST)
_NOT_DONE = (
    "", "F", "FALSE", "N", "NO", "0", "NONE", "OMIT", "PERFORM", "RAW", "SKIPPED", "UNCALIBRATED",
)  # fmt: skip
# BUNIT of numbers that no converter gave: electrons, rates, fluxes (FITS standard 4.0, section 4.3)
_NO_CODES = re.compile(
    r"e-?|el|electrons?|photons?|ph|.*(?:jy\b|\berg|(?:/|\bper)\s*s(?:ec(?:ond)?s?)?\b|\bs(?:ec)?\^?-1).*",
    re.IGNORECASE,
)
_SAME_EXPOSURE = (
    0.05  # keywords that differ by more (the time with the shutter's, asked and taken) contradict each other
)
_PER_DN = re.compile(r"(?:e-?|electrons?)\s*(?:/|per)\s*(?:adu|dn|count)", re.IGNORECASE)


def header_facts(header: Mapping[str, Any], comments: Mapping[str, str], path: Path) -> dict[str, Any]:
    """Facts by the fields of `FrameRecord`.

    Beside them ``words`` (the keyword that gave each field), ``said`` (what was assumed, by its word), ``body`` (which
    camera), ``calibrated`` (the keyword that says so), ``ceiling`` (the largest value, DN).

    Raises:
        InputError: an exposure or another number that is none.
    """
    words: dict[str, str] = {}
    said: dict[str, str] = {}

    def text(name: str) -> str:
        value = header.get(name, "")
        return "" if type(value).__name__ == "Undefined" else str(value).strip()

    def number(field: str, *names: str) -> float | None:
        for name in filter(text, names):
            try:
                value = float(header[name])
            except (TypeError, ValueError):
                raise InputError(f"{header[name]!r} is not a number", file=path, field=name) from None
            words[field] = name
            return value
        return None

    facts: dict[str, Any] = {"words": words, "said": said}
    kinds = [name for name in _KIND if text(name)]
    chosen = next((name for name in kinds if kind_of(text(name))), kinds[0] if kinds else "")
    kind_text = text(chosen) if chosen else ""
    facts.update(kind=kind_of(kind_text), kind_text=kind_text)
    if facts["kind"]:
        words["kind"] = f"{chosen} {kind_text}"
    told = {f"{name} = {text(name)}": kind for name in kinds if (kind := kind_of(text(name)))}
    if len(set(told.values())) > 1:
        said["kind_contradicted"] = f"{', '.join(told)}: the first counts"
    facts["exposure_s"] = _exposure(header, comments, path, text, words, said)
    facts["temperature_c"] = _temperature(header, comments, text, words, said)
    facts["gain_db"] = number("gain_db", "GAIN_DB", "GAINDB")
    facts["photons"] = number("photons", "PHOTONS")
    facts["setting"] = _setting(header, comments, text)
    if facts["kind"] in ("flat", "scene"):
        facts["filter"] = next(filter(None, map(text, _FILTER)), None)
    count = number("combined", *_COMBINED)
    facts["combined"] = int(count) if count and count > 1 else 0 if is_master(kind_text) else 1
    bits = number("bit_depth", *_BITS)
    facts["bit_depth"] = int(bits) if bits else None
    facts["ceiling"] = next((v for n in _CEILING if (v := number_or_none(header.get(n))) is not None), None)
    facts["time_s"] = iso_seconds(text("DATE-OBS"))
    facts["body"] = " ".join(f"{k}={_plain(header[k])}" for k in _BODY if text(k)) or None
    facts["calibrated"] = _calibrated(text)
    return facts


def _exposure(
    header, comments, path: Path, text, words: dict[str, str], said: dict[str, str]
) -> float | None:
    names = [n for n in (*_EXPOSURE, _MICROSECONDS) if text(n)]
    if not names:
        return None
    name = names[0]

    def value_of(name: str) -> float:
        unit = "us" if name == _MICROSECONDS else text("TIMEUNIT")
        try:
            return seconds(header[name], comments.get(name, ""), unit)
        except ValueError:
            raise InputError(f"{header[name]!r} is not a number", file=path, field=name) from None

    value, plain = value_of(name), seconds(header[name])
    if any(abs(value_of(n) - value) > _SAME_EXPOSURE * max(abs(value), 1e-9) for n in names[1:]):
        said["exposure_contradicted"] = f"{', '.join(f'{n} = {text(n)}' for n in names)}: the first counts"
    words["exposure_s"] = name
    if value != plain:
        said["exposure_unit"] = f"{name} is not in seconds, as its unit says"
    return value


def _temperature(header, comments, text, words: dict[str, str], said: dict[str, str]) -> float | None:
    for name in filter(text, _TEMPERATURE):
        value = number_or_none(header[name])
        degrees, made = (None, "none") if value is None else celsius(value, comments.get(name, ""))
        if made == "kelvin":
            said["temperature_kelvin"] = f"{name} = {text(name)} is read as Kelvin"
        if degrees is not None:
            words["temperature_c"] = name
            said.pop("temperature_unknown", None)
            return degrees
        said["temperature_unknown"] = f"{name} = {text(name)} is no temperature of a sensor"
    return None


def _setting(header, comments, text) -> str | None:
    """GAIN is no setting where its comment says electrons per DN: that is somebody's measurement."""
    found = []
    if text("GAIN") and not _PER_DN.search(comments.get("GAIN", "")):
        found.append(f"GAIN={_plain(header['GAIN'])}")
    found += [
        f"{k}={_plain(header[k])}"
        for k in SETTING_KEYWORDS
        if text(k) and not (k == "PEDESTAL" and not number_or_none(header[k]))
    ]
    found += [
        f"{k}={_plain(header[k])}" for k in ("XBINNING", "YBINNING") if text(k) and _plain(header[k]) != "1"
    ]
    return " ".join(found) or None


def _calibrated(text) -> str | None:
    if text("CALSTAT").upper() not in set(_NOT_DONE) - {"F"}:  # here F says that a flat was divided
        return f"CALSTAT = {text('CALSTAT')}"
    if _NO_CODES.fullmatch(text("BUNIT")):
        return f"BUNIT = {text('BUNIT')}"
    return next((f"{k} = {text(k)}" for k in _CALIBRATED if text(k).upper() not in _NOT_DONE), None)


def _plain(value: Any) -> str:
    """A header's value as one word; 120 and 120.0 are one setting."""
    if isinstance(value, float) and value == int(value):
        value = int(value)
    return "_".join(str(value).split())
