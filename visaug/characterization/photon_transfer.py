"""Gain, quantum efficiency, linearity and saturation from flats: temporal variance against mean signal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from visaug.characterization.groups import COLLAPSE, FlatLevel
from visaug.characterization.moments import GroupMoments
from visaug.characterization.response import Response, response
from visaug.core.intervals import Interval, jackknife, t_quantile
from visaug.frames.checks import SATURATED_SHARE
from visaug.statistics.findings import FALSE_ALARM

EVEN_DN = 0.6  # noise from which on rounding is an even error


@dataclass(frozen=True)
class PhotonTransferResult:
    """Results in DN and photons; errors are one standard deviation, relative where the name says so."""

    levels: tuple[FlatLevel, ...]
    gain_dn_per_e: float  # slope at zero signal by weighted least squares over all safe levels
    gain_error: float
    df: float
    # c of the variance K S (1 + c S), its standard error beside it; None for fewer levels than tell it
    curvature_per_dn: tuple[float, float] | None
    flats_alone: bool  # whether the variance without light was fitted, since dark frames do not tell it
    response: Response | None  # the signal's course over photons, None where the source is not calibrated
    safe: tuple[int, ...]  # positions of the levels that are clear of saturation
    # root mean square deviation of the variances from the curve over them, 0 where it is that of their noise
    scatter: float = 0.0

    @property
    def bent(self) -> bool:
        """Whether the curve bends beyond doubt (once in 500 by chance)."""
        if self.curvature_per_dn is None:
            return False
        value, error = self.curvature_per_dn
        return abs(value) > float(stats.t.ppf(1 - 0.002 / 2, self.df)) * error


def transfer(levels: Sequence[FlatLevel], dark_tells: bool = True) -> PhotonTransferResult | None:
    """The photon transfer of a sweep of flats; None where no level clear of saturation has signal and temporal noise, or where
    the interval of the gain holds 0.
    Variance V against signal S follows K S (1 + c S): c is what the response, or charge that shares, bends.
    `dark_tells`: whether mean and variance of the dark frames are those of the camera. Where they are cut
    at 0 or rounded away, the flats alone tell the gain: V against the mean, its intercept free.
    """
    if not (levels := tuple(levels)):
        return None
    safe = safe_levels(levels, saturated_level(levels), dark_tells)
    if len(safe) < (1 if dark_tells else 2):
        return None
    chosen = [levels[i] for i in safe]
    noise = np.array([v.flat.variance + v.dark.variance for v in chosen])
    weights = 1 / np.maximum(noise, 1e-12)  # a variance is known to a share of itself
    pedestal = 0.0 if dark_tells else min(v.flat.mean for v in chosen)
    signals = [v.signal for v in chosen]
    bends = len(chosen) >= 4 and max(signals) >= 3 * min(signals)  # or a bend cannot be seen
    powers = (0, 1) if not dark_tells else (1, 2) if bends else (1,)

    def curve(rows: np.ndarray) -> dict[str, float]:
        if dark_tells:
            x = np.array([v.signal_of(rows) for v in chosen])
            y = np.array([v.noise_of(rows) for v in chosen])
        else:
            x = np.array([(v.flat.row_means * rows).sum() / rows.sum() for v in chosen]) - pedestal
            y = np.array([(v.flat.row_variances * rows).sum() / rows.sum() - v.flat.frame_variance
                          - v.lamp_variance - v.band_variance + v.shared_variance for v in chosen])  # fmt: skip
        basis = np.stack([x**p for p in powers], axis=1)
        fit = dict(zip(powers, np.linalg.lstsq(basis * weights[:, None], y * weights, rcond=None)[0]))
        return {"gain": fit[1], "curvature": fit.get(2, 0.0) / fit[1]}

    found = jackknife(curve, chosen[0].flat.shape[0])
    value, error, df = found["gain"]
    if not value > 0:
        return None
    x = np.array([v.signal if dark_tells else v.flat.mean - pedestal for v in chosen])
    basis = np.stack([x**p for p in powers], axis=1)
    inverse = np.linalg.pinv(basis * weights[:, None]) * weights
    added = _errors(inverse, powers, [v.shared_error for v in chosen])
    white = _errors(inverse, powers, [v.variance_error for v in chosen])
    error = math.hypot(error, added[1])
    if not value > t_quantile(df) * error:  # the frames do not tell it from none
        return None
    scatter, times, spare = _scatter(chosen, basis, inverse, dark_tells)
    if scatter:
        error, df = times * error, min(df, spare)
    curvature = None
    if 2 in powers:
        bend, bend_error, _ = found["curvature"]
        curvature = bend, max(math.hypot(bend_error, added[2] / value), white[2] / value)
    line = response(chosen, dark_tells)
    return PhotonTransferResult(levels, value, error, df, curvature, not dark_tells, line, safe, scatter)


def _scatter(
    levels: Sequence[FlatLevel], basis: np.ndarray, inverse: np.ndarray, dark_tells: bool
) -> tuple[float, float, int]:
    """Relative deviation of the variances from their curve, how many times their noise that is, and its degrees of freedom.
    Zeros where noise explains it.
    """
    if (spare := len(levels) - basis.shape[1]) < 1:
        return 0.0, 0.0, 0
    y = np.array([v.variance_of_all + (0.0 if dark_tells else v.dark.variance) for v in levels])
    errors = np.array([v.variance_error for v in levels])
    fitted = basis @ (inverse @ y)
    square = float((((y - fitted) / errors) ** 2).sum())
    if stats.chi2.sf(square, spare) > FALSE_ALARM:
        return 0.0, 0.0, 0
    relative = (y - fitted) / np.maximum(fitted, errors)
    return math.sqrt(float((relative**2).sum()) / spare), math.sqrt(square / spare), spare


def _errors(inverse: np.ndarray, powers: tuple[int, ...], errors: Sequence[float]) -> dict[int, float]:
    """Standard error of each coefficient by those of the variances."""
    return {p: float(np.sqrt(((row * errors) ** 2).sum())) for p, row in zip(powers, inverse)}


def saturated_level(levels: Sequence[FlatLevel]) -> int | None:
    """Position of the largest temporal variance, if it falls again at brighter levels or pixels clip."""
    variances = np.array([v.flat.variance for v in levels])
    top = int(variances.argmax())
    # Near saturation single levels may stand out; EMVA 1288 looks for the last rise.
    falls = top < len(levels) - 1 and variances[top + 1 :].min() < COLLAPSE * variances[top]
    clips = levels[-1].flat.clipped_high > 0.001
    return top if falls or clips else None


def clipped_levels(levels: Sequence[FlatLevel]) -> Sequence[FlatLevel]:
    """Those whose pixels reach saturation, where the variance over time and over the pixels falls, or pixels clip.

    A level is clear of it where three standard deviations of the widest level lie between.
    """
    if not levels:
        return []
    levels = sorted(levels, key=lambda v: v.signal)
    variances = np.array([max(v.flat.variance, 0.0) + v.flat.spatial_variance for v in levels])
    top = int(variances.argmax())
    falls = variances[top:].min() < COLLAPSE * variances[top]
    if not falls and levels[-1].flat.clipped_high <= SATURATED_SHARE:
        return []
    return [v for v in levels if v.signal + 3 * math.sqrt(variances[top]) > levels[-1].signal]


def safe_levels(levels: Sequence[FlatLevel], saturation: int | None, dark_tells: bool) -> tuple[int, ...]:
    safe = 0.85  # of saturation: the camera's own gain may use more levels than the standard's fit
    limit = math.inf if saturation is None else safe * levels[saturation].signal
    clear = [v.flat.clipped_high == 0 and v.photons != 0 and 0 < v.signal <= limit for v in levels]
    chosen = [i for i, v in enumerate(levels) if clear[i] and (v.variance_of_all > 0 or not dark_tells)]
    if not dark_tells:
        return tuple(i for i in chosen if rounds_evenly(levels[i].flat) and levels[i].flat.clipped_low < 1e-4)
    if not chosen and saturation is not None:  # the sweep's steps are too wide to tell where it saturates
        chosen = [i for i, v in enumerate(levels[: saturation + 1]) if below(v, levels[-1])]
    return tuple(chosen)


def below(level: FlatLevel, full: FlatLevel) -> bool:
    """Whether clipping leaves a level's variance alone, as far as a saturated level tells.
    Its pixels lie three standard deviations below the saturated mean: clipping there takes 0.3 % of a normal variance.
    """
    spread = math.sqrt(max(level.flat.variance, 0.0) + level.flat.spatial_variance)
    clear = level.flat.clipped_high <= SATURATED_SHARE and level.signal + 3 * spread <= full.signal
    return clear and level.photons != 0 and level.signal > 0


def rounds_evenly(moments: GroupMoments) -> bool:
    """Whether the noise spreads over enough DN that rounding adds 1/12 DN^2 and no bias of the mean.
    For normal noise of s DN the variance is off by at most 4 (s^2 + 1/(4 pi^2)) exp(-2 pi^2 s^2), below 0.3 %
    from s = 0.6 on (W. F. Sheppard's corrections; B. Widrow, IRE Trans. Circuit Theory 3 (1956) 266).
    """
    return moments.variance - moments.step_dn**2 / 12 >= (EVEN_DN * moments.step_dn) ** 2


def last_fitted(levels: Sequence[FlatLevel], saturation: int | None) -> int:
    """Position of the last level of the standard's fits: up to 70 % of saturation, or the one of the largest variance."""
    top = len(levels) - 1 if saturation is None else saturation
    limit = (0.7 if saturation is not None else 1.0) * levels[top].signal
    return max((i for i, v in enumerate(levels[: top + 1]) if v.signal <= limit), default=top)


def tells_gain(levels: Sequence[FlatLevel], saturation: int | None) -> bool:
    """Whether the levels of the standard's fits are clear of saturation."""
    if saturation is None:
        return True
    chosen = levels[: last_fitted(levels, saturation) + 1]
    return chosen[-1].signal <= 0.7 * levels[saturation].signal or all(below(v, levels[-1]) for v in chosen)


def emva_sensitivity(
    levels: Sequence[FlatLevel], saturation: int | None
) -> dict[str, tuple[float, float, float]]:
    """Release 3: gain and responsivity by unweighted fits through the origin up to 70 % of saturation."""
    chosen = levels[: last_fitted(levels, saturation) + 1]

    def compute(rows: np.ndarray) -> dict[str, float]:
        x = np.array([v.signal_of(rows) for v in chosen])
        y = np.array([v.variance_of(rows) for v in chosen])
        found = {"gain": float((x * y).sum() / (x * x).sum())}
        if all(v.photons is not None for v in chosen):
            p = np.array([v.photons for v in chosen], float)
            found["response"] = float((p * x).sum() / (p * p).sum())
            found["efficiency"] = found["response"] / found["gain"] if found["gain"] else math.nan
        return found

    return jackknife(compute, chosen[0].flat.shape[0])


def emva_linearity(levels: Sequence[FlatLevel], saturation: int | None) -> dict[str, Interval] | None:
    """Release 3: least and largest relative deviation from a line fitted to relative deviations, 5 to 95 %.
    The extremes of noise are no deviations of the camera: the intervals are those of the extremes of a band that holds all levels'
    deviations at once.
    """
    chosen = _linear_levels(levels, saturation)
    if len(chosen) < 3:
        return None

    def compute(rows: np.ndarray) -> dict[str, float]:
        deviations = relative_deviations(chosen, rows)
        return {"min": float(deviations.min()), "max": float(deviations.max())}

    found = jackknife(compute, chosen[0].flat.shape[0])
    deviations = relative_deviations(chosen, np.ones(chosen[0].flat.shape[0]))
    df = sum(v.flat.n - 1 for v in chosen)
    together = float(stats.t.isf((1 - 0.95 ** (1 / len(chosen))) / 2, df))
    noise = np.array([_signal_noise(v) for v in chosen])
    noise += np.mean([v.flat.frame_variance / v.signal**2 / v.flat.n for v in chosen])  # the lamp
    intervals = {}
    for name, (value, error, rows_df) in found.items():
        half = np.hypot(together * np.sqrt(noise), t_quantile(rows_df) * error)
        extreme = np.min if name == "min" else np.max
        intervals[name] = (value, float(extreme(deviations - half)), float(extreme(deviations + half)))
    return intervals


def _signal_noise(level: FlatLevel) -> float:
    """Relative variance of a level's signal by the pixels' noise and the level of its dark frames."""
    pixels = level.flat.shape[0] * level.flat.shape[1]
    flat, dark = (m.variance / (m.n * pixels) for m in (level.flat, level.dark))
    return (flat + dark + level.dark.frame_variance / level.dark.n) / level.signal**2


def linearity_curve(levels: Sequence[FlatLevel], saturation: int | None) -> dict[str, np.ndarray]:
    """Photons and relative deviation of the levels that `emva_linearity` rests on."""
    chosen = _linear_levels(levels, saturation)
    deviation = relative_deviations(chosen, np.ones(chosen[0].flat.shape[0]))
    return {"photons": np.array([v.photons for v in chosen], float), "deviation": deviation}


def _linear_levels(levels: Sequence[FlatLevel], saturation: int | None) -> list[FlatLevel]:
    top = levels[-1 if saturation is None else saturation].signal
    upto = levels[: None if saturation is None else saturation + 1]
    return [v for v in upto if v.photons is not None and 0.05 * top <= v.signal <= 0.95 * top]


def relative_deviations(levels: Sequence[FlatLevel], rows: np.ndarray) -> np.ndarray:
    x = np.array([v.photons for v in levels], float)
    y = np.array([v.signal_of(rows) for v in levels])
    slope, offset = np.polyfit(x, y, 1, w=1 / y)
    return y / (slope * x + offset) - 1


def converter_clips(level: FlatLevel) -> bool:
    """Whether the converter's end cuts a level: it cuts read noise too, which a full pixel keeps."""
    return level.flat.clipped_high > 0.01 or level.flat.variance < 0.5 * level.dark.variance


def full_well(found: PhotonTransferResult, nonuniformity: float) -> tuple[float, float] | None:
    """Full well in electrons and its standard error, from the brightest level that charge clips; else None.
    The mean of a normal signal (shot noise and PRNU) clipped at F is known; F is where it meets the measured one.
    """
    if found.response is None:
        return None
    level = found.levels[-1]
    signal_e = level.signal / found.gain_dn_per_e
    expected = found.response.at(float(level.photons or 0.0)) / found.gain_dn_per_e
    spread = math.sqrt(expected + (nonuniformity * expected) ** 2)
    shot = level.variance_of_all / found.gain_dn_per_e**2
    if converter_clips(level) or shot > COLLAPSE * expected or expected - signal_e < 0.1 * spread:
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
    light = (1 - clipped) / clipped * expected * math.hypot(found.response.relative_error, gain)
    return well, math.hypot(well * gain, light)
