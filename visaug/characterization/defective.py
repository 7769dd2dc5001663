"""Pixels that answer to no light: stuck ones, whole rows and columns, overscan. Left out before anything is averaged."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

from visaug.characterization.facts import PLACES, Facts
from visaug.characterization.views import cropped, repaired, replaced
from visaug.core.wording import counted, listed
from visaug.frames import FrameSet, Group
from visaug.statistics.findings import Findings
from visaug.statistics.kernels import median_of

_APART = 8.0  # noise of single pixels: levels, or values, that differ by more differ by no chance
_MOST = 0.1  # share of the pixels beyond which they are no defects of an otherwise sound sensor


@dataclass(frozen=True)
class GroupSummary:
    """One group: its frames, median level and noise (DN), histogram of whole DN."""

    kind: str
    frames: tuple[int, ...]
    median: float
    noise: float
    codes: np.ndarray | None


@dataclass(frozen=True)
class Extremes:
    """What one pass over the frames of one window keeps."""

    levels: tuple[GroupSummary, ...]
    # (H, W) least and greatest value of every pixel over all frames, DN
    low: np.ndarray = field(repr=False)
    high: np.ndarray = field(repr=False)
    # the same over flats
    flat_low: np.ndarray = field(repr=False)
    flat_high: np.ndarray = field(repr=False)
    # (H, W) whether a pixel has, in all frames of some group of flats, the least or greatest value of the
    # group's first frame, far from the group's level
    at_the_end: np.ndarray = field(repr=False)
    # (H,), (W,) bits that ever change in a row or column; None where values are no whole DN
    row_bits: np.ndarray | None = field(repr=False)
    column_bits: np.ndarray | None = field(repr=False)

    def spans(self, flats_alone: bool) -> bool:
        """Whether levels differ by so much that no sound pixel keeps its value."""
        levels = [v for v in self.levels if v.kind == "flat" or not flats_alone]
        if len(levels) < 2:
            return False
        middles, noise = [v.median for v in levels], max(v.noise for v in levels)
        return max(middles) - min(middles) > _APART * max(noise, 1.0)


def extremes(frames: FrameSet, facts: Sequence[Facts], groups: Sequence[Group]) -> Extremes | None:
    """One pass over all frames; None where they show different windows of the sensor or there are no flats."""
    indices = [i for g in groups for i in g.indices]
    kinds = {g.kind for g in groups}
    if "flat" not in kinds or len({(frames.shape(i), frames.records[i].window) for i in indices}) != 1:
        return None
    shape = frames.shape(indices[0])
    low, high = np.full(shape, np.inf, np.float32), np.full(shape, -np.inf, np.float32)
    flat_low, flat_high = low.copy(), high.copy()
    ends, levels = np.zeros(shape, bool), []
    whole = all(f.bits is not None for f in facts)
    ones = [np.zeros(n, np.int64) for n in shape]
    zeros = [np.zeros(n, np.int64) for n in shape]
    for group in groups:
        medians = []
        top, bottom = np.ones(shape, bool), np.ones(shape, bool)
        codes = np.zeros(0, np.int64)
        ends_here = None
        for i in group.indices:
            frame = frames.read(i)
            np.minimum(low, frame, out=low)
            np.maximum(high, frame, out=high)
            if group.kind == "flat":
                np.minimum(flat_low, frame, out=flat_low)
                np.maximum(flat_high, frame, out=flat_high)
                ends_here = ends_here or (frame.max(), frame.min())
                top &= frame == ends_here[0]
                bottom &= frame == ends_here[1]
            if whole:
                values = frame.astype(np.min_scalar_type(int(frame.max())))  # small numbers are quick
                for axis in (0, 1):
                    ones[axis] |= np.bitwise_or.reduce(values, axis=1 - axis)
                    zeros[axis] |= ~np.bitwise_and.reduce(values, axis=1 - axis).astype(np.int64)
                counts = np.bincount(values.ravel(), minlength=len(codes))
                counts[: len(codes)] += codes
                codes = counts
            medians.append(float(median_of(frame)))
        middle = float(np.median(medians))
        noise = max(float(np.median([facts[i].noise for i in group.indices])), 1.0)
        levels.append(GroupSummary(group.kind, group.indices, middle, noise, codes if whole else None))
        if ends_here is not None and len(group.indices) > 1:
            for end, there in zip(ends_here, (top, bottom)):
                # sound pixels reach an end that more share: those of one colour are at the converter's top
                if abs(end - middle) > _APART * noise and there.mean() <= _MOST:
                    ends |= there
    bits = [a & b for a, b in zip(ones, zeros)] if whole else [None, None]
    return Extremes(tuple(levels), low, high, flat_low, flat_high, ends, bits[0], bits[1])


def lit_window(frames: FrameSet, seen: Extremes, found: Findings) -> tuple[int, int, int, int] | None:
    """Rows and columns that see light, where lines at an edge see none (overscan, optically black lines).
    A covered line is at less than 2 % of the median response and its neighbour at more than half of it, in the
    brightest flats: no light of a lens or a lamp falls off like that.
    """
    flats = [v for v in seen.levels if v.kind == "flat"]
    if not (darks := [v for v in seen.levels if v.kind != "flat"]):
        return None
    bright = max(flats, key=lambda v: v.median)
    dark = min(darks, key=lambda v: v.median)
    if bright.median - dark.median < _APART * bright.noise:
        return None
    window, said = [], []
    lines = (_line_levels(frames, v.frames) for v in (bright, dark))
    for name, lit, unlit in zip(("rows", "columns"), *lines):
        response = lit - unlit
        response = response / np.median(response)
        first, last = _covered(response), len(response) - _covered(response[::-1])
        window += [first + first % 2, last]  # an even start leaves the phase of a mosaic as it is
        said += [f"{name} {a} to {b - 1}" for a, b in ((0, first), (last, len(response))) if b > a]
    if not said:
        return None
    covered = f"{' and '.join(said)} see no light and are excluded"
    found.warn(f"overscan: {covered}; no header gives the part of the frame that is lit")
    r0, r1, c0, c1 = window
    return r0, r1, c0, c1


def _line_levels(frames: FrameSet, indices: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Means over frames of the medians of rows, (H,), and of columns, (W,)."""
    medians = [(np.median(frame, 1), np.median(frame, 0)) for frame in map(frames.read, indices)]
    rows, columns = (np.array(lines, np.float64).mean(0) for lines in zip(*medians))
    return rows, columns


def _covered(response: np.ndarray) -> int:
    """Number of lines from the start that see no light, before one that is lit."""
    lit = int(np.argmax(response > 0.02))  # of the median's response: below, a line is covered
    first, beside = response[lit], response[min(lit + 1, len(response) - 1)]
    # light that falls off has no such edge; one line may be covered in part
    sharp = first > 0.5 or (first < 0.5 and beside > 0.5)
    most_covered = 0.4  # share of the lines that may be covered at one edge
    return lit if 0 < lit <= most_covered * len(response) and sharp else 0


def cut(frames: FrameSet, seen: Extremes, window: tuple[int, int, int, int]) -> tuple[FrameSet, Extremes]:
    """The frames and their extremes inside a window."""
    r0, r1, c0, c1 = window
    names = ("low", "high", "flat_low", "flat_high", "at_the_end")
    maps = {name: getattr(seen, name)[r0:r1, c0:c1] for name in names}
    return cropped(frames, window), replace(seen, **maps)


def stuck_pixels(seen: Extremes, found: Findings) -> np.ndarray | None:
    """(H, W) pixels that do not answer to light; None where there are none.
    A pixel of one value in all flats (or all frames) whose levels are more than eight noises apart, or one that
    is at the least or greatest value of all frames of a level, eight noises from that level.
    """
    stuck = seen.at_the_end.copy()
    if seen.spans(flats_alone=True):
        stuck |= seen.flat_low == seen.flat_high
    if seen.spans(flats_alone=False):
        stuck |= seen.low == seen.high
    if not (share := float(stuck.mean())):
        return None
    if share > _MOST:
        said = f"{share:.0%} of the pixels do not answer to light; they are too many to be left out"
        found.warn(f"stuck_pixels: {said}", spoils=("*",))
        return None
    found.stuck = stuck
    rows, columns = np.flatnonzero(stuck.all(1)), np.flatnonzero(stuck.all(0))
    single = stuck.copy()
    single[rows], single[:, columns] = False, False
    places = [f"({r}, {c})" for r, c in np.argwhere(single)]
    kinds = ("row", rows), ("column", columns), ("pixel", places)
    parts = [f"{counted(len(what), name)} ({listed(what, 5)})" for name, what in kinds if len(what)]
    found.warn(f"stuck_pixels: {', '.join(parts)} keep one value whatever the light and are excluded")
    return stuck


def without(frames: FrameSet, bad: np.ndarray) -> FrameSet:
    """The frames with the value of the nearest sound pixel of the same colour in place of a bad one's.
    A neighbour's value has the law of a sound pixel, which a mean or a constant does not.
    """
    at, source = np.nonzero(bad), donors(bad)
    return repaired(frames, lambda frame, _: replaced(frame, at, source))


def donors(bad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each bad pixel, in order, the nearest sound one of the same phase of a 2 x 2 that is not itself."""
    place = np.indices(bad.shape)
    rows, columns = place[0], place[1]
    for r, c in PLACES:
        part = bad[r::2, c::2]
        if part.size and part.any() and not part.all():
            near = ndimage.distance_transform_edt(part, return_distances=False, return_indices=True)
            assert near is not None
            rows[r::2, c::2], columns[r::2, c::2] = 2 * near[0] + r, 2 * near[1] + c
    return rows[bad], columns[bad]
