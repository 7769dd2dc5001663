"""Signal against photons: the responsivity, and what bends or lifts the line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from visaug.characterization.groups import FlatLevel
from visaug.core.intervals import mean_error, row_blocks
from visaug.statistics.findings import FALSE_ALARM


@dataclass(frozen=True)
class Response:
    """Signal of the light in DN over photons: slope at zero, its relative error, curvature per photon.

    Attributes:
        bent: whether the line bends beyond doubt (once in 500 by chance).
        dark: how the dark current of flats longer than their dark frames was met: ``none`` (nothing to
            meet), ``known``, ``fitted`` (beside the light), or ``unknown`` (it counts as light).
        dark_share: by how much the slope would be higher if the dark current counted as light.
        dark_dn_per_s: dark current that was fitted beside the light, and its standard error.
        scatter: root mean square deviation of the signals from this course, as a share, where a lamp that changes as much as
            from frame to frame exceeds it once in a thousand sets; else 0.
    """

    dn_per_photon: float
    relative_error: float
    df: float
    curvature_per_photon: float
    bent: bool
    dark: str
    dark_share: float
    dark_dn_per_s: tuple[float, float] = (0.0, 0.0)
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
    basis = np.stack([photons, *columns], axis=1)
    bend, bent = 0.0, False
    if len(levels) >= basis.shape[1] + 3:
        bend, bent = _bend(basis, photons, signals, levels)
    if bent:
        basis = np.concatenate([basis, (photons**2)[:, None]], axis=1)
    all_influence = _influence(basis, photons)
    influence = all_influence[0]
    value = float(influence @ signals)
    if not value > 0:
        return None
    rows = _left_out(
        [v.flat.row_means - (v.dark.row_means if dark_tells else 0.0) for v in levels], influence
    )
    columns_too = _left_out(
        [v.flat.column_means - (v.dark.column_means if dark_tells else 0.0) for v in levels], influence
    )
    lamp, spare = _lamp(basis, photons, signals, levels)
    light = float((influence**2 * signals**2).sum()) * lamp
    gap = np.array([v.exposure_gap_s * (v.dark_rate_error or 0.0) for v in levels])
    rate = float(influence @ gap) ** 2 if dark_tells else 0.0
    error, df = mean_error([(rows, 19), (columns_too, 19), (light, spare), (rate, 19)])
    with_dark = _influence(photons[:, None], photons)[0] @ np.array([v.signal for v in levels])
    share = with_dark / value - 1 if dark != "none" and not bent else 0.0
    rate_of_dark = _fitted(all_influence[1], signals, lamp) if dark == "fitted" else (0.0, 0.0)
    return Response(
        value,
        error / value,
        df,
        bend / value if bent else 0.0,
        bent,
        dark,
        float(share),
        rate_of_dark,
        _unexplained(basis, photons, signals, levels),
    )


def _fitted(influence: np.ndarray, signals: np.ndarray, lamp: float) -> tuple[float, float]:
    """A coefficient and its standard error by what the lamp does."""
    return float(influence @ signals), math.sqrt(float((influence**2 * signals**2).sum()) * lamp)


def _beside_the_light(
    levels: Sequence[FlatLevel], photons: np.ndarray, dark_tells: bool
) -> tuple[list[np.ndarray] | None, str]:
    """Columns of the fit beside the photons: a pedestal, and the dark current of longer exposures."""
    pedestal = [] if dark_tells else [np.ones(len(levels))]
    gap = np.array([v.exposure_gap_s for v in levels])
    if not dark_tells:
        return (pedestal if len(levels) > 2 else None), "none"
    if not gap.any():
        return pedestal, "none"
    if all(v.dark_rate_error is not None or not g for v, g in zip(levels, gap)):
        return pedestal, "known"
    basis = np.stack([photons, gap], axis=1) / photons[:, None]
    condition = np.linalg.cond(basis / np.linalg.norm(basis, axis=0))
    collinear = 50.0  # condition number (of columns of norm 1) from which on light and dark current are one
    if len(levels) >= 4 and condition < collinear:
        return [gap], "fitted"
    return pedestal, "unknown"


def _influence(basis: np.ndarray, photons: np.ndarray) -> np.ndarray:
    """What each level's signal adds to each coefficient; shot noise weighs the levels."""
    root = 1 / np.sqrt(photons)
    return np.linalg.pinv(basis * root[:, None]) * root


def _lamp(
    basis: np.ndarray, photons: np.ndarray, signals: np.ndarray, levels: Sequence[FlatLevel]
) -> tuple[float, float]:
    """Relative variance of a level's light and its degrees of freedom: from frame to frame, and as levels
    scatter about the fit.
    """
    flicker = _flicker(levels)
    spread, spare = _spread(basis, photons, signals)
    if spare < 1:
        return flicker
    error, df = mean_error([(flicker[0], max(flicker[1], 1)), (spread, spare)])
    return error**2, df


def _flicker(levels: Sequence[FlatLevel]) -> tuple[float, float]:
    """Relative variance of a level's light from frame to frame, of its mean, and its degrees of freedom."""
    relative = [v.flat.frame_variance / v.signal**2 / v.flat.n for v in levels]
    return float(np.median(relative)), float(sum(v.flat.n - 1 for v in levels))


def _spread(basis: np.ndarray, photons: np.ndarray, signals: np.ndarray) -> tuple[float, int]:
    """Relative variance of the bright levels about the fit, and its degrees of freedom."""
    residual = (signals - basis @ (_influence(basis, photons) @ signals)) / signals
    bright = np.abs(signals) > 0.2 * np.abs(signals).max()
    spare = int(bright.sum()) - basis.shape[1]
    return (float((residual[bright] ** 2).sum()) / spare if spare > 0 else 0.0), spare


def _unexplained(
    basis: np.ndarray, photons: np.ndarray, signals: np.ndarray, levels: Sequence[FlatLevel]
) -> float:
    """Relative scatter of the levels about the fit, see `Response.scatter`."""
    flicker, df = _flicker(levels)
    spread, spare = _spread(basis, photons, signals)
    if spare < 1 or spread <= flicker * float(stats.f.isf(FALSE_ALARM, spare, max(df, 1))):
        return 0.0
    return math.sqrt(spread)


def _bend(
    basis: np.ndarray, photons: np.ndarray, signals: np.ndarray, levels: Sequence[FlatLevel]
) -> tuple[float, bool]:
    """Coefficient of the square of the photons, and whether it is there beyond doubt."""
    whole = np.concatenate([basis, (photons**2)[:, None]], axis=1)
    influence = _influence(whole, photons)[-1]
    value = float(influence @ signals)
    lamp, df = _lamp(whole, photons, signals, levels)
    error = math.sqrt(float((influence**2 * signals**2).sum()) * lamp)
    doubt = 0.002
    return value, abs(value) > float(stats.t.ppf(1 - doubt / 2, df)) * error > 0


def _left_out(profiles: list[np.ndarray], influence: np.ndarray) -> float:
    """Variance of the slope by leaving blocks of a profile out."""
    keep = row_blocks(profiles[0].size)
    parts = np.array([influence @ np.array([(p * k).sum() / k.sum() for p in profiles]) for k in keep])
    return float((len(keep) - 1) / len(keep) * ((parts - parts.mean()) ** 2).sum())
