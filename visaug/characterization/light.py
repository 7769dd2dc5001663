"""From flats: gain, quantum efficiency, full well, PRNU, and how the gain follows its setting in dB."""

from __future__ import annotations

import math

import numpy as np

from visaug.characterization.findings import Findings, Gain
from visaug.characterization.groups import Level, Measured
from visaug.characterization.intervals import root, symmetric, t_quantile
from visaug.characterization.moments import GroupMoments, mean_map
from visaug.characterization.nonuniformity import Parts, parts, surface
from visaug.characterization.photon_transfer import (
    PhotonTransfer,
    converter_clips,
    full_well,
    relative_deviations,
    transfer,
)

NEEDS_FLATS = "flats: two or more frames at each of several light levels, and dark frames beside them"
NEEDS_PHOTONS = "flats with known photons per pixel"


def gain_and_efficiency(found: Findings, measured: Measured) -> PhotonTransfer | None:
    """Photon transfer at the base gain."""
    result = transfer(measured.sweep)
    if result is None:
        found.miss("gain_e_per_dn", NEEDS_FLATS)
        found.miss("quantum_efficiency", NEEDS_PHOTONS)
        return None
    gain, half = result.gain_dn_per_e, t_quantile(result.df) * result.gain_error
    source = f"photon transfer over {len(result.safe)} levels"
    low, high = 1 / (gain + half), 1 / (gain - half) if gain > half else math.inf
    found.add("gain_e_per_dn", (1 / gain, low, high), "e-/DN", source)
    found.gain = Gain(gain, result.gain_error / gain, measured=True)
    if result.response_dn_per_photon is None:
        found.miss("quantum_efficiency", NEEDS_PHOTONS)
    else:
        value = result.response_dn_per_photon / gain
        error = value * math.hypot(result.gain_error / gain, result.response_relative_error)
        found.add(
            "quantum_efficiency",
            symmetric(value, error, result.df),
            "e-/photon",
            "responsivity over gain",
            1.0,
        )
        if value > 1:
            found.warn(
                "quantum_efficiency_above_one: the photons given are too few, or the light is not even"
            )
    _transfer_curves(found, result)
    return result


def _transfer_curves(found: Findings, result: PhotonTransfer) -> None:
    levels = result.levels
    found.curves["photon_transfer"] = {
        "signal_dn": np.array([v.signal for v in levels]),
        "variance_dn2": np.array([v.variance_of_all for v in levels]),
        "used": np.isin(np.arange(len(levels)), result.safe),
        "gain_dn_per_e": np.array([result.gain_dn_per_e]),
    }
    if all(v.photons for v in levels) and len(result.safe) > 2:
        chosen = [levels[i] for i in result.safe]
        found.curves["linearity"] = {
            "photons": np.array([v.photons for v in chosen], float),
            "signal_dn": np.array([v.signal for v in chosen]),
            "deviation": relative_deviations(chosen, np.ones(chosen[0].flat.shape[0])),
        }


def response_pattern(found: Findings, measured: Measured, result: PhotonTransfer) -> Parts | None:
    """PRNU by row, column and pixel from the slope of every pixel over the safe levels."""
    shape = max((result.levels[i].flat.shape for i in result.safe), key=lambda s: s[0] * s[1])
    levels = [v for i in result.safe if (v := result.levels[i]).flat.shape == shape]
    darks: dict[int, tuple[GroupMoments, np.ndarray]] = {}
    weights = np.array([v.signal * v.flat.n / max(v.flat.variance, 1e-9) for v in levels])
    weights /= (weights * np.array([v.signal for v in levels])).sum()
    pattern = np.zeros(shape)
    for v, a in zip(levels, weights):
        pattern += a * mean_map(measured.frames, v.flat.group.indices)
    noise = [(float(a) ** 2 / v.flat.n, v.flat) for v, a in zip(levels, weights)]
    for v in levels:
        if id(v.dark) not in darks:
            darks[id(v.dark)] = (v.dark, mean_map(measured.frames, v.dark.group.indices))
    for key, (dark, master) in darks.items():
        share = float(sum(a for v, a in zip(levels, weights) if id(v.dark) == key))
        pattern -= share * master
        noise.append((share**2 / dark.n, dark))
    split = parts(pattern, noise, detrend=True)
    source = f"analysis of variance of the pixels' slopes over {len(levels)} levels, smooth shading taken out"
    for name in ("row", "column", "pixel"):
        found.add(f"prnu.{name}", root(getattr(split, name)), "fraction", source)
    shading = np.ptp(surface(pattern))
    if shading > 0.01:
        found.warn(f"shading: the light or the response falls off smoothly by {shading:.1%} over the frame")
    if split.defects:
        found.warn(f"defects: {split.defects} pixels respond unlike the others and are left out of PRNU")
    found.maps["response"] = pattern.astype(np.float32)
    return split


def capacity(found: Findings, result: PhotonTransfer, pattern: Parts | None) -> None:
    """Full well from levels that charge clips."""
    spread = math.sqrt(max(pattern.total[0], 0.0)) if pattern else 0.0
    well = full_well(result, spread)
    if well is None:
        if converter_clips(result.levels[-1]):
            found.miss("full_well_e", "a lower gain: here the converter clips before the pixel is full")
        else:
            found.miss("full_well_e", "calibrated flats beyond saturation")
        return
    found.add(
        "full_well_e", symmetric(*well, result.df), "e-", "mean of the brightest flats against the light"
    )


def gain_law(found: Findings, measured: Measured, result: PhotonTransfer) -> None:
    """How the gain follows its setting: slope of measured over nominal decibels, 1 where it does exactly."""
    points = [(measured.gain_db, result.gain_dn_per_e, result.gain_error)]
    for gain_db, levels in measured.other_gains.items():
        other = transfer(_with_noise(levels))
        if other is not None:
            points.append((gain_db, other.gain_dn_per_e, other.gain_error))
    if len(points) < 2:
        found.miss("gain_law.slope", "flats at two or more gain settings")
        return
    db = np.array([p[0] for p in points])
    measured_db = 20 * np.log10([p[1] for p in points])
    errors = 20 / math.log(10) * np.array([p[2] / p[1] for p in points])
    weights = 1 / errors**2
    centre = (weights * db).sum() / weights.sum()
    spread = (weights * (db - centre) ** 2).sum()
    slope = float((weights * (db - centre) * measured_db).sum() / spread)
    residual = measured_db - (weights * measured_db).sum() / weights.sum() - slope * (db - centre)
    misfit = float((weights * residual**2).sum()) / max(len(db) - 2, 1)
    error = math.sqrt(max(misfit if len(db) > 2 else 0.0, 1.0) / spread)
    source = f"photon transfer at {len(db)} gain settings"
    found.add("gain_law.slope", symmetric(slope, error, result.df), "dB/dB", source)
    found.curves["gain_law"] = {
        "gain_db": db,
        "measured_db": measured_db - measured_db[0] + db[0],
        "error_db": errors,
    }
    if abs(slope - 1) > 3 * error + 0.02:
        found.warn(f"gain_law: 1 dB of the setting is {slope:.3f} dB of gain, not 1")


def _with_noise(levels: tuple[Level, ...]) -> list[Level]:
    return [v for v in levels if v.flat.n > 1 and v.dark.n > 1]
