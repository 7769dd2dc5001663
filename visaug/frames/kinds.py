"""The kind of a frame, and whether it is a master, from a word in a header, a table or a file name."""

from __future__ import annotations

import re
from functools import lru_cache

# A flat dark is a dark frame of a flat's exposure, so darks are looked for before flats.
_WORDS = (
    ("bias", ("bias", "biases", "zero", "zeros", "offset", "offsets")),
    ("dark", ("dark", "darks", "darkflat", "flatdark", "darkflats", "flatdarks", "darkframe")),
    ("flat", ("flat", "flats", "flatfield", "flatfields", "domeflat", "skyflat", "twilight", "bright")),
    ("scene", ("scene", "scenes", "light", "lights", "object", "science")),
    ("image", ("image", "images", "picture", "pictures")),
)
_MASTER = ("master", "combined", "stacked", "averaged", "superbias", "superdark", "superflat")
_TYPED = {"superbias": "bias", "superdark": "dark", "superflat": "flat"}


@lru_cache(1000)  # a table contains few different words
def kind_of(text: str) -> str | None:
    """The kind that `text` names (``Bias Frame``, ``DOME FLAT``, ``zero``), None where it names none.

    Examples:
        >>> kind_of("Flat Dark"), kind_of("masterbias_2"), kind_of("lamp")
        ('dark', 'bias', None)
    """
    words = _words(text)
    for kind, known in _WORDS:
        if any(word in known for word in words):
            return kind
    return None


@lru_cache(1000)
def is_master(text: str) -> bool:
    """Whether `text` names a frame that was combined from several exposures."""
    return any(word in _MASTER for word in re.findall("[a-z]+", _split_master(text)))


def _words(text: str) -> list[str]:
    """Words in lower case; ``bias001`` and ``masterBias`` give ``bias``."""
    found = re.findall("[a-z]+", _split_master(text))
    return [*found, *(_TYPED[word] for word in found if word in _TYPED)]


def _split_master(text: str) -> str:
    return re.sub("master", " master ", text.lower())
