"""Which frames of a large set, and which pixels of them, are simulated many times over.

A set of at most `budget` pixels (of `select`) is taken whole. Of a larger one,

- frames of each condition, spread evenly over the sequence, are taken in full where the sensor is small, or in one window of it:
  what changes from frame to frame is measured on them;
- where they are a window, a few full frames are taken beside them: what lies anywhere on the sensor is measured on these. Of the
  shortest darks there are two or more, so that temporal read noise is compared over the whole sensor too.

Both are simulated as frames of the whole sequence: see `visaug.camera.history`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from visaug.core.errors import InputError
from visaug.frames import FrameSet, Group
from visaug.statistics.conditions import MAX_GROUPS, by_condition, choose, spread
from visaug.statistics.split import Folds, share_out

MARGIN = 8  # px around a window that are simulated with it: what neighbours give each other crosses its edge

Window = tuple[int, int, int, int]
NONE = Folds((), (), ())


@dataclass(frozen=True)
class Selection:
    """Positions of frames in a set.

    Attributes:
        total: frames of the set.
        size: rows and columns of its frames.
        corner: row and column of the sensor at which they begin.
        frames: those that all statistics, or those of a window, are taken from.
        window: rows and columns of the frames, r0, r1, c0, c1; None where they are taken in full.
        full: which of the full frames find and which confirm; none where all frames are taken in full.
        noise_everywhere: whether full frames show temporal noise: two of one condition find.
        left_out: unused parts of the set and the effects that this hides, one sentence each.
    """

    total: int
    size: tuple[int, int]
    corner: tuple[int, int]
    frames: tuple[int, ...]
    window: Window | None = None
    full: Folds = NONE
    noise_everywhere: bool = False
    left_out: tuple[str, ...] = ()

    @cached_property
    def full_frames(self) -> tuple[int, ...]:
        return tuple(sorted(self.full.fit + self.full.confirm))

    @property
    def is_all(self) -> bool:
        return len(self.frames) == self.total and self.window is None

    def to_json(self) -> dict[str, Any]:
        """How many frames of how many, the share of their pixels that some statistic covers, and the windows of the temporal ones.

        `frame` is what the frames show of the sensor, `full_frames` how many are looked at in full, `description` says it all.
        """
        rows, columns = self.size
        r0, r1, c0, c1 = self.window or (0, rows, 0, columns)
        top, left = self.corner
        frame = [top, top + rows, left, left + columns]
        return {
            "frames": len({*self.frames, *self.full_frames}),
            "of": self.total,
            "sensor": 1.0 if self.full_frames else (r1 - r0) * (c1 - c0) / (rows * columns),
            "windows": [
                [top + r0, top + r1, left + c0, left + c1],
                *([frame] if self.noise_everywhere else []),
            ],
            "frame": frame,
            "full_frames": len(self.full_frames) if self.window else len(self.frames),
            "description": str(self),
        }

    def __str__(self) -> str:
        """The used frames and pixels, as text."""
        if self.is_all:
            return f"all {self.total} frames in full"
        used = f"{len(self.frames)} of {self.total} frames, spread over the sequence"
        if self.window is None:
            return f"{used}, in full"
        r0, r1, c0, c1 = self.window
        said = f"{used}, in a window of {r1 - r0} x {c1 - c0} pixels for what changes from frame to frame"
        noise = ", read noise included" if self.noise_everywhere else ""
        return f"{said}; {len(self.full_frames)} full frames for what lies anywhere on the sensor{noise}"


def select(frames: FrameSet, budget: int = 3_600_000, full: int = 4_000_000) -> Selection:
    """The frames, and the window of them, that are simulated; all of a small set that shows one window of the sensor.

    Args:
        frames: of any size.
        budget: pixels of a set; to simulate and measure it takes about a fifth of a second of one processor core.
        full: pixels of the full discovery frames, beside those of windows.

    Raises:
        InputError: frames of different size without a region that says which window of the sensor they are.
    """
    sizes = _sizes(frames)
    total = sum(rows * columns for rows, columns in sizes)
    rows, columns = max(sizes)
    if total <= budget and len({r.window for r in frames.records}) == 1:
        return Selection(len(frames), (rows, columns), _corner(frames, 0), tuple(range(len(frames))))
    usable, left_out = _of_one_window(frames, sizes)
    rows, columns = sizes[usable[0]]
    groups = _groups(frames.subset(usable), usable)
    area = rows * columns
    smallest = 50_000  # pixels of a frame: more frames rather than larger ones
    least = area if area <= 1.5 * smallest else smallest
    chosen = _spread_out(groups, _allotted([len(g.indices) for g in groups], budget // least), frames)
    window = _middle(rows, columns, budget / len(chosen))
    in_windows = 2 / 3  # of the budget, where full frames are simulated beside
    if window is not None:  # the full frames take the rest of the time
        window = _middle(rows, columns, in_windows * budget / len(chosen))
    folds, noise = (NONE, False) if window is None else _full_frames(frames, chosen, groups, full)
    corner = _corner(frames, usable[0])
    size = (rows, columns)
    return Selection(len(frames), size, corner, tuple(chosen), window, folds, noise, tuple(left_out))


def _corner(frames: FrameSet, i: int) -> tuple[int, int]:
    window = frames.records[i].window
    return (window[0], window[2]) if window else (0, 0)


def _sizes(frames: FrameSet) -> list[tuple[int, int]]:
    """Rows and columns of each frame; only one is read of all those that are as large as the sensor."""
    whole = next((i for i, r in enumerate(frames.records) if r.window is None), None)
    size = (0, 0) if whole is None else frames.shape(whole)
    sizes = []
    for record in frames.records:
        window = record.window
        sizes.append((window[1] - window[0], window[3] - window[2]) if window else size)
    return sizes


def _of_one_window(frames: FrameSet, sizes: Sequence[tuple[int, int]]) -> tuple[list[int], list[str]]:
    """Positions of the frames with the commonest window, and the warnings about the others."""
    windows = [r.window for r in frames.records]
    main = Counter(windows).most_common(1)[0][0]
    usable = [i for i, r in enumerate(frames.records) if r.window == main and r.kind in MAX_GROUPS]
    others = len(frames) - len([w for w in windows if w == main])
    said = []
    if others:
        rows, columns = sizes[windows.index(main)]
        said.append(
            f"mixed_windows: {others} of {len(frames)} frames show another window of the sensor than the "
            f"{rows} x {columns} pixels of most and are left out; what a frame keeps of those before it (image_lag, "
            "rts_noise) is not known where one was left out"
        )
    if not usable:
        raise InputError("no frame that can be simulated", field="kind", expected=" or ".join(MAX_GROUPS))
    return usable, said


def _groups(frames: FrameSet, positions: Sequence[int]) -> list[Group]:
    """The conditions that are looked at, with positions in the whole set."""
    groups = [replace(g, indices=tuple(sorted(positions[i] for i in g.indices))) for g in frames.groups()]
    return [
        g for kind, most in MAX_GROUPS.items() for g in choose([g for g in groups if g.kind == kind], most)
    ]


def _allotted(counts: Sequence[int], most: int) -> list[int]:
    """How many frames of each condition: `fewest` of all, and further ones where most are left for each that is taken."""
    fewest = 3  # frames of a condition, where it has them
    taken = [min(count, fewest) for count in counts]
    while sum(taken) < min(most, sum(counts)):
        open_to = [k for k, count in enumerate(counts) if taken[k] < count]
        taken[max(open_to, key=lambda k: counts[k] / (taken[k] + 1))] += 1
    return taken


def _spread_out(groups: Sequence[Group], counts: Sequence[int], frames: FrameSet) -> list[int]:
    """So many frames of each condition, spread over the sequence; first those that follow a chosen scene and show what it left."""
    chosen: set[int] = set()
    kind = [record.kind for record in frames.records]
    for scenes_first in (True, False):
        for group, count in zip(groups, counts, strict=True):
            if (group.kind == "scene") == scenes_first:
                after = [i for i in group.indices if i and i - 1 in chosen and kind[i - 1] == "scene"]
                after = [] if scenes_first else spread(after, count)
                others = [i for i in group.indices if i not in after]
                chosen.update(after, spread(others, count - len(after)) if count > len(after) else [])
    return sorted(chosen)


def _middle(rows: int, columns: int, pixels: float) -> Window | None:
    """A central window with this number of pixels and the sensor's aspect ratio; None if that is almost the whole sensor."""
    shrink = (pixels / (rows * columns)) ** 0.5
    if shrink > 0.9:
        return None
    height, width = (max(16, 2 * int(n * shrink / 2)) for n in (rows, columns))
    # rows keep their parity
    top, left = (2 * ((n - part) // 4) for n, part in ((rows, height), (columns, width)))
    return top, top + height, left, left + width


def _full_frames(
    frames: FrameSet, chosen: Sequence[int], groups: Sequence[Group], pixels: int
) -> tuple[Folds, bool]:
    """Frames of the shortest and the longest darks, of a middle flat, and scenes; near each other, as they remember alike.

    No frame finds here that confirms in a window, nor the other way about. The second value says whether two or more of the
    shortest darks find.
    """
    shared = share_out(frames.subset(chosen))
    finds, confirms = ({chosen[k] for k in part} for part in (shared.find, shared.confirm))
    of = {kind: sorted((g for g in groups if g.kind == kind), key=by_condition) for kind in MAX_GROUPS}
    bias, darks, flats = of["bias"], of["dark"], of["flat"]
    ends = [max(bias, key=lambda g: len(g.indices))] if bias else darks[:1]
    ends += [g for g in darks[-1:] if g not in ends]
    ends += flats[len(flats) * 5 // 8 : len(flats) * 5 // 8 + 1]
    rows, columns = frames.shape(chosen[0])
    area = rows * columns
    most_full = 3  # full frames of a condition that find: noise is known from the windows
    each = min(most_full, max(1, pixels // (area * max(len(ends), 1))))
    scenes = spread(of["scene"], max(1, pixels // area - each * len(ends)))
    find: list[int] = []
    confirm: list[int] = []
    noise = False
    pair = 2  # of the shortest darks at least: two frames show temporal noise
    for group, count in [(g, each) for g in ends] + [(g, 1) for g in scenes]:
        is_shortest = bool(ends) and group is ends[0]
        least = pair if is_shortest else 1
        middle = group.indices[len(group.indices) // 2]
        first = _nearest([i for i in group.indices if i not in confirms], middle, max(count, least))
        others = [i for i in group.indices if i not in finds and i not in first]
        find += first
        confirm += _nearest(others, middle, max((count + 1) // 2, least))
        noise |= is_shortest and len(first) >= pair
    return Folds(tuple(sorted(find)), (), tuple(sorted(confirm))), noise


def _nearest(positions: Sequence[int], middle: int, count: int) -> list[int]:
    return sorted(sorted(positions, key=lambda i: abs(i - middle))[:count])
