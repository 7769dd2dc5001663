"""The warnings of the checks of the measurement model alone, for those who compare frames with a camera."""

from weakref import WeakKeyDictionary

from visaug.characterization.model_checks import CHECKS
from visaug.characterization.run import checked
from visaug.core.errors import InputError
from visaug.frames import FrameSet
from visaug.statistics.findings import Findings

_MEASURED = {"bias", "dark", "flat"}
_known: WeakKeyDictionary[FrameSet, Findings | None] = WeakKeyDictionary()


def found_by_checks(frames: FrameSet) -> Findings | None:
    """What the checks find and measure in the frames, once for a set; None without bias, dark or flat frames."""
    if frames not in _known:
        try:
            _known[frames] = checked(frames) if _MEASURED & {r.kind for r in frames.records} else None
        except InputError:  # frames that cannot be read are refused by whoever reads them next
            _known[frames] = None
    return _known[frames]


def adopt(frames: FrameSet, of: FrameSet) -> None:
    """Frames made of others keep what the checks found in these."""
    _known[frames] = found_by_checks(of)


def alarms(frames: FrameSet) -> tuple[str, ...]:
    found = found_by_checks(frames)
    words = tuple(f"{word}:" for check in CHECKS for word in check.words)
    if found is None:
        return ()
    return (*(w for w in found.warnings if w.startswith(words)), *found.apart_because)


def all_warnings(frames: FrameSet) -> tuple[str, ...]:
    """Those of reading the set, and what the checks say of it."""
    return tuple(dict.fromkeys((*frames.warnings, *alarms(frames))))
