"""A parameter of an effect: unit, bounds, default, and the check of a value against them."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from visaug.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Args:
        default: the value where a camera file leaves it out.
        unit: e.g. "e-", "DN", "fraction", "px", "s", "e-/s"; "1" for a pure number.
        low, high: bounds; a value outside is refused, a random draw is truncated to them.
        source: paper, standard or datasheet that the parameter and its default come from.
        strength: True if the effect vanishes where this parameter is zero.
        trials: values at which a diagnosis first tries it, from weak to strong for a strength, all over the range for others.
        options: for a choice (no number): the allowed words. A choice has no bounds and is not randomised.
        integer: True where only whole numbers make sense; a random draw is rounded.
        of: words of the effect's choices that use this number; empty where all do. A fit leaves it alone under other words.
    """

    default: Any = 0.0
    unit: str = "1"
    low: float = 0.0
    high: float = float("inf")
    source: str = ""
    strength: bool = False
    trials: tuple = ()
    options: tuple[str, ...] = ()
    integer: bool = False
    of: tuple[str, ...] = ()
    name: str = field(default="", compare=False)

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


def check_value(parameter: Parameter, value: Any, path: str, file: Path | None = None) -> None:
    """Refuses a value that is not a number of the parameter's range, or not one of its options.

    Args:
        parameter: what the effect states about it.
        value: what a user gave.
        path: the key that the error names, e.g. "effects.0.sigma_e".
        file: the file that the error names.

    Raises:
        InputError: the value is not allowed.
    """
    if parameter.options:
        if value not in parameter.options:
            expected = f"one of {', '.join(parameter.options)}"
            raise InputError(f"{value!r} is not a choice", file=file, field=path, expected=expected)
        return
    number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not number or not parameter.low <= value <= parameter.high:
        raise InputError(f"{value!r} is out of range", file=file, field=path, expected=bounds_text(parameter))
    if parameter.integer and value != int(value):
        expected = f"a whole number, {bounds_text(parameter).removeprefix('a number ')}"
        raise InputError(f"{value!r} is not an integer", file=file, field=path, expected=expected)


def bounds_text(parameter: Parameter) -> str:
    """The allowed range in words, with the unit."""
    return f"a number from {parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip()
