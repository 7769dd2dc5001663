"""What SensorNoise and its adapters accept: options and images, checked with errors that name what is wrong."""

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

import torch
from torch import Tensor

from visaug.camera.loops import ends
from visaug.camera.spec import MOST_PIXELS
from visaug.core.errors import InputError
from visaug.effects.parameter import Parameter, bounds_text

Range = float | tuple[float, float] | None
CHOICES = {
    "fixed_pattern": ("image", "camera"),
    "transfer": ("auto", "linear", "srgb"),
    "black_level": ("subtract", "keep"),
    "resolution": ("network", "sensor"),
}
MOST = 1.5  # image value: beyond, the image is of another scale; between 1 and it, it is cut by the sensor


def check_choice(name: str, word: Any) -> str:
    """The value, if it is one of those that an option allows."""
    if word not in CHOICES[name]:
        raise InputError(f"{word!r} is not a choice", field=name, expected=" or ".join(CHOICES[name]))
    return word


def check_number(name: str, value: Any, low: float, high: float, above: bool = False) -> float:
    """A finite number in [low, high], or in (low, high] where `above`."""
    given = value
    try:
        value = math.nan if isinstance(value, bool | str | bytes) else float(value)
    except (TypeError, ValueError):
        value = math.nan
    if not low <= value <= high or not math.isfinite(value) or (above and value == low):
        end = f" up to {high:g}" if math.isfinite(high) else ""
        expected = f"a number {'above' if above else 'from'} {low:g}{end}"
        raise InputError(f"{given!r} is not valid", field=name, expected=expected)
    return value


def check_strength(value: Any) -> float:
    """A factor on the noise: 0, or a number from `least_strength` to 100."""
    value = check_number("strength", value, 0, 100)
    least_strength = 1e-3  # at its inverse square, 1e6 times the electrons: noise below the last of 16 bits
    if 0 < value < least_strength:
        expected = f"0, or a number from {least_strength:g} to 100"
        raise InputError(f"{value!r} is not valid", field="strength", expected=expected)
    return value


def check_range(name: str, value: Any, low: float, high: float) -> tuple[float, float] | None:
    """None, or the ends of a range; a single number is a range of no width."""
    if value is None:
        return None
    pair = isinstance(value, Sequence) and not isinstance(value, str | bytes)
    if pair and len(value) != 2:
        raise InputError(f"has {len(value)} entries", field=name, expected="a number or a pair (low, high)")
    first, last = (check_number(name, one, low, high) for one in (value if pair else (value, value)))
    if first > last:
        expected = "a pair (low, high) with low <= high"
        raise InputError(f"{value!r} is not increasing", field=name, expected=expected)
    return first, last


def check_flag(name: str, value: Any) -> bool | None:
    """True, False or None."""
    if value is None or isinstance(value, bool):
        return value
    raise InputError(f"{value!r} is not a choice", field=name, expected="True, False or None")


def check_seed(seed: Any) -> int | None:
    """None, or a whole number."""
    if seed is None or is_whole(seed):
        return seed if seed is None else int(seed)
    raise InputError(f"{seed!r} is not valid", field="seed", expected="a whole number, or None")


def is_whole(value: Any) -> bool:
    """Whether a value is a whole number by its type, and no truth value."""
    return isinstance(value, Integral) and not isinstance(value, bool)


def check_origin(origin: Any) -> tuple[int, int] | None:
    """None, or row and column of the sensor at which an image begins."""
    if origin is None:
        return None
    pair = isinstance(origin, Sequence) and not isinstance(origin, str | bytes) and len(origin) == 2
    if not pair or not all(is_whole(one) and 0 <= one < MOST_PIXELS for one in origin):
        expected = f"(row, column), two whole numbers from 0 to {MOST_PIXELS - 1}, or None"
        raise InputError(f"{origin!r} is not valid", field="origin", expected=expected)
    return int(origin[0]), int(origin[1])


def check_replacement(path: str, value: Any, parameter: Parameter) -> None:
    """Refuses what cannot replace a camera's number: a number or tensor of this range, for all images or one for each.

    Tensors are read here, once, and not in each call, which would wait for a GPU.
    """
    try:
        tensor = torch.as_tensor(value)
    except (TypeError, ValueError, RuntimeError):
        tensor = None
    if tensor is None or tensor.dtype == torch.bool or tensor.is_complex():
        raise InputError(f"{value!r} is not a number", field=path, expected=bounds_text(parameter))
    numbers = tensor.detach().float()
    if not numbers.numel() or any(size != 1 for size in numbers.shape[1:]):
        expected = "one number, or (B,) with one for each image"
        raise InputError(f"has shape {tuple(numbers.shape)}", field=path, expected=expected)
    fits = (numbers >= parameter.low) & (numbers <= parameter.high)
    fits &= numbers.isfinite() | (path == "full_well_e")  # which is infinite where a camera states none
    fits &= (numbers == numbers.round()) | (not parameter.integer)
    if not fits.all():
        expected = bounds_text(parameter) + (", whole" if parameter.integer else "")
        raise InputError(f"{numbers[~fits][0].item():g} is not valid", field=path, expected=expected)


def check_images(images: Any) -> Tensor:
    """A batch of images (B, C, H, W) of floating-point values in about [0, 1].

    Raises:
        InputError: no tensor, another number of axes, whole numbers, channels last, no pixels, or values below -0.5 or
            above 1.5, as an image of 0..255 has them. A NaN is no error.
    """
    if not isinstance(images, Tensor):
        expected = "a tensor (B, C, H, W); for PIL and NumPy images use visaug.augment.ImageNoise"
        raise InputError(f"is a {type(images).__name__}", field="images", expected=expected)
    shape = tuple(images.shape)
    if images.ndim != 4:
        raise InputError(f"has shape {shape}", field="images", expected="(B, C, H, W)")
    if not images.dtype.is_floating_point:
        expected = "floating point in [0, 1]: divide by the largest value of the type (255 for uint8)"
        raise InputError(f"has type {images.dtype}", field="images", expected=expected)
    if shape[1] > 4 and shape[3] in (1, 3, 4):
        expected = "(B, C, H, W): permute(0, 3, 1, 2)"
        raise InputError(f"has shape {shape}, channels last", field="images", expected=expected)
    check_pixels(shape)
    return images


def check_pixels(shape: Sequence[int]) -> None:
    """Raises InputError where images of a shape (..., C, H, W), or (H, W), have no pixels."""
    if 0 in shape[-3:]:
        raise InputError(f"has shape {tuple(shape)}, no pixels", field="images", expected="one pixel or more")


def check_number_of_draws(draws: Mapping[str, Tensor], images: Tensor) -> None:
    """Refuses draws of another number of images than these, (B, C, H, W)."""
    if len(draws["keys"]) != len(images):
        problem = f"are of {len(draws['keys'])} images"
        raise InputError(problem, field="draws", expected=f"draw({len(images)}), one for each")


def check_values(images: Tensor) -> None:
    """Refuses values of another scale than [0, 1]; see `check_images`.

    What they look like is said: normalised, high dynamic range, or whole numbers of 8, 12 or 16 bit.
    """
    if images.numel() == 0 or torch.compiler.is_compiling():
        return
    # An image that goes below the second, with more than this share of its values below 0, has had its mean subtracted:
    # resampling and a subtracted black level go less far, or in fewer pixels.
    least, normalized, normalized_share = -0.5, -0.05, 0.25
    low, high = ends(images.detach())  # a missing value must not hide the scale of the others
    if high <= MOST and low >= normalized:
        return
    there = images.detach()[~images.isnan()].float()
    negative = float((there < 0).float().mean())
    bright_share = 0.25  # of values above white: more is no highlight but another scale
    if low < least or negative > normalized_share:
        advice = "put the noise before Normalize, or undo it"
    elif high <= MOST:
        return  # dips below black, as a resampled image has them: the sensor cuts them
    elif float((there > 1).float().mean()) < bright_share:
        advice = "scale a high-dynamic-range image so that white is 1, or clamp its highlights with images.clamp(0, 1)"
    else:
        advice = "divide an image of 8 bit by 255, one of 16 bit by 65535, an HDR image by its value of white"
    share = f", {100 * negative:.0f} % below 0" if negative else ""
    problem = f"holds values from {low:g} to {high:g}{share}"
    raise InputError(problem, field="images", expected=f"values in [0, 1]: {advice}")
