"""The kind of a frame, and whether it is a master, from a word in a header, a table or a file name."""

from __future__ import annotations

import re
from functools import lru_cache

# In this order: a flat dark is a dark frame of a flat's exposure, and a word that says dark or flat says more than
# bias, light or zero, which also name a voltage, a lamp or a gain (FLAT_reverse_bias_30V, flat_zero_gain).
_WORDS = (
    ("dark", re.compile(r"[a-z]*darks?(flat|frame|field)?s?")),
    ("flat", re.compile(r"[a-z]*flats?(frame|field)?s?|twilight|bright")),
    ("bias", re.compile(r"[a-z]*bias(es)?(frames?)?")),
    ("scene", re.compile(r"(scene|light|object)s?|science")),
    ("bias", re.compile(r"zeros?")),
    ("bias", re.compile(r"offsets?")),  # French and Italian programs; elsewhere a camera setting
    ("image", re.compile(r"(image|picture)s?")),
)
_MASTER = re.compile(r"master|combined|stacked|averaged|super(bias|dark|flat)")


@lru_cache(1000)  # a table contains few different words
def kind_of(text: str) -> str | None:
    """The kind that `text` names (``Bias Frame``, ``DOME FLAT``, ``zero``), None where it names none.

    Examples:
        >>> kind_of("Flat Dark"), kind_of("masterbias_2"), kind_of("lamp")
        ('dark', 'bias', None)
    """
    found = kind_and_word(text)
    return found[0] if found else None


@lru_cache(1000)
def kind_and_word(text: str, offset_is_kind: bool = True) -> tuple[str, str] | None:
    """The kind that `text` names and the word that names it.

    Args:
        text: of a header, a cell or a name.
        offset_is_kind: whether the word ``offset`` stands for a bias frame.
    """
    words = words_of(text)
    for kind, pattern in _WORDS:
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
