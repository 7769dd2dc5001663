"""A camera that is noisier, or quieter, by one factor: the same law at another number of electrons.

At strength s every exposure holds 1/s^2 of the electrons: the shot noise, still Poisson, is s times as large a share of
the brightness. Offsets and noise added in electrons are then divided by s and relative scatter is multiplied by s, so that
all of these are s times as large too. Quantisation is not: the converter keeps its bits.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any

from visaug.camera.camera import Camera
from visaug.camera.paths import place_of
from visaug.effects import Stage, catalogue

RESPONSE = {"prnu": "", "dark_current_nonuniformity": "spread", "light_drift": "sigma"}
RESPONSE |= {
    "tap_mismatch": "gain",
    "row_parity": "gain",
}  # relative scatter: of gains, dark currents, the light
POWERS = {  # of s, by the unit
    "e-/DN": -2,
    "e-/s": -2,
    "e-/px": -2,
    "photons": -2,
    "1/(1000 e-)": 2,
}


@cache
def power_of(path: str) -> int:
    """The exponent n with which a parameter takes part: its value is multiplied by s^n.

    Charge before the readout (dark current, clock-induced charge, full well) keeps its share of the range, hence -2; offsets
    and noise in the readout, in electrons, -1; relative scatter of the response 1; noise in DN 1. All else is 0: blur, shares,
    densities, times and temperatures do not change.
    """
    if path == "read_noise.after_gain_dn":
        return 1
    place = place_of(path)
    if place.effect is None:
        return 0
    effect, parameter = place.effect, place.parameter
    if RESPONSE.get(effect.name) in ("", parameter.name):
        return 1
    if parameter.unit == "e-":
        return -1 if effect.stage == Stage.READOUT else -2
    return POWERS.get(parameter.unit, 0)


def at_strength(values: Mapping[str, Any], s: float) -> dict[str, Any]:
    """The values of a camera, by path, at strength s > 0."""
    return {path: value * s ** power_of(path) if power_of(path) else value for path, value in values.items()}


def with_maps_at_strength(camera: Camera, s: float) -> Camera:
    """The camera with its measured maps at strength s > 0, each by its unit as the values are; these stay."""
    maps = {}
    for effect, pattern in camera.maps.items():
        kind = catalogue()[effect]
        unit = kind.map_unit.partition(" ")[0]
        power = -1 if unit == "e-" and kind.stage == Stage.READOUT else POWERS.get(unit, 0)
        maps[effect] = pattern * s ** (1 if effect == "prnu" else power)
    return Camera(camera.spec, camera.folder, maps) if maps else camera
