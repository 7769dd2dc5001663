"""Whether what frames of a group have beyond their mean is independent from frame to frame.

For frames x_i = pattern + independent noise, whatever the pattern and the frames' own variances, sum_ij A_ij x_i x_j has the
expectation 0 for every symmetric A without a diagonal whose rows sum to 0. Two cameras in one folder, frames that are turned
or shifted, a pattern that changes, and averaging over time in the camera make such sums large. One frame alone that is apart adds
to its own variance, which three frames tell: v_k follows from the squares of the residuals about the mean.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import compress

import numpy as np
from scipy import stats

from visaug.characterization.groups import Measured
from visaug.characterization.moments import middle
from visaug.core.wording import listed
from visaug.frames import FrameSet
from visaug.statistics.findings import FALSE_ALARM, FROM_NOISE, Findings


@dataclass(frozen=True)
class Dependence:
    """Of the frames of one group."""

    probability: float  # of their sums for independent noise
    correlation: float  # of the frames' residuals, by which the sums exceed these
    in_sequence: bool  # whether frames that follow each other are alike
    parts: tuple[tuple[int, ...], tuple[int, ...]]  # the frames by their part in what they share most


def check(measured: Measured, found: Findings) -> None:
    groups = [m for m in measured.moments if m.n > 2 and min(m.shape) > 3 and not m.clipped_high]
    tested, variances = [], []
    for m in groups:
        indices = chosen(m.group.indices)
        if (residuals := residuals_of(measured.frames, indices, m.shape)) is None:
            continue
        variances.append((m, indices, *frame_variances(residuals)))
        if m.n > 3:  # of three no such sum is left
            tested.append(dependence(residuals, indices))
    matters = 0.01  # correlation of the noise of two frames
    sure = [d for d in tested if d.probability < FALSE_ALARM / len(tested) and d.correlation > matters]
    if not sure:
        _check_variances(measured, variances, len(groups), found)
        return
    worst = max(sure, key=lambda d: d.correlation)
    if worst.in_sequence:
        what = "frames that follow each other are alike (averaging over time in the camera, or light that lingers)"
    else:
        records = measured.frames.records
        sequences = [listed([records[i].sequence for i in part], 6) for part in worst.parts]
        what = (
            f"frames {sequences[0]} have another pattern than frames {sequences[1]} (two cameras, frames that are turned or "
            "shifted, a light or a gain that changes over the frame)"
        )
    found.warn(
        f"frames_dependent: in {len(sure)} of {len(tested)} groups of frames taken alike the noise correlates from frame to "
        f"frame by up to {worst.correlation:.3f}: {what}, so that their differences are not noise alone",
        spoils=FROM_NOISE,
    )


def _check_variances(measured: Measured, variances_of: list[tuple], several: int, found: Findings) -> None:
    """Warns of frames that have more noise than the others of their group, or less, beyond what their light explains.
    `variances_of`: group, its frames, the variance of the noise of each, and its standard error.
    `several`: number of groups of three or more frames.
    """
    dark = {id(v.flat): v.dark.mean for v in measured.levels}
    apart: list[int] = []
    for m, indices, variances, error in variances_of:
        usual = float(np.median(variances))
        levels = np.array([m.frame_means[m.group.indices.index(i)] for i in indices])
        signal = m.mean - dark.get(id(m), 0.0)
        is_lit = signal > 0 and m.group.kind == "flat"
        by_light = np.abs(levels - np.median(levels)) / signal if is_lit else 0.0
        excess = np.abs(variances / usual - 1) - by_light
        # The test of single frames has its own probability of a false alarm in one set.
        least = float(stats.norm.isf(FALSE_ALARM / 2 / len(indices) / several))
        # 5 % of the variance of the others matter; the median of few variances has an error of its own, hence 1.3
        apart += [i for i, e in zip(indices, excess) if e > max(0.05, 1.3 * least * error / usual)]
    if apart:
        numbers = listed([measured.frames.records[i].sequence for i in sorted(apart)], 8)
        found.warn(
            f"frames_dependent: frames {numbers} differ from the others of their setting by "
            "another noise or another pattern (another camera, moved, torn or disturbed frames)",
            spoils=FROM_NOISE,
        )


def frame_variances(residuals: np.ndarray) -> tuple[np.ndarray, float]:
    """Variance of the noise of each of n frames, from their residuals (n, P) about their mean, and its standard error."""
    n, pixels = residuals.shape
    squares = residuals**2
    square = squares.mean(1)
    variances = (square - square.sum() / (n * (n - 1))) / (1 - 2 / n)
    # Of normal noise, from the covariances of the squares; tails and uneven pixels by the fourth moment.
    factor = (2 * (1 - 1 / n) ** 2 - 4 / n**2 + 2 / (n**2 * (n - 1))) / (1 - 2 / n) ** 2
    kurtosis = float((squares**2).mean() / squares.mean() ** 2)
    usual = float(np.median(variances))
    return variances, usual * float(np.sqrt(factor * max(kurtosis - 1, 2) / 2 / pixels))


def dependence(residuals: np.ndarray, indices: tuple[int, ...]) -> Dependence:
    """Of the frames with these indices, by their residuals (n, P), see `residuals_of`; n is 4 or more."""
    n, pixels = residuals.shape
    variances = (residuals**2).mean(1) * n / (n - 1)
    basis = contrasts(n)
    gram = residuals @ residuals.T / pixels
    sums = np.einsum("kij,ij->k", basis, gram)
    weighted = basis * np.sqrt(variances)[:, None] * np.sqrt(variances)
    covariance = 2 * np.einsum("kij,lij->kl", weighted, weighted) / pixels * _unevenness(residuals)
    square = float(sums @ np.linalg.solve(covariance, sums))
    excess = max(square - len(basis), 0.0) / square if square else 0.0
    shared = np.einsum("k,kij->ij", sums, basis)  # what the frames share, as seen by the contrasts
    correlation = float(np.sqrt(excess * (shared**2).sum() / (n * (n - 1)))) / float(variances.mean())
    # whether frames that follow each other share more than any others do
    nearest, *others = (float(np.diagonal(shared, d).mean()) for d in range(1, n - 1))
    in_sequence = nearest > 0 and nearest > 2 * max(others)
    part = np.linalg.eigh(shared)[1][:, -1]  # of each frame in what they share most, whose sign splits them
    first = part * part[0] > 0
    parts = tuple(compress(indices, first)), tuple(compress(indices, ~first))
    return Dependence(float(stats.chi2.sf(square, len(basis))), correlation, in_sequence, parts)


def chosen(indices: tuple[int, ...]) -> tuple[int, ...]:
    """Of a group of more than a dozen frames the first and the last half dozen."""
    return indices if len(indices) <= 12 else indices[:6] + indices[-6:]


@lru_cache(maxsize=16)
def contrasts(n: int) -> np.ndarray:
    """(K, n, n) orthonormal basis of the symmetric matrices without a diagonal whose rows sum to 0, K = n (n - 3) / 2."""
    pairs = np.array(np.triu_indices(n, 1)).T
    rows = np.zeros((n, len(pairs)))
    for k, (i, j) in enumerate(pairs):
        rows[i, k] = rows[j, k] = 1
    free = np.linalg.svd(rows)[2][n:]
    made = np.zeros((len(free), n, n))
    made[:, pairs[:, 0], pairs[:, 1]] = free / np.sqrt(2)
    return made + made.transpose(0, 2, 1)


def residuals_of(frames: FrameSet, indices: tuple[int, ...], shape: tuple[int, int]) -> np.ndarray | None:
    """(n, P) of every frame about the mean; level, rows, columns and a change of the whole light or gain taken out."""
    part = np.stack([frames.read(i)[middle(shape)] for i in indices]).astype(np.float64)
    part -= part.mean(2, keepdims=True)
    part -= part.mean(1, keepdims=True)
    mean = part.mean(0)
    square = float((mean**2).sum())
    left = part - mean
    if square > 0:
        left -= (left * mean).sum((1, 2), keepdims=True) / square * mean
    left = left.reshape(len(indices), -1)
    scale = np.sqrt((left**2).mean(1))
    if not (scale > 1e-6).all():  # copies differ by what floats round
        return None
    outlier = 5.0  # standard deviations: single pixels that jump are another matter
    return left[:, (np.abs(left) < outlier * scale[:, None]).all(0)]


def _unevenness(residuals: np.ndarray) -> float:
    """Mean square over squared mean of the pixels' variance, from products of the differences of separate frames."""
    steps = np.diff(residuals, axis=0)[::2] ** 2
    a, b = steps[0::2], steps[1::2]
    ratios = [float((p * q).mean() / (p.mean() * q.mean())) for p, q in zip(a, b)]
    return max(float(np.mean(ratios)), 1.0)
