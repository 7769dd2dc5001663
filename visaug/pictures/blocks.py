"""Blocks of 8 x 8 pixels in the frequency domain: which are flat, and how much noise they hold.

White noise puts the same variance into every coefficient of an orthonormal DCT, independently. Blocks are chosen by low
coefficients and the noise is taken from high ones, so the choice does not bias it. Coefficients of horizontal frequency 0
hold the noise of rows too, those of vertical frequency 0 that of columns: the noise of pixels comes from the others. The
blocks are those of the JPEG grid, and a coefficient's known rounding step is part of its expected mean square.
"""

import io
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft, ndimage, stats

from visaug.pictures.files import PictureSet

SIDE = 8  # px, of a block of JPEG
U, V = np.indices((SIDE, SIDE))  # frequencies down and across
INNER = (U > 0) & (V > 0)
CHOICE = INNER & (U + V <= 4)  # shows structure
NOISE = INNER & (U + V > 4)  # shows noise
LINE = np.arange(SIDE) > 3  # of the coefficients of rows or columns, those that shading does not reach
PIXELS_ROUNDED = 1 / 12
EDGE = 8.0  # low coefficients of a line above this many medians are an edge of the scene
_CHOSEN = int(np.count_nonzero(CHOICE))
_FLAT = float(stats.chi2.ppf(0.9, _CHOSEN))  # sum of squares of noise alone up to which a block is flat
FLAT_MEAN = float(stats.chi2.cdf(_FLAT, _CHOSEN + 2)) / 0.9  # of the squares in flat blocks over the noise's
_LEAST = 16  # blocks for one level: their variance is then known to about a tenth
_DEVIATIONS = np.geomspace(0.1, 120, 900)
_COARSEST = 2.5  # rounding step of JPEG over the standard deviation of noise


def texture_share(which: np.ndarray = NOISE) -> float:
    """Power of texture at some coefficients over that at those that tell structure, where it falls as frequency squared.
    That is the mean law of natural scenes: D. J. Field, J. Opt. Soc. Am. A 4 (1987) 2379.
    """
    power = 1 / np.maximum(U**2 + V**2, 1)
    return float(power[which].mean() / power[CHOICE].mean())


@dataclass(frozen=True)
class Blocks:
    """Coefficients (n, 8, 8), mean level (n,), number of the picture (n,), highest level of the block and its neighbours (n,)."""

    coefficients: np.ndarray
    level: np.ndarray
    picture: np.ndarray
    around: np.ndarray


def cut(pictures: np.ndarray) -> np.ndarray:
    """Pictures (n, H, W) by block: (n, R, 8, C, 8), without a copy."""
    n, height, width = pictures.shape
    return pictures.reshape(n, height // SIDE, SIDE, width // SIDE, SIDE)


def blocks_of(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients (R, C, 8, 8) and level (R, C) of the blocks, and which may be used (neither saturated nor all black)."""
    rows, columns = (n // SIDE for n in picture.shape)
    pixels = picture[: rows * SIDE, : columns * SIDE].reshape(rows, SIDE, columns, SIDE).transpose(0, 2, 1, 3)
    usable = (pixels.max((2, 3)) < 255) & (pixels.max((2, 3)) > 0)
    coefficients = np.asarray(fft.dctn(pixels, axes=(2, 3), norm="ortho"))
    return coefficients, coefficients[..., 0, 0] / SIDE, usable


def sample(pictures: PictureSet, seed: int) -> tuple[Blocks, float]:
    """Blocks of all pictures, evenly many of each; and the share of all blocks that are saturated or black."""
    rng = np.random.default_rng(seed)
    most = max(200_000 // len(pictures), 200)
    parts, left_out = [], []
    for n in range(len(pictures)):
        coefficients, level, usable = blocks_of(pictures.read(n))
        left_out.append(1 - usable.mean() if usable.size else 1.0)
        chosen = np.flatnonzero(usable)
        if len(chosen) > most:
            chosen = rng.choice(chosen, most, replace=False)
        around = ndimage.maximum_filter(level, 3).ravel()[chosen]
        coefficients = coefficients.reshape(-1, SIDE, SIDE)[chosen].astype(np.float32)
        parts.append((coefficients, level.ravel()[chosen], np.full(len(chosen), n), around))
    return Blocks(*(np.concatenate(p) for p in zip(*parts, strict=True))), float(np.mean(left_out))


class Rounding:
    """Mean squares of coefficients of Gaussian noise that JPEG has rounded, and the noise behind given ones."""

    def __init__(self, steps: np.ndarray, is_jpeg: bool) -> None:
        self.steps = steps
        self.kinds = np.unique(steps[NOISE]) if is_jpeg else np.array([0.0])
        self.of = np.searchsorted(self.kinds, steps) if is_jpeg else np.zeros(steps.shape, int)
        self._table = np.array([_mean_square(_DEVIATIONS, step) for step in self.kinds])
        self.is_jpeg = is_jpeg
        self._calibration: tuple[np.ndarray, np.ndarray] | None = None
        self._low = _mean_square(_DEVIATIONS, float(np.mean(steps[CHOICE]))) if is_jpeg else _DEVIATIONS**2
        if is_jpeg:
            self._calibration = self._calibrate(steps)

    def _calibrate(self, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What `variance` finds in Gaussian noise that the codec itself has compressed, and what was put in.
        Integer transforms and the rounding of whole pixels move it by some per cent.
        """
        from PIL import Image

        rng = np.random.default_rng(0)
        given, found = [], []
        for deviation in np.geomspace(0.4, 20, 12):
            pixels = np.rint(rng.normal(128 + rng.uniform(-0.5, 0.5), deviation, (512, 512))).clip(0, 255)
            file, tables = io.BytesIO(), [steps.astype(int).ravel().tolist()]
            Image.fromarray(pixels.astype(np.uint8)).save(file, "JPEG", qtables=tables)
            coefficients, _, _ = blocks_of(np.asarray(Image.open(file)).astype(float))
            coefficients = coefficients.reshape(-1, SIDE, SIDE)
            found.append(self.variance(self.sums(coefficients).sum(0), self.counts() * len(coefficients)))
            given.append(pixels.var())
        return np.maximum.accumulate(np.log(found)), np.log(given)

    def sums(self, coefficients: np.ndarray, which: np.ndarray = NOISE) -> np.ndarray:
        """Sums of squares of each block's coefficients by kind, (n, kinds)."""
        squares = coefficients[:, which] ** 2
        return np.stack([squares[:, self.of[which] == k].sum(1) for k in range(len(self.kinds))], 1)

    def counts(self, which: np.ndarray = NOISE) -> np.ndarray:
        return np.array([np.count_nonzero(self.of[which] == k) for k in range(len(self.kinds))])

    def variance(self, sums: np.ndarray, counts: np.ndarray) -> float:
        """Variance of the noise before rounding, from sums of squares and their numbers: gamma quasi-likelihood.
        Steps of more than `_COARSEST` standard deviations round nearly all away and are left out.
        """
        mean = sums / np.maximum(counts, 1)
        score = np.log(self._table) + mean[:, None] / self._table
        deviation = _DEVIATIONS[np.argmin(score[0] if counts[0] else score.sum(0))]
        usable = (self.kinds <= _COARSEST * deviation) & (counts > 0)
        if not usable.any():
            usable = counts > 0
        total = (score[usable] * counts[usable, None]).sum(0)
        best = int(np.clip(np.argmin(total), 1, len(total) - 2))
        left, middle, right = total[best - 1 : best + 2]
        curvature = left - 2 * middle + right
        shift = 0.5 * (left - right) / curvature if curvature > 0 else 0.0
        step = np.log(_DEVIATIONS[1] / _DEVIATIONS[0])
        log_variance = 2 * (np.log(_DEVIATIONS[best]) + np.clip(shift, -0.5, 0.5) * step)
        if self._calibration is not None:
            log_variance = np.interp(log_variance, *self._calibration)
        return float(np.exp(log_variance))

    @cached_property
    def least(self) -> float:
        """What `variance` finds where there is no noise: that of rounding to codes, or all the noise that JPEG rounds away."""
        counts = self.counts()
        return self.variance(PIXELS_ROUNDED * counts, counts)

    def degrees(self, variance: float) -> float:
        """Coefficients of a block that tell of noise: of those that JPEG rounds, half the ones that `variance` uses."""
        if not self.is_jpeg:
            return float(self.counts().sum())
        told = self.counts() * (self.kinds <= _COARSEST * np.sqrt(variance))
        return 0.5 * float(told.sum() or self.counts()[0])

    def chosen_mean(self, variance: np.ndarray | float) -> np.ndarray:
        """Expected mean square of the coefficients that show structure."""
        return np.interp(np.sqrt(variance), _DEVIATIONS, self._low)


def _mean_square(deviation: np.ndarray, step: float) -> np.ndarray:
    """E[(q round(x / q))^2] of Gaussian x, and the rounding of the decoded pixels."""
    if step == 0:
        return deviation**2
    k = np.arange(1, 400)
    beyond = stats.norm.sf((k - 0.5) * step / deviation[:, None])
    return 2 * step**2 * ((2 * k - 1) * beyond).sum(1) + PIXELS_ROUNDED


@dataclass(frozen=True)
class Levels:
    """Noise of flat blocks by level."""

    edges: np.ndarray  # of the bins
    number: np.ndarray  # of the bin, among the edges
    # of the bins that hold enough flat blocks, in DN and DN^2 of 8 bit
    level: np.ndarray
    variance: np.ndarray
    chosen: np.ndarray  # the variance where blocks of the sky are chosen as at other levels
    error: np.ndarray  # standard error of the logarithm of the variance
    structure: np.ndarray
    # by picture and bin, for other draws of the pictures
    sums: np.ndarray
    levels: np.ndarray
    blocks: np.ndarray

    def variance_at(self, level: np.ndarray | float) -> np.ndarray:
        return np.asarray(np.interp(level, self.level, self.variance))

    def curve(self, scale: float = 1.0) -> dict[str, np.ndarray]:
        """Noise and its standard error by level, in DN of 8 bit times `scale`."""
        noise = np.sqrt(self.variance) * scale
        return {"level_dn": self.level * scale, "noise_dn": noise, "error_dn": noise * self.error / 2}

    def where(self, kept: np.ndarray) -> "Levels":
        """The levels of a mask (levels,)."""
        of_levels = ("number", "level", "variance", "chosen", "error", "structure")
        parts = {n: getattr(self, n)[kept] for n in of_levels}
        return replace(self, **parts, **{n: getattr(self, n)[:, kept] for n in ("sums", "levels", "blocks")})

    def of_pictures(self, weights: np.ndarray, rounding: Rounding) -> tuple[np.ndarray, np.ndarray]:
        """Level and variance of each bin where the pictures have these weights; NaN where nothing is left."""
        blocks = np.tensordot(weights, self.blocks, 1)
        level = np.tensordot(weights, self.levels, 1) / np.maximum(blocks, 1e-9)
        sums = np.tensordot(weights, self.sums, 1)
        of_block = rounding.counts()
        variance = [rounding.variance(s, of_block * n) if n > 0 else np.nan for s, n in zip(sums, blocks)]
        return level, np.array(variance)


def flat_limit(variance: np.ndarray | float, rounding: Rounding) -> np.ndarray:
    """Mean square of low coefficients that a tenth of blocks of noise alone exceed."""
    return rounding.chosen_mean(variance) * _FLAT / _CHOSEN


def is_flat(coefficients: np.ndarray, variance: np.ndarray, rounding: Rounding) -> np.ndarray:
    """Which blocks' low coefficients are no larger than the noise explains."""
    return (coefficients[..., CHOICE] ** 2).mean(-1) <= flat_limit(variance, rounding)


def noise_by_level(
    blocks: Blocks, rounding: Rounding, pictures: int, one_level: tuple[float, float] | None = None
) -> Levels:
    """Variance of pixels in flat blocks, level by level. Bins are 1 DN wide at black and grow by 6 % of the level.
    Blocks between the two levels of `one_level` are one bin: offsets tell them apart, not light. Where no neighbour is brighter
    there is no scene whose structure could pass for noise, so all blocks are used: a choice of quiet ones would lose the tails
    of noise that has heavy ones.
    """
    edges = [-0.5]
    while edges[-1] < 255:
        edges.append(edges[-1] + 1 + 0.06 * max(edges[-1], 0))
    edges = np.array(edges)
    if one_level is not None:
        low, high = one_level
        edges = np.concatenate([edges[edges < low], [low, high], edges[edges > high]])
    which = np.digitize(blocks.level, edges) - 1
    low = (blocks.coefficients[:, CHOICE] ** 2).mean(1)
    sums = rounding.sums(blocks.coefficients)
    rows = []
    for k in range(len(edges) - 1):
        here = np.flatnonzero(which == k)
        if len(here) < _LEAST:
            continue
        kept, variance, structure = _flat_ones(low[here], sums[here], rounding)
        if len(kept) < _LEAST:
            continue
        used, chosen = here[kept], variance
        if one_level is not None and edges[k] == one_level[0]:
            inside = here[blocks.around[here] < one_level[1]]
            if len(inside) >= _LEAST:
                used = inside
                variance = rounding.variance(sums[inside].sum(0), rounding.counts() * len(inside))
        rows.append((k, used, variance, structure, chosen))
    number, members, variance, structure, chosen = map(list, zip(*rows)) if rows else ([],) * 5
    shape = (pictures, len(rows))
    all_sums, levels, counts = np.zeros((*shape, len(rounding.kinds))), np.zeros(shape), np.zeros(shape)
    for j, used in enumerate(members):
        for table, values in ((all_sums, sums[used]), (levels, blocks.level[used]), (counts, 1)):
            np.add.at(table[:, j], blocks.picture[used], values)
    total = counts.sum(0)
    level = levels.sum(0) / np.maximum(total, 1)
    error = np.sqrt(2 / np.maximum(total * np.array([rounding.degrees(v) for v in variance]), 1))
    parts = np.array(variance), np.array(chosen), error, np.array(structure)
    return Levels(edges, np.array(number, int), level, *parts, all_sums, levels, counts)


def _flat_ones(low: np.ndarray, sums: np.ndarray, rounding: Rounding) -> tuple[np.ndarray, float, float]:
    """Flat blocks of one level, their variance, and by what share their low coefficients exceed it."""
    per_block = rounding.counts()
    outlying = stats.chi2.ppf(1 - 1e-4, per_block[0]) / per_block[0]
    kept = np.argsort(low)[: max(len(low) // 10, _LEAST)]
    variance = rounding.variance(sums[kept].sum(0), per_block * len(kept))
    for _ in range(6):
        flat = low <= flat_limit(variance, rounding)
        expected = rounding._table[0][np.argmin(abs(_DEVIATIONS**2 - variance))]
        flat &= sums[:, 0] / per_block[0] <= outlying * expected
        kept = np.flatnonzero(flat)
        if not len(kept):
            return kept, variance, np.inf
        variance = rounding.variance(sums[kept].sum(0), per_block * len(kept))
    structure = low[kept].mean() / rounding.chosen_mean(variance) / FLAT_MEAN - 1
    return kept, variance, max(float(structure), 0.0)
