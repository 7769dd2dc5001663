"""Frames of equal conditions, reduced to what statistics of temporal noise need: sums that several uses of the frames share."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np

from visaug.core.constants import MAD
from visaug.statistics import kernels

LEAST_VARIANCE = 1 / 1200  # DN^2: a hundredth of quantisation's
LEAST_SCALE = 0.03  # DN
RATIOS = (3, 6, 15)  # of a pixel's variance over that of all, beyond which pixels are counted
LAGS = {lag: k for k, lag in enumerate((*kernels.LAGS, *kernels.FAR_LAGS))}


class Stack:
    """Frames of equal conditions with their sums.

    Args:
        frames: (n, H, W) uint16 or float32.

    Attributes:
        total: (H, W) sum of the frames, exact for uint16.
        rows, columns: (n, H) and (n, W) float64 means of their rows and columns.
    """

    def __init__(self, frames: np.ndarray):
        self.frames = frames
        count, height, width = self.shape = frames.shape
        kind = np.uint32 if frames.dtype == np.uint16 else np.float64
        self.total = np.zeros((height, width), kind)
        rows, columns = np.zeros((count, height), kind), np.zeros((count, width), kind)
        kernels.add_up(frames, self.total, rows, columns)
        self.rows, self.columns = rows / width, columns / height

    @cached_property
    def codes(self) -> np.ndarray:
        """How many pixels have each DN code, (largest code + 1,)."""
        if self.frames.dtype != np.uint16:
            return np.bincount(np.rint(self.frames).astype(np.intp).ravel())
        counts = np.zeros((2, int(self.frames.max(initial=0)) + 1), np.int64)
        kernels.count_codes(self.frames, counts)
        return counts.sum(0)

    @cached_property
    def own_lines(self) -> tuple[np.ndarray, np.ndarray]:
        """What is taken off the rows and columns of each frame less the mean of these frames."""
        return _lines(self, self.rows.mean(0), self.columns.mean(0))

    @cached_property
    def scatter(self) -> "NoiseProducts":
        """Products of the noise about the mean of these frames alone."""
        found = NoiseProducts.empty(self.shape[1:])
        if self.shape[0] > 1:
            found.add(self.frames, mean_of(self.total, self.shape[0]), *self.own_lines)
        return found


@dataclass
class NoiseProducts:
    """Sums over frames and pixels of products of noise: see `kernels.scatter`."""

    products: np.ndarray
    halves: np.ndarray
    squares: np.ndarray

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> "NoiseProducts":
        return cls(np.zeros(len(LAGS)), np.zeros(4), np.zeros(shape, np.float32))

    def add(self, frames: np.ndarray, mean: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> None:
        kernels.scatter(frames, mean, rows, columns, True, self.products, self.halves, self.squares)


class Noise:
    """Mean frame and temporal noise of one stack, or of two as if they were one.

    Squares of deviations from a common mean are those from each mean and a term for the distance of the means (the
    decomposition of sums of squares), so that frames of two stacks are not gone through again for them.

    Args:
        stacks: one or two.
        order: (n,) places among the frames of the stacks, one after the other, of the frames in their order.
    """

    def __init__(self, stacks: Sequence[Stack], order: Sequence[int] | np.ndarray | None = None):
        self.stacks = tuple(stacks)
        self.count = sum(stack.shape[0] for stack in stacks)
        self.shape = stacks[0].shape[1:]
        self.order = np.arange(self.count) if order is None else np.asarray(order)

    @property
    def frames(self) -> np.ndarray:
        """(n, H, W) float32."""
        return np.concatenate([s.frames for s in self.stacks])[self.order].astype(np.float32)

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean frame, (H, W) float32."""
        return mean_of(reduce(np.add, [s.total for s in self.stacks]), self.count)

    @cached_property
    def level(self) -> float:
        return float(self.frame_means.mean())

    @cached_property
    def frame_means(self) -> np.ndarray:
        """(n,) float64."""
        return np.concatenate([s.rows.mean(1) for s in self.stacks])[self.order]

    @property
    def bessel(self) -> float:
        """Factor by which deviations from the mean frame are too small; needs two frames."""
        return float(np.sqrt(self.count / (self.count - 1)))

    @cached_property
    def _lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Means of the rows (n, H) and of the columns (n, W) of the frames."""
        rows, columns = ([getattr(s, lines) for s in self.stacks] for lines in ("rows", "columns"))
        return np.concatenate(rows)[self.order], np.concatenate(columns)[self.order]

    @cached_property
    def rows(self) -> np.ndarray:
        """Row means of the temporal noise, (n, H)."""
        rows = self._lines[0]
        return self.bessel * (rows - rows.mean(0))

    @cached_property
    def columns(self) -> np.ndarray:
        columns = self._lines[1]
        return self.bessel * (columns - columns.mean(0))

    def _passes(self) -> Iterator[Any]:
        """What a pass over the noise of each stack begins with: its frames, the mean frame, what is taken off its lines."""
        for stack, off in zip(self.stacks, self._off, strict=True):
            yield stack.frames, self.mean, *off

    @cached_property
    def _off(self) -> list[tuple[np.ndarray, np.ndarray]]:
        if len(self.stacks) == 1:
            return [self.stacks[0].own_lines]
        rows, columns = (lines.mean(0) for lines in self._lines)
        return [_lines(stack, rows, columns) for stack in self.stacks]

    @cached_property
    def codes(self) -> np.ndarray:
        """How many pixels have each DN code."""
        return added([s.codes for s in self.stacks])

    @cached_property
    def _scatter(self) -> NoiseProducts:
        if len(self.stacks) == 1:
            return self.stacks[0].scatter
        one, other = self.stacks
        parts = one.scatter, other.scatter
        found = NoiseProducts(
            *(parts[0].__dict__[k] + parts[1].__dict__[k] for k in ("products", "halves", "squares"))
        )
        weight = np.sqrt(one.shape[0] * other.shape[0] / self.count)
        distance = (one.total / one.shape[0] - other.total / other.shape[0]).astype(np.float32)
        distance *= np.float32(weight)
        rows, columns = kernels.line_means(distance)
        rows = (rows - rows.mean()).astype(np.float32)
        found.add(distance[None], np.zeros_like(distance), rows[None], columns.astype(np.float32)[None])
        return found

    @property
    def _factor(self) -> float:
        """From a sum of squares about the mean to a mean square of the noise of one frame."""
        return self.bessel**2 / self.count

    @cached_property
    def variance(self) -> float:
        """Of the pixel part of the temporal noise, DN^2."""
        height, width = self.shape
        return max(self._factor * self._scatter.products[0] / height / width, LEAST_VARIANCE)

    @cached_property
    def correlations(self) -> dict[tuple[int, int], float]:
        """Mean product of the noise of pixels so many rows and columns apart, over its variance."""
        return correlations(self._factor * self._scatter.products, self.shape, self.variance)

    @cached_property
    def halves(self) -> np.ndarray:
        """Mean squares of the noise of the left, right, upper and lower half, (4,) DN^2."""
        height, width = self.shape
        across, down = width // 2, height // 2
        sizes = [height * across, height * (width - across), down * width, (height - down) * width]
        return self._factor * self._scatter.halves / sizes

    @cached_property
    def noisy_pixels(self) -> tuple[list[int], float]:
        """Pixels whose ratio is beyond each of `RATIOS`, and the median of the ratios."""
        ratios = self.pixel_ratios.ravel()
        return [int(np.count_nonzero(ratios > limit)) for limit in RATIOS], kernels.median_of_sizes(ratios)

    @cached_property
    def pixel_ratios(self) -> np.ndarray:
        """(H, W) variance of each pixel's noise over that of all."""
        return self._scatter.squares * np.float32(self._factor / self.variance)

    @cached_property
    def scale(self) -> float:
        """Robust standard deviation of the noise, DN, from every second row and third column."""
        height, width = self.shape
        sizes = []
        for frames, mean, rows, columns in self._passes():
            out = np.empty((len(frames), (height + 1) // 2, (width + 2) // 3), np.float32)
            kernels.noise_sizes(frames, mean, rows, columns, out)
            sizes.append(out.ravel())
        sample = sizes[0] if len(sizes) == 1 else np.concatenate(sizes)
        return max(MAD * self.bessel * kernels.median_of_sizes(sample), LEAST_SCALE)

    @cached_property
    def tails(self) -> "Tails":
        sums, counts, often = np.zeros(2), np.zeros(7, np.int64), np.zeros(self.shape, np.uint16)
        scale, spread = self.scale / self.bessel, self.variance**0.5 / self.bessel
        for frames, mean, rows, columns in self._passes():
            kernels.tails(frames, mean, rows, columns, scale, spread, sums, counts, often)
        pixels = self.count * self.mean.size
        return Tails(
            self.bessel * sums[0] / pixels,
            sums[1] / pixels,
            tuple(map(int, counts[:4])),
            int(counts[4]),
            int(counts[5]),
            int(counts[6]),
            int(np.count_nonzero(often >= 3)),
        )

    def limited_squares(self, deviations: float) -> np.ndarray:
        """(H, W) mean square of each pixel's noise; beyond so many standard deviations it counts as these."""
        found = np.zeros(self.shape, np.float32)
        limit = deviations * self.variance**0.5 / self.bessel
        for frames, mean, rows, columns in self._passes():
            kernels.limited_squares(frames, mean, rows, columns, limit, found)
        return found * np.float32(self._factor)


@dataclass(frozen=True)
class Tails:
    """How far out the noise of pixels lies.

    Attributes:
        mean_size: mean absolute noise, DN.
        skewness: mean cube of the noise in standard deviations, limited to 3 either way.
        beyond: pixels beyond 3, 5, 8 and 20 robust standard deviations ("scales").
        up, down: pixels above 8 scales, and below -8 of them.
        touching: pairs of neighbours that are both above 8 scales.
        recurring: pixels beyond 3.5 scales in three frames or more.
    """

    mean_size: float
    skewness: float
    beyond: tuple[int, ...]
    up: int
    down: int
    touching: int
    recurring: int


def mean_of(total: np.ndarray, count: int) -> np.ndarray:
    """The sum of so many frames over their number, float32; divided in float64, a piece at a time."""
    return np.divide(total, count, out=np.empty(total.shape, np.float32), casting="same_kind")


def _lines(stack: Stack, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each frame less a mean frame, what is taken off its rows (n, H) and columns (n, W), float32.

    Args:
        rows, columns: means of the lines of the mean frame.
    """
    off_rows, off_columns = stack.rows - rows, stack.columns - columns
    off_rows -= off_rows.mean(1, keepdims=True)
    return off_rows.astype(np.float32), off_columns.astype(np.float32)


def correlations(
    products: np.ndarray, shape: tuple[int, int], variance: float
) -> dict[tuple[int, int], float]:
    """Of sums of products over an image, their means over the variance, by `LAGS`."""
    height, width = shape
    return {
        (r, c): float(products[k] / max(height - r, 1) / max(width - c, 1) / variance)
        for (r, c), k in LAGS.items()
    }


def added(counts: Sequence[np.ndarray]) -> np.ndarray:
    """The sum of tables of different length."""
    whole = np.zeros(max(map(len, counts)), np.int64)
    for one in counts:
        whole[: len(one)] += one
    return whole
