"""Covariance of the temporal noise of neighbours: charge or signal that they share, smoothing, demosaicing.

A share of a pixel's signal that shows in its neighbours lowers its variance and not the sum of variance and covariances
(A. C. Moore, Z. Ninkov and W. J. Forrest, Opt. Eng. 45 (2006) 076402; P. Astier et al., A&A 629 (2019) A36), so that the
sum against the signal has the slope that the variance alone would have without it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from visaug.characterization.groups import FlatLevel, Measured
from visaug.characterization.moments import GroupMoments, mean_map, middle
from visaug.frames import FrameSet
from visaug.statistics.findings import FROM_NOISE, Findings

LAGS = ((0, 1), (1, 0), (1, 1), (1, -1))  # each with its mirror image: the eight neighbours
_OF_THE_STANDARD = ("emva.system_gain_dn_per_e", "emva.quantum_efficiency", "emva.saturation_e", "emva.dark_noise_e",
                    "emva.dsnu_e", "emva.dark_current_*", "emva4.*_e", "emva4.snr_*")  # fmt: skip


@dataclass(frozen=True)
class Covariances:
    """Of one group: variance, covariance at each of LAGS, and the number of independent products; DN^2."""

    variance: float
    lags: np.ndarray
    n: float

    @property
    def error(self) -> float:
        """Standard error of each covariance of white noise."""
        return self.variance / math.sqrt(self.n)

    @property
    def shared(self) -> float:
        """Sum over the eight neighbours."""
        return 2 * float(self.lags.sum())


def covariances(frames: FrameSet, moments: GroupMoments) -> Covariances:
    """Of the residuals about the group's mean map, the mean of each row and column of each frame taken out.
    Taking them out leaves -v/W between pixels of one row and -v/H between those of one column: added back.
    """
    indices, part = moments.group.indices, middle(moments.shape)
    mean = mean_map(frames, indices)[part]
    h, w = mean.shape
    sums, square = np.zeros(len(LAGS)), 0.0
    for i in indices:
        r = frames.read(i)[part] - mean
        r = r - r.mean(1, keepdims=True) - r.mean(0) + r.mean()
        square += float((r * r).mean())
        for k, (down, across) in enumerate(LAGS):
            a = r[: h - down, max(-across, 0) : w - max(across, 0)]
            b = r[down:, max(across, 0) : w - max(-across, 0)]
            sums[k] += float((a * b).mean())
    n = len(indices)
    variance = square / (n - 1) / ((1 - 1 / h) * (1 - 1 / w))
    bias = np.array([(-1 / w if d == 0 else 0.0) + (-1 / h if a == 0 else 0.0) for d, a in LAGS])
    return Covariances(variance, sums / (n - 1) - variance * bias, (n - 1) * h * w)


def with_covariances(measured: Measured, found: Findings) -> Measured:
    """The levels with the covariances of the light's noise, where there are any; warns of what they spoil."""
    levels = [v for v in measured.sweep if v.signal > 0 and min(v.flat.shape) > 3 and not v.flat.clipped_high]
    if not levels:
        return measured
    groups = {id(m): m for v in levels for m in (v.flat, v.dark)}
    known = {key: covariances(measured.frames, m) for key, m in groups.items()}
    pairs = {id(v): (known[id(v.flat)], known[id(v.dark)]) for v in levels}
    light = _pooled([*pairs.values()])
    darks = [known[key] for key in dict.fromkeys(id(v.dark) for v in levels)]
    products = np.array([c.n for c in darks])
    each = np.array([c.lags / max(c.variance, 1e-12) for c in darks])
    dark = (products[:, None] * each).sum(0) / products.sum()
    in_light = _significant(*light)
    in_dark = _significant(dark, np.full(len(LAGS), 1 / math.sqrt(products.sum())))
    if in_light and not in_dark:
        _warn_shared(found, light[0])
        return replace(measured, levels=tuple(_with(v, pairs.get(id(v))) for v in measured.levels))
    if in_light:
        found.filtered = True
        found.smoothed = _alike(light[0], dark)
        found.warn(
            "correlated_noise: the noise of neighbours correlates, that of light by "
            f"{_largest(light[0]):+.3f} and that of dark frames by {_largest(dark):+.3f}: the frames were "
            "smoothed, demosaiced, resampled or filtered, so their variance is not that of pixels",
            spoils=FROM_NOISE,
        )
    elif in_dark:
        found.warn(
            f"correlated_noise: the noise of neighbours in dark frames correlates by {_largest(dark):+.3f} "
            "and that of light does not: read noise contains noise that neighbours share",
            spoils=("read_noise.*",),
        )
    return measured


def _warn_shared(found: Findings, correlation: np.ndarray) -> None:
    beside = float(correlation[:2].mean())
    found.warn(
        f"correlated_noise: the light's noise correlates by {beside:+.4f} with the next pixel and that of "
        "dark frames does not: pixels share charge or are coupled; gain_e_per_dn is from variance plus "
        "covariances, the emva figures from the variance alone",
        spoils=_OF_THE_STANDARD,
    )
    if (share := _coupling(beside)) > 0:
        found.effects.append({"name": "interpixel_crosstalk", "share": share})


def _coupling(correlation: float) -> float:
    """Share a of each of four neighbours from the correlation 2 a (1 - 4 a) / ((1 - 4 a)^2 + 4 a^2) with one."""
    share = correlation / 2
    for _ in range(20):
        own = 1 - 4 * share
        share = correlation * (own**2 + 4 * share**2) / (2 * own)
    return share if 0 < share < 0.1 else 0.0


def _with(level: FlatLevel, pair: tuple[Covariances, Covariances] | None) -> FlatLevel:
    if pair is None:
        return level
    flat, dark = pair
    error = 4 * math.hypot(flat.error, dark.error)  # of the sum of four covariances, each counted twice
    return replace(level, shared_variance=flat.shared - dark.shared, shared_error=error)


def _pooled(pairs: Sequence[tuple[Covariances, Covariances]]) -> tuple[np.ndarray, np.ndarray]:
    """Correlation of the light's noise at each lag and its error, over all levels by their precision."""
    excess = np.array([f.variance - d.variance for f, d in pairs])
    errors = np.array([math.hypot(f.error, d.error) for f, d in pairs])
    lags = np.array([f.lags - d.lags for f, d in pairs])
    usable = excess > 0
    known = np.maximum(errors, 1e-12)  # frames without noise have no error
    weights = np.where(usable, excess / known**2, 0.0)
    total = float((weights * excess).sum())
    if not total > 0:
        return np.zeros(len(LAGS)), np.full(len(LAGS), np.inf)
    error = math.sqrt(float((weights**2 * errors**2).sum())) / total
    return (weights[:, None] * lags).sum(0) / total, np.full(len(LAGS), error)


def _significant(value: np.ndarray, error: np.ndarray) -> bool:
    false = 0.0025  # probability of a false alarm of the flats, and again of the dark frames
    limit = float(stats.norm.isf(false / 2 / len(LAGS)))
    return bool((np.abs(value) > limit * error).any())


def _alike(light: np.ndarray, dark: np.ndarray) -> bool:
    """Whether noise of light and of dark frames correlates alike along rows and along columns, as after one filter."""
    beside = np.minimum(light[:2], dark[:2])
    smoothed = 0.05  # correlation with the next pixel: half of what a Gaussian filter of 0.4 px makes
    alike = 0.25  # of the larger correlation: after one filter, rounding alone makes them differ
    is_alike = np.abs(light - dark)[:2] < alike * np.maximum(light, dark)[:2]
    return bool((beside > smoothed).all() and is_alike.all())


def _largest(values: np.ndarray) -> float:
    return float(values[np.abs(values).argmax()])
