"""The figures of EMVA 1288: those of release 3, and those that release 4.0 Linear has beside them.

The standard: EMVA Standard 1288, release 3.0 (2010) and release 4.0 Linear (2021), European Machine Vision Association. Intervals
are this package's own; the standard gives none. Release 4.0 General, for cameras without a linear raw signal, is not implemented.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy import stats

from visaug.characterization import emva_curves, photon_transfer
from visaug.characterization.alike import SAME_C, degrees_apart
from visaug.characterization.dark_current import mean_points, slopes, variance_points
from visaug.characterization.groups import FlatLevel, Measured
from visaug.characterization.light import NEEDS_FLATS, NEEDS_GAIN, NEEDS_PHOTONS
from visaug.characterization.moments import GroupMoments, mean_map
from visaug.characterization.nonuniformity import PARTS, corrected_split, not_white, parts, release_4
from visaug.characterization.response import errors_of_light
from visaug.core.intervals import Interval, jackknife, mean_error, root, symmetric, widen
from visaug.frames.checks import SATURATED_SHARE
from visaug.statistics.findings import Estimate, Findings

_SATURATED = "calibrated flats up to saturation and beyond"
_STACKS = "two or more flats at one level, and two or more dark frames beside them"
# What each figure needs, where nothing more particular is said.
_NEEDS = {
    "emva.system_gain_dn_per_e": NEEDS_FLATS,
    "emva.quantum_efficiency": NEEDS_PHOTONS,
    "emva.saturation_photons": NEEDS_PHOTONS,
    "emva.saturation_e": NEEDS_PHOTONS,
    "emva.dark_noise_dn": "two or more dark frames at one setting",
    "emva.dark_noise_e": NEEDS_FLATS,
    "emva.dsnu_dn": _STACKS,
    "emva.dsnu_e": _STACKS,
    "emva.prnu_fraction": NEEDS_FLATS,
    "emva.linearity_error_min": NEEDS_PHOTONS,
    "emva.linearity_error_max": NEEDS_PHOTONS,
    "emva.dark_current_mean_e_per_s": "dark frames at three or more exposures, and flats for the gain",
    "emva.dark_current_variance_e_per_s": "dark frames at three or more exposures, and flats for the gain",
    "emva4.snr_max": _SATURATED,
    "emva4.dynamic_range_db": _SATURATED,
    "emva4.absolute_sensitivity_threshold_e": "flats for the gain, and dark frames",
    "emva4.absolute_sensitivity_threshold_photons": "flats with known photons and dark frames",
    "emva4.doubling_temperature_c": "dark frames at several exposures and temperatures",
    **{f"emva4.dsnu_{part}_e": _STACKS for part in PARTS},
    **{f"emva4.prnu_{part}": _STACKS for part in PARTS},
}

_R3, _R4 = "EMVA 1288 release 3", "EMVA 1288 release 4"
# Figures of release 4 that are a monotonic law of another one: unit, the other one, law.
LAWS: dict[str, tuple[str, str, Callable[[float], float]]] = {
    "emva4.inverse_gain_e_per_dn": ("e-/DN", "emva.system_gain_dn_per_e", lambda k: 1 / k),
    "emva4.snr_max": ("1", "emva.saturation_e", math.sqrt),
    "emva4.snr_max_db": ("dB", "emva.saturation_e", lambda e: 10 * math.log10(e)),
    "emva4.snr_max_bit": ("bit", "emva.saturation_e", lambda e: 0.5 * math.log2(e)),
    "emva4.inverse_snr_max": ("fraction", "emva.saturation_e", lambda e: 1 / math.sqrt(e)),
    "emva4.dynamic_range_db": ("dB", "emva4.dynamic_range", lambda r: 20 * math.log10(r)),
    "emva4.dynamic_range_bit": ("bit", "emva4.dynamic_range", math.log2),
    "emva4.doubling_temperature_c": ("degC", "dark_current.b_per_c", lambda b: math.log(2) / b),
}


def emva(found: Findings, measured: Measured) -> None:
    """Add `emva.*` (release 3) and `emva4.*` (release 4): every figure, or what it needs."""
    _figures(found, measured)
    for key, needs in _NEEDS.items():
        found.miss(key, needs)


def _figures(found: Findings, measured: Measured) -> None:
    levels = measured.sweep
    darks = _dark_sweep(measured, measured.temperature_c)
    if not levels or levels[-1].signal <= 0:
        _dark_noise(found, measured, darks, None, 0.0)
        return
    saturation = photon_transfer.saturated_level(levels)
    sensitivity = photon_transfer.emva_sensitivity(levels, saturation)
    system_gain = symmetric(*sensitivity["gain"])
    if not (photon_transfer.tells_gain(levels, saturation) and system_gain[1] > 0):
        _dark_noise(found, measured, darks, None, 0.0)
        derived(found, None)
        for key in _NEEDS:
            found.miss(key, NEEDS_GAIN)
        return
    last = photon_transfer.last_fitted(levels, saturation)
    found.curves.update(emva_curves.sweep_curves(levels, saturation, last, darks))
    gain, gain_error, _ = sensitivity["gain"]
    relative = gain_error / gain
    found.add("emva.system_gain_dn_per_e", system_gain, "DN/e-", _R3)
    if "efficiency" in sensitivity:
        light = errors_of_light(levels[: last + 1])
        for name in ("response", "efficiency"):
            value, error, df = sensitivity[name]
            parts = [(error**2, df), *((share * value**2, its) for share, its in light)]
            sensitivity[name] = value, *mean_error(parts)
        found.add("emva.quantum_efficiency", symmetric(*sensitivity["efficiency"]), "e-/photon", _R3)
        _saturation(found, levels, saturation, sensitivity["efficiency"])
        if (linearity := photon_transfer.emva_linearity(levels, saturation)) is not None:
            found.curves["emva4_linearity"] = photon_transfer.linearity_curve(levels, saturation)
        for name in ("min", "max"):
            key = f"emva.linearity_error_{name}"
            if linearity is None:
                found.miss(key, "three or more levels between 5 and 95 % of saturation")
            else:
                found.add(key, linearity[name], "fraction", _R3)
    _dark_noise(found, measured, darks, gain, relative)
    _dark_current(found, _dark_ladder(measured), gain, relative)
    _disagree(found)
    _spatial(found, measured, gain, relative)
    derived(found, symmetric(*sensitivity["response"]) if "response" in sensitivity else None)


def _dark_sweep(measured: Measured, temperature_c: float | None) -> list[GroupMoments]:
    """Dark frames at one temperature, by exposure; stacks of many frames stand apart from a sweep."""
    every = (m for m in (*measured.darks, *measured.biases) if m.n > 1)
    same = [m for m in every if degrees_apart(temperature_c, m.group.temperature_c) <= SAME_C]
    usual = np.median([m.n for m in same]) if same else 0
    small = [m for m in same if m.n <= 4 * usual]
    chosen = small if len({m.group.exposure_s for m in small}) > 2 else same
    shape = max((m.shape for m in chosen), key=lambda s: s[0] * s[1], default=None)
    return sorted((m for m in chosen if m.shape == shape), key=lambda m: m.group.exposure_s)


def _dark_ladder(measured: Measured) -> list[GroupMoments]:
    """The sweep of three or more exposures whose temperature is nearest to the flats'."""
    base = measured.temperature_c
    degrees = {m.group.temperature_c for m in measured.darks}
    temperatures = sorted(degrees, key=lambda t: (degrees_apart(t, base), t is None, t or 0.0))
    for t in (base, *temperatures):
        ladder = _dark_sweep(measured, t)
        if len({m.group.exposure_s for m in ladder}) > 2:
            return ladder
    return []


def _saturation(found: Findings, levels: tuple[FlatLevel, ...], saturation: int | None, efficiency) -> None:
    if saturation is None:
        found.miss("emva.saturation_photons", "flats beyond saturation")
        found.miss("emva.saturation_e", "flats beyond saturation")
        return
    photons = [float(v.photons or 0.0) for v in levels]
    value = photons[saturation]
    # The sweep's steps are all that is known of where the variance peaks.
    low, high = photons[max(saturation - 1, 0)], photons[min(saturation + 1, len(photons) - 1)]
    found.add("emva.saturation_photons", (value, low, high), "photons", _R3)
    e = efficiency[0]
    found.add("emva.saturation_e", widen((value * e, low * e, high * e), efficiency[1] / e), "e-", _R3)


def _without_dark_current(
    found: Findings, measured: Measured, darks: list[GroupMoments]
) -> tuple[list[GroupMoments], bool]:
    """Those of the sweep `darks` that tell the noise at the flats' exposure, and whether a line over their exposures tells it."""
    if (exposures := len({m.group.exposure_s for m in darks})) > 2:
        return darks, True
    # with a log's rounding
    longest = 1.02 * max((v.flat.group.exposure_s for v in measured.levels), default=math.inf)
    every = (m for m in (*measured.biases, *measured.darks) if m.n > 1 and m.shape == darks[0].shape)
    shortest = min(every, key=lambda m: m.group.exposure_s)  # of any temperature: it has no dark current
    for m in (darks[0], shortest):
        if m.group.exposure_s <= longest:
            return [m], False
    if exposures > 1:
        return darks, True
    found.warn(
        f"dark_noise_exposure: the dark noise is that of dark frames of {darks[0].group.exposure_s:g} s, and flats were exposed "
        f"for {longest / 1.02:g} s at most: the shot noise of the dark current is in it",
        spoils=("emva.dark_noise_*", "emva4.absolute_sensitivity_*", "emva4.dynamic_range*"),
    )
    return darks[:1], False


def _dark_noise(
    found: Findings, measured: Measured, darks: list[GroupMoments], gain: float | None, relative: float
) -> None:
    if not darks:
        return
    darks, is_line = _without_dark_current(found, measured, darks)
    exposures = np.array([m.group.exposure_s for m in darks])

    def compute(rows: np.ndarray) -> dict[str, float]:
        y = np.array([(m.row_variances * rows).sum() / rows.sum() - m.frame_variance for m in darks])
        return {"variance": float(np.polyfit(exposures, y, 1)[1] if is_line else y[0])}

    value, low, high = symmetric(*jackknife(compute, darks[0].shape[0])["variance"])
    # Release 3: below 0.24 DN^2 quantization hides the dark noise.
    variance = (max(value, 0.24), max(low, 0.0), max(high, 0.24))
    found.add("emva.dark_noise_dn", root(variance), "DN", _R3)
    if gain is not None:
        value, low, high = (max(v - 1 / 12, 0.0) for v in variance)  # less that of quantization
        found.add("emva.dark_noise_e", root((value, low, high), 1 / gain, relative), "e-", _R3)


def _dark_current(found: Findings, darks: list[GroupMoments], gain: float, relative: float) -> None:
    for name, of, power in (("mean", mean_points, 1), ("variance", variance_points, 2)):
        key = f"emva.dark_current_{name}_e_per_s"
        if not (lines := slopes(of(darks))):
            found.miss(key, "dark frames at three or more exposures")
            continue
        line = lines[0]
        at = "" if line.temperature_c is None else f", at {line.temperature_c:g} degC"
        value, low, high = (v * gain**-power for v in symmetric(line.value, line.error, line.df))
        if value > 0:
            found.add(key, widen((value, max(low, 0.0), high), power * relative), "e-/s", _R3 + at)
        elif name == "mean":
            found.add(key, (value, low, high), "e-/s", _R3 + at)
        else:
            found.miss(key, "longer exposures: the dark variance does not grow with exposure")


def _disagree(found: Findings) -> None:
    """Mean and variance of the dark signal tell the same current, unless something else is in it."""
    mean, variance = (found.parameters.get(f"emva.dark_current_{n}_e_per_s") for n in ("mean", "variance"))
    if mean is None or variance is None:
        return
    if variance.low > mean.high > 0 or variance.high < mean.low:
        found.warn(
            "dark_current_disagrees: mean and variance of the dark signal give different dark currents (cosmic rays, "
            "hot pixels that clip, light, or a mean that is corrected in the camera)",
            spoils=("dark_current.*", "emva.dark_current_*"),
        )


def _spatial(found: Findings, measured: Measured, gain: float, relative: float) -> None:
    if (level := _stack(measured)) is None:
        return
    flat, dark, signal = level.flat, level.dark, level.signal
    dark_map, flat_map = (mean_map(measured.frames, m.group.indices) for m in (dark, flat))
    dark_parts = parts(dark_map, [(1 / dark.n, dark)])
    flat_parts = parts(flat_map - dark_map, [(1 / flat.n, flat), (1 / dark.n, dark)])

    def deviation(variance: float, part: Interval, divisor: float, relative: float = 0.0) -> Interval:
        """By the standard's variance, with the interval of `part`; the divisor is known to `relative`."""
        _, low, high = root(part, 1 / divisor, relative)
        return math.sqrt(max(variance, 0.0)) / divisor, low, high

    def split(release: str, dark: dict[str, float], flat: dict[str, float], source: str) -> None:
        """Parts of DSNU and PRNU from the spatial variances of both stacks, DN^2."""
        for name in PARTS:
            interval = deviation(dark[name], getattr(dark_parts, name), gain, relative)
            found.add(f"{release}.dsnu_{name}_e", interval, "e-", source)
            interval = deviation(flat[name] - dark[name], getattr(flat_parts, name), signal)
            found.add(f"{release}.prnu_{name}", interval, "fraction", source)

    r4_dark, r4_flat = release_4(dark), release_4(flat)
    value, low, high = deviation(r4_dark["total"], dark_parts.total, 1.0)
    dsnu = (value, min(low, value), max(high, value))
    found.add("emva.dsnu_dn", dsnu, "DN", _R3)
    found.add("emva.dsnu_e", widen([v / gain for v in dsnu], relative), "e-", _R3)
    prnu = deviation(r4_flat["total"] - r4_dark["total"], flat_parts.total, signal)
    found.add("emva.prnu_fraction", prnu, "fraction", _R3)
    split("emva4", r4_dark, r4_flat, _R4)
    if shared := {name for m in (dark, flat) for name in not_white(m)}:
        source = "release 4, temporal noise of rows and columns as measured"
        split("emva4_corrected", corrected_split(dark), corrected_split(flat), source)
        negative = " and ".join(name for name in PARTS if r4_dark[name] < 0)
        spoiled = f"; it gives a negative variance of {negative} (shown as 0)" if negative else ""
        found.warn(
            f"emva4_split: {' and '.join(sorted(shared))} means share temporal noise, which release 4 assumes "
            f"to be white: emva4.dsnu_* and emva4.prnu_* are the figures of the standard{spoiled}; emva4_corrected.* subtracts "
            "the noise of rows and columns",
            spoils=("emva4.dsnu_*", "emva4.prnu_*"),
        )
    _prnu_high_pass(found, level, flat_map - dark_map)
    percent = 100 * (flat_map - dark_map) / signal
    noise = (flat.variance / flat.n + dark.variance / dark.n) * (100 / signal) ** 2
    found.curves["emva4_dsnu"] = emva_curves.pattern_curves(dark_map / gain, dark.variance / dark.n / gain**2)
    found.curves["emva4_prnu"] = emva_curves.pattern_curves(percent, noise)
    found.curves["emva4_defects_dsnu"] = emva_curves.defect_counts(dark_map / gain)
    if min(percent.shape) > 10:
        found.curves["emva4_defects_prnu"] = emva_curves.defect_counts(emva_curves.high_pass(percent))


def _prnu_high_pass(found: Findings, level: FlatLevel, pattern: np.ndarray) -> None:
    """PRNU of what a high-pass filter leaves: shading of lamp and lens, which the standard's PRNU holds, is gone."""
    if min(pattern.shape) <= 2 * emva_curves.HIGH_PASS:
        return
    pattern = emva_curves.high_pass(pattern)
    noise = level.flat.variance / level.flat.n + level.dark.variance / level.dark.n
    square, df = float(pattern.var(ddof=1)), pattern.size - 1
    low, high = (square * df / stats.chi2.ppf(p, df) for p in (0.975, 0.025))
    value = math.sqrt(max(square - noise, 0.0)) / level.signal
    bounds = (math.sqrt(max(v - noise, 0.0)) / level.signal for v in (low, high))
    found.add("emva4.prnu_highpass", (value, *bounds), "fraction", f"{_R4}, high-pass 5 x 5")


def _stack(measured: Measured) -> FlatLevel | None:
    """The level for spatial figures: most frames; among equals nearest to half of saturation."""
    levels = [v for v in measured.levels if v.flat.n > 1 and v.dark.n > 1 and v.signal > 0]
    if not levels:
        return None
    saturation = photon_transfer.saturated_level(levels)
    half = 0.5 * levels[-1 if saturation is None else saturation].signal
    if saturation is not None:  # a stack of saturated flats shows no PRNU
        levels = [v for v in levels[: saturation + 1] if v.flat.clipped_high <= SATURATED_SHARE] or levels
    most = max(v.flat.n for v in levels)
    return min((v for v in levels if v.flat.n == most), key=lambda v: abs(v.signal - half))


def derived(found: Findings, response: Interval | None) -> None:
    """Figures that follow from gain, dark noise, saturation and, of a calibrated source, responsivity in DN/photon."""
    gain, dark = (found.parameters.get(f"emva.{n}") for n in ("system_gain_dn_per_e", "dark_noise_dn"))
    photons = found.parameters.get("emva.saturation_photons")
    if gain is not None and dark is not None and gain.low > 0:
        threshold = _threshold(dark, gain, None)
        found.add("emva4.absolute_sensitivity_threshold_e", threshold, "e-", _R4)
        if response is not None:
            found.add("emva4.responsivity_dn_per_photon", response, "DN/photon", _R4)
            threshold = _threshold(dark, gain, response)
            found.add("emva4.absolute_sensitivity_threshold_photons", threshold, "photons", _R4)
            if photons is not None and threshold[1] > 0 and photons.low > 0:
                ratio = _ratio((photons.value, photons.low, photons.high), threshold)
                found.add("emva4.dynamic_range", ratio, "1", _R4)
    for key, (unit, of, law) in LAWS.items():
        estimate = found.parameters.get(of)
        if estimate is not None and estimate.low > 0:
            low, high = sorted((law(estimate.low), law(estimate.high)))
            found.add(key, (law(estimate.value), low, high), unit, _R4)


def _threshold(dark: Estimate, gain: Estimate, response: Interval | None) -> Interval:
    """Signal at which the signal-to-noise ratio is 1: (sigma_y.dark + K / 2) / R, in photons with R the
    responsivity; without one in electrons, K in its place.
    """
    per, least, most = response or (gain.value, gain.low, gain.high)
    value = (dark.value + 0.5 * gain.value) / per

    def half(d: float, k: float, r: float) -> float:
        if response is None:
            by_gain, by_response = dark.value * (k - gain.value) / gain.value**2, 0.0
        else:
            by_gain, by_response = 0.5 * (k - gain.value) / per, value * (r - per) / per
        return math.sqrt(((d - dark.value) / per) ** 2 + by_gain**2 + by_response**2)

    low, high = value - half(dark.low, gain.low, most), value + half(dark.high, gain.high, least)
    return value, max(low, 0.0), high


def _ratio(a: Interval, b: Interval) -> Interval:
    """a / b of two independent positive figures, errors added in logarithms."""
    value = a[0] / b[0]
    down = math.hypot(math.log(a[0] / a[1]), math.log(b[2] / b[0]))
    up = math.hypot(math.log(a[2] / a[0]), math.log(b[0] / b[1]))
    return value, value * math.exp(-down), value * math.exp(up)
