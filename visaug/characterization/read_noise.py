"""Standard deviation and shape of read noise by maximum likelihood on residuals of the master bias; and whether every pixel has
noise of its own, from the variances of single pixels.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from visaug.characterization import tukey
from visaug.characterization.moments import GroupMoments, mean_map, pixel_variances
from visaug.characterization.rounded import BLOCKS
from visaug.frames import FrameSet


@dataclass(frozen=True)
class ReadNoiseResult:
    """Read noise of single pixels: standard deviation in DN, shape, errors (one sigma), fitted histogram."""

    sigma_dn: float
    shape: float
    sigma_error: float
    shape_error: float
    df: float
    centres_dn: np.ndarray
    counts: np.ndarray
    model: np.ndarray


def fit(
    frames: FrameSet, indices: Sequence[int], moments: GroupMoments, other_variance: float = 0.0
) -> ReadNoiseResult:
    """Fit residuals of two or more frames about their own mean map; nothing may clip.
    The residual of n frames is (1 - 1/n) times one draw less 1/n times the n - 1 others, so its law is known from that of one
    draw through the characteristic function: no approximation for small n. Each draw is Tukey-lambda noise, rounding (uniform
    over a DN) and a Gaussian of `other_variance` (dark current's shot noise, DN^2). Offsets of whole frames, rows or columns
    that change from frame to frame are taken out where there are any. The residuals of one pixel are dependent, so errors
    come from blocks of rows (sandwich estimator).
    """
    n = len(indices)
    assert moments.temporal is not None
    width, histogram, kept = _histogram(frames, indices, moments)
    counts = histogram.sum(0)
    half = counts.size // 2
    centres = (np.arange(counts.size) - half) * width

    def log_probabilities(p: np.ndarray) -> np.ndarray:
        return np.log(_bin_probabilities(math.exp(p[0]), p[1], n, width, half, other_variance))

    def loss(p: np.ndarray) -> float:
        if not tukey.SHAPE_BOUNDS[0] <= p[1] <= tukey.SHAPE_BOUNDS[1]:
            return math.inf
        return -float(counts @ log_probabilities(p)) / counts.sum()

    spread = math.sqrt(max(moments.temporal.pixel - 1 / 12 - other_variance, 0.02))
    start = [math.log(spread), 0.05]
    simplex = [start, [start[0] + 0.05, 0.05], [start[0], -0.15]]
    options = {"initial_simplex": simplex, "xatol": 2e-5, "fatol": 1e-10}
    p = optimize.minimize(loss, start, method="Nelder-Mead", options=options).x
    errors = _sandwich(p, histogram, log_probabilities)
    model = np.exp(log_probabilities(p)) * counts.sum()
    sigma = math.exp(p[0]) / math.sqrt(kept)
    figures = sigma, float(p[1]), sigma * errors[0], errors[1], len(histogram) - 1
    return ReadNoiseResult(*figures, centres, counts, model)


def _histogram(
    frames: FrameSet, indices: Sequence[int], moments: GroupMoments
) -> tuple[float, np.ndarray, float]:
    """Bin width in DN, counts by block of rows and bin (the outermost take the rest), share of variance kept.
    Taking the mean of a row of W pixels out of each takes 1/W of the variance with it.
    """
    n, t = len(indices), moments.temporal
    assert t is not None
    centre = mean_map(frames, indices)
    sigma = math.sqrt(max(t.pixel, 0.05))
    # odd, so that none lies on the edge of a bin, eight of a sigma
    points = round(n * sigma / 8) // 2 * 2 + 1
    width = points / n  # residuals of whole DN lie on multiples of 1/n
    half = math.ceil(40.0 * sigma / width)
    rows_flicker = unsteady(t.row, t.pixel, t.row_df)
    columns_flicker = unsteady(t.column, t.pixel, t.column_df)
    frame_flickers = unsteady(t.frame, max(t.row, t.column, t.pixel), t.frame_df)
    blocks = np.array_split(np.arange(centre.shape[0]), min(BLOCKS, centre.shape[0]))
    counts = np.zeros((len(blocks), 2 * half + 1))
    for i in indices:
        residual = frames.read(i) - centre
        if rows_flicker:
            residual -= residual.mean(1, keepdims=True)
        if columns_flicker:
            residual -= residual.mean(0, keepdims=True)
        if frame_flickers and not (rows_flicker or columns_flicker):
            residual -= residual.mean()
        bins = np.clip(np.rint(residual / width).astype(np.int64) + half, 0, 2 * half)
        for b, rows in enumerate(blocks):
            counts[b] += np.bincount(bins[rows[0] : rows[-1] + 1].ravel(), minlength=2 * half + 1)
    height, columns = centre.shape
    kept = (1 - 1 / columns if rows_flicker else 1.0) * (1 - 1 / height if columns_flicker else 1.0)
    return width, counts, kept


def unsteady(mean_square: float, noise: float, df: int) -> bool:
    """Whether a mean square stands four standard deviations above the noise's."""
    return mean_square > noise * (1 + 4 * math.sqrt(2 / df))


def _bin_probabilities(
    sigma: float, shape: float, n: int, width: float, half: int, other: float
) -> np.ndarray:
    """Probability of each bin of the residual of n draws, from the characteristic function."""
    size = 1 << (2 * (2 * half + 1) - 1).bit_length()
    t = 2 * np.pi * np.fft.rfftfreq(size, d=width)
    law = tukey.standard(round(shape, 5))

    def one(s: np.ndarray) -> np.ndarray:
        return law.phi(sigma * s) * np.sinc(s / (2 * np.pi)) * np.exp(-0.5 * other * s**2)

    # A bin sums the density at its lattice points; rounding as a uniform part makes that exact.
    lattice = t / n / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        points = np.sin(lattice * n * width) / (n * width * np.sin(lattice))
    points[np.abs(np.sin(lattice)) < 1e-9] = 1.0
    spectrum = one((1 - 1 / n) * t) * one(t / n) ** (n - 1) * points
    density = np.fft.irfft(spectrum, size)
    inner = np.maximum(np.concatenate([density[-half:], density[: half + 1]]), 1e-15)
    inner[[0, -1]] += max(1 - inner.sum(), 0.0) / 2
    return inner / inner.sum()


def _sandwich(p: np.ndarray, histogram: np.ndarray, log_probabilities) -> tuple[float, float]:
    steps = np.array([1e-3, 2e-3])
    counts = histogram.sum(0)
    up = [log_probabilities(p + s) for s in np.diag(steps)]
    down = [log_probabilities(p - s) for s in np.diag(steps)]
    gradient = np.stack([(a - b) / (2 * h) for a, b, h in zip(up, down, steps)])
    # Fisher's information of one observation, from the model's own probabilities.
    information = (np.exp(log_probabilities(p)) * gradient) @ gradient.T * counts.sum()
    scores = histogram @ gradient.T
    scores -= scores.mean(0)
    spread = scores.T @ scores * len(scores) / (len(scores) - 1)
    inverse = np.linalg.inv(information)
    covariance = inverse @ spread @ inverse
    return math.sqrt(covariance[0, 0]), math.sqrt(covariance[1, 1])


@dataclass(frozen=True)
class PixelNoiseSpread:
    """Spread of the pixels' own read noise: standard deviation of log sigma, and a map."""

    variance: tuple[float, float]  # of log sigma, and its standard error; it may be negative by chance
    deviation_dn: np.ndarray  # (H, W) standard deviation of every pixel, rounding taken off, DN

    @property
    def spread(self) -> float:
        return math.sqrt(max(self.variance[0], 0.0))

    @property
    def established(self) -> bool:
        value, error = self.variance
        return value > 3.0 * error  # 6 standard errors of its root


def pixel_noise(frames: FrameSet, still: GroupMoments) -> PixelNoiseSpread | None:
    """Of six or more frames without light, else None.
    Pixels of one law have variances that scatter by chance, the more so the heavier its tails, but those of two halves of the
    frames scatter independently. Their logarithms covary by what pixels differ in, 4 s^2 where s is the spread of log sigma.
    """
    if still.n < 6:  # halves of three frames each tell a variance apart from its chance
        return None
    halves = still.group.indices[0::2], still.group.indices[1::2]
    offsets = dict(zip(still.group.indices, still.frame_means))
    first, second = (pixel_variances(frames, half, offsets.__getitem__) for half in halves)
    logs = [np.log(np.maximum(v, 1 / 12)) for v in (first, second)]
    product = (logs[0] - logs[0].mean()) * (logs[1] - logs[1].mean())
    variance = 0.25 * float(product.mean()), 0.25 * float(product.std() / math.sqrt(product.size))
    mixed = (first * (len(halves[0]) - 1) + second * (len(halves[1]) - 1)) / (still.n - 2)
    return PixelNoiseSpread(variance, np.sqrt(np.maximum(mixed - 1 / 12, 0.0)))


def shrunk(noise: PixelNoiseSpread, rms_dn: float) -> np.ndarray:
    """The map without the chance of few frames: the logarithms drawn to their mean until they spread as the pixels' own do,
    scaled to the camera's read noise (rms), (H, W) DN.
    """
    logs = np.log(np.maximum(noise.deviation_dn, 0.1 * rms_dn))
    total = float(logs.std())
    kept = min(noise.spread / total, 1.0) if total > 0 else 0.0
    deviations = np.exp(logs.mean() + kept * (logs - logs.mean()))
    return deviations * rms_dn / math.sqrt(float((deviations**2).mean()))
