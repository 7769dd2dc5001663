"""From frames without light: black level, read noise, temporal noise of frames, rows and columns, DSNU and its spectra."""

import math
from functools import lru_cache

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import gammaln, log_ndtr

from visaug.characterization import read_noise, tukey
from visaug.characterization.groups import FlatLevel, Measured
from visaug.characterization.moments import GroupMoments, mean_map
from visaug.characterization.nonuniformity import PARTS, Parts, parts
from visaug.characterization.photon_transfer import EVEN_DN, rounds_evenly, saturated_level
from visaug.characterization.read_noise import PixelNoiseSpread, pixel_noise, shrunk
from visaug.core.intervals import jackknife, mean_error, root, symmetric, variance_combination, widen
from visaug.statistics.findings import Findings

CLIPPED = 0.002  # share of pixels at 0 above which moments of bias frames are cut
NEEDS_STILL = "two or more bias frames (lens capped, shortest exposure)"


def tells(moments: GroupMoments) -> bool:
    """Whether mean and variance of dark frames are the camera's: not cut at 0, not rounded away."""
    return moments.clipped_low <= CLIPPED and (moments.n < 2 or rounds_evenly(moments))


def flicker(measured: Measured) -> bool:
    """Whether dark frames are noisier than an unsaturated flat; a full pixel has lost the noise of its dark current."""
    levels = measured.sweep
    full = saturated_level(levels) if levels else None
    return any(noisier(v) for v in levels[: None if full is None else full + 1])


def noisier(level: FlatLevel) -> bool:
    """Whether dark frames scatter more than a flat of more signal: something but noise is in them."""
    df = level.dark.n - 1 if level.dark.n > 1 else 1
    excess = level.dark.variance / max(level.flat.variance, 1e-12) - 1
    is_clear = level.flat.clipped_high == 0 and level.signal > 0 and level.flat.variance > EVEN_DN**2
    return is_clear and excess > 0.1 + 6 / math.sqrt(df * level.dark.shape[0] * level.dark.shape[1])


def black_level(found: Findings, still: GroupMoments, pattern: Parts, dark_signal_dn: float) -> None:
    """Mean of the bias frames less their dark signal; the pattern's spread hides the camera's own offset."""
    height, width = still.shape
    frame_noise = max(still.frame_variance, still.variance / (height * width)) / still.n
    variances = [
        (max(pattern.row[0], 0) / height, height - 1),
        (max(pattern.column[0], 0) / width, width - 1),
        (max(pattern.pixel[0], 0) / (height * width), height * width),
        (frame_noise, max(still.n - 1, 1)),
    ]
    error, df = mean_error(variances)
    source = f"mean of {still.n} {still.group.kind} frames"
    found.add("black_level_dn", symmetric(still.mean - dark_signal_dn, error, df), "DN", source)


def noise_of_reading(found: Findings, measured: Measured, still: GroupMoments, dark_dn2: float) -> None:
    """Read noise by maximum likelihood; in DN where the gain is unknown."""
    fitted = read_noise.fit(measured.frames, still.group.indices, still, dark_dn2)
    source = f"maximum likelihood on residuals of {still.n} {still.group.kind} frames"
    sigma, low, high = symmetric(fitted.sigma_dn, fitted.sigma_error, fitted.df)
    interval = (sigma, max(low, 0.0), high)
    shape = symmetric(fitted.shape, fitted.shape_error, fitted.df)
    found.add("read_noise.shape", tukey.hold_both_gaussians(shape), "1", source)
    if (own := pixel_noise(measured.frames, still)) is not None:
        interval = _own_noise(found, still, own, interval, dark_dn2)
    add_in_electrons(found, "read_noise.sigma", interval, source)
    curve = {"residual_dn": fitted.centres_dn, "counts": fitted.counts, "model": fitted.model}
    found.curves["read_noise"] = curve


def _own_noise(
    found: Findings, still: GroupMoments, own: PixelNoiseSpread, interval: tuple[float, ...], dark_dn2: float
) -> tuple[float, ...]:
    """Read noise by pixel; returns the interval of its root mean square in DN."""
    source = f"covariance of the pixels' variances between halves of {still.n} {still.group.kind} frames"
    square, error = own.variance  # the upper limit of a negative one is that of 0
    found.add("read_noise.spread", root(symmetric(max(square, 0.0), error)), "1", source)
    rms = interval[0]
    uneven = 0.05  # spread of log sigma from which on it bends the histogram's shape
    if own.established and own.spread > uneven:
        needs = "pixels of equal noise: here every pixel has its own, see read_noise.spread"
        found.drop("read_noise.shape", needs)
        found.warn(
            f"read_noise_nonuniform: the read noise varies by {own.spread:.0%} between pixels; its histogram has "
            "heavy tails although each pixel may be normal, so the shape is not determined; sigma is the root mean square",
            spoils=("read_noise.shape",),
        )

        def variance(rows: np.ndarray) -> dict[str, float]:
            return {"v": float((still.row_variances * rows).sum() / rows.sum()) - still.frame_variance}

        value, error, df = jackknife(variance, still.shape[0])["v"]
        interval = root([max(v - 1 / 12 - dark_dn2, 0.0) for v in symmetric(value, error, df)])
        rms = interval[0]
    if rms > 0:
        scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
        found.maps["read_noise"] = (shrunk(own, rms) * scale).astype(np.float32)
    return interval


def temporal_parts(found: Findings, still: GroupMoments) -> None:
    """Noise that whole frames, rows or columns share, from frame to frame."""
    if (t := still.temporal) is None:
        return
    height, width = still.shape
    source = f"three-way analysis of variance of {still.n} {still.group.kind} frames"
    pixel = (-1.0, t.pixel, t.pixel_df)
    for name, ms, df, size in (("row", t.row, t.row_df, width), ("column", t.column, t.column_df, height)):
        terms = [(c / size, m, d) for c, m, d in ((1.0, ms, df), pixel)]
        add_in_electrons(found, f"temporal.{name}", root(variance_combination(terms)), source)
        if read_noise.unsteady(ms, t.pixel, df) and not found.filtered:
            found.warn(
                f"{name}_noise: the offset of whole {name}s changes from frame to frame; read noise excludes it",
                spoils=[f"emva4.{kind}_{part}*" for part in (name, "pixel") for kind in ("dsnu", "prnu")],
            )
            if f"temporal.{name}_e" in found.parameters:
                sigma_e = found.parameters[f"temporal.{name}_e"].value
                found.effects.append({"name": f"{name}_noise", "sigma_e": sigma_e})
    size = height * width
    signs = {"frame": 1, "row": -1, "column": -1, "pixel": 1}
    terms = [(sign / size, getattr(t, part), getattr(t, f"{part}_df")) for part, sign in signs.items()]
    interval = root(variance_combination(terms))
    found.add("temporal.frame_dn", interval, "DN", source)
    is_unsteady = read_noise.unsteady(t.frame, max(t.row, t.column), t.frame_df)
    if is_unsteady and interval[1] > 0.02 * math.sqrt(t.pixel):
        found.warn("black_level_drift: the offset of whole frames changes by more than the noise")
        if found.gain is not None:
            course = still.frame_means - still.frame_means.mean()
            follows = float((course[1:] * course[:-1]).sum() / (course**2).sum()) if still.n > 7 else None
            drift = {"name": "black_level_drift", "sigma_e": interval[0] / found.gain.dn_per_e}
            found.effects.append(drift | ({} if follows is None else {"correlation": max(follows, 0.0)}))
            if follows is None:
                found.assumed.append("effects.black_level_drift.correlation")


def dark_pattern(found: Findings, measured: Measured, still: GroupMoments) -> Parts:
    """DSNU by row, column and pixel, and the master bias."""
    master = master_bias(found, measured, still)
    add_profiles(found, master)
    split = parts(master, [(1 / still.n, still)])
    source = f"analysis of variance of the mean of {still.n} {still.group.kind} frames"
    for name in PARTS:
        add_in_electrons(found, f"dsnu.{name}", root(getattr(split, name)), source)
    if split.defects:
        found.warn(f"defects: {split.defects} outlier pixels of the master bias are excluded from DSNU")
    return split


def master_bias(found: Findings, measured: Measured, still: GroupMoments) -> np.ndarray:
    """The mean of the frames, (H, W) DN, which is kept as a map."""
    master = mean_map(measured.frames, still.group.indices)
    found.maps["master_bias"] = master.astype("float32")
    return master


def add_profiles(found: Findings, master: np.ndarray) -> None:
    """Row and column profiles, their spectra, with a word on what no white pattern has."""
    curves: dict[str, np.ndarray] = {}
    for name, axis in (("row", 1), ("column", 0)):
        *spectrum, found_peaks = describe(master.mean(axis))
        curves |= zip([f"{name}_{what}" for what in ("profile_dn", "frequency", "power")], spectrum)
        if found_peaks.size:
            peaks = ", ".join(f"{f:.3f}" for f in found_peaks[:4])
            said = f"the master bias's {name} means have power at {peaks} cycles per {name}"
            found.warn(f"{name}_structure: {said}")
    found.curves["nonuniformity"] = curves


def add_in_electrons(found: Findings, name: str, interval_dn: tuple[float, ...], source: str) -> None:
    """`name`_e where the gain is known, else `name`_dn and a word on what it needs."""
    if found.gain is None:
        found.add(f"{name}_dn", interval_dn, "DN", source)
        found.miss(f"{name}_e", "the gain: flats at several levels, or a camera with a known gain")
        return
    scaled = tuple(v / found.gain.dn_per_e for v in interval_dn)
    if not found.gain.measured:
        source += ", gain as given"
    found.add(f"{name}_e", widen(scaled, found.gain.relative_error), "e-", source)


def describe(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The profile of rows or columns, (n,) in any unit, about its mean; frequencies, power at these, and its peaks.
    Peaks: frequencies (cycles per line) whose power no white normal pattern would show (1 % in all).
    """
    values, is_even = np.asarray(values, np.float64) - np.mean(values), len(values) % 2 == 0
    power, frequency = np.abs(np.fft.rfft(values)) ** 2 / len(values), np.fft.rfftfreq(len(values))
    m, fewest_frequencies, rest = len(power) - 1 - is_even, 8, power[1:].copy()
    rank = (m + 1) // 2
    median = np.partition(rest[:m], rank - 1)[rank - 1] if m >= fewest_frequencies else 0.0
    if not median > 0:  # too few lines, or lines without noise
        return values, frequency, power, np.empty(0)
    if is_even:
        # Half the sampling frequency has one degree of freedom, the others two: the same probability.
        white = median / np.log(2)
        rest[-1] = -white * (np.log(2) + log_ndtr(-np.sqrt(rest[-1] / white)))
    return values, frequency, power, frequency[1:][rest > _least_peak(m, rank) * median]


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
