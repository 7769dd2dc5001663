"""Gain, quantum efficiency, linearity and saturation from flats: temporal variance against mean signal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from visaug.characterization.groups import Level
from visaug.characterization.intervals import jackknife, row_blocks

_FIT_SHARE = 0.7  # EMVA 1288: the fits of gain and responsivity end at 70 % of saturation
_LINEAR_SHARE = (0.05, 0.95)
_SAFE_SHARE = 0.85  # the camera's own gain may use more levels than the standard's fit
_COLLAPSE = 0.7  # variance below this share of the shot noise's tells clipping


@dataclass(frozen=True)
class PhotonTransfer:
    """Results in DN and photons; errors are one standard deviation, relative where the name says so.

    Attributes:
        gain_dn_per_e: by weighted least squares over all safe levels.
        response_dn_per_photon: mean signal over photons, None where the source is not calibrated.
        saturation: position in `levels` of the largest temporal variance, None where it is not reached.
        safe: positions of the levels that are clear of saturation.
    """

    levels: tuple[Level, ...]
    gain_dn_per_e: float
    gain_error: float
    df: float
    response_dn_per_photon: float | None
    response_relative_error: float
    saturation: int | None
    safe: tuple[int, ...]


def transfer(levels: Sequence[Level]) -> PhotonTransfer | None:
    """The photon transfer of a sweep of flats; None where no level has signal and temporal noise."""
    levels = tuple(levels)
    if not levels:
        return None
    saturation = saturated_level(levels)
    safe = safe_levels(levels, saturation)
    if not safe:
        return None
    noise = np.array([levels[i].flat.variance + levels[i].dark.variance for i in safe])
    weights = 1 / np.maximum(noise, 1e-12) ** 2  # a variance is known to a share of itself

    def gain(rows: np.ndarray) -> dict[str, float]:
        x = np.array([levels[i].signal_of(rows) for i in safe])
        y = np.array([levels[i].variance_of(rows) for i in safe])
        return {"gain": float((weights * x * y).sum() / (weights * x * x).sum())}

    value, error, df = jackknife(gain, levels[0].flat.shape[0])["gain"]
    if not value > 0:
        return None
    response, relative = _response([levels[i] for i in safe])
    return PhotonTransfer(levels, value, error, df, response, relative, saturation, safe)


def saturated_level(levels: Sequence[Level]) -> int | None:
    """Position of the largest temporal variance, if it falls again at brighter levels or pixels clip."""
    variances = np.array([v.flat.variance for v in levels])
    top = int(variances.argmax())
    # Near saturation single levels may stand out; EMVA 1288 looks for the last rise.
    falls = top < len(levels) - 1 and variances[top + 1 :].min() < _COLLAPSE * variances[top]
    clips = levels[-1].flat.clipped_high > 0.001
    return top if falls or clips else None


def safe_levels(levels: Sequence[Level], saturation: int | None) -> tuple[int, ...]:
    limit = math.inf if saturation is None else _SAFE_SHARE * levels[saturation].signal
    chosen = [
        i
        for i, v in enumerate(levels)
        if 0 < v.signal <= limit and v.flat.clipped_high == 0 and v.variance_of_all > 0 and v.photons != 0
    ]
    if not chosen and saturation is not None:
        chosen = [i for i in range(saturation + 1) if levels[i].signal > 0]
    return tuple(chosen)


def _response(levels: Sequence[Level]) -> tuple[float | None, float]:
    """Signal per photon, and its relative standard error as an estimate of the camera's own.

    Parts of the error: pixels and rows (blocks of rows left out), columns (blocks of columns left out), and
        what
    the lamp does from frame to frame and from level to level.
    """
    if any(v.photons is None or v.photons <= 0 for v in levels):
        return None, math.nan
    photons = np.array([v.photons for v in levels], float)
    weights = 1 / photons  # shot noise

    def slope(signals: np.ndarray) -> float:
        return float((weights * photons * signals).sum() / (weights * photons**2).sum())

    def left_out(profiles: list[np.ndarray]) -> float:
        keep = row_blocks(profiles[0].size)
        parts = np.array([slope(np.array([(p * k).sum() / k.sum() for p in profiles])) for k in keep])
        return float((len(keep) - 1) / len(keep) * ((parts - parts.mean()) ** 2).sum())

    value = slope(np.array([v.signal for v in levels]))
    error = left_out([v.flat.row_means - v.dark.row_means for v in levels])
    error += left_out([v.flat.column_means - v.dark.column_means for v in levels])
    relative = [v.flat.frame_variance / v.signal**2 for v in levels]
    lamp = np.median(relative) / sum(v.flat.n for v in levels)
    bright = [v.signal / float(v.photons or 1.0) for v in levels if v.signal > 0.2 * levels[-1].signal]
    if len(bright) > 1:
        lamp += (np.std(bright, ddof=1) / value) ** 2 / len(bright)
    return value, math.sqrt(error / value**2 + lamp)


def emva_sensitivity(
    levels: Sequence[Level], saturation: int | None
) -> dict[str, tuple[float, float, float]]:
    """Release 3: gain and responsivity by unweighted fits through the origin up to 70 % of saturation."""
    top = len(levels) - 1 if saturation is None else saturation
    limit = (_FIT_SHARE if saturation is not None else 1.0) * levels[top].signal
    last = max((i for i, v in enumerate(levels[: top + 1]) if v.signal <= limit), default=top)
    chosen = levels[: last + 1]

    def compute(rows: np.ndarray) -> dict[str, float]:
        x = np.array([v.signal_of(rows) for v in chosen])
        y = np.array([v.variance_of(rows) for v in chosen])
        found = {"gain": float((x * y).sum() / (x * x).sum())}
        if all(v.photons is not None for v in chosen):
            p = np.array([v.photons for v in chosen], float)
            found["response"] = float((p * x).sum() / (p * p).sum())
            found["efficiency"] = found["response"] / found["gain"]
        return found

    return jackknife(compute, chosen[0].flat.shape[0])


def emva_linearity(
    levels: Sequence[Level], saturation: int | None
) -> dict[str, tuple[float, float, float]] | None:
    """Release 3: least and largest relative deviation from a line fitted to relative deviations, 5 to 95
    %.
    """
    top = levels[-1 if saturation is None else saturation].signal
    chosen = [
        v
        for v in levels[: None if saturation is None else saturation + 1]
        if v.photons is not None and _LINEAR_SHARE[0] * top <= v.signal <= _LINEAR_SHARE[1] * top
    ]
    if len(chosen) < 3:
        return None

    def compute(rows: np.ndarray) -> dict[str, float]:
        deviations = relative_deviations(chosen, rows)
        return {"min": float(deviations.min()), "max": float(deviations.max())}

    return jackknife(compute, chosen[0].flat.shape[0])


def relative_deviations(levels: Sequence[Level], rows: np.ndarray) -> np.ndarray:
    x = np.array([v.photons for v in levels], float)
    y = np.array([v.signal_of(rows) for v in levels])
    slope, offset = np.polyfit(x, y, 1, w=1 / y)
    return y / (slope * x + offset) - 1


def converter_clips(level: Level) -> bool:
    """Whether the converter's end cuts a level: it cuts read noise too, which a full pixel keeps."""
    return level.flat.clipped_high > 0.01 or level.flat.variance < 0.5 * level.dark.variance


def full_well(found: PhotonTransfer, nonuniformity: float) -> tuple[float, float] | None:
    """Full well in electrons and its standard error, from the brightest level that charge clips; else None.

    The mean of a normal signal (shot noise and PRNU) clipped at F is known; F is where it meets the measured
    one.
    """
    if found.response_dn_per_photon is None:
        return None
    level = found.levels[-1]
    signal_e = level.signal / found.gain_dn_per_e
    expected = float(level.photons or 0.0) * found.response_dn_per_photon / found.gain_dn_per_e
    spread = math.sqrt(expected + (nonuniformity * expected) ** 2)
    shot = level.variance_of_all / found.gain_dn_per_e**2
    if converter_clips(level) or shot > _COLLAPSE * expected or expected - signal_e < 0.1 * spread:
        return None

    def excess(f: float) -> float:
        z = (expected - f) / spread
        return float(expected - (expected - f) * stats.norm.cdf(z) - spread * stats.norm.pdf(z) - signal_e)

    low, high = signal_e * 0.8, expected + 6 * spread
    if excess(low) * excess(high) > 0:
        return None
    well = float(optimize.root_scalar(excess, bracket=(low, high)).root)
    clipped = float(stats.norm.cdf((expected - well) / spread))
    gain = found.gain_error / found.gain_dn_per_e
    response = (1 - clipped) / clipped * expected * math.hypot(found.response_relative_error, gain)
    return well, math.hypot(well * gain, response)
