"""The figures of EMVA 1288, release 3, and the row, column and pixel parts of release 4 beside them.

The standard: EMVA Standard 1288, release 3.0 (2010) and release 4.0 Linear (2021), European Machine Vision
Association. Intervals are this package's own; the standard gives none.
"""

from __future__ import annotations

import math

import numpy as np

from visaug.characterization import emva4
from visaug.characterization.alike import SAME_C, degrees_apart
from visaug.characterization.dark_current import mean_points, slopes, variance_points
from visaug.characterization.findings import Findings
from visaug.characterization.groups import FlatLevel, Measured
from visaug.characterization.light import NEEDS_FLATS, NEEDS_PHOTONS
from visaug.characterization.moments import GroupMoments, mean_map
from visaug.characterization.nonuniformity import parts, release_4
from visaug.characterization.photon_transfer import (
    emva_linearity,
    emva_sensitivity,
    last_fitted,
    linearity_curve,
    saturated_level,
)
from visaug.core.intervals import jackknife, root, t_quantile, widen

_QUANTIZATION = 1 / 12
_LEAST_DARK_VARIANCE = 0.24  # release 3: below, quantization hides the dark noise
_R3, _R4 = "EMVA 1288 release 3", "EMVA 1288 release 4"


def emva(found: Findings, measured: Measured) -> None:
    """Add `emva.*` (release 3) and `emva4.*` (release 4)."""
    levels = measured.sweep
    darks = _dark_sweep(measured, measured.temperature_c)
    if not levels or levels[-1].signal <= 0:
        found.miss("emva.system_gain_dn_per_e", NEEDS_FLATS)
        _dark_noise(found, darks, None, 0.0)
        return
    saturation = saturated_level(levels)
    found.curves.update(emva4.sweep_curves(levels, saturation, last_fitted(levels, saturation), darks))
    sensitivity = emva_sensitivity(levels, saturation)
    gain, gain_error, _ = sensitivity["gain"]
    relative = gain_error / gain if gain > 0 else math.nan
    found.add("emva.system_gain_dn_per_e", _around(sensitivity["gain"]), "DN/e-", _R3)
    if "efficiency" in sensitivity:
        found.add("emva.quantum_efficiency", _around(sensitivity["efficiency"]), "e-/photon", _R3)
        _saturation(found, levels, saturation, sensitivity["efficiency"])
        linearity = emva_linearity(levels, saturation)
        if linearity is not None:
            found.curves["emva4_linearity"] = linearity_curve(levels, saturation)
        for name in ("min", "max"):
            if linearity is None:
                found.miss(
                    f"emva.linearity_error_{name}", "three or more levels between 5 and 95 % of saturation"
                )
            else:
                found.add(f"emva.linearity_error_{name}", _around(linearity[name]), "fraction", _R3)
    else:
        for name in ("quantum_efficiency", "saturation_photons", "saturation_e"):
            found.miss(f"emva.{name}", NEEDS_PHOTONS)
    _dark_noise(found, darks, gain, relative)
    _dark_current(found, _dark_ladder(measured), gain, relative)
    _disagree(found)
    _spatial(found, measured, gain, relative)
    emva4.derived(found, _around(sensitivity["response"]) if "response" in sensitivity else None)


def _around(result: tuple[float, float, float]) -> tuple[float, float, float]:
    value, error, df = result
    half = t_quantile(df) * error
    return value, value - half, value + half


def _dark_sweep(measured: Measured, temperature_c: float | None) -> list[GroupMoments]:
    """Dark frames at one temperature, by exposure; stacks of many frames stand apart from a sweep."""
    same = [
        m
        for m in (*measured.darks, *measured.biases)
        if m.n > 1 and _alike(temperature_c, m.group.temperature_c)
    ]
    usual = np.median([m.n for m in same]) if same else 0
    small = [m for m in same if m.n <= 4 * usual]
    chosen = small if len({m.group.exposure_s for m in small}) > 2 else same
    shape = max((m.shape for m in chosen), key=lambda s: s[0] * s[1], default=None)
    return sorted((m for m in chosen if m.shape == shape), key=lambda m: m.group.exposure_s)


def _dark_ladder(measured: Measured) -> list[GroupMoments]:
    """The sweep of three or more exposures whose temperature is nearest to the flats'."""
    base = measured.temperature_c
    temperatures = sorted(
        {m.group.temperature_c for m in measured.darks},
        key=lambda t: (degrees_apart(t, base), t is None, t or 0.0),
    )
    for t in (base, *temperatures):
        ladder = _dark_sweep(measured, t)
        if len({m.group.exposure_s for m in ladder}) > 2:
            return ladder
    return []


def _alike(a: float | None, b: float | None) -> bool:
    return degrees_apart(a, b) <= SAME_C


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
    interval = widen((value * e, low * e, high * e), efficiency[1] / e)
    found.add("emva.saturation_e", interval, "e-", _R3)


def _dark_noise(found: Findings, darks: list[GroupMoments], gain: float | None, relative: float) -> None:
    if not darks:
        found.miss("emva.dark_noise_dn", "two or more dark frames at one setting")
        return
    exposures = np.array([m.group.exposure_s for m in darks])

    def compute(rows: np.ndarray) -> dict[str, float]:
        y = np.array([(m.row_variances * rows).sum() / rows.sum() - m.frame_variance for m in darks])
        several = len(np.unique(exposures)) > 2
        return {"variance": float(np.polyfit(exposures, y, 1)[1] if several else y[0])}

    value, low, high = _around(jackknife(compute, darks[0].shape[0])["variance"])
    variance = (max(value, _LEAST_DARK_VARIANCE), max(low, 0.0), max(high, _LEAST_DARK_VARIANCE))
    found.add("emva.dark_noise_dn", root(variance), "DN", _R3)
    if gain is None:
        found.miss("emva.dark_noise_e", NEEDS_FLATS)
    else:
        electrons = tuple(max(v - _QUANTIZATION, 0.0) for v in variance)
        found.add(
            "emva.dark_noise_e",
            root((electrons[0], electrons[1], electrons[2]), 1 / gain, relative),
            "e-",
            _R3,
        )


def _dark_current(found: Findings, darks: list[GroupMoments], gain: float, relative: float) -> None:
    for name, of, power in (("mean", mean_points, 1), ("variance", variance_points, 2)):
        key = f"emva.dark_current_{name}_e_per_s"
        lines = slopes(of(darks))
        if not lines:
            found.miss(key, "dark frames at three or more exposures")
            continue
        line = lines[0]
        at = "" if line.temperature_c is None else f", at {line.temperature_c:g} degC"
        half = t_quantile(line.df) * line.error
        scale = gain**-power
        value, low, high = line.value * scale, (line.value - half) * scale, (line.value + half) * scale
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
    level = _stack(measured)
    if level is None:
        found.miss("emva.prnu_fraction", NEEDS_FLATS)
        return
    flat, dark = level.flat, level.dark
    dark_map = mean_map(measured.frames, dark.group.indices)
    dark_parts = parts(dark_map, [(1 / dark.n, dark)])
    r4_dark, r4_flat = release_4(dark), release_4(flat)
    value = math.sqrt(max(r4_dark["total"], 0.0))
    _, low, high = root(dark_parts.total)
    found.add("emva.dsnu_dn", (value, min(low, value), max(high, value)), "DN", _R3)
    scaled = (value / gain, min(low, value) / gain, max(high, value) / gain)
    found.add("emva.dsnu_e", widen(scaled, relative), "e-", _R3)
    flat_map = mean_map(measured.frames, flat.group.indices)
    flat_parts = parts(flat_map - dark_map, [(1 / flat.n, flat), (1 / dark.n, dark)])
    signal = level.signal
    value = math.sqrt(max(r4_flat["total"] - r4_dark["total"], 0.0)) / signal
    _, low, high = root(flat_parts.total, 1 / signal)
    found.add("emva.prnu_fraction", (value, min(low, value), max(high, value)), "fraction", _R3)
    for name in ("row", "column", "pixel"):
        value = math.sqrt(max(r4_dark[name], 0.0)) / gain
        _, low, high = root(getattr(dark_parts, name), 1 / gain, relative)
        found.add(f"emva4.dsnu_{name}_e", (value, min(low, value), max(high, value)), "e-", _R4)
        value = math.sqrt(max(r4_flat[name] - r4_dark[name], 0.0)) / signal
        _, low, high = root(getattr(flat_parts, name), 1 / signal)
        found.add(f"emva4.prnu_{name}", (value, min(low, value), max(high, value)), "fraction", _R4)
    emva4.corrected(found, level, dark_parts, flat_parts, gain, relative)
    emva4.prnu_high_pass(found, level, dark_map, flat_map)
    percent = 100 * (flat_map - dark_map) / signal
    noise = (flat.variance / flat.n + dark.variance / dark.n) * (100 / signal) ** 2
    for name, values, left in (
        ("dsnu", dark_map / gain, dark.variance / dark.n / gain**2),
        ("prnu", percent, noise),
    ):
        found.curves[f"emva4_{name}"] = emva4.pattern_curves(values, left)
    found.curves["emva4_defects_dsnu"] = emva4.defect_counts(dark_map / gain)
    if min(percent.shape) > 10:
        found.curves["emva4_defects_prnu"] = emva4.defect_counts(emva4.high_pass(percent))


def _stack(measured: Measured) -> FlatLevel | None:
    """The level for spatial figures: most frames; among equals nearest to half of saturation."""
    levels = [v for v in measured.levels if v.flat.n > 1 and v.dark.n > 1 and v.signal > 0]
    if not levels:
        return None
    saturation = saturated_level(levels)
    half = 0.5 * levels[-1 if saturation is None else saturation].signal
    most = max(v.flat.n for v in levels)
    return min((v for v in levels if v.flat.n == most), key=lambda v: abs(v.signal - half))
