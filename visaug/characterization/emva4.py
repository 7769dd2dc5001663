"""EMVA 1288 release 4.0 Linear: the figures of its data sheet that follow from those of `emva`, and the arrays of its
plots.

The standard: EMVA Standard 1288, release 4.0 Linear (2021), European Machine Vision Association. It gives no
intervals; those here are this package's own. Release 4.0 General, for cameras without a linear raw signal, is not
implemented.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage, stats

from visaug.characterization.findings import Findings
from visaug.characterization.groups import FlatLevel
from visaug.characterization.moments import GroupMoments
from visaug.characterization.nonuniformity import Parts, release_4
from visaug.characterization.result import Estimate

SOURCE = "EMVA 1288 release 4"
CORRECTED = "release 4, temporal noise of rows and columns as measured"
NEEDS_SATURATION = "calibrated flats up to saturation and beyond"
_HIGH_PASS = 5  # the standard's box of 5 x 5
_NOT_WHITE = 1e-3  # false-alarm rate of the test that rows or columns share temporal noise
_BINS = 256
Interval = tuple[float, float, float]


def derived(found: Findings, response: Interval | None) -> None:
    """Figures that follow from gain, efficiency, dark noise and saturation: 1/K, R, SNR, thresholds, dynamic range."""
    gain, dark = (found.parameters.get(f"emva.{n}") for n in ("system_gain_dn_per_e", "dark_noise_dn"))
    photons, electrons = (found.parameters.get(f"emva.saturation_{n}") for n in ("photons", "e"))
    threshold = None
    if gain is not None and gain.low > 0:
        found.add("emva4.inverse_gain_e_per_dn", _through(gain, lambda k: 1 / k), "e-/DN", SOURCE)
    if gain is not None and dark is not None and gain.low > 0:
        interval = _threshold(dark, gain, _scaled(gain, 1.0))
        found.add("emva4.absolute_sensitivity_threshold_e", interval, "e-", SOURCE)
        if response is not None:
            found.add("emva4.responsivity_dn_per_photon", response, "DN/photon", SOURCE)
            threshold = _threshold(dark, gain, response)
            found.add("emva4.absolute_sensitivity_threshold_photons", threshold, "photons", SOURCE)
    if electrons is not None and electrons.low > 0:
        found.add("emva4.snr_max", _through(electrons, math.sqrt), "1", SOURCE)
        found.add("emva4.snr_max_db", _through(electrons, lambda e: 10 * math.log10(e)), "dB", SOURCE)
        found.add("emva4.snr_max_bit", _through(electrons, lambda e: 0.5 * math.log2(e)), "bit", SOURCE)
        found.add(
            "emva4.inverse_snr_max", _through(electrons, lambda e: 1 / math.sqrt(e)), "fraction", SOURCE
        )
    else:
        found.miss("emva4.snr_max", NEEDS_SATURATION)
    if photons is not None and threshold is not None and threshold[1] > 0 and photons.low > 0:
        ratio = _ratio((photons.value, photons.low, photons.high), threshold)
        estimate = Estimate(*ratio, "1", SOURCE)
        found.add("emva4.dynamic_range", ratio, "1", SOURCE)
        found.add("emva4.dynamic_range_db", _through(estimate, lambda r: 20 * math.log10(r)), "dB", SOURCE)
        found.add("emva4.dynamic_range_bit", _through(estimate, math.log2), "bit", SOURCE)
    else:
        found.miss("emva4.dynamic_range_db", NEEDS_SATURATION)
        found.miss("emva4.absolute_sensitivity_threshold_photons", "flats with known photons and dark frames")
    slope = found.parameters.get("dark_current.b_per_c")
    if slope is not None and slope.low > 0:
        found.add("emva4.doubling_temperature_c", _through(slope, lambda b: math.log(2) / b), "degC", SOURCE)
    else:
        found.miss("emva4.doubling_temperature_c", "dark frames at several exposures and temperatures")


def _through(estimate: Estimate, law) -> Interval:
    """A monotonic law of an estimate."""
    low, high = sorted((law(estimate.low), law(estimate.high)))
    return law(estimate.value), low, high


def _scaled(estimate: Estimate, factor: float) -> Interval:
    return estimate.value * factor, estimate.low * factor, estimate.high * factor


def _threshold(dark: Estimate, gain: Estimate, response: Interval) -> Interval:
    """Signal at which the signal-to-noise ratio is 1: (sigma_y.dark + K / 2) / R, in photons with R the
    responsivity, in electrons with K in its place.
    """
    value = (dark.value + 0.5 * gain.value) / response[0]

    def half(d: float, k: float, r: float) -> float:
        same = response[0] == gain.value and response[1] == gain.low
        by_gain = (
            dark.value * (k - gain.value) / gain.value**2 if same else 0.5 * (k - gain.value) / response[0]
        )
        by_response = 0.0 if same else value * (r - response[0]) / response[0]
        return math.sqrt(((d - dark.value) / response[0]) ** 2 + by_gain**2 + by_response**2)

    return (
        value,
        max(value - half(dark.low, gain.low, response[2]), 0.0),
        value + half(dark.high, gain.high, response[1]),
    )


def _ratio(a: Interval, b: Interval) -> Interval:
    """a / b of two independent positive figures, errors added in logarithms."""
    value = a[0] / b[0]
    down = math.hypot(math.log(a[0] / a[1]), math.log(b[2] / b[0]))
    up = math.hypot(math.log(a[2] / a[0]), math.log(b[0] / b[1]))
    return value, value * math.exp(-down), value * math.exp(up)


def not_white(m: GroupMoments) -> list[str]:
    """``row`` and ``column`` where these share temporal noise: the standard's split takes it to be white."""
    if m.temporal is None:
        return []
    t = m.temporal
    if t.pixel <= 0:
        return []
    return [
        name
        for name, square, df in (("row", t.row, t.row_df), ("column", t.column, t.column_df))
        if stats.f.sf(square / t.pixel, df, t.pixel_df) < _NOT_WHITE
    ]


def corrected_split(m: GroupMoments) -> dict[str, float]:
    """Release 4's spatial variances with the temporal variance that rows and columns have, DN^2.

    The standard takes off sigma^2 / (L M) from the variance of column means and sigma^2 / (L N) from that of row
    means, as for white noise. Here the variance of these means over the frames is measured, the frame's own mean
    taken out, and divided by L: right for any noise that is independent from frame to frame.
    """

    def noise(means: np.ndarray) -> float:
        steady = means - means.mean(1, keepdims=True)
        return float(steady.var(axis=0, ddof=1).mean()) / m.n

    return release_4(
        m,
        total_noise=m.variance / m.n,
        column_noise=noise(m.columns_by_frame),
        row_noise=noise(m.rows_by_frame),
    )


def corrected(
    found: Findings, level: FlatLevel, dark_parts: Parts, flat_parts: Parts, gain: float, relative: float
) -> None:
    """`emva4_corrected.*` where rows or columns share temporal noise, with a warning that says what it does."""
    from visaug.core.intervals import root

    shared = {name for m in (level.dark, level.flat) for name in not_white(m)}
    if not shared:
        return
    dark, flat = corrected_split(level.dark), corrected_split(level.flat)
    as_written = release_4(level.dark)
    for name in ("row", "column", "pixel"):
        value = math.sqrt(max(dark[name], 0.0)) / gain
        _, low, high = root(getattr(dark_parts, name), 1 / gain, relative)
        found.add(
            f"emva4_corrected.dsnu_{name}_e", (value, min(low, value), max(high, value)), "e-", CORRECTED
        )
        value = math.sqrt(max(flat[name] - dark[name], 0.0)) / level.signal
        _, low, high = root(getattr(flat_parts, name), 1 / level.signal)
        interval = (value, min(low, value), max(high, value))
        found.add(f"emva4_corrected.prnu_{name}", interval, "fraction", CORRECTED)
    negative = [name for name in ("row", "column", "pixel") if as_written[name] < 0]
    spoiled = f"; it gives a negative variance of {' and '.join(negative)} (shown as 0)" if negative else ""
    found.warn(
        f"emva4_split: {' and '.join(sorted(shared))} means share temporal noise, which release 4 assumes "
        f"to be white: emva4.dsnu_* and emva4.prnu_* are the figures of the standard{spoiled}; emva4_corrected.* subtracts "
        "the noise of rows and columns",
        spoils=("emva4.dsnu_*", "emva4.prnu_*"),
    )


def high_pass(values: np.ndarray) -> np.ndarray:
    """A map less its mean over 5 x 5 pixels, without the borders that lack neighbours; scaled so that a white
    pattern keeps its variance (the box takes 1/25 of it).
    """
    edge = _HIGH_PASS // 2
    inner = (slice(edge, -edge or None),) * 2
    smooth = ndimage.uniform_filter(values, _HIGH_PASS, mode="nearest")
    return (values - smooth)[inner] / math.sqrt(1 - 1 / _HIGH_PASS**2)


def prnu_high_pass(found: Findings, level: FlatLevel, dark_map: np.ndarray, flat_map: np.ndarray) -> None:
    """PRNU of what a high-pass filter leaves: shading of lamp and lens, which the standard's PRNU holds, is gone."""
    if min(flat_map.shape) <= 2 * _HIGH_PASS:
        return
    pattern = high_pass(flat_map - dark_map)
    noise = level.flat.variance / level.flat.n + level.dark.variance / level.dark.n
    square, df = float(pattern.var(ddof=1)), pattern.size - 1
    low, high = (square * df / stats.chi2.ppf(p, df) for p in (0.975, 0.025))
    value = math.sqrt(max(square - noise, 0.0)) / level.signal
    bounds = (math.sqrt(max(v - noise, 0.0)) / level.signal for v in (low, high))
    found.add("emva4.prnu_highpass", (value, *bounds), "fraction", f"{SOURCE}, high-pass 5 x 5")


def sweep_curves(
    levels: tuple[FlatLevel, ...], saturation: int | None, last: int, darks: list[GroupMoments]
) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of the plots against exposure: photons, means and variances of bright and dark frames."""
    photons = [math.nan if v.photons is None else v.photons for v in levels]
    return {
        "emva4_sweep": {
            "photons": np.array(photons, float),
            "mean_dn": np.array([v.flat.mean for v in levels]),
            "dark_mean_dn": np.array([v.dark.mean for v in levels]),
            "variance_dn2": np.array([v.flat.variance for v in levels]),
            "dark_variance_dn2": np.array([v.dark.variance for v in levels]),
            "saturation": np.array([-1 if saturation is None else saturation]),
            "last_fitted": np.array([last]),
        },
        "emva4_dark": {
            "exposure_s": np.array([m.group.exposure_s for m in darks]),
            "mean_dn": np.array([m.mean for m in darks]),
            "variance_dn2": np.array([m.variance for m in darks]),
        },
    }


def pattern_curves(values: np.ndarray, noise: float) -> dict[str, np.ndarray]:
    """Arrays of the plots of one map: spectrograms, profiles and histograms along rows and columns.

    Args:
        values: (H, W) map in the plot's unit (e- or %).
        noise: variance of the temporal noise that is left in the map, in its unit squared.
    """
    curves: dict[str, np.ndarray] = {"noise": np.array([math.sqrt(max(noise, 0.0))])}
    centred = values - values.mean()
    for name, lines in (("horizontal", values), ("vertical", values.T)):
        rows = lines - lines.mean()
        power = (np.abs(np.fft.rfft(rows, axis=1)) ** 2).mean(0) / rows.shape[1]
        curves[f"{name}_frequency"] = np.fft.rfftfreq(rows.shape[1])
        curves[f"{name}_amplitude"] = np.sqrt(power)
        curves[f"{name}_mean"] = lines.mean(0)
        curves[f"{name}_middle"] = lines[lines.shape[0] // 2]
        curves[f"{name}_least"], curves[f"{name}_most"] = lines.min(0), lines.max(0)
    counts, edges = np.histogram(centred, _BINS)
    curves["deviation"], curves["count"] = 0.5 * (edges[1:] + edges[:-1]), counts
    spread = centred.std()
    width = edges[1] - edges[0]
    curves["normal"] = centred.size * width * stats.norm.pdf(curves["deviation"], scale=max(spread, 1e-12))
    size = np.sort(np.abs(centred), axis=None)
    chosen = np.unique(np.linspace(0, size.size - 1, _BINS).astype(int))
    tail = np.arange(max(size.size - _BINS, 0), size.size)  # the largest few one by one
    at = np.union1d(chosen, tail)
    curves["beyond"], curves["percent_beyond"] = size[at], 100 * (size.size - at) / size.size
    return curves


def defect_counts(
    values: np.ndarray, sigmas: tuple[float, ...] = (4.0, 5.0, 6.0, 8.0)
) -> dict[str, np.ndarray]:
    """Pixels farther from the mean than so many robust standard deviations, and how many a normal pattern has."""
    centred = values - np.median(values)
    spread = 1.4826 * np.median(np.abs(centred))
    return {
        "sigma": np.array(sigmas),
        "limit": np.array(sigmas) * spread,
        "above": np.array([np.count_nonzero(centred > s * spread) for s in sigmas]),
        "below": np.array([np.count_nonzero(centred < -s * spread) for s in sigmas]),
        "normal": np.array([2 * stats.norm.sf(s) * values.size for s in sigmas]),
        "pixels": np.array([values.size]),
    }
