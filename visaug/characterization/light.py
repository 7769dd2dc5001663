"""From flats: gain, quantum efficiency, full well, PRNU, and how the gain follows its setting in dB."""

import math

import numpy as np

from visaug.characterization import additivity, photon_transfer
from visaug.characterization.dark_current import weighted_line
from visaug.characterization.groups import Measured
from visaug.characterization.moments import GroupMoments, largest_place, mean_map
from visaug.characterization.mosaic import Mosaic
from visaug.characterization.nonuniformity import PARTS, Parts, check_structure, parts, surface, tile
from visaug.characterization.photon_transfer import PhotonTransferResult
from visaug.core.intervals import mean_error, root, symmetric, t_quantile
from visaug.statistics.findings import Findings, MeasuredGain

NEEDS_FLATS = "flats: two or more frames at each of several light levels, and dark frames beside them"
NEEDS_GAIN = "flats that tell the gain: clear of saturation, and bright enough that their noise exceeds that of the dark frames"
NEEDS_CLEAR_FLATS = (
    "a higher black level or more gain, or two or more levels of flats whose noise spreads over several DN, "
    "clear of 0 and of the converter's top"
)
NEEDS_PHOTONS = "flats with known photons per pixel"
_FROM_PHOTONS = ("quantum_efficiency", "emva.quantum_efficiency", "emva.saturation_photons",
                 "emva4.absolute_sensitivity_*photons", "emva4.responsivity_*")  # fmt: skip


def gain_and_efficiency(found: Findings, measured: Measured, dark_tells: bool) -> PhotonTransferResult | None:
    """Photon transfer at the base gain."""
    if (result := photon_transfer.transfer(measured.sweep, dark_tells)) is None:
        needs = NEEDS_GAIN if measured.sweep else NEEDS_FLATS
        found.miss("gain_e_per_dn", needs if dark_tells else NEEDS_CLEAR_FLATS)
        found.miss("quantum_efficiency", NEEDS_PHOTONS)
        return None
    gain, half = result.gain_dn_per_e, t_quantile(result.df) * result.gain_error
    source = f"photon transfer over {len(result.safe)} levels"
    if result.curvature_per_dn:
        source += ", slope at zero signal"
    if not dark_tells:
        source += ", without dark frames"
    low, high = 1 / (gain + half), 1 / (gain - half) if gain > half else math.inf
    found.add("gain_e_per_dn", (1 / gain, low, high), "e-/DN", source)
    found.gain = MeasuredGain(gain, result.gain_error / gain, measured=True)
    if result.scatter > 0.02:  # the gain of any level alone is as far off
        found.warn(
            f"photon_transfer_scattered: the variances of {len(result.safe)} levels deviate by {result.scatter:.1%} from every "
            "smooth course over the signal: the gain is not one (automatic or alternating gain, levels of several cameras), "
            "or single levels are disturbed",
            spoils=additivity.FROM_GAIN,
        )
    _curvature(found, result, additivity.course([result.levels[i] for i in result.safe]))
    _efficiency(found, result)
    _transfer_curves(found, result)
    return result


def _curvature(found: Findings, result: PhotonTransferResult, course: additivity.VarianceFits) -> None:
    if result.curvature_per_dn is None:
        if not result.flats_alone and course.deviates:
            found.warn(
                f"photon_transfer_bent: the variance of {len(result.safe)} levels is not proportional to their "
                "signal, and so few do "
                f"not tell why ({_causes(found, result, course)}): take four or more levels over a factor of three",
                spoils=additivity.FROM_GAIN,
            )
        return
    interval = symmetric(*result.curvature_per_dn, result.df)
    found.add("photon_transfer.curvature_per_dn", interval, "1/DN", "c of the variance K S (1 + c S)")
    if course.undecided and not result.flats_alone:
        found.warn(
            "photon_transfer_bent: the variance is not proportional to the signal, and the levels do not tell a bend from "
            f"another black level of the flats ({_causes(found, result, course)}); gain_e_per_dn is right for a bend alone",
            spoils=additivity.FROM_GAIN,
        )
    elif result.bent:
        top = result.levels[result.safe[-1]].signal
        found.warn(
            f"photon_transfer_bent: at {top:.4g} DN the variance deviates by {interval[0] * top:+.1%} from the straight "
            f"line ({_causes(found, result, course)}); gain_e_per_dn is the slope at zero signal, "
            "the emva gain that of the straight line required by the standard",
            spoils=("emva.system_gain_dn_per_e", "emva.quantum_efficiency", "emva.saturation_e",
                    "emva.dark_noise_e", "emva.dsnu_e", "emva4.*_e"),
        )  # fmt: skip


def _causes(found: Findings, result: PhotonTransferResult, course: additivity.VarianceFits) -> str:
    """What bends a photon transfer, by what the frames say of each cause."""
    shared = found.filtered or any(v.shared_variance for v in result.levels)
    line = result.response
    bends = "the signal bends too" if line and line.bent else "not seen in the signal against photons"
    causes = {
        "charge sharing": "neighbours correlate" if shared else "ruled out, neighbours do not correlate",
        "nonlinear response": bends if line else "photons are not known",
        "another black level than that of the dark frames":
            "possible" if course.undecided else "fits worse than a bend",
        "a lamp that changes": "taken out",
    }  # fmt: skip
    return "; ".join(f"{cause}: {verdict}" for cause, verdict in causes.items())


def _efficiency(found: Findings, result: PhotonTransferResult) -> None:
    if (line := result.response) is None:
        found.miss("quantum_efficiency", NEEDS_PHOTONS)
        return
    gain = result.gain_dn_per_e
    value = line.dn_per_photon / gain
    by_gain = (value * result.gain_error / gain) ** 2, result.df
    error, df = mean_error([by_gain, ((value * line.relative_error) ** 2, line.df)])
    _, low, high = symmetric(value, error, df)
    interval = value, max(low, 0.0), high
    found.add("quantum_efficiency", interval, "e-/photon", "responsivity over gain", 1.0)
    if value < 1e-3:  # below what silicon has anywhere between 300 and 1100 nm
        found.warn(
            f"photons_implausible: a quantum efficiency of {value:.2g} is that of no sensor; are the photons "
            "per pixel, not per cm2 or of the whole frame?",
            spoils=_FROM_PHOTONS,
        )
    if line.scatter > 0.05:  # that of a rough calibration of the light
        found.warn(
            f"photons_contradicted: the signals of the flats deviate by {line.scatter:.0%} from every straight or bent course "
            "over the stated photons; check the column `photons` (levels exchanged, one unit for another, an offset)",
            spoils=(*_FROM_PHOTONS, "emva.linearity_error_*"),
        )
    if value > 1:
        said = "quantum_efficiency_above_one: the stated photons are too few, or the light is not uniform"
        found.warn(said, spoils=("quantum_efficiency", "emva.quantum_efficiency"))
    if line.bent:
        top = max(float(result.levels[i].photons or 0.0) for i in result.safe)
        found.warn(
            f"nonlinear_response: at {top:.4g} photons the signal deviates by {line.curvature_per_photon * top:+.1%} from "
            "a straight line; quantum_efficiency is that at low light",
            spoils=("emva.quantum_efficiency",),
        )
        found.bend_per_e = line.curvature_per_photon / value
    if line.dark == "unknown":
        found.warn(
            "dark_exposure: flats were exposed longer than their dark frames and dark frames at two exposures "
            "are missing, so dark current is counted as light",
            spoils=("quantum_efficiency", "prnu.*", "emva.quantum_efficiency", "emva.prnu_fraction",
                    "emva4.prnu_*", "emva.linearity_error_*", "full_well_e", "emva.saturation_e"),
        )  # fmt: skip
    elif line.dark_share > max(0.003, 2 * line.relative_error):
        found.warn(
            "dark_exposure: flats were exposed longer than their dark frames; quantum_efficiency is corrected for "
            "the dark current, the emva figures do not",
            spoils=("emva.quantum_efficiency", "emva.prnu_fraction", "emva4.prnu_*", "emva.linearity_error_*",
                    "emva.saturation_e"),
        )  # fmt: skip


def _transfer_curves(found: Findings, result: PhotonTransferResult) -> None:
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
            "deviation": photon_transfer.relative_deviations(chosen, np.ones(chosen[0].flat.shape[0])),
        }


def response_pattern(
    found: Findings, measured: Measured, result: PhotonTransferResult, mosaic: Mosaic | None
) -> Parts | None:
    """PRNU by row, column and pixel from the slope of every pixel over the safe levels.
    On a mosaic each pixel is compared with those of its own colour.
    """
    place = largest_place(result.levels[i].flat for i in result.safe)
    levels = [v for i in result.safe if (v := result.levels[i]).flat.place == place]
    shape = levels[0].flat.shape
    line = result.response
    gap = np.array([v.exposure_gap_s for v in levels])
    rate, rate_error = line.dark_dn_per_s if line is not None else (0.0, 0.0)
    signals = np.array([v.light for v in levels]) - rate * gap
    weights = np.array([v.flat.n / max(v.flat.variance, 1e-9) for v in levels])
    free = result.flats_alone  # dark frames do not tell the pattern either: flats alone
    if free and len(levels) < 2:
        for name in PARTS:
            found.miss(f"prnu.{name}", NEEDS_CLEAR_FLATS)
        return None
    weights *= signals - (weights @ signals / weights.sum() if free else 0.0)
    weights /= (weights * signals).sum()
    uncertain = abs(float(weights @ gap)) * rate_error  # relative, of the light
    pattern = np.zeros(shape)
    for v, a in zip(levels, weights):
        pattern += a * mean_map(measured.frames, v.flat.group.indices)
    noise = [(float(a) ** 2 / v.flat.n, v.flat) for v, a in zip(levels, weights)]
    for dark in () if free else {id(v.dark): v.dark for v in levels}.values():
        share = float(sum(a for v, a in zip(levels, weights) if v.dark is dark))
        pattern -= share * mean_map(measured.frames, dark.group.indices)
        noise.append((share**2 / dark.n, dark))
    if mosaic is not None:
        colours = mosaic.map(shape)
        pattern /= colours
        noise = [(f * _noise_over(colours, m, result), m) for f, m in noise]
    if (places := tile(pattern)) is not None:
        pattern /= places
        noise = [(f * _noise_over(places, m, result), m) for f, m in noise]
        found.warn(
            f"periodic_response: pixels respond by {places.min():.3g} to {places.max():.3g} of their mean in a "
            "mosaic of more than 2 x 2 "
            "(quad Bayer, X-Trans); PRNU is that within a place of the mosaic, quantum_efficiency the mean over colours",
            spoils=("quantum_efficiency", "emva.prnu_fraction", "emva4.prnu_*", "emva4_corrected.prnu_*", "emva.quantum_efficiency",
                    "emva.saturation_*", "full_well_e", "emva.linearity_error_*"),
        )  # fmt: skip
    if not found.filtered:
        check_structure(pattern, found)
    split = parts(pattern, noise, detrend=True)
    source = f"analysis of variance of the pixels' slopes over {len(levels)} levels, smooth shading taken out"
    for name in PARTS:
        found.add(f"prnu.{name}", root(getattr(split, name), relative=uncertain), "fraction", source)
    if (shading := np.ptp(surface(pattern))) > 0.01:
        found.warn(f"shading: the light or the response varies smoothly by {shading:.1%} over the frame")
    if split.defects:
        found.warn(f"defects: {split.defects} pixels with an outlying response are excluded from PRNU")
    found.maps["response"], found.response_place = pattern.astype(np.float32), place
    return split


def _noise_over(colours: np.ndarray, moments: GroupMoments, result: PhotonTransferResult) -> float:
    """How much the temporal noise grows where every pixel is divided by its colour's response."""
    quiet = min(v.dark.variance for v in result.levels)
    shot = max(moments.variance - quiet, 0.0)
    return float(((shot * colours + quiet) / colours**2).mean() / max(shot + quiet, 1e-12))


def colour_efficiency(found: Findings, mosaic: Mosaic) -> None:
    """Quantum efficiency of green, whose share of a flat's mean signal is known."""
    if (mean := found.parameters.get("quantum_efficiency")) is None:
        return
    share = sum(mosaic.response[i] for i in mosaic.green) / 2
    interval = (mean.value * share, mean.low * share, mean.high * share)
    found.add("quantum_efficiency", interval, "e-/photon", mean.source + ", of green", 1.0)


def capacity(found: Findings, result: PhotonTransferResult, pattern: Parts | None) -> None:
    """Full well from levels that charge clips."""
    spread = math.sqrt(max(pattern.total[0], 0.0)) if pattern else 0.0
    if (well := photon_transfer.full_well(result, spread)) is None:
        lower_gain = "a lower gain: at this gain the converter clips before the full well"
        clips = photon_transfer.converter_clips(result.levels[-1])
        found.miss("full_well_e", lower_gain if clips else "calibrated flats beyond saturation")
        return
    source = "mean of the brightest flats against the light"
    found.add("full_well_e", symmetric(*well, result.df), "e-", source)


def gain_law(found: Findings, measured: Measured, result: PhotonTransferResult) -> None:
    """How the gain follows its setting: slope of measured over nominal decibels, 1 where it does exactly."""
    points = [(measured.gain_db, result.gain_dn_per_e, result.gain_error)]
    for gain_db, levels in measured.other_gains.items():
        other = photon_transfer.transfer([v for v in levels if v.flat.n > 1 and v.dark.n > 1])
        if other is not None:
            points.append((gain_db, other.gain_dn_per_e, other.gain_error))
    if len(points) < 2:
        found.miss("gain_law.slope", "flats at two or more gain settings")
        return
    db = np.array([p[0] for p in points])
    measured_db = 20 * np.log10([p[1] for p in points])
    errors = 20 / math.log(10) * np.array([p[2] / p[1] for p in points])
    weights = 1 / errors**2
    slope, _, lever, spread = weighted_line(db, measured_db, weights)
    residual = measured_db - (weights * measured_db).sum() / weights.sum() - slope * lever
    misfit = float((weights * residual**2).sum()) / max(len(db) - 2, 1)
    error = math.sqrt(max(misfit if len(db) > 2 else 0.0, 1.0) / spread)
    source = f"photon transfer at {len(db)} gain settings"
    found.add("gain_law.slope", symmetric(slope, error, result.df), "dB/dB", source)
    shown_db = measured_db - measured_db[0] + db[0]
    found.curves["gain_law"] = {"gain_db": db, "measured_db": shown_db, "error_db": errors}
    if abs(slope - 1) > 3 * error + 0.02:
        found.warn(f"gain_law: 1 dB of the setting is {slope:.3f} dB of gain, not 1")
