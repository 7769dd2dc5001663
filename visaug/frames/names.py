"""The kind of a frame from a word, and its conditions from the names of its folders and file: ``darks/dark_2s_20C_003.tif``.

A number that can be read in two ways (``dark_3_2s``: 3.2 s, or frame 3 of 2 s) gives no condition and is named.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import PurePath
from typing import Any

from visaug.frames.units import SECONDS

# In this order: a flat dark is a dark frame of a flat's exposure, and a word that says dark or flat says more than
# bias, light or zero, which also name a voltage, a lamp or a gain (FLAT_reverse_bias_30V, flat_zero_gain).
_KIND_WORDS = (
    ("dark", re.compile(r"[a-z]*darks?(flat|frame|field)?s?")),
    ("flat", re.compile(r"[a-z]*flats?(frame|field)?s?|twilight|bright")),
    ("bias", re.compile(r"[a-z]*bias(es)?(frames?)?")),
    ("scene", re.compile(r"(scene|light|object)s?|science")),
    ("bias", re.compile(r"zeros?")),
    ("bias", re.compile(r"offsets?")),  # French and Italian programs; elsewhere a camera setting
    ("image", re.compile(r"(image|picture)s?")),
)
_MASTER = re.compile(r"master|combined|stacked|averaged|super(bias|dark|flat)")
_END = r"(?![a-z0-9])"
_NUMBER = r"(?<![\d.,])(?P<value>\d+(?:[.,p]\d+)?(?:e[-+]?\d+)?)"
_EXPOSURE = re.compile(_NUMBER + r"\s?(?P<unit>[nuµμm]?s|[um]?sec|secs|seconds|min)" + _END)
_MINUTES = re.compile(r"(?<![a-z\d.,])(\d+)\s?m(?:in)?_?(\d+(?:[.,]\d+)?)\s?s(?:ec)?" + _END)
_TEMPERATURE = re.compile(_NUMBER + r"\s?(?:degc|deg|°c|c)" + _END)
_DECIBELS = re.compile(r"(?P<sign>-?)" + _NUMBER + r"\s?db" + _END)
_PHOTONS = re.compile(_NUMBER + r"\s?(?:ph|photons?)" + _END)
_BITS = re.compile(r"(?<![\d.,a-z])(\d{1,2})\s?-?bits?" + _END)
_WAVELENGTH = re.compile(r"(?<![\d.,])(\d{3,4})\s?nm" + _END)
_SETTING = re.compile(r"(?<![a-z])(gain|offset|iso)([_=.-]?)(\d+(?:[.,]\d+)?)(?!\d)(?!\s?db)")
_DATE = re.compile(r"(?<!\d)(?:19|20)\d\d([-_.]?)[01]\d\1[0-3]\d(?!\d)")
_TIME = re.compile(r"(?<!\d)t?(?:[01]\d|2[0-3])(?P<sep>[-_:.])[0-5]\d(?P=sep)[0-5]\d(?:\.\d+)?s?(?![\d.a-z])")
# What may stand directly before a number with its unit; other letters make it part of a name (`A7s`, `QHY268C`).
_KINDS = "darks?|flats?|lights?|bias|scenes?"
_BEFORE_SECONDS = re.compile(rf"(?<![a-z])(?:{_KINDS}|t|tint|time|exp|exptime|exposure|shutter)$")
_BEFORE_CELSIUS = re.compile(rf"(?<![a-z])(?:{_KINDS}|t|temp|temperature|ccd|ccdtemp|sensor)$")
_FIRST_NUMBER = re.compile(
    r"(?:(?<![a-z0-9.,])|(?<=[^a-z]m)|(?<=[^a-z]t)|(?<=minus)|(?<=neg)|(?<=plus)|(?<=exp)|(?<=temp))(\d{1,3})([_-])$"
)
_SIGN = re.compile(r"(?<![a-z])(?:minus|neg|plus|m)_?$|[-−+]$")
_CAMERA = re.compile(r"(?:asi|zwo|qhy|qhyccd|altair|hypercam|atik|touptek|omegon|svbony|sv|playerone)[_ -]$")


@lru_cache(1000)  # a table contains few different words
def kind_of(text: str) -> str | None:
    """The kind that `text` names (``Bias Frame``, ``DOME FLAT``, ``zero``), None where it names none.

    >>> kind_of("Flat Dark"), kind_of("masterbias_2"), kind_of("lamp")
    ('dark', 'bias', None)
    """
    found = kind_and_word(text)
    return found[0] if found else None


@lru_cache(1000)
def kind_and_word(text: str, offset_is_kind: bool = True) -> tuple[str, str] | None:
    """The kind that `text` names and the word that names it; `offset_is_kind`: the word ``offset`` stands for a bias frame."""
    words = words_of(text)
    for kind, pattern in _KIND_WORDS:
        for word in words:
            if pattern.fullmatch(word) and (offset_is_kind or not word.startswith("offset")):
                return kind, word
    return None


@lru_cache(1000)
def is_master(text: str) -> bool:
    """Whether `text` names a frame that was combined from several exposures."""
    return any(_MASTER.fullmatch(word) for word in words_of(text))


def words_of(text: str) -> list[str]:
    """Words in lower case; ``bias001`` gives ``bias``, ``masterBias`` gives ``master`` and ``bias``."""
    return re.findall("[a-z]+", re.sub("master", " master ", text.lower()))


@dataclass
class Named:
    """What a name tells: conditions by the fields of `FrameRecord`, unknown ones absent; the parts of the name that gave them; and
    parts that can be read in two ways.
    """

    facts: dict[str, Any] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    unclear: list[str] = field(default_factory=list)

    def take(self, name: str, value: Any, word: str) -> None:
        self.facts[name], self.words[name] = value, word


def read_name(name: str) -> Named:
    """What a relative path tells. The file's own name wins over its folder's, the nearer folder over the farther.

    A minus sign counts where no letter or digit stands before it: ``dark_-10C`` is below zero; of ``dark-10C``, where the sign may
    be a dash, no temperature is read.

    >>> read_name("darks/2s_-10C/003.fits").facts
    {'kind': 'dark', 'exposure_s': 2.0, 'temperature_c': -10.0}
    """
    parts = _parts(name)
    found = Named()
    if kind := _kind(parts):
        found.take("kind", *kind)
    for part in parts:  # later ones, nearer to the file, replace
        _read_part(found, part.lower(), part is parts[-1])
    return found


def kind_of_name(name: str) -> str | None:
    """The kind alone."""
    kind = _kind(_parts(name))
    return kind[0] if kind else None


def _parts(name: str) -> list[str]:
    """Folders and the file without its ending, of known ones alone: in ``dark_0.5s.fits.fz`` one dot is a decimal point."""
    stem = re.sub(r"(\.(fits?|fts|fz|gz|xisf|ser|tiff?|ome|npy|npz|mat|png|jpe?g|raw|h5|hdf5?|dng|cr[23]|nef|arw|pgm|bmp))+$",
                  "", PurePath(name).name, flags=re.IGNORECASE)  # fmt: skip
    return [*PurePath(name).parent.parts, stem]


def _kind(parts: list[str]) -> tuple[str, str] | None:
    for offset_is_kind in (False, True):  # the word is a setting unless nothing else tells the kind
        for part in reversed(parts):
            if offset_is_kind and _settings(part.lower(), True).get("OFFSET"):
                continue
            kind = kind_and_word(part, offset_is_kind)
            if kind is not None and kind[0] != "image":  # a folder "images" may contain frames of any kind
                return kind
    return None


def _read_part(found: Named, part: str, is_file: bool) -> None:
    if is_master(part):
        found.facts["combined"] = 0
    part = _TIME.sub(_blank, _DATE.sub(_blank, part))
    if match := _MINUTES.search(part):
        found.take("exposure_s", 60.0 * int(match[1]) + float(match[2].replace(",", ".")), match[0])
    else:
        _first(found, "exposure_s", _EXPOSURE, part, _exposure)
    _first(found, "temperature_c", _TEMPERATURE, part, _celsius)
    _first(found, "gain_db", _DECIBELS, part, _decibels)
    if match := _PHOTONS.search(part):
        found.take("photons", _plain(match), match[0])
    if match := _BITS.search(part):
        found.take("bit_depth", int(match[1]), match[0])
    if match := _WAVELENGTH.search(part):
        found.take("filter", f"{match[1]} nm", match[0])
    if settings := _settings(part, is_file):
        found.take("setting", " ".join(f"{k}={v}" for k, v in settings.items()), part)


# the value of a match, and the part of the name that gives it
_Reader = Callable[[re.Match], tuple[float | None, str]]


def _first(found: Named, name: str, pattern: re.Pattern, part: str, read: _Reader) -> None:
    """The first match that can be read; where there is none, those that could be read in two ways."""
    unclear = []
    for match in pattern.finditer(part):
        value, word = read(match)
        if value is not None:
            found.take(name, round(value, 12), word)
            return
        unclear += [word] if word else []
    if unclear:  # the nearer name does not say it, so the farther one's value is not sure either
        found.facts.pop(name, None)
        found.words.pop(name, None)
        found.unclear += unclear


def _blank(match: re.Match) -> str:
    return "|" * len(match[0])


def _plain(match: re.Match) -> float:
    return float(re.sub("[,p]", ".", match["value"]))


def _number(match: re.Match, before: str) -> tuple[float | None, str, str]:
    """Value, its text and what stands before it, of a number that another one may precede.

    ``0_5`` and ``T25_5`` are decimal numbers, ``1_100`` and ``1-100`` fractions; the value is None where the first may be a
    running number as well (``12_5``). A first number of four digits, with leading zeros, or of a setting stands apart.
    """
    pair = _FIRST_NUMBER.search(before)
    alone = _plain(match), match[0], before
    if pair is None or re.fullmatch(r"0\d+", pair[1]) or not match["value"].isdigit():
        return alone
    head, text = before[: pair.start()], pair[0] + match[0]
    if re.search(r"(?:gain|offset|iso|bin)[_=-]$", head):
        return alone
    first, sign, second = pair[1], pair[2], match["value"]
    attached = re.search(r"[a-z+−-]$", head) is not None  # `T25_5C`, `m10_5C`: no running number
    if first == "0" or (attached and len(first) > 1 and sign == "_" and len(second) == 1):
        return float(f"{first}.{second}"), text, head
    if first == "1" and int(second) > 1 and match.groupdict().get("unit") in ("s", "sec"):
        return 1 / int(second), text, head
    return None, text, head


def _exposure(match: re.Match) -> tuple[float | None, str]:
    value, text, before = _number(match, match.string[: match.start()])
    if re.search("[a-zµμ]$", before) and not _BEFORE_SECONDS.search(before):
        return None, ""
    return None if value is None else value * SECONDS[match["unit"]], text


def _celsius(match: re.Match) -> tuple[float | None, str]:
    value, text, before = _number(match, match.string[: match.start()])
    sign = _SIGN.search(before)
    if sign is not None:
        text, before = sign[0] + text, before[: sign.start()]
        is_part = re.search("[a-z0-9]$", before) and not _BEFORE_CELSIUS.search(before)
        if sign[0] == "-" and (is_part or re.search(rf"(?:{_KINDS})$", before)):
            return None, text  # a dash or a minus
        if sign[0][0] in "-−mn" and value is not None:
            value = -value
    elif _CAMERA.search(before) or (re.search("[a-z]$", before) and not _BEFORE_CELSIUS.search(before)):
        return None, ""
    coldest_c, warmest_c = -200.0, 125.0  # of sensors that take pictures: liquid nitrogen, automotive grade 1
    return (value, text) if value is not None and coldest_c <= value <= warmest_c else (None, text)


def _decibels(match: re.Match) -> tuple[float | None, str]:
    if not match["sign"]:
        return _plain(match), match[0]
    before = match.string[: match.start()]
    return (None, match[0]) if before and before[-1].isalnum() else (-_plain(match), match[0])


def _settings(part: str, is_file: bool) -> dict[str, str]:
    """Values of gain, offset and ISO. A separate number at the end of a file's name, or with leading zeros, counts frames."""
    found = {}
    for match in _SETTING.finditer(part):
        word, separator, value = match.groups()
        padded = len(value) > 1 and value.startswith("0") and value.isdigit()
        counts = separator in ("_", "-") and (padded or (is_file and match.end() == len(part)))
        if not counts and not (word == "offset" and padded):
            found[word.upper()] = f"{float(value.replace(',', '.')):g}"
    return found
