"""Accurate DSNU: rows and columns as they are spread and ordered, not as white normal noise.

A profile of row or column means is described by the bands its values fall into (a Gaussian mixture) and by
its slow course (a polynomial); what is left keeps its spectrum. From the three a new pattern of the same
kind can be drawn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import gammaln, log_ndtr

_FALSE_PEAKS = 0.01
_FEWEST_FREQUENCIES = 8
_MOST_BANDS = 4
_MOST_ORDER = 6


@dataclass(frozen=True)
class Profile:
    """One profile: values, mixture (weight, mean, standard deviation of each band), polynomial, power
    spectrum.
    """

    values: np.ndarray
    weights: np.ndarray
    means: np.ndarray
    deviations: np.ndarray
    polynomial: np.ndarray
    frequency: np.ndarray
    power: np.ndarray

    @property
    def peaks(self) -> np.ndarray:
        """Frequencies (cycles per line) whose power no white normal pattern would show (1 % in all)."""
        power, even = self.power[1:].copy(), len(self.values) % 2 == 0
        m = len(power) - even
        if m < _FEWEST_FREQUENCIES:
            return np.empty(0)
        rank = (m + 1) // 2
        median = np.partition(power[:m], rank - 1)[rank - 1]
        if not median > 0:  # lines without noise
            return np.empty(0)
        if even:
            # Half the sampling frequency has one degree of freedom, the others two: the same probability.
            white = median / np.log(2)
            power[-1] = -white * (np.log(2) + log_ndtr(-np.sqrt(power[-1] / white)))
        return self.frequency[1:][power > _least_peak(m, rank) * median]


@lru_cache(maxsize=64)
def _least_peak(m: int, rank: int) -> float:
    """Ratio to their `rank`th smallest that one of m exponential values exceeds in 1 % of all draws, or less.

    Above an order statistic M the values are independent M + Exp(1): the m - rank of them exceed c M in at most
    (m - rank) E[exp(-(c - 1) M)], and E[exp(-s M)] is a ratio of gamma functions (A. Renyi's representation).
    """

    def excess(s: float) -> float:
        logs = gammaln(m + 1) + gammaln(m - rank + 1 + s) - gammaln(m - rank + 1) - gammaln(m + 1 + s)
        return logs + np.log((m - rank + 1) / _FALSE_PEAKS)

    return 1 + root_scalar(excess, bracket=(0.0, 1e4)).root


def describe(values: np.ndarray) -> Profile:
    """The profile of rows or columns, (n,) in any unit, about its mean."""
    values = np.asarray(values, np.float64) - np.mean(values)
    weights, means, deviations = mixture(values)
    power = np.abs(np.fft.rfft(values)) ** 2 / len(values)
    return Profile(
        values, weights, means, deviations, polynomial(values), np.fft.rfftfreq(len(values)), power
    )


def draw(profile: Profile, seed: int) -> np.ndarray:
    """Another profile of the same values' distribution and the same spectrum.

    Amplitudes of the spectrum with phases by chance, then the profile's own values in that order.
    """
    rng = np.random.default_rng(seed)
    n = len(profile.values)
    phases = np.exp(2j * np.pi * rng.random(len(profile.power)))
    ordered = np.fft.irfft(np.sqrt(profile.power * n) * phases, n)
    bands = rng.choice(len(profile.weights), size=n, p=profile.weights)
    values = np.sort(rng.normal(profile.means[bands], profile.deviations[bands]))
    return values[np.argsort(np.argsort(ordered))]


def synthesize(master: np.ndarray, seed: int) -> np.ndarray:
    """A pattern like a master bias: its mean, rows and columns drawn like its own, white pixels; (H, W)
    float32.
    """
    rows, columns = describe(master.mean(1)), describe(master.mean(0))
    residual = master - master.mean(1, keepdims=True) - master.mean(0, keepdims=True) + master.mean()
    pixel = 1.4826 * float(np.median(np.abs(residual)))
    rng = np.random.default_rng([seed, 2])
    pattern = master.mean() + draw(rows, seed)[:, None] + draw(columns, seed + 1)[None]
    return (pattern + rng.normal(0, pixel, master.shape)).astype(np.float32)


def mixture(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gaussian mixture by expectation maximisation, of as many bands (up to four) as Bayes' criterion keeps."""
    best, least = None, np.inf
    spread_of_all = float(values.std())
    narrowest = 0.05 * spread_of_all + 1e-12  # a band narrower than that is one value
    for k in range(1, _MOST_BANDS + 1):
        weights = np.full(k, 1 / k)
        means = np.quantile(values, (np.arange(k) + 0.5) / k)
        deviations = np.full(k, spread_of_all / k + narrowest)
        before = -np.inf
        for _ in range(100):
            logs = np.log(weights) - 0.5 * ((values[:, None] - means) / deviations) ** 2 - np.log(deviations)
            top = logs.max(1, keepdims=True)
            shares = np.exp(logs - top)
            total = shares.sum(1, keepdims=True)
            shares /= total
            counts = shares.sum(0) + 1e-9
            weights = counts / counts.sum()
            means = shares.T @ values / counts
            spread = (shares * (values[:, None] - means) ** 2).sum(0) / counts
            deviations = np.sqrt(np.maximum(spread, narrowest**2))
            likelihood = float((top + np.log(total)).sum()) - 0.5 * len(values) * np.log(2 * np.pi)
            if likelihood - before < 1e-3:
                break
            before = likelihood
        criterion = (3 * k - 1) * np.log(len(values)) - 2 * likelihood
        if criterion < least:
            best, least = (weights, means, deviations), criterion
    assert best is not None
    return best


def polynomial(values: np.ndarray) -> np.ndarray:
    """Coefficients on [-1, 1], highest order first; as many orders as the Bayesian criterion keeps."""
    n = len(values)
    x = np.linspace(-1, 1, n)
    best, least = np.zeros(1), np.inf
    for order in range(min(_MOST_ORDER, n - 2) + 1):
        coefficients = np.polyfit(x, values, order)
        rest = float(((values - np.polyval(coefficients, x)) ** 2).mean()) + 1e-12
        criterion = n * np.log(rest) + (order + 1) * np.log(n)
        if criterion < least:
            best, least = coefficients, criterion
    return best
