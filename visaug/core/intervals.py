"""95 % intervals for a camera's own parameters from one camera's frames."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy import special, stats

_HALF = 0.5 * (1 - 0.95)
Z = float(special.ndtri(1 - _HALF))
Interval = tuple[float, float, float]  # value, low, high


def t_quantile(df: float) -> float:
    """Two-sided 95 % quantile of Student's t; the normal's for infinite degrees of freedom."""
    return float(stats.t.ppf(1 - _HALF, df)) if math.isfinite(df) else Z


def variance_combination(terms: Sequence[tuple[float, float, float]]) -> Interval:
    """Estimate (may be negative), low and high (clipped at 0) of a sum of c * E[MS], mean squares with chi-square spread; terms are
    (coefficient, mean square, degrees of freedom).

    The modified large-sample method (Graybill and Wang, J. Am. Stat. Assoc. 75 (1980) 869; for differences
    Ting et al., J. Stat. Comput. Simul. 35 (1990) 135): exact for one term, nearly so for several. The upper limit of a
    negative estimate is that of 0: below 0 the limit itself can fall to 0, an interval of no width, which would claim an exact 0.
    """
    value = sum(c * ms for c, ms, _ in terms)
    below = above = 0.0
    for c, ms, df in terms:
        shrink = (1 - df / stats.chi2.ppf(1 - _HALF, df)) * c * ms
        grow = (df / stats.chi2.ppf(_HALF, df) - 1) * c * ms
        below += (shrink if c > 0 else grow) ** 2
        above += (grow if c > 0 else shrink) ** 2
    return value, max(value - math.sqrt(below), 0.0), max(value, 0.0) + math.sqrt(above)


def root(interval: Sequence[float], factor: float = 1.0, relative: float = 0.0) -> Interval:
    """Standard deviation from a variance and its interval, times `factor` known to `relative` (one sigma)."""
    value, low, high = (math.sqrt(max(v, 0.0)) * factor for v in interval)
    return widen((value, low, high), relative)


def widen(interval: Sequence[float], relative: float) -> Interval:
    """An interval of a positive figure, widened by the relative standard error of a factor in it."""
    value, low, high = interval
    if relative <= 0:
        return value, low, high
    extra = Z * relative
    low = value * math.exp(-math.hypot(math.log(value / low), extra)) if low > 0 and value > 0 else 0.0
    base = value if value > 0 else high
    high = base * math.exp(math.hypot(math.log(high / base), extra)) if base > 0 else high
    return value, low, high


def symmetric(value: float, error: float, df: float = math.inf) -> Interval:
    half = t_quantile(df) * error
    return value, value - half, value + half


def mean_error(parts: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Standard error and Satterthwaite degrees of freedom from (variance, degrees of freedom) of parts."""
    total = sum(v for v, _ in parts)
    spread = sum(v**2 / df for v, df in parts if df > 0)
    return math.sqrt(max(total, 0.0)), (total**2 / spread if spread > 0 else math.inf)


def row_blocks(rows: int) -> np.ndarray:
    """(blocks, rows) weights: each leaves one block of rows out, 1 where kept and 0 where left out."""
    blocks = np.array_split(np.arange(rows), min(20, rows))
    return np.array([~np.isin(np.arange(rows), members) for members in blocks], float)


def jackknife(
    compute: Callable[[np.ndarray], dict[str, float]], rows: int
) -> dict[str, tuple[float, float, float]]:
    """Every figure of `compute` with its standard error and degrees of freedom, leaving blocks of rows out.

    `compute` takes weights (rows,) of 0 and 1 and returns figures by name. Pixels of different rows have independent temporal
    noise; its distribution need not be known.
    """
    parts = [compute(weights) for weights in row_blocks(rows)]
    blocks = len(parts)
    result: dict[str, tuple[float, float, float]] = {}
    for name, value in compute(np.ones(rows)).items():
        values = np.array([part.get(name, math.nan) for part in parts])
        values = values[np.isfinite(values)]
        error = math.nan
        if values.size > 1:
            error = math.sqrt((blocks - 1) / blocks * ((values - values.mean()) ** 2).sum())
        result[name] = (value, error, blocks - 1)
    return result
