"""Options of SensorNoise and its adapters, checked with errors that name what is wrong."""

import math
from collections.abc import Sequence
from numbers import Integral
from typing import Any

import torch

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
