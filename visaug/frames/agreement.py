"""What only the frames of a folder together tell: which are colours of one picture, bodies, settings, ceilings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug.core.wording import first_of
from visaug.frames.keywords import SETTING_KEYWORDS
from visaug.frames.pixels import split_name
from visaug.frames.units import number_or_none

_SHARED = ("GAIN", *(name for name in SETTING_KEYWORDS if name != "PEDESTAL"))  # binning left out is 1

Row = dict[str, Any]


def names(rows: Sequence[Row]) -> str:
    """How many frames, and the first of their names."""
    listed = [r["file"] for r in rows]
    return f"{len(listed)} frames ({first_of(listed)})" if len(listed) > 1 else listed[0]


def agreed(rows: list[Row], folder: Path) -> tuple[list[Row], list[str]]:
    """The rows that are frames of their own, with settings and bit depth as all headers tell them, and notes."""
    notes: list[str] = []
    rows = _one_plane(rows, notes)
    rows = _raw(rows, folder, notes)
    _depth(rows)
    _settings(rows, notes)
    if len({r["_body"] for r in rows if r["_body"]}) > 1:  # two cameras in one folder are two settings
        for row in rows:
            row["setting"] = " ".join(filter(None, (row["setting"], row["_body"]))) or None
    several = sorted({r["setting"] for r in rows if r["setting"]})
    if len(several) > 1:
        notes.append(
            f"setting: frames of {len(several)} settings ({first_of(several, between='; ')}); each is a camera of its own: the "
            "one with most flats is measured, the others are excluded, so give each its own folder"
        )
    return rows, notes


def _one_plane(rows: list[Row], notes: list[str]) -> list[Row]:
    """Of red, green and blue planes green alone: they are no frames taken one after another.

    Where no header says what three planes are, they are colours if two or more files hold three each: a single
    plane of frames taken in turn loses frames, three colours taken for frames make noise of what is fixed.
    """
    planes = [r for r in rows if r["_plane"] is not None]
    stacks = {split_name(r["file"])[0]: r["_colour"] for r in planes}
    unknown = len(stacks) > 1 and all(colour in (None, True) for colour in stacks.values())
    colours = [r for r in planes if r["_colour"] or (r["_colour"] is None and unknown)]
    if not colours:
        return rows
    dropped = {id(r) for r in colours if r["_plane"] != 1}
    notes.append(
        f"colour_planes: {names([r for r in colours if r['_plane'] == 1])} hold three planes, read as red, green and blue; green "
        "alone is used. If they are exposures, list each in frames.csv (file.fits#[0])"
    )
    return [r for r in rows if id(r) not in dropped]


def _raw(rows: list[Row], folder: Path, notes: list[str]) -> list[Row]:
    done = [r for r in rows if r["_calibrated"]]
    if not done:
        return rows
    why = first_of(sorted({r["_calibrated"] for r in done}), between="; ")
    if len(done) == len(rows):
        expected = "raw frames, nothing subtracted or divided"
        raise InputError(f"all frames were calibrated already ({why})", file=folder, expected=expected)
    notes.append(
        f"calibrated_frames: {names(done)} are left out: their headers say that they were calibrated already ({why}); "
        "bring the raw frames"
    )
    return [r for r in rows if not r["_calibrated"]]


def _depth(rows: list[Row]) -> None:
    """Bits from the largest value that all headers give alike; one that differs is each frame's own maximum."""
    ceilings = {r["_ceiling"] for r in rows if r["_ceiling"] is not None}
    by_dn = {(1 << n) - 1: n for n in (8, 10, 12, 14)}  # of converters that are coarser than their files
    known = by_dn.get(ceilings.pop()) if len(ceilings) == 1 else None
    if known and all(r["bit_depth"] is None for r in rows):
        for row in rows:
            row["bit_depth"] = known
            row["_from"]["bit_depth"] = "the header's largest value"


def _settings(rows: list[Row], notes: list[str]) -> None:
    """GAIN with a fraction that scatters is a measured gain; a setting that some frames lack and the others share is theirs."""
    parts = [
        {word: value for word, _, value in (p.partition("=") for p in (r["setting"] or "").split())}
        for r in rows
    ]
    gains = [g for p in parts if (g := number_or_none(p.get("GAIN"))) is not None and g >= 0]
    same_gain = 0.02  # measured gains of one camera scatter by less; settings that differ by less are none
    is_measured = len(set(gains)) > 1 and any(g != int(g) for g in gains)
    if is_measured and max(gains) <= (1 + same_gain) * min(gains):
        notes.append(
            f"gain_measured: GAIN scatters between {min(gains):g} and {max(gains):g}; it is read as a measured gain, not as a "
            "setting"
        )
        for part in parts:
            part.pop("GAIN", None)
    filled: set[str] = set()
    for word in _SHARED:
        values = {p[word] for p in parts if word in p}
        if len(values) == 1 and not all(word in p for p in parts):
            (value,) = values
            filled.add(f"{word}={value}")
            for part in parts:
                part[word] = value
    if filled:
        notes.append(
            f"setting_assumed: some frames do not state {', '.join(sorted(filled))}, which all others share; it is taken for "
            "theirs too"
        )
    order = list(dict.fromkeys(w for p in parts for w in p))
    for row, part in zip(rows, parts, strict=True):
        row["setting"] = " ".join(f"{w}={part[w]}" if part[w] else w for w in order if w in part) or None
