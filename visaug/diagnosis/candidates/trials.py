"""Effects that may be missing, and the trial values of each."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from visaug.camera import Camera
from visaug.camera.paths import place_of
from visaug.core.errors import InputError
from visaug.core.sampling.tukey_lambda import GAUSSIAN_SHAPE
from visaug.diagnosis.candidates.look import filled_well, look
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import Effect, Parameter, Stage, catalogue

LADDER = 3  # trial values from which a number counts as one of a wide range, over which no fit leads
TRACE = 0.1  # relative strength up to which one is there beside a stronger one for the fit alone


@dataclass(frozen=True)
class Trial:
    """A camera with one more effect.

    Args:
        effect: its name.
        values: the effect's parameters by path, and its options.
        looked: whether they were estimated from the measured frames.
        following: steps of the camera's coordinates with it, by path; empty if they do not move.
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
    def is_other_form(self) -> bool:
        """Whether an effect beyond the base chain has another form than its default one."""
        return not catalogue()[self.effect].base and bool(self.form)

    @property
    def kind(self) -> tuple:
        """Common part of trials that differ in strength: effect, form, and which strengths are not zero."""
        absent = tuple(path for path, value in self.values if value == 0)
        return self.effect, self.form, absent

    @property
    def unmoved(self) -> "Trial":
        """The same with the camera's parameters where they are."""
        return replace(self, following=())

    @property
    def by_name(self) -> dict[str, Any]:
        """The values by name of the parameter."""
        return {path.split(".", 1)[-1]: value for path, value in self.values}

    @property
    def is_signed(self) -> bool:
        """Whether its strengths may have either sign."""
        parameters = catalogue()[self.effect].parameters
        strong = [parameters[key] for key in catalogue()[self.effect].strengths() if self.by_name.get(key)]
        return bool(strong) and all(p.low < 0 < p.high for p in strong)

    def with_values(self, values: Mapping[str, Any]) -> "Trial":
        """The same with other values, by name of the parameter."""
        changed = dict(self.values) | {f"{self.effect}.{key}": value for key, value in values.items()}
        return replace(self, values=tuple(changed.items()))

    def times(self, factor: float) -> "Trial":
        """The same with its strengths multiplied, each within the range of its parameter; an integer stays."""
        parameters = catalogue()[self.effect].parameters

        def scaled(path: str, value: Any) -> Any:
            p = parameters.get(path.split(".", 1)[-1])
            if p is None or not p.strength or p.integer or not value:
                return value
            return min(max(value * factor, p.low), p.high)

        return replace(self, values=tuple((path, scaled(path, value)) for path, value in self.values))

    def in_units(self, scale: Mapping[str, float]) -> "Trial":
        """The same with values of some units multiplied, each within the range of its parameter; see `Laboratory.units`."""
        parameters = catalogue()[self.effect].parameters

        def scaled(path: str, value: Any) -> Any:
            p = parameters.get(path.split(".", 1)[-1])
            return (
                value if p is None or p.unit not in scale else min(max(value * scale[p.unit], p.low), p.high)
            )

        return replace(self, values=tuple((path, scaled(path, value)) for path, value in self.values))

    def fits(self, camera: Camera) -> bool:
        """Whether a camera can have these values."""
        try:
            self.on(camera)
        except InputError:
            return False
        return True

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
    """Trials of effects that the camera lacks and a diagnosis proposes; of `only`, also of others."""
    found = []
    for name in missing_base(camera):
        if name not in without:
            found += base_trials(camera, name)
    for name, effect in catalogue().items():
        if effect.base or name in camera.effect_names or name in without:
            continue
        if is_proposed(effect) or (name in only and effect.stage < Stage.PICTURE):
            found += effect_trials(effect) + form_trials(effect)
    return [trial for trial in found if trial.fits(camera)]


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
    """Each strength alone at its weakest trial value, in the default form; an integer at each of its trial values.

    Other strengths follow from the scale of the signature (`Trial.times`), and negative ones from its sign.
    """
    strengths = effect.strengths()
    return [
        _trial(effect, {**dict.fromkeys(strengths, 0.0), key: value})
        for key in strengths
        for value in strengths_to_try(effect.parameters[key])
    ]


def form_trials(effect: type[Effect]) -> list[Trial]:
    """The first strength in each other form that no fit leads to: every option, and numbers that are tried over a wide range."""
    first = {t.values[0][0]: t for t in reversed(effect_trials(effect))}
    plain = next(reversed(first.values()), None)
    return [] if plain is None else [plain.with_values(form) for form in _forms(effect, least=LADDER)]


def beside_words(trial: Trial) -> list[Trial]:
    """A trial in words that are not the default ones, with the other values of its numbers that are tried over a wide range.

    `form_trials` tries these beside the default words alone: a glow of few pixels in one corner, not in each. A number with one
    or two values is within reach of a fit.
    """
    effect, own = catalogue()[trial.effect], trial.by_name
    words = {key: own.get(key, p.default) for key, p in effect.parameters.items() if p.options}
    if effect.base or all(word == effect.parameters[key].default for key, word in words.items()):
        return []
    return [
        trial.with_values({key: value})
        for key, p in effect.parameters.items()
        if not p.strength and not p.options and len(p.trials) >= LADDER
        if not p.of or set(p.of) & set(words.values())
        for value in p.trials
        if value != own.get(key, p.default)
    ]


def _forms(effect: type[Effect], least: int) -> list[dict[str, Any]]:
    """Every other value of each option and of each number with at least so many trial values, one at a time.

    A number that is used with some options only is tried beside each of these.
    """
    words = {p.default for p in effect.parameters.values() if p.options}
    forms: list[dict[str, Any]] = []
    for key, p in effect.parameters.items():
        if p.strength or not (p.options or len(p.trials) >= least):
            continue
        beside: list[dict[str, Any]] = [{}]
        if p.of and not words & set(p.of):
            beside = [{k: w} for k, c in effect.parameters.items() for w in p.of if w in c.options]
        others = [value for value in p.options or p.trials if value != p.default]
        forms += [{**word, key: value} for value in others for word in beside]
    return forms


def looked(lab: Laboratory, camera: Camera, without: frozenset[str] = frozenset()) -> list[Trial]:
    """Trials whose values are estimated from the measured frames."""
    found = []
    if "saturation" in missing_base(camera) and "saturation" not in without:
        well_e = filled_well(lab, camera)
        found += [] if well_e is None else [Trial("saturation", (("full_well_e", well_e),), looked=True)]
    seen = look(lab, camera)
    if seen is None:
        return found
    return found + [
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
    """The weakest trial value, and each of an integer; 1, or what the bounds allow, of a strength that states none."""
    values = parameter.trials or (parameter.default,)
    values = values if parameter.integer else values[:1]
    return values if any(values) else (min(max(1.0, parameter.low), parameter.high),)


def strength_of(camera: Camera, trial: Trial) -> tuple[str, float]:
    """Path of the first strength of a trial, and its distance from the camera without the effect."""
    path, value = next((path, value) for path, value in trial.values if not isinstance(value, str))
    without = camera.values().get(path, 0.0)
    return path, abs(value - without) if math.isfinite(without) else 1 / value


def leads(trial: Trial) -> bool:
    """Whether the first strength of a trial is not far weaker than another one, each relative to its strongest trial value.

    A trial of the rows of a fixed pattern has a trace of its columns too, so that a fit can find those.
    """
    parameters = {path: place_of(path).parameter for path, _ in trial.values}
    shares = {
        path: abs(value) / abs(p.trials[-1])
        for path, value in trial.values
        if (p := parameters[path]).strength and p.trials and p.trials[-1]
    }
    first = next(iter(parameters))
    return first not in shares or shares[first] > TRACE * max(shares.values())


def exchanged(camera: Camera, own: str, other: Camera, rival: str) -> Camera:
    """The camera with one of its further effects replaced by a rival as another camera has it."""
    entry = next(entry for entry in other.to_dict()["effects"] if entry["name"] == rival)
    return camera.without_effect(own).with_effect(**entry)
