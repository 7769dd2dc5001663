"""The frames that a camera model can explain: without what the checks of the measurement model found beyond it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from visaug.characterization.alarms import adopt, found_by_checks
from visaug.characterization.views import cropped, repaired, replaced
from visaug.core.errors import InputError
from visaug.frames import FrameSet
from visaug.statistics.findings import Findings


def usable(frames: FrameSet, resolution: Sequence[int]) -> FrameSet:
    """The frames without overscan, constant rows and columns, flats of a lamp whose bands roll over the rows, copies of other
    frames, frames of other settings or averaged by what the set states, and flats and scenes behind colour filters that it
    states. Photons are left out where the levels of the flats contradict them.

    No parameter of a camera describes these, and effects of the catalogue would be named in their place. Single stuck pixels
    stay: they are the effect `dead_pixels`. The warnings of the checks go with the frames, and say what was left out.

    Args:
        resolution: rows and columns of the camera; frames cut to a part of it know their place on the sensor.

    Raises:
        InputError: frames of another size than the sensor's that do not state their window.
    """
    made = _explained(frames, resolution)
    whole = next((i for i, record in enumerate(made.records) if record.window is None), None)
    if whole is not None and made.shape(whole) != tuple(resolution):
        height, width = resolution
        expected = f"{height} x {width} as the camera's resolution, or a region that states the window"
        size = "is {} x {}".format(*made.shape(whole))
        raise InputError(size, file=made.records[whole].file, expected=expected)
    return made


def _explained(frames: FrameSet, resolution: Sequence[int]) -> FrameSet:
    if (found := found_by_checks(frames)) is None:
        return frames
    made = frames
    if len({(frames.shape(i), r.window) for i, r in enumerate(frames.records)}) == 1:
        made = _without_lines(_lit(made, found, tuple(resolution)), found)
    if not found.has_one_light:
        made = made.with_records([replace(r, photons=None) for r in made.records])
    out = found.banded | found.apart
    kept = [i for i, r in enumerate(made.records) if r.sequence not in out]
    if 0 < len(kept) < len(made):
        made = made.subset(kept)
    if made is frames:
        return frames
    adopt(made, frames)
    return made


def _lit(frames: FrameSet, found: Findings, resolution: tuple[int, ...]) -> FrameSet:
    if found.lit is None:
        return frames
    shape = frames.shape(0)
    if resolution == shape and frames.records[0].window is None:
        whole = (0, shape[0], 0, shape[1])
        frames = frames.with_records([replace(r, window=whole) for r in frames.records])
    return cropped(frames, found.lit)


def _without_lines(frames: FrameSet, found: Findings) -> FrameSet:
    """Pixels of a constant row get the value of another row of the same column, a fixed one drawn for each pixel.
    A copy of one row would be a pair of rows that share their noise.
    """
    stuck = found.stuck
    if stuck is None or stuck.shape != frames.shape(0):
        return frames
    rows, columns = np.asarray(stuck.all(1)), np.asarray(stuck.all(0))
    if not (rows.any() or columns.any()):
        return frames
    rng = np.random.default_rng(0)
    height, width = stuck.shape
    row, column = (np.asarray(grid) for grid in np.indices(stuck.shape))
    for k in np.flatnonzero(rows):
        row[k] = rng.choice(_near(int(k), ~rows), width)
    for k in np.flatnonzero(columns):
        column[:, k] = rng.choice(_near(int(k), ~columns), height)
    at = np.nonzero(rows[:, None] | columns)
    return repaired(frames, lambda frame, _: replaced(frame, at, (row[at], column[at])))


def _near(k: int, sound: np.ndarray) -> np.ndarray:
    """Sound lines of the same parity around line k, which a mosaic's colours share."""
    same = np.flatnonzero(sound)
    same = same[same % 2 == k % 2]
    reach = 16  # rows or columns within which the value of a constant one's pixel is taken from another
    near = same[np.abs(same - k) <= reach]
    return near if len(near) else np.flatnonzero(sound)
