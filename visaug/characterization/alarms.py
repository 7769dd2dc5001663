"""The warnings of the checks of the measurement model alone, for those who compare frames with a camera."""

from __future__ import annotations

from visaug.characterization.model_checks import CHECKS
from visaug.characterization.result import Warned
from visaug.characterization.run import characterize
from visaug.core.errors import InputError
from visaug.frames import FrameSet

_MEASURED = {"bias", "dark", "flat"}


def alarms(frames: FrameSet) -> tuple[Warned, ...]:
    """What the checks say of the frames; empty where there are no bias, dark or flat frames to be checked."""
    words = {word for check in CHECKS for word in check.words}
    try:
        found = characterize(frames).warning_details if _MEASURED & {r.kind for r in frames.records} else ()
    except InputError:  # frames that cannot be read are refused by whoever reads them next
        return ()
    return tuple(w for w in found if w.word in words)


def note_alarms(frames: FrameSet) -> None:
    """Add what the checks say to the warnings of the set, which every result and page repeats."""
    frames.warnings.extend(w.text for w in alarms(frames) if w.text not in frames.warnings)
