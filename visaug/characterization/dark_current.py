"""Dark current from the mean and from the variance of dark frames, and its law of temperature."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from visaug.characterization.moments import GroupMoments


@dataclass(frozen=True)
class Slope:
    """DN per second (or DN^2 per second) at one temperature, its standard error and degrees of freedom."""

    temperature_c: float | None
    value: float
    error: float
    df: float
    offset: float
    offset_error: float
    exposures_s: np.ndarray
    levels: np.ndarray


@dataclass(frozen=True)
class Law:
    """a exp(b T): logarithm of a (DN/s) and b with their covariance."""

    log_a: float
    b_per_c: float
    covariance: np.ndarray
    df: float
    misfit: float


def slopes(moments: Sequence[GroupMoments], of: str = "mean") -> list[Slope]:
    """A straight line through `mean` or `variance` against exposure at every temperature with two or more.

    The error comes from how frame means scatter about their groups (black-level drift is in it) or, where lines
    have three or more exposures, from how groups scatter about the lines, whichever is larger.
    """
    by_temperature: dict[float | None, list[GroupMoments]] = {}
    for m in moments:
        t = m.group.temperature_c
        key = next((k for k in by_temperature if k is not None and t is not None and abs(k - t) < 0.6), t)
        by_temperature.setdefault(key, []).append(m)
    lines = []
    for temperature, group in by_temperature.items():
        t = np.array([m.group.exposure_s for m in group])
        if len(np.unique(t)) < 2:
            continue
        y = np.array([m.mean if of == "mean" else m.variance for m in group])
        lines.append((temperature, t, y, np.array([float(m.n) for m in group])))
    scatter, df = _scatter(moments, of)
    misfit, misfit_df = 0.0, 0
    for _, t, y, n in lines:
        value, offset, *_ = _line(t, y, n)
        if len(t) > 2:
            misfit += (n * (y - offset - value * t) ** 2).sum()
            misfit_df += len(t) - 2
    if misfit_df and misfit / misfit_df > scatter:
        scatter, df = misfit / misfit_df, misfit_df
    found = []
    for temperature, t, y, n in lines:
        value, offset, spread, middle = _line(t, y, n)
        error = math.sqrt(scatter / spread)
        offset_error = math.sqrt(scatter * (1 / n.sum() + middle**2 / spread))
        found.append(Slope(temperature, value, error, df, offset, offset_error, t, y))
    return sorted(found, key=lambda s: (s.temperature_c is not None, s.temperature_c or 0.0))


def law(found: Sequence[Slope]) -> Law | None:
    """Exponential law through slopes at two or more temperatures, by weighted least squares; None if none is."""
    points = [s for s in found if s.temperature_c is not None]
    if len(points) < 2 or sum(s.value > 0 for s in points) < 2:
        return None
    t = np.array([s.temperature_c for s in points], float)
    y, e = np.array([s.value for s in points]), np.array([s.error for s in points])
    centre = float(np.average(t, weights=np.maximum(y, 0) + 1e-12))
    warm = y > 0
    start = np.polyfit(t[warm] - centre, np.log(y[warm]), 1, w=y[warm] / e[warm])
    fit = optimize.least_squares(
        lambda p: (np.exp(np.clip(p[0] + p[1] * (t - centre), -700, 700)) - y) / e,
        x0=[start[1], start[0]],
        x_scale="jac",
    )
    try:
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    except np.linalg.LinAlgError:
        return None
    misfit = 2 * fit.cost / (len(t) - 2) if len(t) > 2 else 0.0
    covariance *= max(misfit, 1.0)
    shift = np.array([[1.0, -centre], [0.0, 1.0]])  # from the centre to 0 degrees
    return Law(
        fit.x[0] - fit.x[1] * centre, float(fit.x[1]), shift @ covariance @ shift.T, points[0].df, misfit
    )


def _line(t: np.ndarray, y: np.ndarray, n: np.ndarray) -> tuple[float, float, float, float]:
    """Slope, offset, weighted spread of t and its weighted mean, for weights n."""
    middle = float((n * t).sum() / n.sum())
    spread = float((n * (t - middle) ** 2).sum())
    value = float((n * (t - middle) * y).sum() / spread)
    return value, float((n * y).sum() / n.sum()) - value * middle, spread, middle


def _scatter(moments: Sequence[GroupMoments], of: str) -> tuple[float, float]:
    """Variance of one frame's contribution, and its degrees of freedom."""
    if of == "variance":
        # Relative variance 2/df of a variance with df degrees; per frame of a group.
        values = [2 * m.variance**2 * m.n / m.temporal.pixel_df for m in moments if m.temporal]
        return float(np.mean(values)) if values else math.nan, math.inf
    several = [m for m in moments if m.n > 1]
    df = sum(m.n - 1 for m in several)
    if not df:
        return math.nan, math.inf
    pooled = sum((m.n - 1) * m.frame_variance for m in several) / df
    least = float(np.median([m.variance / (m.shape[0] * m.shape[1]) for m in several]))
    return max(pooled, least), df if pooled > least else math.inf
