"""Free parameters of a camera as coordinates that suit a fit.

Positive parameters are logarithmic. Parameters in electrons are coordinates in DN, as the frames show them: a step of the
system gain then changes shot noise alone and leaves levels, patterns and read noise in DN. The full well is the DN at which
it clips, so that the black level does not change it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.camera import Camera
from visaug.camera.paths import place_of
from visaug.core.sampling.tukey_lambda import GAUSSIAN_SHAPE
from visaug.effects import Parameter, catalogue
from visaug.frames import FrameSet

LINEAR = 0.5  # standard deviations of read noise over which shares of bits are linear in the black level
STOPPED = 1e-6  # steps of a coordinate; what rounding leaves is less
GAIN, BLACK, WELL = "gain_e_per_dn", "black_level_dn", "full_well_e"


@dataclass(frozen=True)
class Coordinate:
    """One free parameter.

    Args:
        path: as in camera.yaml.
        logarithmic: the coordinate is the parameter's logarithm.
        step: of finite differences, in the coordinate.
        prior: standard deviation about the camera file's value, in the coordinate: weak, for parameters that the frames do
            not determine.
        in_dn: the parameter is in electrons (or electrons per something), the coordinate in DN.
        linear: over which statistics are linear; finite differences are not larger.
    """

    path: str
    logarithmic: bool
    step: float
    prior: float
    in_dn: bool = False
    linear: float = math.inf

    def difference(self, width: float = 1.0) -> float:
        """A finite difference, a number of steps wide where statistics are linear over that."""
        return min(width * self.step, self.linear)

    def read(self, camera: Camera) -> float:
        values = camera.values()
        value = values[self.path] / (values[GAIN] if self.in_dn else 1.0)
        value += values[BLACK] if self.path == WELL else 0.0
        return math.log(value) if self.logarithmic else value

    def number(self, coordinate: float, gain_e_per_dn: float, black_level_dn: float) -> float:
        """The parameter value, within its bounds."""
        parameter = place_of(self.path).parameter
        value = math.exp(min(coordinate, 60.0)) if self.logarithmic else coordinate
        value -= black_level_dn if self.path == WELL else 0.0
        value *= gain_e_per_dn if self.in_dn else 1.0
        return min(max(value, parameter.low), parameter.high)


def moved(camera: Camera, coordinates: Sequence[Coordinate], at: Sequence[float]) -> Camera:
    """The camera with these coordinates."""
    values = camera.values()
    scale = {path: values[path] for path in (GAIN, BLACK)}
    pairs = list(zip(coordinates, at, strict=True))
    scale |= {c.path: c.number(x, 1.0, 0.0) for c, x in pairs if c.path in scale}
    return camera.replace({c.path: c.number(x, scale[GAIN], scale[BLACK]) for c, x in pairs})


def is_stopped(coordinate: Coordinate, camera: Camera, at: float) -> bool:
    """Whether a camera that was moved to a value of a coordinate stopped before it, at a bound of the parameter."""
    return abs(coordinate.read(camera) - at) > STOPPED * coordinate.step


def intervals(
    coordinates: Sequence[Coordinate],
    camera: Camera,
    steps: np.ndarray | None = None,
    undetermined: np.ndarray | None = None,
) -> dict[str, tuple[float, float | None, float | None]]:
    """Each parameter of a fitted camera by path, with its 95 % interval: value, low, high.

    Args:
        steps: (R, coordinates), changes by refits of simulated sets of the camera, NaN in sets that do not tell one; if omitted,
            no interval is known.
        undetermined: (coordinates,) prior standard deviation of what the frames do not determine; 0 if omitted.
    """
    values = camera.values()
    scale = (values[GAIN], values[BLACK])
    if steps is None:
        return {c.path: (c.number(c.read(camera), *scale), None, None) for c in coordinates}
    wavers = next(
        (steps[:, [k]] for k, c in enumerate(coordinates) if c.path == GAIN), np.zeros((len(steps), 1))
    )
    found: dict[str, tuple[float, float | None, float | None]] = {}
    for k, c in enumerate(coordinates):
        at = c.read(camera)
        own = steps[:, [k]] + (wavers * (1.0 if c.logarithmic else at) if c.in_dn else 0.0)
        reach = 1.96 * math.hypot(np.nanstd(own, ddof=1), 0.0 if undetermined is None else undetermined[k])
        found[c.path] = (c.number(at, *scale), c.number(at - reach, *scale), c.number(at + reach, *scale))
    return found


def base_coordinates(camera: Camera, frames: FrameSet, calibrated: bool) -> list[Coordinate]:
    """Nuisance parameters of a refit: base terms that are present, and the further effects that the file names.

    A term that the file leaves at zero stays there: if the frames show it, it is a missing effect. The same holds for the
    shape of Gaussian read noise.

    Args:
        calibrated: whether the photons of flats are known; without them quantum efficiency is not free.
    """
    kinds = {record.kind for record in frames.records}
    light = bool(kinds & {"flat", "scene"})
    exposed = {r.exposure_s for r in frames.records if r.kind in ("dark", "bias")}
    temperatures = {r.temperature_c for r in frames.records if r.kind == "dark"}
    values = camera.values()
    free: list[Coordinate] = [Coordinate(BLACK, False, 1.0, 30.0, linear=linear_dn(camera))]

    def scale(path: str, step: float = 0.04, prior: float = 0.5) -> None:
        if 0 < values[path] < math.inf and path.partition(".")[0] not in camera.maps:
            free.append(Coordinate(path, True, step, prior, in_dn=_is_in_electrons(path)))

    if light:
        scale(GAIN, 0.02, 0.3)
        if calibrated:
            scale("quantum_efficiency", 0.02, 0.3)
        scale(WELL, 0.01, 0.3)
        for part in ("column", "row", "pixel"):
            scale(f"prnu.{part}", 0.08, 1.0)
    for part in ("column_e", "row_e", "pixel_e"):
        scale(f"dsnu.{part}", 0.08, 1.0)
    scale("read_noise.sigma_e")
    if values["read_noise.sigma_e"] > 0 and abs(values["read_noise.shape"] - GAUSSIAN_SHAPE) > 1e-9:
        free.append(Coordinate("read_noise.shape", False, 0.03, 0.3))
    if len(exposed) > 1:
        scale("dark_current.a_e_per_s", 0.08, 1.0)
        if len(temperatures) > 1 and values["dark_current.a_e_per_s"] > 0:
            free.append(Coordinate("dark_current.b_per_c", False, 0.004, 0.05))
    for name in camera.effect_names:
        free += effect_coordinates(camera, name)
    return free


def linear_dn(camera: Camera) -> float:
    """DN of a dark level over which shares of bits are linear: a part of the read noise.

    Infinite where that is less than half a step of the codes in use. The level itself then rises in steps, and only differences
    over whole ones show its slope of 1.
    """
    values = camera.values()
    noise_dn = math.hypot(values["read_noise.sigma_e"] / values[GAIN], values["read_noise.after_gain_dn"])
    smallest_dn = 2 ** values.get("bit_truncation.bits", 0)
    return LINEAR * noise_dn if noise_dn > 0.5 * smallest_dn else math.inf


def effect_coordinates(camera: Camera, name: str) -> list[Coordinate]:
    """The free parameters of a further effect, given its options."""
    values = camera.values()
    words = {word for path, word in camera.choices().items() if path.startswith(f"{name}.")}
    free = []
    for key, parameter in catalogue()[name].parameters.items():
        path = f"{name}.{key}"
        if parameter.options or parameter.integer or place_is_held(parameter):
            continue
        if parameter.of and not words & set(parameter.of):
            continue
        value = values[path]
        in_dn = _is_in_electrons(path)
        if value > 0 and parameter.low >= 0:
            free.append(Coordinate(path, True, 0.1 if parameter.strength else 0.06, 1.5, in_dn))
        else:
            reach = max(abs(v) for v in (value, parameter.default, *parameter.trials)) or 1.0
            reach /= values[GAIN] if in_dn else 1.0
            free.append(Coordinate(path, False, 0.06 * reach, 5 * reach, in_dn))
    return free


def strengths_of(name: str, coordinates: Sequence[Coordinate]) -> tuple[Coordinate, ...]:
    """The coordinates that are the logarithm of one of an effect's strengths."""
    strengths = {f"{name}.{key}" for key in catalogue()[name].strengths()}
    return tuple(c for c in coordinates if c.path in strengths and c.logarithmic)


def _is_in_electrons(path: str) -> bool:
    """Whether a parameter is in electrons; quantum efficiency is too (electrons per photon, measured as DN per photon)."""
    return path == "quantum_efficiency" or place_of(path).parameter.unit in ("e-", "e-/s", "e-/px/s")


def is_of(path: str, effect: str) -> bool:
    """Whether a parameter is one of an effect's."""
    return path == WELL if effect == "saturation" else path.startswith(f"{effect}.")


def place_is_held(parameter: Parameter) -> bool:
    """Whether a parameter is set by the user and not fitted: no strength, and without trial values, or one that is considered."""
    return parameter.unknown > 0 or not (parameter.strength or parameter.trials)
