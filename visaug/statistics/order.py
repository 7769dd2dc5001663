"""Whether the order of acquisition is known, on which effects with memory depend."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from visaug.frames import FrameRecord

SPOILED = "what a frame keeps of those before it (image_lag, rts_noise) and slow drift (black_level_drift, light_drift)"


def history_warnings(records: Sequence[FrameRecord]) -> list[str]:
    """Named warnings, each ``name: sentence``, of frames in order of ``sequence``; an empty list where the order is whole.

    ``sequence_gap``: numbers are missing. ``order_of_acquisition``: times disagree with the numbers. ``unknown_frames``: light
    of some frames between the others is not known.
    """
    found = []
    numbers = [r.sequence for r in records]
    behind = [b for a, b in pairwise(numbers) if b != a + 1]
    if behind:
        missing = numbers[-1] - numbers[0] + 1 - len(numbers)
        found.append(
            f"sequence_gap: {missing} numbers are missing before the frames of sequence {_listed(behind)}; {SPOILED} are "
            "simulated as if no frame had been taken there"
        )
    times = [(r.time_s, r.sequence) for r in records if r.time_s is not None]
    early = [number for (before, _), (time, number) in pairwise(times) if time < before]
    if early:
        found.append(
            f"order_of_acquisition: frames of sequence {_listed(early)} were taken earlier than the frames before them, by "
            f"their times; {SPOILED} are simulated in the wrong order. Number the frames by their times"
        )
    dark_of = [r.sequence for r in records if r.kind == "image" or (r.kind == "scene" and not r.clean)]
    if dark_of and len(dark_of) < len(records):
        found.append(
            f"unknown_frames: nothing is known of the light of the frames of sequence {_listed(dark_of)}; what the frames "
            "after them keep of it (image_lag) is not simulated"
        )
    return found


def _listed(numbers: Sequence[int]) -> str:
    named = 5  # numbers that are listed
    shown = ", ".join(map(str, numbers[:named]))
    return f"{shown} and {len(numbers) - named} others" if len(numbers) > named else shown
