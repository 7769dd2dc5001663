"""What a camera does to one picture: a crop with its noise, and the noise's standard deviation by level."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from visaug.augment.files import add_noise
from visaug.augment.image_io import Picture
from visaug.augment.light import linear_to_srgb

if TYPE_CHECKING:
    from visaug.augment.sensor_noise import SensorNoise

LEVELS = (13, 64, 128, 191, 242)  # of 255, in the picture's own encoding
FLATS, SIDE = 16, 96  # as many draws of the camera, each on SIDE x SIDE pixels


@dataclass(frozen=True)
class Sample:
    """A camera's noise on a picture.

    Attributes:
        name: the camera's.
        crop: (H, W, 3) uint8, to be shown pixel by pixel.
        sigma: standard deviation at each of `LEVELS`, in 8-bit levels (0 to 255).
    """

    name: str
    crop: np.ndarray
    sigma: tuple[float, ...]


def sample(
    picture: Picture, noise: "SensorNoise", seed: int, window: tuple[slice, slice], bits: int | None
) -> Sample:
    """The picture through a camera, and that camera's noise on even patches."""
    noisy = add_noise(picture, noise, seed, bits)
    name = " | ".join(camera.name for camera in noise.cameras)
    return Sample(name, shown(noisy, window, bits), noise_by_level(picture, noise, seed))


def noise_by_level(picture: Picture, noise: "SensorNoise", seed: int) -> tuple[float, ...]:
    """Standard deviation of all noise, fixed patterns included, at each of `LEVELS` in 8-bit levels (0 to 255).

    Root mean square over draws of the camera; near black and white a part of the noise is clipped.
    """
    sigma = []
    with torch.random.fork_rng(devices=[]), torch.no_grad():
        torch.manual_seed(seed)
        for level in LEVELS:
            flat = torch.full((FLATS, picture.colours, SIDE, SIDE), level / 255)
            noisy = noise.apply_draws(flat, noise.draw(FLATS), transfer=picture.transfer)
            sigma.append(255 * float(noisy.double().var(dim=(2, 3)).mean()) ** 0.5)
    return tuple(sigma)


def middle(picture: Picture, rows: int, columns: int) -> tuple[slice, slice]:
    """The window of this size, or as much of it as there is, around the centre."""
    height, width = picture.pixels.shape[:2]
    rows, columns = min(rows, height), min(columns, width)
    top, left = (height - rows) // 2, (width - columns) // 2
    return slice(top, top + rows), slice(left, left + columns)


def shown(picture: Picture, window: tuple[slice, slice], bits: int | None = None) -> np.ndarray:
    """A window of the picture as a screen shows it, (H, W, 3) uint8; floating-point light is encoded as sRGB."""
    pixels = picture.pixels[window][..., : picture.colours]
    if pixels.dtype.kind == "f":
        light = torch.from_numpy(np.ascontiguousarray(pixels, dtype=np.float32)).clamp(0, 1)
        values = linear_to_srgb(light).numpy() * 255
    else:
        depth = bits if bits is not None and pixels.dtype == np.uint16 else 8 * pixels.itemsize
        values = pixels.astype(float) * (255 / (2**depth - 1))
    return np.broadcast_to(values.round().astype(np.uint8), (*pixels.shape[:2], 3))
