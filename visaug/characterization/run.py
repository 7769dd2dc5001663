"""The steps of a characterization, in the order in which each needs the ones before."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from visaug.camera import Camera
from visaug.characterization import (
    additivity,
    codes,
    dark,
    evenness,
    light,
    model_checks,
    paper,
    photon_transfer,
    still,
)
from visaug.characterization.clipped import clipped_frames
from visaug.characterization.conditions import prepared
from visaug.characterization.emva import emva
from visaug.characterization.facts import PLACES
from visaug.characterization.groups import Measured, measure_groups
from visaug.characterization.maps import add_maps, map_headers
from visaug.characterization.mosaic import PLAIN, Mosaic, find_mosaic
from visaug.characterization.nonuniformity import PARTS
from visaug.characterization.result import CAMERA_KEYS, Characterization, Warned, without_impossible
from visaug.characterization.views import colour_plane
from visaug.core.errors import InputError
from visaug.core.wording import first_of
from visaug.frames import FrameSet
from visaug.statistics.findings import Findings, MeasuredGain


def characterize(
    frames: FrameSet | str | Path,
    camera: Camera | str | Path | None = None,
    seed: int = 0,
    method: Literal["emva", "paper"] = "emva",
) -> Characterization:
    """Estimates camera parameters with 95 % confidence intervals from measured frames.

    Args:
        frames: bias, dark and flat frames in any combination, or images of scenes; or the path of a frame set.
        camera: supplies parameters that the frames do not determine (the quantum efficiency if the photons are not
            calibrated, the gain without flats).
        seed: of the bootstrap and of random subsamples.
        method: ``emva``, or ``paper`` for the paper's procedure, which uses bias and dark frames only: regression on means,
            standard deviation of residuals, histogram match of the shape.

    Returns:
        The estimates. Parameters that the frames do not determine are listed with the reason, and get no value.

    Raises:
        InputError: frames that cannot be read, or from which nothing can be measured.

    Examples:
        >>> import numpy as np, visaug
        >>> from visaug.frames import FrameRecord
        >>> camera = visaug.Camera.load({"resolution": [64, 64], "gain_e_per_dn": 0.5, "black_level_dn": 100})
        >>> records = [FrameRecord(sequence=k, file=f"{k}", kind="bias", exposure_s=0.0, temperature_c=20.0) for k in range(4)]
        >>> plan = visaug.FrameSet.from_arrays(records, np.zeros((4, 64, 64)))
        >>> result = visaug.characterize(visaug.simulate(camera, plan))
        >>> round(result["black_level_dn"].value)
        100
    """
    if method not in ("emva", "paper"):
        raise InputError(f"{method!r} is unknown", field="method", expected="emva or paper")
    camera = None if camera is None else Camera.load(camera)
    frames = FrameSet.of(frames, None if camera is None else camera.resolution)
    found = Findings()
    found.warn_of(frames.warnings)
    kinds = {r.kind for r in frames.records}
    if not kinds & {"bias", "dark", "flat"}:
        if "image" not in kinds:
            expected = "bias, dark, flat or image frames"
            raise InputError("nothing can be measured", field="kind", expected=expected)
        from visaug.pictures.camera import camera_of_pictures

        size = camera_of_pictures(found, frames, seed)
        result = _result(found, None, None, "pictures")
        return replace(result, assumed={"bit_depth": frames.bit_depth or 8}, resolution=size)
    found.warn_of(w for w in frames.check() if not w.startswith("few_frames"))  # of groups as measured: below
    told_bits = frames.told_bits or (camera.bit_depth if camera is not None else None)
    ready, mosaic, measured = _read(frames, found, told_bits)
    alone = sorted(measured.frames.records[m.group.indices[0]].sequence for m in measured.moments if m.n == 1)
    if alone:
        said = f"{first_of(alone, 8)} are single at their settings; temporal noise requires two or more"
        found.warn(f"few_frames: frames {said}")
    if method == "paper":
        paper.procedure(found, measured, camera)
        return _result(found, camera, measured, method)
    _measure(found, measured, camera, seed, mosaic)
    result = _result(found, camera, measured, method)
    if mosaic is None:
        return result
    places = zip(mosaic.names, PLACES)
    planes = {name: characterize(colour_plane(ready, *at), camera, seed) for name, at in places}
    return replace(result, planes=planes)


def _read(frames: FrameSet, found: Findings, bits: int | None) -> tuple[FrameSet, Mosaic | None, Measured]:
    """The frames that can be measured together, their mosaic, and their groups; `bits` of the converter as told."""
    ready, facts = prepared(frames, found, bits)
    ready, facts = model_checks.screened(ready, facts, found)
    return ready, find_mosaic(ready, facts), measure_groups(ready, facts, found.step_dn)


def checked(frames: FrameSet) -> Findings:
    """What the checks of the measurement model find, and the figures that `characterize` gives without a camera.

    Raises:
        InputError: frames that cannot be read.
    """
    found = Findings()
    ready, mosaic, measured = _read(frames, found, frames.told_bits)
    if mosaic is not None and np.ptp(mosaic.response) > PLAIN and any(r.bayer for r in frames.records):
        found.set_apart(
            (r.sequence for r in frames.records if r.kind in ("flat", "scene")),
            "mosaic: flats and scenes are left out, since the set states colour filters and a camera model has one quantum "
            "efficiency for all pixels; `visaug characterize` measures each colour (`planes`)",
        )
    flats = [(n, m.group.indices) for n, m in enumerate(measured.moments) if m.group.kind == "flat"]
    found.lights = {ready.records[i].sequence: n for n, indices in flats for i in indices}
    _without_unknown_light(found, measured)
    _measure(found, measured, None, 0, mosaic)
    return found


def _without_unknown_light(found: Findings, measured: Measured) -> None:
    """Flats at saturation whose photons are not known are not compared with a camera: their level does not tell these."""
    groups = [
        v.flat.group
        for levels in (measured.levels, *measured.other_gains.values())
        for v in photon_transfer.clipped_levels(levels)
        if v.photons is None
    ]
    if groups:
        sequences = sorted(measured.frames.records[i].sequence for group in groups for i in group.indices)
        found.set_apart(
            sequences,
            f"saturated_flats: flats {first_of(sequences, 8)} are saturated, and their photons are not known: they are left out of "
            "comparisons with a camera, since their level does not tell the light",
        )


def _measure(
    found: Findings, measured: Measured, camera: Camera | None, seed: int, mosaic: Mosaic | None
) -> None:
    if len({m.place for m in measured.moments if m.group.kind == "flat"}) > 1:
        found.warn(
            "flats_of_windows: flats show several windows of the sensor; gain, quantum efficiency, PRNU and full well are those of "
            "the window with the most levels"
        )
    measured = model_checks.tested(measured, found)
    flickers = still.flicker(measured)
    dark_tells = not flickers and all(still.tells(v.dark) for v in measured.sweep)
    dark_tells = dark_tells and not additivity.pedestal(measured, found)
    if flickers:
        found.warn(
            "dark_frames_noisier: dark frames have more noise than brighter flats (image lag, "
            "cosmic rays, unstable pixels); gain_e_per_dn and PRNU are estimated from flats only",
            spoils=("read_noise.*", "dsnu.*", "dark_current.*", "emva.*", "emva4.*"),
        )
    measured = measured.with_dark_signal() if dark_tells else measured
    transfer = light.gain_and_efficiency(found, measured, dark_tells)
    if transfer is not None and not found.filtered:
        evenness.check(measured, transfer, found)
    if transfer is None and camera is not None:
        given = camera.gain_at(measured.gain_db)
        found.gain = MeasuredGain(1 / given, 0.0, measured=False)
        used = f"{given:.4g} e-/DN of the camera is used"
        found.warn(f"gain_as_given: without flats the gain is not determined; {used}")
    _without_light(found, measured, seed)
    if transfer is None:
        for name in PARTS:
            found.miss(f"prnu.{name}", light.NEEDS_FLATS)
        found.miss("full_well_e", "calibrated flats beyond saturation")
    else:
        pattern = light.response_pattern(found, measured, transfer, mosaic)
        if mosaic is not None:
            if mosaic.contradicted is not None:
                found.warn(mosaic.contradicted)
            light.colour_efficiency(found, mosaic)
            found.warn(
                f"mosaic: neighbouring pixels respond by {', '.join(f'{r:.3g}' for r in mosaic.response)} of "
                f"their mean ({mosaic.pattern or 'a pattern that no header states'}); PRNU is that within a "
                "colour, quantum_efficiency that of green, and `planes` contains each colour separately"
                f"{'; red and blue are as the header names them, flats of unknown colour do not tell' if mosaic.pattern else ''}",
                spoils=("emva.prnu_fraction", "emva4.prnu_*", "emva.quantum_efficiency",
                        "emva.saturation_*", "full_well_e", "emva.linearity_error_*"),
            )  # fmt: skip
        light.capacity(found, transfer, pattern)
        light.gain_law(found, measured, transfer)
    emva(found, measured)
    if dark_tells:
        add_maps(found, measured)


def _without_light(found: Findings, measured: Measured, seed: int) -> None:
    if (frames := measured.still) is None:
        parts = [f"dsnu.{part}_e" for part in PARTS]
        for name in ("black_level_dn", "read_noise.sigma_e", "read_noise.shape", *parts):
            found.miss(name, still.NEEDS_STILL)
        dark.dark_law(found, measured)
        return
    coarse_steps = found.step_dn > 1 and not still.tells(frames)
    if coarse_steps:
        for name in ("read_noise.sigma_e", "read_noise.shape"):
            found.miss(name, codes.NEEDS_WHOLE_STEPS)
    elif not still.tells(frames):
        clipped_frames(found, measured, frames, seed)
        return
    signal = dark.dark_law(found, measured, frames)
    still.black_level(found, frames, still.dark_pattern(found, measured, frames), signal)
    if not coarse_steps:
        shot = 0.0 if found.gain is None else max(signal, 0.0) * found.gain.dn_per_e
        still.noise_of_reading(found, measured, frames, shot + (found.step_dn**2 - 1) / 12)
    still.temporal_parts(found, frames)


def _result(
    found: Findings, camera: Camera | None, measured: Measured | None, method: str
) -> Characterization:
    settings: dict[str, float] = {}
    resolution = None
    if measured is not None:
        windows = [m.group.window or (0, m.shape[0], 0, m.shape[1]) for m in measured.moments]
        resolution = max(w[1] for w in windows), max(w[3] for w in windows)
        settings["gain_db"] = measured.gain_db
        if found.bit_depth is not None:
            settings["bit_depth"] = found.bit_depth
        if flats := [v.flat.group.exposure_s for v in measured.levels]:
            settings["exposure_s"] = float(np.median(flats))
        if measured.temperature_c is not None:
            settings["temperature_c"] = measured.temperature_c
    _dark_rate(found, settings)
    _nonlinearity(found, settings)
    base = None
    if camera is not None:
        base, resolution = camera.to_dict(), camera.resolution
        values = camera.values()
        for key in CAMERA_KEYS:
            if key not in found.parameters and math.isfinite(values.get(key, math.inf)):
                settings.setdefault(key, values[key])
        if measured is not None and not measured.levels:
            settings["gain_e_per_dn"] = camera.gain_at(measured.gain_db)
        settings["bit_depth"] = camera.bit_depth
        for key in found.open.keys() & settings.keys():
            found.open[key] += "; taken from the camera given"
    place = {key: n for n, key in enumerate(CAMERA_KEYS)}
    names = sorted(found.parameters, key=lambda n: (n.startswith("emva"), place.get(n, len(place)), n))
    return without_impossible(Characterization(
        parameters={name: found.parameters[name] for name in names},
        not_determined=found.open,
        warning_details=tuple(Warned(t.split(":")[0], t, found.spoiled_by(t)) for t in found.warnings),
        curves=found.curves,
        maps=found.maps,
        dark_current_error=found.dark_current_error,
        map_headers=map_headers(found),
        assumed=settings,
        not_measured=tuple(found.assumed),
        effects=tuple(found.effects),
        base=base,
        resolution=resolution,
        method=method,
    ))  # fmt: skip


def _dark_rate(found: Findings, settings: dict[str, float]) -> None:
    """Dark current known at one temperature, with the doubling interval of the literature."""
    if found.dark_rate is None or "dark_current.a_e_per_s" in found.parameters:
        return
    rate, temperature_c = found.dark_rate
    at = 20.0 if temperature_c is None else temperature_c
    doubling_c = 8.0  # of silicon near room temperature: 0.64 eV (half the band gap, diffusion aside)
    b = math.log(2) / doubling_c
    settings["dark_current.a_e_per_s"], settings["dark_current.b_per_c"] = rate * math.exp(-b * at), b
    settings.setdefault("temperature_c", at)
    if temperature_c is None:
        found.assumed.append("temperature_c")


def _nonlinearity(found: Findings, settings: dict[str, float]) -> None:
    """A response that bends, as the effect has it: its departure at the converter's full scale."""
    black = found.parameters.get("black_level_dn")
    if found.bend_per_e is None or found.gain is None or "bit_depth" not in settings:
        return
    top_dn = 2 ** settings["bit_depth"] - 1 - (black.value if black else 0.0)
    quadratic = found.bend_per_e * top_dn / found.gain.dn_per_e
    if abs(quadratic) <= 0.15:  # the most that the effect `nonlinearity` takes
        found.effects.append({"name": "nonlinearity", "quadratic": quadratic, "full_scale": "converter"})
