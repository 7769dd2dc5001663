"""Spectra of the rows and columns of a dark pattern, which white normal noise does not describe.

Their levels and slow course are part of the law in `visaug.camera.patterns`.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import gammaln, log_ndtr


@dataclass(frozen=True)
class LineProfile:
    """One profile: values and their power spectrum."""

    values: np.ndarray
    frequency: np.ndarray
    power: np.ndarray

    @property
    def peaks(self) -> np.ndarray:
        """Frequencies (cycles per line) whose power no white normal pattern would show (1 % in all)."""
        power, even = self.power[1:].copy(), len(self.values) % 2 == 0
        m = len(power) - even
        fewest_frequencies = 8
        if m < fewest_frequencies:
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
    false_peaks = 0.01

    def excess(s: float) -> float:
        logs = gammaln(m + 1) + gammaln(m - rank + 1 + s) - gammaln(m - rank + 1) - gammaln(m + 1 + s)
        return logs + np.log((m - rank + 1) / false_peaks)

    return 1 + root_scalar(excess, bracket=(0.0, 1e4)).root


def describe(values: np.ndarray) -> LineProfile:
    """The profile of rows or columns, (n,) in any unit, about its mean."""
    values = np.asarray(values, np.float64) - np.mean(values)
    power = np.abs(np.fft.rfft(values)) ** 2 / len(values)
    return LineProfile(values, np.fft.rfftfreq(len(values)), power)
