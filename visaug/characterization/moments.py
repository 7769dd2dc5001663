"""Means and variances of a group of frames, in one pass, holding one frame and two maps."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from visaug.frames import FrameSet, Group
from visaug.frames.checks import PILED_SHARE
from visaug.frames.record import Window

Place = tuple[tuple[int, int], Window | None]


@dataclass(frozen=True)
class TemporalParts:
    """Mean squares of the temporal noise about the mean map and their degrees of freedom.
    Expectations: ``frame`` HW s_t^2 + W s_tv^2 + H s_th^2 + s_tvh^2; ``row`` W s_tv^2 + s_tvh^2; ``column`` H s_th^2 + s_tvh^2;
    ``pixel`` s_tvh^2 (t frame, v row, h column). The 3-D noise model: J. D'Agostino and C. Webb, Proc. SPIE 1488 (1991) 110.
    """

    frame: float
    row: float
    column: float
    pixel: float
    frame_df: int
    row_df: int
    column_df: int
    pixel_df: int


@dataclass(frozen=True)
class GroupMoments:
    """First and second moments of one group."""

    group: Group
    n: int  # number of frames
    shape: tuple[int, int]  # rows and columns
    frame_means: np.ndarray  # (n,) mean of each frame, DN
    row_means: np.ndarray  # (H,) mean over frames and columns, DN
    column_means: np.ndarray  # (W,) mean over frames and rows, DN
    # (H,) mean over columns of the pixels' variance over frames (n - 1 in it), DN^2; 0 for one frame
    row_variances: np.ndarray
    spatial_variance: float  # variance of the mean map (HW - 1 in it), DN^2
    temporal: TemporalParts | None  # mean squares of the temporal noise, None for one frame
    # share of pixels at 0 and at the converter's top
    clipped_low: float
    clipped_high: float
    columns_by_frame: np.ndarray = field(repr=False)
    rows_by_frame: np.ndarray = field(repr=False)
    step_dn: float = 1.0  # distance of neighbouring codes, DN

    @property
    def place(self) -> Place:
        """Size and window: the same pixels of the sensor where both are equal."""
        return self.shape, self.group.window

    @property
    def mean(self) -> float:
        return float(self.row_means.mean())

    @property
    def variance(self) -> float:
        """Temporal variance as EMVA 1288 defines it: the change of the frame's mean taken out (DN^2)."""
        return float(self.row_variances.mean()) - self.frame_variance

    @property
    def frame_variance(self) -> float:
        return float(self.frame_means.var(ddof=1)) if self.n > 1 else 0.0


def measure(frames: FrameSet, group: Group, step_dn: float = 1.0) -> GroupMoments:
    """Moments of one group in one pass."""
    indices, n = group.indices, len(group.indices)
    first = frames.read(indices[0])
    height, width = first.shape
    total, squares = np.zeros(first.shape), np.zeros(first.shape)
    rows, columns = np.empty((n, height)), np.empty((n, width))
    low = high = 0
    top = None if frames.bit_depth is None else (1 << frames.bit_depth) - 1
    for k, i in enumerate(indices):
        frame = first if k == 0 else frames.read(i)
        low += np.count_nonzero(frame <= 0)
        largest = float(frame.max())
        at_largest = np.count_nonzero(frame == largest)
        # The converter's top: the known one, or, of flats, a value that far too many pixels share as the largest.
        piled = group.kind == "flat" and at_largest > PILED_SHARE * frame.size and largest > frame.min()
        high += at_largest if largest == top or piled else 0
        difference = frame.astype(np.float64)
        rows[k], columns[k] = difference.mean(1), difference.mean(0)
        difference -= first  # small numbers, so that the squares do not swallow the variance
        total += difference
        squares += np.square(difference, out=difference)
    total /= n
    variance = np.zeros_like(total) if n == 1 else (squares - n * total**2) / (n - 1)
    average = first + total
    return GroupMoments(
        group=group,
        n=n,
        shape=(height, width),
        frame_means=rows.mean(1),
        row_means=average.mean(1),
        column_means=average.mean(0),
        row_variances=variance.mean(1),
        spatial_variance=float(average.var(ddof=1)),
        temporal=_temporal_parts(rows, columns, float(variance.mean())) if n > 1 else None,
        clipped_low=low / (n * height * width),
        clipped_high=high / (n * height * width),
        rows_by_frame=rows,
        columns_by_frame=columns,
        step_dn=step_dn,
    )


def largest_place(moments: Iterable[GroupMoments]) -> Place | None:
    """The largest window, of equal ones that of the most frames, then the nearest to the first row: only frames of one window
    show one pattern.
    """
    frames: Counter[Place] = Counter()
    for m in moments:
        frames[m.place] += m.n
    return max(frames, key=lambda p: (math.prod(p[0]), frames[p], nearness(p[1])), default=None)


def nearness(window: Window | None) -> tuple[int, ...]:
    """Grows with the nearness to the first row: settings of equal frames in several windows then all count in one."""
    return tuple(-edge for edge in window or ())


def middle(shape: tuple[int, int]) -> tuple[slice, slice]:
    """A window in the middle of up to 512 x 512 pixels, which tells covariances to 0.2 % of the variance from two frames."""
    side = 512
    r0, c0 = (max((n - side) // 2, 0) for n in shape)
    return slice(r0, r0 + side), slice(c0, c0 + side)


def mean_map(frames: FrameSet, indices: Iterable[int]) -> np.ndarray:
    """Mean over frames, (H, W) float64 in DN."""
    indices = list(indices)
    total = frames.read(indices[0]).astype(np.float64)
    for i in indices[1:]:
        total += frames.read(i)
    return total / len(indices)


def pixel_variances(
    frames: FrameSet, indices: Sequence[int], offset: Callable[[int], float | np.ndarray]
) -> np.ndarray:
    """Variance of every pixel over frames, (H, W) DN^2; what a frame has beyond its `offset` counts (n - 1 in it)."""
    total = squares = np.zeros(frames.shape(indices[0]))
    for i in indices:
        values = frames.read(i) - offset(i)
        total, squares = total + values, squares + values**2
    return np.maximum(squares - total**2 / len(indices), 0.0) / (len(indices) - 1)


def _temporal_parts(rows: np.ndarray, columns: np.ndarray, variance: float) -> TemporalParts:
    """The sums of squares of a three-way layout, from row and column means of every frame."""
    (n, height), width = rows.shape, columns.shape[1]
    levels = rows.mean(1)
    t = levels - levels.mean()
    tv = (rows - levels[:, None]) - (rows - levels[:, None]).mean(0)
    th = (columns - levels[:, None]) - (columns - levels[:, None]).mean(0)
    frame = height * width * (t**2).sum()
    row, column = width * (tv**2).sum(), height * (th**2).sum()
    pixel = max(variance * (n - 1) * height * width - frame - row - column, 0.0)
    df = [max((n - 1) * k, 1) for k in (1, height - 1, width - 1, (height - 1) * (width - 1))]
    return TemporalParts(frame / df[0], row / df[1], column / df[2], pixel / df[3], *df)
