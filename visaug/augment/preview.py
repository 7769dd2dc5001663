"""What a camera does to one picture: a crop with its noise, and the noise's standard deviation by level."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from visaug.augment.exposure import linear_to_srgb
from visaug.augment.files import add_noise
from visaug.augment.image_io import Picture
from visaug.augment.options import Range
from visaug.augment.sensor_noise import SensorNoise

if TYPE_CHECKING:
    from visaug.camera import Camera

LEVELS = (13, 64, 128, 191, 242)  # of 255, in the picture's own encoding
MIDDLE = LEVELS[2]
# 8-bit levels at MIDDLE: a contrast of 5 %, several times what the eye resolves in pixels at 4x
VISIBLE = 6.0
# Tried in this order until the noise is visible: dB above the camera's own gain, and share of the saturation exposure.
CONDITIONS = ((0, 1.0), (12, 1.0), *((24, share) for share in (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)))


@dataclass(frozen=True)
class NoiseSample:
    """A camera's noise on a picture."""

    name: str  # the camera's
    crop: np.ndarray  # (H, W, 3) uint8, to be shown pixel by pixel
    sigma: tuple[float, ...]  # standard deviation at each of `LEVELS`, in 8-bit levels (0 to 255)
    conditions: str = ""  # gain and exposure, in words


def sample(
    picture: Picture,
    noise: SensorNoise,
    seed: int,
    window: tuple[slice, slice],
    bits: int | None,
    conditions: str = "",
) -> NoiseSample:
    """The picture through a camera, and that camera's noise on even patches."""
    noisy = add_noise(picture, noise, seed, bits)
    name = " | ".join(camera.name for camera in noise.cameras)
    return NoiseSample(name, shown(noisy, window, bits), noise_by_level(picture, noise, seed), conditions)


def visible(
    picture: Picture,
    camera: "Camera",
    seed: int,
    gain_db: Range = None,
    exposure: Range = None,
    **options: Any,
) -> tuple[SensorNoise, str]:
    """The camera's noise under conditions in which it can be seen, and these in words.

    The first of `CONDITIONS` at which the noise at a middle level is at least `VISIBLE`; the last one if there is none. What
    is given of gain and exposure stays as it is; with `strength` below 1 the noise may stay invisible.
    """
    noise, tried = None, None
    for more_db, share in CONDITIONS:
        gain = camera.spec.gain_db + more_db if gain_db is None else gain_db
        light = share if exposure is None else exposure
        if (gain, light) == tried:
            continue
        tried = gain, light
        noise = SensorNoise(camera, gain_db=gain, exposure=light, **options)
        if noise_by_level(picture, noise, seed, (MIDDLE,))[0] >= VISIBLE:
            break
    assert noise is not None and tried is not None  # noqa: PT018 - there is a condition
    of_gain, of_light = (" (chosen)" if given is None else "" for given in (gain_db, exposure))
    mono = ", monochrome" if picture.colours == 3 and not camera.spec.colour else ""
    return noise, f"gain {_words(tried[0])} dB{of_gain}, exposure {_words(tried[1])}{of_light}{mono}"


def _words(given: Any) -> str:
    return " to ".join(f"{end:g}" for end in given) if isinstance(given, tuple) else f"{given:g}"


def noise_by_level(
    picture: Picture, noise: SensorNoise, seed: int, levels: Sequence[int] = LEVELS
) -> tuple[float, ...]:
    """Standard deviation of all noise, fixed patterns included, at each of `levels`, in 8-bit levels (0 to 255).

    Root mean square over draws of the camera; near black and white a part of the noise is clipped.
    """
    sigma = []
    flats, side = 16, 96  # draws of the camera, each on so many pixels squared
    source = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for level in levels:
            flat = torch.full((flats, picture.colours, side, side), level / 255)
            noisy = noise.apply_draws(flat, noise.draw(flats, source=source), transfer=picture.transfer)
            sigma.append(255 * float(noisy.double().var(dim=(2, 3)).mean()) ** 0.5)
    return tuple(sigma)


def middle(picture: Picture, rows: int, columns: int) -> tuple[slice, slice]:
    """The window of this size, or as much of it as there is, around the centre."""
    height, width = picture.pixels.shape[:2]
    rows, columns = min(rows, height), min(columns, width)
    top, left = (height - rows) // 2, (width - columns) // 2
    return slice(top, top + rows), slice(left, left + columns)


def liveliest(crop: np.ndarray, rows: int, columns: int) -> tuple[slice, slice]:
    """The window of this size with the most middle levels, in which noise is neither cut at black nor at white."""
    height, width = crop.shape[:2]
    rows, columns = min(rows, height), min(columns, width)
    grey = crop.mean(axis=2)
    middling = grey * (255 - grey)
    tops = np.unique(np.linspace(0, height - rows, 9).astype(int))
    lefts = np.unique(np.linspace(0, width - columns, 9).astype(int))
    places = ((top, left) for top in tops for left in lefts)
    top, left = max(places, key=lambda at: middling[at[0] : at[0] + rows, at[1] : at[1] + columns].sum())
    return slice(int(top), int(top) + rows), slice(int(left), int(left) + columns)


def shown(picture: Picture, window: tuple[slice, slice], bits: int | None = None) -> np.ndarray:
    """A window of the picture as a screen shows it, (H, W, 3) uint8; floating-point light is encoded as sRGB.

    Missing values (NaN) are shown in black.
    """
    pixels = np.nan_to_num(picture.pixels[window][..., : picture.colours], posinf=np.inf)
    if pixels.dtype.kind == "f":
        light = torch.from_numpy(np.ascontiguousarray(pixels, dtype=np.float32)).clamp(0, 1)
        values = linear_to_srgb(light).numpy() * 255
    else:
        depth = bits if bits is not None and pixels.dtype == np.uint16 else 8 * pixels.itemsize
        values = pixels.astype(float) * (255 / (2**depth - 1))
    return np.broadcast_to(values.round().astype(np.uint8), (*pixels.shape[:2], 3))
