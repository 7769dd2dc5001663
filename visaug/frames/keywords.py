"""Conditions of a frame from the keywords of its header, as FITS and XISF files have them.

Keywords: the FITS standard 4.0 (Pence et al., A&A 524 (2010) A42), the conventions of NOAO/IRAF mosaics (DETSEC,
TRIMSEC, BIASSEC, ZEROCOR), of ESO (DPR TYPE), LSST (IMGTYPE) and of amateur programs (MaxIm DL, N.I.N.A., INDI, SharpCap:
GAIN, OFFSET, READOUTM, BAYERPAT, ROWORDER, CCD-TEMP, CALSTAT, BLKLEVEL).
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug.frames.names import is_master, kind_of
from visaug.frames.table import iso_seconds
from visaug.frames.units import celsius, number_or_none, seconds

_KIND = ("IMAGETYP", "IMGTYPE", "IMAGETYPE", "OBSTYPE", "FRAME", "FRAMETYP", "IMAGTYPE", "CALTYPE", "ESO DPR TYPE", "DPR TYPE",
         "PICTTYPE")  # fmt: skip
_EXPOSURE = ("EXPTIME", "EXPOSURE", "EXP_TIME")
_MICROSECONDS = "EXPOINUS"  # ASI cameras
_TEMPERATURE = ("CCD-TEMP", "CCD_TEMP", "CCDTEMP", "DET-TEMP", "DETTEMP", "SET-TEMP")
SETTING_KEYWORDS = ("OFFSET", "BLKLEVEL", "PEDESTAL", "READOUTM", "READMODE", "ISOSPEED", "ISO", "EMGAIN", "PREAMP",
                    "GAINMODE")  # fmt: skip
_FILTER = ("FILTER", "FILTER1", "INSFILTE")
# SNAPSHOT: MaxIm DL
_COMBINED = ("NCOMBINE", "STACKCNT", "NIMAGES", "SNAPSHOT", "COADDS", "NCOADDS", "NCOADD")
_BITS = ("BITDEPTH", "ADCBITS")
_CEILING = ("DATAMAX", "SATURATE", "SATLEVEL")
_BODY = ("INSTRUME", "SERIAL", "SERIALNO", "SERIALNB", "CAMSERNO", "CAM_SN", "CAMERASN", "CAMERAID", "CAMID",
         "DETSER")  # fmt: skip
_CALIBRATED = ("ZEROCOR", "BIASCOR", "BIASCORR", "BIASSUB", "DARKCOR", "DARKCORR", "DARKSUB", "FLATCOR", "FLATCORR",
               "FLATDIV")  # fmt: skip
# PERFORM: still to be done (HST)
_NOT_DONE = {"", "F", "FALSE", "N", "NO", "0", "NONE", "OMIT", "PERFORM", "RAW", "SKIPPED", "UNCALIBRATED"}
# BUNIT of numbers that no converter gave: electrons, rates, fluxes (FITS standard 4.0, section 4.3)
_NO_CODES = re.compile(
    r"e-?|el|electrons?|photons?|ph|.*(?:jy\b|\berg|(?:/|\bper)\s*s(?:ec(?:ond)?s?)?\b|\bs(?:ec)?\^?-1).*",
    re.IGNORECASE,
)
_PER_DN = re.compile(r"(?:e-?|electrons?)\s*(?:/|per)\s*(?:adu|dn|count)", re.IGNORECASE)


@dataclass
class Header:
    """The keywords of one header, and what was said and assumed while they were read."""

    header: Mapping[str, Any]
    comments: Mapping[str, str]
    path: Path
    words: dict[str, str] = field(default_factory=dict)
    said: dict[str, str] = field(default_factory=dict)

    def facts(self) -> dict[str, Any]:
        """Facts by the fields of `FrameRecord`.

        Beside them ``words`` (the keyword that gave each field), ``said`` (what was assumed, by its word), ``body`` (which
        camera), ``calibrated`` (the keyword that says so), ``ceiling`` (the largest value, DN).
        """
        text = self.text
        facts: dict[str, Any] = {"words": self.words, "said": self.said}
        said = {name: text(name) for name in _KIND if text(name)}
        told = {name: kind for name in said if (kind := kind_of(said[name]))}
        chosen = next(iter(told or said), "")
        facts["kind"] = told.get(chosen)
        if told:
            self.words["kind"] = f"{chosen} {said[chosen]}"
        if len(set(told.values())) > 1:
            listed = ", ".join(f"{name} = {said[name]}" for name in told)
            self.said["kind_contradicted"] = f"{listed}: the first counts"
        facts["exposure_s"] = self.exposure()
        facts["temperature_c"] = self.temperature()
        facts["gain_db"] = self.number("gain_db", "GAIN_DB", "GAINDB")
        facts["photons"] = self.number("photons", "PHOTONS")
        facts["setting"] = self.setting()
        if facts["kind"] in ("flat", "scene"):
            facts["filter"] = next(filter(None, map(text, _FILTER)), None)
        count = self.number("combined", *_COMBINED)
        facts["combined"] = int(count) if count and count > 1 else 0 if is_master(said.get(chosen, "")) else 1
        bits = self.number("bit_depth", *_BITS)
        facts["bit_depth"] = int(bits) if bits else None
        ceilings = (number_or_none(self.header.get(name)) for name in _CEILING)
        facts["ceiling"] = next((value for value in ceilings if value is not None), None)
        facts["time_s"] = iso_seconds(text("DATE-OBS"))
        facts["body"] = " ".join(self.pairs(_BODY)) or None
        facts["calibrated"] = self.calibrated()
        return facts

    def text(self, name: str) -> str:
        value = self.header.get(name, "")
        return "" if type(value).__name__ == "Undefined" else str(value).strip()

    def number(self, fact: str, *names: str) -> float | None:
        for name in filter(self.text, names):
            try:
                value = float(self.header[name])
            except (TypeError, ValueError):
                raise self.no_number(name) from None
            self.words[fact] = name
            return value
        return None

    def no_number(self, name: str) -> InputError:
        return InputError(f"{self.header[name]!r} is not a number", file=self.path, field=name)

    def pairs(self, names: Iterable[str]) -> list[str]:
        """``NAME=value`` of the keywords that are there; 120 and 120.0 are one value, and a value is one word."""
        found = []
        for name in filter(self.text, names):
            value = self.header[name]
            whole = isinstance(value, float) and value == int(value)
            found.append(f"{name}={'_'.join(str(int(value) if whole else value).split())}")
        return found

    def exposure(self) -> float | None:
        names = list(filter(self.text, (*_EXPOSURE, _MICROSECONDS)))
        if not names:
            return None

        def value_of(name: str) -> float:
            unit = "us" if name == _MICROSECONDS else self.text("TIMEUNIT")
            try:
                return seconds(self.header[name], self.comments.get(name, ""), unit)
            except ValueError:
                raise self.no_number(name) from None

        value, plain = value_of(names[0]), seconds(self.header[names[0]])
        same = 0.05  # keywords that differ by more (the time with the shutter's, asked and taken) contradict each other
        if any(abs(value_of(n) - value) > same * max(abs(value), 1e-9) for n in names[1:]):
            listed = ", ".join(f"{name} = {self.text(name)}" for name in names)
            self.said["exposure_contradicted"] = f"{listed}: the first counts"
        self.words["exposure_s"] = names[0]
        if value != plain:
            self.said["exposure_unit"] = f"{names[0]} is not in seconds, as its unit says"
        return value

    def temperature(self) -> float | None:
        for name in filter(self.text, _TEMPERATURE):
            value = number_or_none(self.header[name])
            degrees, made = (None, "none") if value is None else celsius(value, self.comments.get(name, ""))
            if made == "kelvin":
                self.said["temperature_kelvin"] = f"{name} = {self.text(name)} is read as Kelvin"
            if degrees is not None:
                self.words["temperature_c"] = name
                self.said.pop("temperature_unknown", None)
                return degrees
            self.said["temperature_unknown"] = f"{name} = {self.text(name)} is no temperature of a sensor"
        return None

    def setting(self) -> str | None:
        """GAIN is no setting where its comment says electrons per DN: that is somebody's measurement."""
        names = [] if _PER_DN.search(self.comments.get("GAIN", "")) else ["GAIN"]
        names += [n for n in SETTING_KEYWORDS if n != "PEDESTAL" or number_or_none(self.header.get(n))]
        found = self.pairs(names)
        found += [p for p in self.pairs(("XBINNING", "YBINNING")) if p not in ("XBINNING=1", "YBINNING=1")]
        return " ".join(found) or None

    def calibrated(self) -> str | None:
        text = self.text
        if text("CALSTAT").upper() not in _NOT_DONE - {"F"}:  # here F says that a flat was divided
            return f"CALSTAT = {text('CALSTAT')}"
        if _NO_CODES.fullmatch(text("BUNIT")):
            return f"BUNIT = {text('BUNIT')}"
        return next((f"{k} = {text(k)}" for k in _CALIBRATED if text(k).upper() not in _NOT_DONE), None)
