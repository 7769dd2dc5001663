"""How likely a deviation as large is by chance, and whether enough simulated sets have been counted to say it."""

import numpy as np
from scipy.stats import binomtest

SIGNIFICANT = 0.02  # rate of false alarms


def tail_factor(value: float, null: np.ndarray) -> float:
    """How much less likely a value beyond all of the null is than the null's largest; 1 where it is not beyond.

    The tail is extrapolated as exponential, with the mean excess over the ninth decile as its scale (Pickands 1975).
    """
    beyond = value - float(null.max())
    if beyond <= 0:
        return 1.0
    tail = 0.9  # quantile of the null's largest values above which its tail is extrapolated
    start = float(np.quantile(null, tail))
    excess = null[null > start] - start
    scale = float(excess.mean()) if len(excess) else 0.0
    return float(np.exp(-beyond / max(scale, 1e-9)))


def is_decided(value: float, null: np.ndarray) -> bool:
    """Whether more simulated sets would hardly change which side of `SIGNIFICANT` the p-value of `value` lies on.

    That is so where the 95 % interval of the share of sets beyond `value` (Clopper and Pearson 1934) excludes
    `SIGNIFICANT`, or where `value` lies far beyond all of them.
    """
    share = binomtest(int(np.count_nonzero(null >= value)), len(null)).proportion_ci()
    certain = 0.05  # factor below the least probability that counting resolves: three scales of the tail
    return not share.low <= SIGNIFICANT <= share.high or tail_factor(value, null) < certain
