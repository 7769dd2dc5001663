"""Conversion between image values and photons, and from DN back to image values.

Functions take NumPy arrays or torch tensors, and gradients pass.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

if TYPE_CHECKING:
    from visaug.camera.camera import Camera


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


def gain_of(camera: "Camera", values: Mapping[str, Any]) -> Any:
    """Electrons per DN at the gain in dB in use: 20 dB more are a tenth of the electrons."""
    return values["gain_e_per_dn"] * 10 ** ((camera.spec.gain_db - values["gain_db"]) / 20)


def white_dn(camera: "Camera", values: Mapping[str, Any]) -> Any:
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
        well = torch.as_tensor(values["full_well_e"], device=converter.device) / gain
        return torch.minimum(converter, well).clamp_min(1)
    return np.maximum(np.minimum(converter, values["full_well_e"] / gain), 1)


def saturation_e(camera: "Camera", values: Mapping[str, Any]) -> Any:
    """Electrons of the saturated exposure, min(full well, (max_dn - black level) G); see `white_dn`."""
    return white_dn(camera, values) * gain_of(camera, values)


def scale_of(
    camera: "Camera",
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
