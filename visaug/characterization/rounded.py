"""Likelihood of values that are rounded to whole DN and cut at 0.

Every pixel's value is its location plus noise. The likelihood of a pixel's values is known for any location; integrated over a
normal law of locations it gives read noise and pattern together. Only what the cut and the rounding hide is lost.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import optimize

from visaug.characterization import tukey
from visaug.characterization.moments import GroupMoments
from visaug.core.constants import MAD
from visaug.core.intervals import t_quantile
from visaug.frames import FrameSet

BLOCKS = 20  # of rows, for standard errors
_RIDGE = 1e-6  # of the information: keeps what is not told at no information


@dataclass(frozen=True)
class CodeHistograms:
    """Counts (P, bins) of chosen pixels, edges between bins (DN above `origin`; bin 0 may be the cut), places of the pixels."""

    counts: np.ndarray
    edges: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    frames: int
    origin: int

    @cached_property
    def alike(self) -> tuple[np.ndarray, np.ndarray]:
        """Distinct rows of counts, and which of them each pixel has: few where noise is finer than a DN."""
        patterns, which = np.unique(self.counts, axis=0, return_inverse=True)
        return patterns, which.ravel()


@dataclass(frozen=True)
class RoundedFit:
    """Log sigma (DN), shape (nan: normal noise), shift of the locations (DN), log of their spread (DN)."""

    log_sigma: float
    shape: float
    shift: float
    log_spread: float
    # (4, 4) of the four, from sums over rows and columns; 0 where a parameter is fixed
    covariance: np.ndarray
    dependence: float = 1.0  # variance of log sigma over that of independent pixels

    @property
    def sigma(self) -> float:
        return math.exp(self.log_sigma)

    @property
    def spread(self) -> float:
        return math.exp(self.log_spread)


def take_sample(
    frames: FrameSet, indices: tuple[int, ...], still: GroupMoments, seed: int, coarse: bool
) -> CodeHistograms:
    """Counts of pixels drawn by chance; more of a coarse converter's, whose pixels are alike in many."""
    height, width = still.shape
    chosen = np.random.default_rng(seed).permutation(height * width)[: 20000 if coarse else 3000]
    rows, columns = np.divmod(np.sort(chosen), width)
    values = np.stack([frames.read(i)[rows, columns] for i in indices])
    sigma = MAD * np.median(np.abs(values - values.mean(0)))
    step = max(1, round(max(sigma, 1.0) / 6))  # bins per sigma
    origin = max(int(values.min()) - 1, 0)
    values = values - origin
    edges = _edges(float(np.median(values)) + 5 * max(sigma, 1.0), float(values.max()), step)
    bins = np.searchsorted(edges, values)
    n = len(edges) + 1
    flat = (np.arange(len(rows))[None] * n + bins).ravel()
    counts = np.bincount(flat, minlength=len(rows) * n).reshape(len(rows), n).astype(np.float64)
    return CodeHistograms(counts, edges, rows, columns, len(indices), origin)


def _edges(dense: float, top: float, step: int) -> np.ndarray:
    """Edges between bins, half-way between DN: at the cut, every `step` DN up to `dense`, then ever wider."""
    edges = [0.5]
    while edges[-1] < top:
        wide = step if edges[-1] < dense else max(step, int(0.15 * (edges[-1] - dense)) + step)
        edges.append(edges[-1] + wide)
    return np.array(edges)


def fit_locations(
    sample: CodeHistograms, centre: np.ndarray, start: RoundedFit | None, free: tuple[int, ...]
) -> RoundedFit:
    """Maximum likelihood, the location of pixel p being N(centre_p + shift, spread); `free` parameters only.
    Without a start and with a fixed shape the noise is normal.
    """
    if start is None:
        mids = np.concatenate([[0.0], 0.5 * (sample.edges[:-1] + sample.edges[1:]), sample.edges[-1:]])
        mean = sample.counts @ mids / sample.frames
        level = float(np.median(mean))
        noise = float(np.sqrt(np.median((sample.counts @ mids**2) / sample.frames - mean**2)))
        shape, shift = (0.0, level - 0.3 * noise) if 1 in free else (math.nan, level)
        first = [math.log(max(noise, 0.3) * 1.1), shape, shift, math.log(max(mean.std(), 0.3))]
    else:
        first = [start.log_sigma, start.shape, 0.0 if centre.any() else start.shift, start.log_spread]

    p = np.array(first)
    value = _log_likelihood(p, sample, centre).sum()
    for _ in range(12):  # Fisher scoring: the information is the scores' outer product
        scores = _scores(p, sample, centre)[list(free)]
        gradient = scores.sum(1)
        step = np.zeros(4)
        step[list(free)] = np.linalg.solve(scores @ scores.T + _RIDGE * np.eye(len(free)), gradient)
        if gradient @ step[list(free)] < 0.02:  # gain of log-likelihood: a seventh of a standard error
            break
        most = 0.3, 0.1, math.exp(p[0]), 0.5
        step *= min(1.0, *(m / max(abs(s), 1e-12) for s, m in zip(step, most)))
        for _ in range(6):
            trial = p + step
            trial[1] = np.clip(trial[1], *tukey.SHAPE_BOUNDS)
            trial[3] = max(trial[3], p[0] - 4.0)  # a spread of 2 % of the noise is none
            if (new := _log_likelihood(trial, sample, centre).sum()) > value:
                p, value = trial, new
                break
            step *= 0.4
        else:
            break
    covariance = np.zeros((4, 4))
    scores = _scores(p, sample, centre)[list(free)]
    covariance[np.ix_(free, free)] = _sandwich(scores, sample)
    independent = np.linalg.inv(scores @ scores.T + _RIDGE * np.eye(len(free)))[0, 0]
    dependence = max(float(covariance[0, 0] / independent), 1.0)
    return RoundedFit(*map(float, p), covariance=covariance, dependence=dependence)


class SigmaLikelihood:
    """Log-likelihood of normal noise finer than the converter's steps against its standard deviation.
    It may be flat down to no noise at all, and may have several maxima: it is mapped over a grid, with location and
    spread fitted at each standard deviation.
    """

    def __init__(self, sample: CodeHistograms) -> None:
        patterns, which = sample.alike
        self._times = np.bincount(which)
        self._few, self._centre = replace(sample, counts=patterns), np.zeros(len(patterns))
        mids = np.concatenate([[0.0], 0.5 * (sample.edges[:-1] + sample.edges[1:]), sample.edges[-1:] + 0.5])
        mean = sample.counts @ mids / sample.frames
        self._start = np.array([float(mean.mean()), math.log(max(float(mean.std()), 0.05))])
        self._grid = np.log(np.geomspace(0.02, 1.2, 25))  # DN
        self._found = [self._at(log_sigma) for log_sigma in self._grid]
        self._losses = np.array([loss for loss, _ in self._found])

    def _at(self, log_sigma: float) -> tuple[float, np.ndarray]:
        """Minus the log-likelihood at one standard deviation, with the best location and log spread."""

        def loss(q: np.ndarray) -> float:
            p = np.array([log_sigma, math.nan, q[0], np.clip(q[1], -6, 3)])
            return -float(self._times @ _log_likelihood(p, self._few, self._centre))

        simplex = self._start + np.array([[0.0, 0.0], [0.2, 0.0], [0.0, -1.5]])
        options = {"xatol": 2e-3, "fatol": 0.01, "initial_simplex": simplex}
        best = optimize.minimize(loss, self._start, method="Nelder-Mead", options=options)
        return float(best.fun), best.x

    def start(self) -> RoundedFit:
        """The best of the grid, to start a fit from."""
        best = int(self._losses.argmin())
        shift, log_spread = map(float, self._found[best][1])
        return RoundedFit(float(self._grid[best]), math.nan, shift, log_spread, np.zeros((4, 4)))

    def bounds(self, fit: RoundedFit) -> tuple[float, float]:
        """95 % interval of the standard deviation, DN, by the likelihood ratio; from 0 where nothing bounds it.
        What pixels of a row or column have in common stretches the ratio (R. E. Chandler and S. Bate, Biometrika 94 (2007) 167).
        """
        least = min(self._at(fit.log_sigma)[0], float(self._losses.min()))
        limit = least + 0.5 * t_quantile(BLOCKS - 1) ** 2 * fit.dependence

        def excess(log_sigma: float) -> float:
            return self._at(log_sigma)[0] - limit

        inside = np.flatnonzero(self._losses < limit)
        first, last = (int(inside[0]), int(inside[-1])) if inside.size else (len(self._grid), -1)
        first = min(first, int(np.searchsorted(self._grid, fit.log_sigma)))
        last = max(last, int(np.searchsorted(self._grid, fit.log_sigma)) - 1)
        low, high = 0.0, math.inf
        if first > 0:
            above = min(self._grid[first], fit.log_sigma) if first < len(self._grid) else fit.log_sigma
            low = math.exp(_root(excess, float(self._grid[first - 1]), float(above)))
        if last < len(self._grid) - 1:
            below = max(self._grid[last], fit.log_sigma) if last >= 0 else fit.log_sigma
            high = math.exp(_root(excess, float(below), float(self._grid[last + 1])))
        return low, high


def _root(excess: Callable[[float], float], a: float, b: float) -> float:
    """Where a function changes its sign between two places; the outer one where it does not by a rounding error."""
    if excess(a) * excess(b) > 0:
        return a if excess(a) > excess(b) else b
    return optimize.root_scalar(excess, bracket=(a, b), xtol=5e-3).root


def _log_likelihood(p: np.ndarray, sample: CodeHistograms, centre: np.ndarray) -> np.ndarray:
    """(P,) logarithm of each pixel's likelihood, its location integrated out on a grid."""
    sigma, shape, shift, spread = math.exp(p[0]), p[1], p[2], math.exp(p[3])
    law = tukey.law(shape)
    step = min(0.8 * sigma / math.sqrt(sample.frames), 0.5 * spread)
    low, high = centre.min() + shift - 5 * spread, centre.max() + shift + 5 * spread
    nodes = np.linspace(low, high, int(np.clip((high - low) / step, 24, 500)))
    inner = np.interp((sample.edges[:, None] - nodes[None]) / sigma, law.x, law.distribution)
    cumulative = np.concatenate([np.zeros((1, nodes.size)), inner, np.ones((1, nodes.size))])
    logs = np.log(np.maximum(np.diff(cumulative, axis=0), 1e-12))
    counts, which = sample.alike if not centre.any() else (sample.counts, slice(None))
    places = centre[: len(counts)] + shift
    joint = counts @ logs - 0.5 * ((nodes[None] - places[:, None]) / spread) ** 2
    top = joint.max(1, keepdims=True)
    scale = (nodes[1] - nodes[0]) / (spread * math.sqrt(2 * math.pi))
    return (top[:, 0] + np.log(np.exp(joint - top).sum(1) * scale))[which]


def _scores(p: np.ndarray, sample: CodeHistograms, centre: np.ndarray) -> np.ndarray:
    """(4, P) derivatives of each pixel's log-likelihood."""
    steps = np.array([2e-3, 4e-3, 0.02 * math.exp(p[0]), 4e-3])
    return np.stack(
        [(_log_likelihood(p + s, sample, centre) - _log_likelihood(p - s, sample, centre)) / (2 * s.sum())
         for s in np.diag(steps)]
    )  # fmt: skip


def _sandwich(scores: np.ndarray, sample: CodeHistograms) -> np.ndarray:
    """Covariance from scores summed over blocks of rows and over columns.
    Pixels of a column share the error of its centre, which near the cut moves the spread at first order. Sums
    over rows and over columns, less what both count, hold either dependence (A. C. Cameron, J. B. Gelbach and
    D. L. Miller, J. Bus. Econ. Stat. 29 (2011) 238).
    """
    information = scores @ scores.T
    inverse = np.linalg.inv(information + _RIDGE * np.eye(len(scores)))  # of what is not told: no information
    by_row = _clustered(scores, np.minimum(sample.rows * BLOCKS // (sample.rows.max() + 1), BLOCKS - 1))
    by_both = by_row + _clustered(scores, sample.columns) - information
    rows_alone, both = (inverse @ spread @ inverse for spread in (by_row, by_both))
    larger = (np.diag(both) > np.diag(rows_alone)).all()
    return both if larger else np.maximum(both, rows_alone) * np.eye(len(both))


def _clustered(scores: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """Spread of the sum of scores (4, P), from sums over clusters, each independent of the others."""
    _, cluster = np.unique(cluster, return_inverse=True)
    sums = np.stack([np.bincount(cluster, s) for s in scores])
    sums -= sums.mean(1, keepdims=True)
    return sums @ sums.T * sums.shape[1] / (sums.shape[1] - 1)
