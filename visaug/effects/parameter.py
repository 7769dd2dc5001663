"""A parameter of an effect: unit, bounds, default, and the check of a value against them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: a number with a unit and bounds, or a categorical option.

    The catalogue gives numbers as default, unit, low, high and source by place, and the rest by name.

    Args:
        default: value used if a camera file does not give the parameter.
        unit: e.g. "e-", "DN", "fraction", "px", "s", "e-/s"; "1" for a dimensionless number.
        low: lower bound. A value below it is an error; random draws are truncated at it.
        high: upper bound, likewise.
        source: paper, standard or datasheet that the parameter and its default come from.
        strength: True if the effect vanishes when this parameter is zero.
        trials: starting values of a diagnosis: from weak to strong for a strength, across the range otherwise.
        options: allowed values of a categorical parameter. It has no bounds and is not randomised.
        integer: True if only whole numbers are allowed; random draws are rounded.
        of: options of the effect's categorical parameters with which this number is used; empty means all. A fit does not vary
            it with other options.
        unknown: standard deviation of a number that a fit keeps at its value, being one of many that would describe what is not
            known; the intervals of other parameters contain it.

    Examples:
        >>> from visaug.effects import Effect, Parameter, Stage
        >>> class Offset(Effect):
        ...     name, stage = "offset", Stage.READOUT
        ...     level_e = Parameter(1.0, unit="e-", high=1e4, strength=True)
        ...     def apply(self, signal, p, stream, context):
        ...         return signal + p.level_e
        >>> Offset.parameters["level_e"].high
        10000.0
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
    unknown: float = 0.0
    name: str = field(default="", compare=False)

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


@dataclass(frozen=True)
class Strength(Parameter):
    """A parameter at whose zero the effect vanishes."""

    strength: bool = True


def choice(options: tuple[str, ...], source: str) -> Parameter:
    """A categorical parameter; the first of its options is the default."""
    return Parameter(options[0], options=options, source=source)


def unused(parameters: Mapping[str, Parameter], values: Mapping[str, Any]) -> dict[str, str]:
    """Values other than the default that the chosen options leave without effect, with the options that use them, in words."""
    words = {values.get(name, p.default) for name, p in parameters.items() if p.options}
    found = {}
    for name, value in values.items():
        p = parameters.get(name)
        if p is not None and p.of and value != p.default and not words & set(p.of):
            found[name] = used_with(parameters, p)
    return found


def used_with(parameters: Mapping[str, Parameter], parameter: Parameter) -> str:
    """The options with which a parameter counts, in words: "levels: two"."""
    chosen = [key for key, other in parameters.items() if set(parameter.of) & set(other.options)]
    return f"{' or '.join(chosen)}: {' or '.join(parameter.of)}"


def plain(value: Any) -> Any:
    """Python's number for one of NumPy or torch; anything else, and a tensor whose gradient is wanted, as it is."""
    is_number = getattr(value, "ndim", None) == 0 and not getattr(value, "requires_grad", False)
    return value.item() if is_number else value


def check_value(parameter: Parameter, value: Any, path: str, file: Path | None = None) -> None:
    """Checks that a value is a number within the parameter's bounds, or one of its options; the error names path and file."""
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
    """Describes the allowed range, with the unit."""
    return f"a number from {parameter.low:g} to {parameter.high:g} {parameter.unit}".rstrip()
