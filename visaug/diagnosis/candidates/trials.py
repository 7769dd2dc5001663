"""Effects that may be missing, and the trial values of each."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from visaug.camera import Camera
from visaug.diagnosis.candidates.look import look
from visaug.diagnosis.fitting.parameters import GAUSSIAN_SHAPE
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import Effect, Parameter, Stage, catalogue

LADDER = 3  # values of a number that is tried over a wide range


@dataclass(frozen=True)
class Trial:
    """A camera with one more effect.

    Args:
        effect: its name.
        values: the effect's parameters by path, and its options.
        looked: whether they were estimated from the measured frames.
        following: coordinates of the camera's parameters with it, by path; empty if they do not move.
    """

    effect: str
    values: tuple[tuple[str, Any], ...]
    looked: bool = False
    following: tuple[tuple[str, float], ...] = ()

    @property
    def is_fixed(self) -> bool:
        """Whether its strength is an integer, which only the trial values can have."""
        effect = catalogue()[self.effect]
        return any(effect.parameters[key].integer for key in effect.strengths())

    @property
    def form(self) -> tuple[tuple[str, Any], ...]:
        """All parameters except strengths."""
        strengths = {f"{self.effect}.{key}" for key in catalogue()[self.effect].strengths()}
        return tuple(pair for pair in self.values if pair[0] not in strengths)

    @property
    def kind(self) -> tuple:
        """Common part of trials that differ in strength: effect, form, and which strengths are not zero."""
        absent = tuple(path for path, value in self.values if value == 0)
        return self.effect, self.form, absent

    def in_units(self, scale: Mapping[str, float]) -> "Trial":
        """The same with values of some units multiplied, each in the range of its parameter."""
        known = catalogue()[self.effect].parameters

        def scaled(path: str, value: Any) -> Any:
            parameter = known.get(path.split(".", 1)[-1])
            if parameter is None or parameter.unit not in scale:
                return value
            return min(max(value * scale[parameter.unit], parameter.low), parameter.high)

        return replace(self, values=tuple((path, scaled(path, value)) for path, value in self.values))

    def on(self, camera: Camera) -> Camera:
        own = dict(self.values)
        if catalogue()[self.effect].base:
            return camera.replace(own)
        return camera.with_effect(
            self.effect, **{path.split(".", 1)[1]: value for path, value in own.items()}
        )


def missing_base(camera: Camera) -> list[str]:
    """Base terms that the camera file leaves at zero, in whole or in part, and read noise that it has as Gaussian."""
    values = camera.values()
    names = ("prnu", "dsnu", "dark_current", "read_noise")
    absent = [name for name in names if missing_parts(camera, name)]
    if "read_noise" not in absent and abs(values["read_noise.shape"] - GAUSSIAN_SHAPE) < 1e-9:
        absent.append("read_noise")
    if values["full_well_e"] == float("inf"):
        absent.append("saturation")
    return absent


def missing_parts(camera: Camera, name: str) -> list[str]:
    """Strengths of a base term that the camera file leaves at zero: makers often give the PRNU of pixels and not that of columns.

    None of a term whose maps the camera has, which hold all parts. A strength without trial values is not fitted: frames of one
    gain cannot separate what is added after it from what is added before.
    """
    if name in camera.maps:
        return []
    values, term = camera.values(), catalogue()[name]
    return [key for key in term.strengths() if values[f"{name}.{key}"] == 0 and term.parameters[key].trials]


def is_proposed(effect: type[Effect]) -> bool:
    """Whether a diagnosis tries the effect by itself: frames end at the converter, before the picture stage."""
    return effect.proposed and effect.stage < Stage.PICTURE


def trials(
    camera: Camera, without: frozenset[str] = frozenset(), only: frozenset[str] = frozenset()
) -> list[Trial]:
    """Trials of effects that the camera lacks and a diagnosis proposes, at several strengths and forms; of `only`, also others."""
    found = []
    for name in missing_base(camera):
        if name not in without:
            found += base_trials(camera, name)
    for name, effect in catalogue().items():
        if effect.base or name in camera.effect_names or name in without:
            continue
        if is_proposed(effect) or (name in only and effect.stage < Stage.PICTURE):
            found += effect_trials(effect)
    return found


def base_trials(camera: Camera, name: str) -> list[Trial]:
    if name == "saturation":
        full_scale = 2**camera.bit_depth * camera.spec.gain_e_per_dn
        return [Trial(name, (("full_well_e", share * full_scale),)) for share in (0.3, 0.6, 0.85)]
    if name == "read_noise" and camera.spec.read_noise.sigma_e > 0:
        return [Trial(name, (("read_noise.shape", shape),)) for shape in (0.0, -0.15)]
    strengths = {key: catalogue()[name].parameters[key] for key in missing_parts(camera, name)}
    together = [tuple((f"{name}.{key}", p.trials[i]) for key, p in strengths.items()) for i in (0, -1)]
    alone = [
        tuple(
            (f"{name}.{key}", p.trials[-1] if key == one else 1e-3 * p.trials[0])
            for key, p in strengths.items()
        )
        for one in strengths
    ]
    return [Trial(name, values) for values in (*together, *(alone if len(strengths) > 1 else ()))]


def effect_trials(effect: type[Effect]) -> list[Trial]:
    """Weak and strong trials, each strength alone and in both signs, then each other form at the strong end, in both signs."""
    strengths = {key: p for key, p in effect.parameters.items() if p.strength}
    points: list[dict[str, Any]] = []
    for key, p in strengths.items():
        others = dict.fromkeys(strengths, 0.0)
        for value in strengths_to_try(p):
            points.append({**others, key: value})
    if len(strengths) > 1:
        points.append({key: p.trials[-1] for key, p in strengths.items()})
    first, parameter = next(iter(strengths.items()))
    strongest = [s for s in strengths_to_try(parameter) if abs(s) == abs(parameter.trials[-1])]
    for form in _forms(effect):
        points += [{**dict.fromkeys(strengths, 0.0), first: strength, **form} for strength in strongest]
    return [_trial(effect, point) for point in points]


def _forms(effect: type[Effect]) -> list[dict[str, Any]]:
    """Every other value of each parameter that is not a strength, one at a time, and beside each of them those of its options."""
    words = {p.default for p in effect.parameters.values() if p.options}
    forms: list[dict[str, Any]] = []
    for key, p in effect.parameters.items():
        others = [] if p.strength else [value for value in p.options or p.trials if value != p.default]
        beside: list[dict[str, Any]] = [{}]
        if p.of and not words & set(p.of):
            beside = [{k: w} for k, c in effect.parameters.items() for w in p.of if w in c.options]
        forms += [{**word, key: value} for value in others for word in beside]
    return forms


def beside_words(trial: Trial) -> list[Trial]:
    """A trial in words that are not the default ones, with the other values of its numbers that are tried over a wide range.

    `effect_trials` tries these beside the default words alone: a glow of few pixels in one corner, not in each. A number with one
    or two values is within reach of a fit.
    """
    effect = catalogue()[trial.effect]
    own = {path.split(".", 1)[1]: value for path, value in trial.values}
    words = {key: own.get(key, p.default) for key, p in effect.parameters.items() if p.options}
    if effect.base or all(word == effect.parameters[key].default for key, word in words.items()):
        return []
    return [
        _trial(effect, {**own, key: value})
        for key, p in effect.parameters.items()
        if not p.strength and not p.options and len(p.trials) >= LADDER
        if not p.of or set(p.of) & set(words.values())
        for value in p.trials
        if value != own.get(key, p.default)
    ]


def looked(lab: Laboratory, camera: Camera, without: frozenset[str] = frozenset()) -> list[Trial]:
    """Trials whose values are estimated from the measured frames."""
    seen = look(lab, camera)
    if seen is None:
        return []
    return [
        _trial(effect, within_bounds(effect, point), looked=True)
        for name, effect in catalogue().items()
        if not effect.base and name not in camera.effect_names and name not in without and is_proposed(effect)
        for point in effect.looks(seen)
    ]


def within_bounds(effect: type[Effect], point: dict[str, Any]) -> dict[str, Any]:
    """Values estimated from frames, clipped to the bounds of their parameters."""
    return {
        key: value
        if effect.parameters[key].options
        else min(max(value, effect.parameters[key].low), effect.parameters[key].high)
        for key, value in point.items()
    }


def _trial(effect: type[Effect], point: dict[str, Any], looked: bool = False) -> Trial:
    return Trial(effect.name, tuple((f"{effect.name}.{key}", value) for key, value in point.items()), looked)


def strengths_to_try(parameter: Parameter) -> tuple:
    """A fifth of the weakest trial, the trials, and the same with the other sign if it may be negative."""
    values = parameter.trials or (parameter.default,)
    if not parameter.integer:
        values = (0.2 * values[0], *values)
    if parameter.low < 0 < parameter.high:
        values = (*values, *(-v for v in values))
    return values


def exchanged(camera: Camera, own: str, other: Camera, rival: str) -> Camera:
    """The camera with one of its further effects replaced by a rival as another camera has it."""
    entry = next(entry for entry in other.to_dict()["effects"] if entry["name"] == rival)
    return camera.without_effect(own).with_effect(**entry)
