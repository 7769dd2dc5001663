"""How many electrons an image value is, and which image value a DN; a camera that is noisier, or quieter, by one factor.

Functions take NumPy arrays or torch tensors, and gradients pass.

At strength s every exposure holds 1/s^2 of the electrons: the shot noise, still Poisson, is s times as large a share of
the brightness. Offsets and noise added in electrons are then divided by s and relative scatter is multiplied by s, so that
all of these are s times as large too. Quantisation is not: the converter keeps its bits.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from visaug.camera.camera import Camera
from visaug.camera.maps import effect_of
from visaug.camera.paths import place_of
from visaug.effects import Stage, catalogue

# relative scatter: of gains, dark currents, the light
RESPONSE = {
    "prnu": "", "dark_current_nonuniformity": "spread", "light_drift": "sigma", "tap_mismatch": "gain", "row_parity": "gain",
    "column_parity": "gain",
}  # fmt: skip
# of s, by the unit
POWERS = {"e-/DN": -2, "e-/s": -2, "e-/px": -2, "photons": -2, "1/(1000 e-)": 2}
# of measured maps that their unit alone does not tell: levels are charge, variances squares
MAP_POWERS = {"prnu": 1} | dict.fromkeys(
    (f"unexplained.{part}" for part in ("level_e", "row_power_e2", "column_power_e2", "variance_e2")), -2
)


class Scale(NamedTuple):
    """How image values become electrons, and DN image values: value = (DN - less_dn) per_dn, cut to [0, 1].

    One number an image, all of one kind: NumPy arrays (B,) or (1,), or tensors (B, 1, 1, 1).

    Attributes:
        electrons: mean photo-electrons of the image value 1.
        less_dn: the DN that becomes the value 0.
        per_dn: image value of one DN.
    """

    electrons: Any
    less_dn: Any
    per_dn: Any


def gain_of(camera: Camera, values: Mapping[str, Any]) -> Any:
    """Electrons per DN at the gain in dB in use: 20 dB more are a tenth of the electrons."""
    return values["gain_e_per_dn"] * 10 ** ((camera.spec.gain_db - values["gain_db"]) / 20)


def white_dn(camera: Camera, values: Mapping[str, Any]) -> Any:
    """DN above the black level at which an exposure saturates: where the converter ends, or the full well before it.

    In the paper's reading the whole range of the converter, as in its eq. 7, whatever black level and full well are.

    Args:
        camera: supplies bit depth, reading and the gain's reference.
        values: numbers of the camera by path: scalars, arrays or tensors.
    """
    max_dn = 2**camera.bit_depth - 1
    gain = gain_of(camera, values)
    if camera.spec.reading == "paper":
        return max_dn + 0 * gain
    converter = max_dn - values["black_level_dn"] + 0 * gain
    if isinstance(converter, Tensor):
        well_e = torch.as_tensor(values["full_well_e"], device=converter.device)
        is_known = well_e.isfinite()  # an infinite one has no derivative by the gain
        well = torch.where(is_known, well_e, 1.0) / gain
        return torch.where(is_known, torch.minimum(converter, well), converter).clamp_min(1)
    return np.maximum(np.minimum(converter, values["full_well_e"] / gain), 1)


def scale_of(
    camera: Camera,
    values: Mapping[str, Any],
    exposure: Any = 1.0,
    subtract_black_level: bool = True,
    full_scale_photons: float | None = None,
) -> Scale:
    """The scale of an exposure at these values of the camera.

    The image value 1 is the saturation of the exposure, min(full well, (max_dn - black level) G), whatever
    gain and quantum efficiency are, so that these change the noise and not the brightness.

    Args:
        camera, values: see `white_dn`.
        exposure: share of that light which reaches the sensor; the result is brightened by its inverse.
        subtract_black_level: True maps the black level to 0 and saturation to 1. False maps DN 0 to 0 and the
            converter's last DN to 1; then only the signal above the black level is brightened.
        full_scale_photons: mean photons per pixel at the image value 1, instead of saturation.
    """
    black, white = values["black_level_dn"], white_dn(camera, values)
    if full_scale_photons is None:
        electrons = white * gain_of(camera, values) * exposure
    else:
        electrons = full_scale_photons * exposure * values["quantum_efficiency"]
    if subtract_black_level:
        return Scale(electrons, black, 1 / (white * exposure))
    return Scale(electrons, black * (1 - exposure), 1 / ((2**camera.bit_depth - 1) * exposure))


@cache
def power_of(path: str) -> int:
    """The exponent n with which a parameter takes part: its value is multiplied by s^n.

    Charge before the readout (dark current, clock-induced charge, full well), and the seam of two gains, keep their share of the
    range, hence -2; offsets and noise in the readout, in electrons, -1; relative scatter of the response 1; noise in DN 1. All
    else is 0: blur, shares, densities, times and temperatures do not change.
    """
    if path == "read_noise.after_gain_dn":
        return 1
    if path == "dual_gain.seam_e":  # a level of the signal
        return -2
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
    if s == 1:
        return dict(values)
    return {path: value * s ** power_of(path) if power_of(path) else value for path, value in values.items()}


def with_maps_at_strength(camera: Camera, s: float) -> Camera:
    """The camera with its measured maps at strength s > 0, each by its unit as the values are; these stay."""
    maps = {}
    for key, pattern in camera.maps.items():
        kind = catalogue()[effect_of(key)]
        unit = kind.map_unit.partition(" ")[0]
        power = -1 if unit == "e-" and kind.stage == Stage.READOUT else POWERS.get(unit, 0)
        if unit == "factor":  # of mean 1, whose scatter is the noise
            maps[key] = 1 + s * (pattern - 1)
        else:
            maps[key] = pattern * s ** MAP_POWERS.get(key, power)
    return Camera(camera.spec, camera.folder, maps) if maps else camera
