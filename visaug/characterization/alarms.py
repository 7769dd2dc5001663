"""The warnings of the checks of the measurement model alone, for those who compare frames with a camera."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from visaug.characterization.model_checks import CHECKS
from visaug.characterization.run import checked
from visaug.core.errors import InputError
from visaug.frames import FrameSet

_MEASURED = {"bias", "dark", "flat"}
_known: WeakKeyDictionary[FrameSet, tuple[str, ...]] = WeakKeyDictionary()


def alarms(frames: FrameSet) -> tuple[str, ...]:
    """What the checks say of the frames, found once for a set; empty without bias, dark or flat frames."""
    if frames not in _known:
        words = tuple(f"{word}:" for check in CHECKS for word in check.words)
        try:
            found = checked(frames).warnings if _MEASURED & {r.kind for r in frames.records} else []
        except InputError:  # frames that cannot be read are refused by whoever reads them next
            found = []
        _known[frames] = tuple(w for w in found if w.startswith(words))
    return _known[frames]


def all_warnings(frames: FrameSet) -> tuple[str, ...]:
    """Those of reading the set, and what the checks say of it."""
    return tuple(dict.fromkeys((*frames.warnings, *alarms(frames))))
