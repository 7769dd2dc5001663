"""Mistakes in a camera file: a figure in the wrong unit, inverted, squared, or left out, named as what it is and corrected.

Each figure of the file is compared with the same figure as `visaug.characterization` measures it. Where both differ by far, and
the figure as one of the usual mistakes would have changed it agrees with the measured one, the mistake is a candidate. The
candidates are accepted together if simulated frames of the corrected camera are nearer to the measured ones, each of them in turn.

Photons of flats with which the quantum efficiency would be above 1 are a mistake of the list of frames: no camera explains them.
They are multiplied so that the efficiency of the file holds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from visaug.camera import Camera
from visaug.characterization.alarms import found_by_checks
from visaug.core.constants import ZERO_C_K
from visaug.core.errors import InputError
from visaug.diagnosis.fitting.parameters import BLACK, GAIN
from visaug.diagnosis.fitting.robust import misfit
from visaug.diagnosis.laboratory import Laboratory
from visaug.frames import FrameSet

FAR = math.log(1.3)  # logarithm of the ratio of file and measurement below which no mistake is sought
NEAR = math.log(
    1.15
)  # and of the corrected figure and the measurement up to which they agree: intervals leave out the effects
DOUBLED = 2.0  # ratio of dark currents below which hot pixels or a few degrees explain it as well
CERTAIN = 4.0  # half widths of the measurement's 95 % interval by which a wrong figure must differ
BETTER = 10.0  # decrease of the robust misfit (a log likelihood) by a correction
SETS = 4  # simulated sets for the mean of a camera
BLACK_DN = 5.0  # DN of a black level that is left out or subtracted already
LIT = ("flat", "scene")
EFFICIENCY = "quantum_efficiency"
PHOTONS = 3.0  # ratio of efficiencies from which the photons are not those on a pixel
DARK, DARK_RATE = "dark_current.a_e_per_s", "dark_current.rate_e_per_s"


@dataclass(frozen=True)
class Mistake:
    """A figure of the camera file that is mistaken.

    Attributes:
        key: path in the camera file.
        mistake: unit, inverse, variance, per_frame, time_unit, kelvin, per_cent, bit_depth, black_level or photons.
        text: a sentence.
        value: the corrected figure; of photons that no efficiency explains, the efficiency that is kept.
        also: further figures that the correction changes.
    """

    key: str
    mistake: str
    text: str
    value: float
    also: tuple[tuple[str, float], ...] = ()

    def to_json(self) -> dict[str, Any]:
        return {"key": self.key, "mistake": self.mistake, "text": self.text, "value": self.value}


def corrected(camera: Camera, frames: FrameSet, lab: Laboratory) -> tuple[Camera, tuple[Mistake, ...]]:
    """The camera without the mistakes of its file, and these; the camera itself where none is found."""
    if frames.is_pictures:
        return camera, ()
    seen = tuple(_exposure(camera, frames))  # which no statistic of the frames depends on
    camera = (_fixed(camera, seen) if seen else None) or camera
    found = suspects(camera, frames)
    if not found or not (better := _fixed(camera, found)):
        return camera, seen
    statistics = lab.measured[0]
    scale = np.array([s.least_spread for s in statistics.statistics])
    sets = [lab.finding([(one, k) for k in range(SETS)]) for one in (camera, better)]
    scale = np.maximum(np.sqrt(np.minimum(*(of.var(0, ddof=1) for of in sets))), scale)

    def distance(of: np.ndarray) -> float:
        return misfit(np.nan_to_num(statistics.values - of.mean(0)), scale)

    best = distance(sets[1])
    if distance(sets[0]) - best < BETTER:
        return camera, seen
    kept = []
    for one in found:
        others = _fixed(camera, [other for other in found if other is not one])
        without = sets[0] if len(found) == 1 else lab.finding([(others or camera, k) for k in range(SETS)])
        if distance(without) - best > BETTER:
            kept.append(one)
    return (_fixed(camera, kept) if kept else None) or camera, (*seen, *kept)


def _fixed(camera: Camera, mistakes: Sequence[Mistake]) -> Camera | None:
    """The camera with the corrected figures; None where it cannot have them."""
    content = camera.to_dict()
    for path, value in [pair for m in mistakes for pair in ((m.key, m.value), *m.also)]:
        *parts, last = path.split(".")
        part = content
        for name in parts:
            part = part.setdefault(name, {})
        part[last] = int(value) if last == "bit_depth" else value
    try:
        return camera.with_content(content)
    except InputError:
        return None


def suspects(camera: Camera, frames: FrameSet) -> list[Mistake]:
    """Figures that differ from the measurement as a mistake would make them differ, the nearest mistake of each."""
    checks = found_by_checks(frames)
    if checks is None:
        return []
    measured = _with_dark_current(checks.parameters, camera, frames)
    exposures = {r.exposure_s for r in frames.records if r.exposure_s}
    found = list(_bit_depth(camera, measured))
    shifted = {key for m in found for key in (m.key, *(path for path, _ in m.also))}
    found += [m for m in _black_level(camera, measured) if m.key not in shifted]
    file = camera.values()
    g = measured[GAIN].value if GAIN in measured else file[GAIN]
    for key, estimate in measured.items():
        value = file.get(key, 0.0)
        if key in shifted or key == BLACK or not (value > 0 and estimate.value > 0) or math.isinf(value):
            continue
        width = (
            max(math.log(estimate.high / max(estimate.low, 1e-12)) / 2, 1e-6)
            if estimate.low > 0
            else math.inf
        )
        apart = abs(math.log(estimate.value / value))
        if apart < max(FAR, CERTAIN * width):
            continue
        least = math.log(DOUBLED) if key == DARK else 0.0
        tried = sorted(
            (abs(math.log(right / estimate.value)), word, right, text)
            for word, right, text in _hypotheses(key, value, g, file, exposures)
            if right > 0 and abs(math.log(right / value)) >= least
        )
        if tried and tried[0][0] < min(max(NEAR, 2 * width), 0.5 * apart):
            _, word, right, text = tried[0]
            sentence = (
                f"{key} is {text}: {value:g} in the file, {estimate.value:.4g} {estimate.unit} measured; "
                f"corrected to {right:.4g}."
            )
            found.append(Mistake(key, word, sentence, right))
    found += _photons(file, measured, {m.key for m in found})
    return found


def _with_dark_current(measured: Mapping[str, Any], camera: Camera, frames: FrameSet) -> Mapping[str, Any]:
    """With the dark current at 0 C that the rate at one temperature gives by the file's own coefficient."""
    rate, temperatures = (
        measured.get(DARK_RATE),
        {r.temperature_c for r in frames.records if r.kind == "dark"},
    )
    if rate is None or DARK in measured or len(temperatures) != 1 or None in temperatures:
        return measured
    cold = math.exp(-camera.values()["dark_current.b_per_c"] * float(temperatures.pop() or 0.0))
    at_0 = replace(rate, value=cold * rate.value, low=cold * rate.low, high=cold * rate.high)
    return {**measured, DARK: at_0}


def _hypotheses(
    key: str, value: float, gain: float, file: Mapping[str, float], exposures: set[float]
) -> Iterator[tuple[str, float, str]]:
    """Mistakes that a figure may contain: the word, the figure that was meant, and what the file has."""
    unit = key.rsplit("_", 1)[-1]
    if key == GAIN:
        yield "inverse", 1 / value, "in DN/e- and not in e-/DN"
    if key.endswith("_e") or key == DARK:
        yield "unit", value * gain, "in DN and not in electrons"
        yield "unit", value / gain, "in electrons of another gain, or multiplied by the gain"
    if key.startswith(("read_noise.sigma", "dsnu.")) and unit == "e":
        yield "variance", math.sqrt(value), "a variance and not a standard deviation"
        yield "variance", value**2, "the square root of a standard deviation"
        yield (
            "variance",
            math.sqrt(value) * gain,
            "a variance in DN^2 and not a standard deviation in electrons",
        )
    if key.startswith("prnu."):
        yield "per_cent", value / 100, "in per cent and not a fraction"
        yield "variance", math.sqrt(value), "a variance and not a standard deviation"
    if key == "quantum_efficiency":
        yield "per_cent", value * 100, "a hundredth of the fraction"
    if key == DARK:
        for exposure in sorted(exposures | {file["exposure_s"]} if "exposure_s" in file else exposures):
            yield "per_frame", value / exposure, f"per frame of {exposure:g} s and not per second"
        for factor, name in ((1e3, "millisecond"), (1e6, "microsecond")):
            yield "time_unit", value * factor, f"per {name} and not per second"
            yield "time_unit", value / factor, f"per second, while the exposures of the frames are in {name}s"
        shift = math.exp(min(file["dark_current.b_per_c"] * ZERO_C_K, 300.0))
        yield "kelvin", value * shift, "for temperatures in Kelvin and not in degrees Celsius"
        yield (
            "kelvin",
            value / shift,
            "for degrees Celsius, while the temperatures of the frames are in Kelvin",
        )


def _bit_depth(camera: Camera, measured: Mapping[str, Any]) -> Iterator[Mistake]:
    """Frames whose DN are those of another bit depth: gain, and black level, differ by the same power of two."""
    if GAIN not in measured:
        return
    file, gain = camera.values(), measured[GAIN].value
    bits = round(math.log2(file[GAIN] / gain))
    black = measured[BLACK].value if BLACK in measured else 0.0
    fits_black = file[BLACK] > 0 and abs(math.log(max(black, 1e-9) / (file[BLACK] * 2.0**bits))) < NEAR
    near = abs(math.log(file[GAIN] / 2.0**bits / gain)) < NEAR
    depth = camera.bit_depth + bits
    if bits and near and fits_black and 1 <= depth <= 16:
        also = ((GAIN, file[GAIN] / 2.0**bits), (BLACK, file[BLACK] * 2.0**bits))
        sentence = (
            f"bit_depth is {camera.bit_depth} in the file, while the frames have the DN of {depth} bits: gain and black level "
            f"differ by a factor of {2.0**bits:g}; all three are corrected."
        )
        yield Mistake("bit_depth", "bit_depth", sentence, float(depth), also)


def _black_level(camera: Camera, measured: Mapping[str, Any]) -> Iterator[Mistake]:
    if BLACK not in measured:
        return
    stated, found = camera.values()[BLACK], measured[BLACK].value
    if stated == 0 and found > BLACK_DN:
        text = f"{BLACK} is 0 in the file, or left out, and the frames have {found:.4g} DN."
    elif stated > BLACK_DN and found < 0.1 * stated:
        text = f"{BLACK} is {stated:g} in the file, and is subtracted from the frames already, which have {found:.4g} DN."
    else:
        return
    yield Mistake(BLACK, "black_level", text, max(found, 0.0))


def _photons(file: Mapping[str, float], measured: Mapping[str, Any], known: set[str]) -> Iterator[Mistake]:
    """Photons of the flats that are not those of one pixel: the efficiency is off by far."""
    if EFFICIENCY not in measured or known & {EFFICIENCY, GAIN}:
        return
    found, stated = measured[EFFICIENCY].value, file[EFFICIENCY]
    if found <= 1 and abs(math.log(found / stated)) > math.log(PHOTONS):
        yield Mistake(EFFICIENCY, "photons", _not_on_a_pixel(found, stated), found)


def with_enough_photons(camera: Camera, frames: FrameSet) -> tuple[FrameSet, tuple[Mistake, ...]]:
    """The frames, and a mistake where their flats have photons with which the efficiency is above 1: with more photons then."""
    checks = None if frames.is_pictures else found_by_checks(frames)
    if checks is None or EFFICIENCY not in checks.parameters:
        return frames, ()
    found, stated = checks.parameters[EFFICIENCY].value, camera.values()[EFFICIENCY]
    if found <= max(1.0, PHOTONS * stated):
        return frames, ()
    more = found / stated
    text = (
        f"{_not_on_a_pixel(found, stated)} None is above 1: the photons of frames.csv are too low. Correct them there; here they "
        f"are multiplied by {more:.3g}, with which the efficiency of the file holds."
    )
    records = [
        replace(r, photons=more * r.photons) if r.kind == "flat" and r.photons else r for r in frames.records
    ]
    return frames.with_records(records), (Mistake(EFFICIENCY, "photons", text, stated),)


def _not_on_a_pixel(found: float, stated: float) -> str:
    return (
        f"The photons of the flats are not those on a pixel: with them the quantum efficiency is {found:.3g}, and {stated:g} in "
        "the file."
    )


def _exposure(camera: Camera, frames: FrameSet) -> Iterator[Mistake]:
    """The exposure of the file in ms or us, where that of the lit frames is in seconds."""
    lit = {r.exposure_s for r in frames.records if r.kind in LIT and r.exposure_s}
    stated = camera.spec.exposure_s
    for factor, unit in ((1e3, "ms"), (1e6, "us")):
        if stated > 10 * max(lit, default=math.inf) and any(abs(stated / factor / t - 1) < 0.01 for t in lit):
            text = f"exposure_s is {stated:g} in the file and {stated / factor:g} s in the frames: it is in {unit}."
            yield Mistake("exposure_s", "time_unit", text, stated / factor)
