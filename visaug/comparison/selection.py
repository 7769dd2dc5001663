"""A share of a large frame set that can be simulated many times over."""

from dataclasses import replace

import numpy as np

from visaug.fingerprint.reduction import MAX_GROUPS, choose
from visaug.frames import FrameSet

BUDGET = 3_600_000  # pixels of a set; to simulate and measure it takes about a fifth of a second of one processor core
SMALLEST = 50_000  # pixels of a frame: more frames rather than larger ones
FEWEST = 3  # frames of a group, where it has them


def manageable(frames: FrameSet, budget: int = BUDGET) -> tuple[FrameSet, str | None]:
    """The set itself where it is small, or fewer of its conditions, frames and pixels.

    Conditions are spread evenly over those that were measured, frames are the first of each in order of acquisition, and
    pixels are a window in the middle of the sensor.

    Returns:
        The set, and in words what was left out.
    """
    sizes = {frames.shape(i) for i in range(len(frames))}
    total = sum(rows * columns for rows, columns in (frames.shape(i) for i in range(len(frames))))
    if total <= budget:
        return frames, None
    rows, columns = max(sizes)
    groups = [
        g
        for kind, most in MAX_GROUPS.items()
        for g in choose([g for g in frames.groups() if g.kind == kind], most)
    ]
    most = max(len(g.indices) for g in groups)
    smallest = min(rows * columns, SMALLEST)
    while most > FEWEST and sum(min(len(g.indices), most) for g in groups) * smallest > budget:
        most -= 1
    chosen = sorted(i for g in groups for i in sorted(g.indices)[:most])
    kept = frames.subset(chosen)
    said = f"{len(chosen)} of {len(frames)} frames"
    shrink = np.sqrt(budget / (len(chosen) * rows * columns))
    if shrink < 1 and len(sizes) == 1 and len({r.window for r in frames.records}) == 1:
        height, width = max(16, int(rows * shrink)), max(16, int(columns * shrink))
        kept = _cropped(kept, (rows - height) // 2, (columns - width) // 2, height, width)
        said += f", a window of {height} x {width} pixels in the middle"
    return kept, said


def _cropped(frames: FrameSet, r0: int, c0: int, height: int, width: int) -> FrameSet:
    """A window of every frame, in memory."""
    part = np.s_[r0 : r0 + height, c0 : c0 + width]
    records, cleans = [], {}
    for i, record in enumerate(frames.records):
        top, left = (record.window[0], record.window[2]) if record.window else (0, 0)
        records.append(replace(record, window=(top + r0, top + r0 + height, left + c0, left + c0 + width)))
        if record.kind == "scene" and record.clean and record.clean not in cleans:
            cleans[record.clean] = np.ascontiguousarray(frames.clean(i)[part])
    pixels = [np.ascontiguousarray(frames.read(i)[part]) for i in range(len(frames))]
    return FrameSet.from_arrays(records, pixels, cleans, bit_depth=frames.bit_depth)
