"""Dark current from the mean and from the variance of dark frames, and its law of temperature."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize

from visaug.characterization.alike import SAME_C
from visaug.characterization.moments import GroupMoments


@dataclass(frozen=True)
class Slope:
    """DN per second (or DN^2 per second) at one temperature, its standard error and degrees of freedom."""

    temperature_c: float | None
    value: float
    error: float
    df: float


@dataclass(frozen=True)
class DarkCurrentLaw:
    """a exp(b T): logarithm of a (DN/s) and b with their covariance."""

    log_a: float
    b_per_c: float
    covariance: np.ndarray
    df: float
    misfit: float


@dataclass(frozen=True)
class DarkPoint:
    """Level (or variance) of one group of frames; `scatter` is the variance of one frame's share in it."""

    temperature_c: float | None
    exposure_s: float
    frames: int
    level: float
    scatter: float
    df: float


def mean_points(moments: Sequence[GroupMoments]) -> list[DarkPoint]:
    """Mean level; its scatter is that of the frames' means, of which the pixels' noise is the least part."""
    return [
        DarkPoint(m.group.temperature_c, m.group.exposure_s, m.n, m.mean, m.frame_variance, m.n - 1)
        for m in moments
    ]


def variance_points(moments: Sequence[GroupMoments]) -> list[DarkPoint]:
    """Temporal variance; a variance of df degrees of freedom scatters by 2/df of its square."""
    points = []
    for m in moments:
        if m.temporal is not None:
            scatter = 2 * m.variance**2 * m.n / m.temporal.pixel_df
            point = DarkPoint(m.group.temperature_c, m.group.exposure_s, m.n, m.variance, scatter, math.inf)
            points.append(point)
    return points


def wanders(temperature_c: np.ndarray, exposure_s: np.ndarray) -> bool:
    """Whether temperatures of dark frames (n,) make no steps with two exposures each: one fit to all must part them."""
    if len(np.unique(exposure_s)) < 2:
        return False
    order = np.argsort(temperature_c)
    t, e = temperature_c[order], exposure_s[order]
    steps = np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > SAME_C) + 1)
    drifts = any(np.ptp(t[s]) > 1.5 * SAME_C for s in steps)
    return drifts or (len(steps) > 1 and any(len(np.unique(e[s])) < 2 for s in steps))


def joint_law(temperature_c: np.ndarray, exposure_s: np.ndarray, level: np.ndarray) -> DarkCurrentLaw | None:
    """a exp(b T) t + black level by one least-squares fit over frames, each of its own temperature and
    exposure; the misfit tells the errors.
    """
    n = len(level)
    steps = np.rint((temperature_c - temperature_c.min()) / SAME_C)
    points = len(np.unique(np.stack([steps, exposure_s]), axis=1).T)
    if n < 6 or points < 3 or np.ptp(temperature_c) < 0.5 or len(np.unique(exposure_s)) < 2:
        return None
    centre = float(np.average(temperature_c, weights=exposure_s + 1e-12))
    rate = np.polyfit(exposure_s, level, 1)[0]
    if not rate > 0:
        return None

    def residual(p: np.ndarray) -> np.ndarray:
        return p[0] + np.exp(np.clip(p[1] + p[2] * (temperature_c - centre), -700, 700)) * exposure_s - level

    fit = optimize.least_squares(residual, [float(level.min()), math.log(rate), 0.08], x_scale="jac")
    try:
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)[1:, 1:] * 2 * fit.cost / (n - 3)
    except np.linalg.LinAlgError:
        return None
    return _at_zero(fit.x[1], fit.x[2], covariance, centre, n - 3, 0.0)


def _at_zero(
    log_a: float, b_per_c: float, covariance: np.ndarray, centre: float, df: float, misfit: float
) -> DarkCurrentLaw:
    """The law with its factor at 0 degrees in place of that at the centre of the temperatures."""
    shift = np.array([[1.0, -centre], [0.0, 1.0]])
    log_a = float(log_a - b_per_c * centre)
    return DarkCurrentLaw(log_a, float(b_per_c), shift @ covariance @ shift.T, df, misfit)


def slopes(points: Sequence[DarkPoint]) -> list[Slope]:
    """A straight line against exposure at every temperature with two or more exposures.
    The error comes from how frames scatter about their group (black-level drift is in it) or, where lines
    have three or more exposures, from how groups scatter about the lines, whichever is larger. Scatter that is
    known counts at its own exposure: variances scatter the more the larger they are, where a line has its lever.
    """
    scatter, df = _scatter(points)
    by_temperature: dict[float | None, list[DarkPoint]] = {}
    for p in points:
        t = p.temperature_c
        near = (k for k in by_temperature if k is not None and t is not None and abs(k - t) < SAME_C)
        by_temperature.setdefault(next(near, t), []).append(p)
    lines = []
    for temperature, group in by_temperature.items():
        t = np.array([p.exposure_s for p in group])
        if len(np.unique(t)) > 1:
            y, n = np.array([p.level for p in group]), np.array([float(p.frames) for p in group])
            share = [p.scatter / scatter if math.isinf(p.df) and scatter else 1.0 for p in group]
            lines.append((temperature, t, y, n, np.array(share), *weighted_line(t, y, n)))
    misfit, expected, misfit_df = 0.0, 0.0, 0  # expected of a scatter of 1 DN^2
    for _, t, y, n, share, value, offset, lever, spread in lines:
        if len(t) > 2:
            misfit += (n * (y - offset - value * t) ** 2).sum()
            expected += (share * (1 - n / n.sum() - n * lever**2 / spread)).sum()
            misfit_df += len(t) - 2
    if expected > 0 and not misfit / expected <= scatter:
        scatter, df = misfit / expected, misfit_df
    found = []
    for temperature, _, _, n, share, value, _, lever, spread in lines:
        by_lever = float((n * lever**2 * share).sum() / spread)
        found.append(Slope(temperature, value, math.sqrt(scatter / spread) * math.sqrt(by_lever), df))
    return sorted(found, key=lambda s: (s.temperature_c is not None, s.temperature_c or 0.0))


def law(found: Sequence[Slope]) -> DarkCurrentLaw | None:
    """Exponential law through slopes at two or more temperatures by weighted least squares, if there is one."""
    points = [s for s in found if s.temperature_c is not None]
    if len(points) < 2 or sum(s.value > 0 for s in points) < 2:
        return None
    t = np.array([s.temperature_c for s in points], float)
    y, e = np.array([s.value for s in points]), np.array([s.error for s in points])
    centre = float(np.average(t, weights=np.maximum(y, 0) + 1e-12))
    warm = y > 0
    start = np.polyfit(t[warm] - centre, np.log(y[warm]), 1, w=y[warm] / e[warm])

    def residual(p: np.ndarray) -> np.ndarray:
        return (np.exp(np.clip(p[0] + p[1] * (t - centre), -700, 700)) - y) / e

    fit = optimize.least_squares(residual, [start[1], start[0]], x_scale="jac")
    try:
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    except np.linalg.LinAlgError:
        return None
    misfit = 2 * fit.cost / (len(t) - 2) if len(t) > 2 else 0.0
    covariance *= max(misfit, 1.0)
    return _at_zero(fit.x[0], fit.x[1], covariance, centre, points[0].df, misfit)


def weighted_line(t: np.ndarray, y: np.ndarray, n: np.ndarray) -> tuple[float, float, np.ndarray, float]:
    """Slope, offset, t about its middle and the weighted spread of that, for weights n."""
    middle = float((n * t).sum() / n.sum())
    lever = t - middle
    spread = float((n * lever**2).sum())
    value = float((n * (t - middle) * y).sum() / spread)
    return value, float((n * y).sum() / n.sum()) - value * middle, lever, spread


def _scatter(points: Sequence[DarkPoint]) -> tuple[float, float]:
    """Pooled variance of one frame's share, and its degrees of freedom."""
    if points and all(math.isinf(p.df) for p in points):
        return float(np.mean([p.scatter for p in points])), math.inf
    df = sum(p.df for p in points)
    return (sum(p.df * p.scatter for p in points) / df, df) if df > 0 else (math.nan, math.inf)
