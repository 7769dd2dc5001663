"""Whether a class is an effect that the rest of the program can work with; found out once, when it is registered."""

import math
from collections.abc import Mapping
from typing import Any

import torch

from visaug.core.errors import InputError, described, user_line
from visaug.effects.effect import TEXTS, Effect, Stage
from visaug.effects.parameter import Parameter, check_value, unused

TAKEN = ("name", "map")  # keys of an effect in a camera file that are no parameters


def check_definition(effect: type[Effect]) -> None:
    """Refuse a class with an attribute of a wrong type or value, before anything uses it."""
    where = f"effect {effect.__name__}"
    name = effect.name
    if not isinstance(name, str) or not name.isascii() or not name.isidentifier():
        problem = f"{where}: name: {name!r} is none; expected letters, digits and _, such as my_effect"
        raise InputError(problem)
    where = f"effect {name}"
    if not isinstance(getattr(effect, "stage", None), Stage):
        raise InputError(f"{where}: stage: expected a Stage such as Stage.READOUT")
    if not _number(effect.order) or not math.isfinite(effect.order):
        raise InputError(f"{where}: order: {effect.order!r} is not a number")
    if not _number(effect.map_low):
        raise InputError(f"{where}: map_low: {effect.map_low!r} is not a number")
    for key in TEXTS:
        if not isinstance(getattr(effect, key), str):
            raise InputError(f"{where}: {key}: {getattr(effect, key)!r} is not text")
    if not isinstance(effect.aliases, tuple) or not all(isinstance(word, str) for word in effect.aliases):
        raise InputError(f"{where}: aliases: {effect.aliases!r} is not a tuple of words")
    for key in ("differentiable", "base", "proposed", "map_is_table", "local", "stepwise"):
        if not isinstance(getattr(effect, key), bool):
            raise InputError(f"{where}: {key}: expected True or False")
    parameters = effect.parameters
    if not isinstance(parameters, dict) or not all(isinstance(p, Parameter) for p in parameters.values()):
        raise InputError(
            f"{where}: parameters: expected one class attribute for each, such as sigma_e = Parameter(...)"
        )
    for key, parameter in parameters.items():
        if not isinstance(key, str) or key in TAKEN:
            raise InputError(f"{where}: parameters: {key!r} cannot be the name of a parameter")
        _check_parameter(parameter, f"{where}: {key}")
    _check_special_cases(effect, f"{where}: special_cases")
    if not callable(effect.apply) or effect.apply is Effect.apply:
        raise InputError(f"{where}: apply: expected a method `apply(self, signal, p, stream, context)`")


def try_effect(effect: type[Effect]) -> None:
    """Apply an effect once to two frames of 96 x 128 pixels with three channels, so that an error in `apply` is reported early.

    Parameters have their first trial value, or their default where there is none. An effect whose strength is then 0 is not
    applied, as in the chain.
    """
    level = 0.5 if effect.stage == Stage.PICTURE else 500.0
    trial = (2, 3, 96, 128)  # shape of the frames to which an effect is applied when it is registered
    signal = torch.full(trial, level)
    where = f"effect {effect.name}: apply"
    trials = {name: p.trials[0] for name, p in effect.parameters.items() if p.trials}
    idle = unused(effect.parameters, trials)
    one = effect(**{name: value for name, value in trials.items() if name not in idle})
    strengths = [one.values()[name] for name in effect.strengths()]
    if strengths and not any(strengths):
        return
    try:
        out = one(signal, sequence=True)
    except InputError:
        raise
    except (IndexError, RuntimeError):
        return  # of a place or a neighbourhood that only larger frames have, perhaps: told when the effect is used
    except Exception as error:
        raise InputError(f"{user_line(error) or where}: {described(error)}") from error
    if not bool((signal == level).all()):
        raise InputError(f"{where}: changes its input in place; expected a new tensor")
    if not bool(torch.isfinite(out).all()):
        raise InputError(f"{where}: returns NaN or infinite values for a signal of {level:g} with {one!r}")


def _check_special_cases(effect: type[Effect], where: str) -> None:
    cases = effect.special_cases if isinstance(effect.special_cases, tuple) else (None,)
    for case in cases:
        match case:
            case (Mapping() as values, str()) if values:
                pass
            case _:
                expected = 'a tuple of pairs, such as (({"duty": 1.0}, "hot_pixels"),)'
                raise InputError(f"{where}: {effect.special_cases!r} is none; expected {expected}")
        for key, value in values.items():
            if key not in effect.parameters:
                raise InputError(f"{where}: {key!r} is not the name of a parameter")
            check_value(effect.parameters[key], value, f"{where}: {key}")


def _check_parameter(parameter: Parameter, where: str) -> None:
    for key in ("unit", "source"):
        if not isinstance(getattr(parameter, key), str):
            raise InputError(f"{where}: {key}: {getattr(parameter, key)!r} is not text")
    for key in ("options", "of"):
        words = getattr(parameter, key)
        if not isinstance(words, tuple) or not all(isinstance(word, str) for word in words):
            raise InputError(f"{where}: {key}: {words!r} is not a tuple of words")
    for key in ("low", "high"):
        if not _number(getattr(parameter, key)):
            raise InputError(f"{where}: {key}: {getattr(parameter, key)!r} is not a number")
    if not parameter.low <= parameter.high:
        raise InputError(f"{where}: low, high: {parameter.low} is not below {parameter.high}")
    if not isinstance(parameter.trials, tuple):
        raise InputError(f"{where}: trials: {parameter.trials!r} is not a tuple")
    if parameter.default != math.inf or parameter.options:
        check_value(parameter, parameter.default, f"{where}: default")
    for trial in parameter.trials:
        check_value(parameter, trial, f"{where}: trials")


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)
