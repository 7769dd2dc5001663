"""Signal against photons: the responsivity, and what bends or lifts the line."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from visaug.characterization.groups import FlatLevel
from visaug.core.intervals import mean_error, row_blocks
from visaug.statistics.findings import FALSE_ALARM


@dataclass(frozen=True)
class Response:
    """Signal of the light in DN over photons: slope at zero, its relative error, curvature per photon."""

    dn_per_photon: float
    relative_error: float
    df: float
    curvature_per_photon: float
    bent: bool  # whether the line bends beyond doubt (once in 500 by chance)
    # how the dark current of flats longer than their dark frames was met: ``none`` (nothing to meet),
    # ``known``, ``fitted`` (beside the light), or ``unknown`` (it counts as light)
    dark: str
    dark_share: float  # by how much the slope would be higher if the dark current counted as light
    # dark current that was fitted beside the light, and its standard error
    dark_dn_per_s: tuple[float, float] = (0.0, 0.0)
    # root mean square deviation of the signals from this course, as a share, where a lamp that changes as
    # much as from frame to frame exceeds it once in a thousand sets; else 0
    scatter: float = 0.0

    def at(self, photons: float) -> float:
        """Signal of the light, DN."""
        return self.dn_per_photon * photons * (1 + self.curvature_per_photon * photons)


def response(levels: Sequence[FlatLevel], dark_tells: bool) -> Response | None:
    """Signal per photon at low light, and its standard error as an estimate of the camera's own.
    Parts of the error: pixels and rows (blocks of rows left out), columns (blocks of columns left out), and
    what the lamp does from frame to frame and from level to level.
    """
    if any(v.photons is None or v.photons <= 0 for v in levels):
        return None
    photons = np.array([v.photons for v in levels], float)
    columns, dark = _beside_the_light(levels, photons, dark_tells)
    if columns is None:
        return None
    signals = np.array([v.flat.mean if not dark_tells else v.light for v in levels])
    fit = _Fit(levels, signals, np.stack([photons, *columns], axis=1))
    bend, bent = 0.0, False
    if len(levels) >= fit.basis.shape[1] + 3:
        curved = _Fit(levels, signals, np.concatenate([fit.basis, (photons**2)[:, None]], axis=1))
        bend = float(curved.influence[-1] @ signals)
        variance, df = curved.by_lamp(-1)
        bent = abs(bend) > float(stats.t.ppf(1 - 0.002 / 2, df)) * math.sqrt(variance) > 0
        fit = curved if bent else fit
    influence = fit.influence[0]
    value = float(influence @ signals)
    if not value > 0:
        return None
    dark_share = 1.0 if dark_tells else 0.0
    by_row = _left_out([v.flat.row_means - dark_share * v.dark.row_means for v in levels], influence)
    by_column = _left_out([v.flat.column_means - dark_share * v.dark.column_means for v in levels], influence)
    gap = np.array([v.exposure_gap_s * (v.dark_rate_error or 0.0) for v in levels])
    rate = float(influence @ gap) ** 2 if dark_tells else 0.0
    light, spare = fit.by_lamp(0)
    error, df = mean_error([(by_row, 19), (by_column, 19), (light, spare), (rate, 19)])
    with_dark = _influence(photons[:, None])[0] @ np.array([v.signal for v in levels])
    share = with_dark / value - 1 if dark != "none" and not bent else 0.0
    rate_of_dark = (0.0, 0.0)
    if dark == "fitted":
        rate_of_dark = float(fit.influence[1] @ signals), math.sqrt(fit.by_lamp(1)[0])
    bend = bend / value if bent else 0.0
    return Response(value, error / value, df, bend, bent, dark, float(share), rate_of_dark, fit.unexplained())


def _beside_the_light(
    levels: Sequence[FlatLevel], photons: np.ndarray, dark_tells: bool
) -> tuple[list[np.ndarray] | None, str]:
    """Columns of the fit beside the photons: a pedestal, and the dark current of longer exposures."""
    if not dark_tells:
        return ([np.ones(len(levels))] if len(levels) > 2 else None), "none"
    gap = np.array([v.exposure_gap_s for v in levels])
    if not gap.any():
        return [], "none"
    if all(v.dark_rate_error is not None or not g for v, g in zip(levels, gap)):
        return [], "known"
    basis = np.stack([photons, gap], axis=1) / photons[:, None]
    condition = np.linalg.cond(basis / np.linalg.norm(basis, axis=0))
    collinear = 50.0  # condition number (of columns of norm 1) from which on light and dark current are one
    return ([gap], "fitted") if len(levels) >= 4 and condition < collinear else ([], "unknown")


def errors_of_light(levels: Sequence[FlatLevel]) -> list[tuple[float, float]]:
    """Relative variances of the unweighted slope of signal over photons through 0, and their degrees of freedom: by columns, and
    by the lamp. Rows are not in it.
    """
    levels = [v for v in levels if v.photons and v.signal > 0]
    photons = np.array([v.photons for v in levels], float)
    fit = _Fit(levels, np.array([v.signal for v in levels]), photons[:, None], weighted=False)
    slope = float(fit.influence[0] @ fit.signals)
    columns = _left_out([v.flat.column_means - v.dark.column_means for v in levels], fit.influence[0])
    light, df = fit.by_lamp(0)
    return [(columns / slope**2, 19), (light / slope**2, df)]


def _influence(basis: np.ndarray, weighted: bool = True) -> np.ndarray:
    """What each level's signal adds to each coefficient; shot noise weighs the levels by their photons, the first column."""
    root = 1 / np.sqrt(basis[:, 0]) if weighted else np.ones(len(basis))
    return np.linalg.pinv(basis * root[:, None]) * root


@dataclass(frozen=True)
class _Fit:
    """Signals of levels as a sum of the columns of a basis, the first of which are the photons."""

    levels: Sequence[FlatLevel]
    signals: np.ndarray
    basis: np.ndarray
    weighted: bool = True

    @cached_property
    def influence(self) -> np.ndarray:
        return _influence(self.basis, self.weighted)

    def by_lamp(self, k: int) -> tuple[float, float]:
        """Variance of coefficient `k` by what the lamp does, and its degrees of freedom: from frame to frame, and as levels
        scatter about the fit.
        """
        relative, df = self._flicker
        spread, spare = self._spread
        if spare >= 1:
            error, df = mean_error([(relative, max(df, 1)), (spread, spare)])
            relative = error**2
        return float((self.influence[k] ** 2 * self.signals**2).sum()) * relative, df

    @cached_property
    def _flicker(self) -> tuple[float, float]:
        """Relative variance of a level's light from frame to frame, of its mean, and its degrees of freedom."""
        relative = [v.flat.frame_variance / v.signal**2 / v.flat.n for v in self.levels]
        return float(np.median(relative)), float(sum(v.flat.n - 1 for v in self.levels))

    @cached_property
    def _spread(self) -> tuple[float, int]:
        """Relative variance of the bright levels about the fit, and its degrees of freedom."""
        residual = (self.signals - self.basis @ (self.influence @ self.signals)) / self.signals
        bright = np.abs(self.signals) > 0.2 * np.abs(self.signals).max()
        spare = int(bright.sum()) - self.basis.shape[1]
        return (float((residual[bright] ** 2).sum()) / spare if spare > 0 else 0.0), spare

    def unexplained(self) -> float:
        """Relative scatter of the levels about the fit, see `Response.scatter`."""
        (flicker, df), (spread, spare) = self._flicker, self._spread
        if spare < 1 or spread <= flicker * float(stats.f.isf(FALSE_ALARM, spare, max(df, 1))):
            return 0.0
        return math.sqrt(spread)


def _left_out(profiles: list[np.ndarray], influence: np.ndarray) -> float:
    """Variance of the slope by leaving blocks of a profile out."""
    keep = row_blocks(profiles[0].size)
    parts = np.array([influence @ np.array([(p * k).sum() / k.sum() for p in profiles]) for k in keep])
    return float((len(keep) - 1) / len(keep) * ((parts - parts.mean()) ** 2).sum())
