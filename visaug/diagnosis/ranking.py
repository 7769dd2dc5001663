"""The reported candidates: the probability of each, its parameters, and which of them these frames do not distinguish."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.choice import Accepted, Judged
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.result import FittedValue, Ranked, estimates
from visaug.diagnosis.separate import measurement
from visaug.diagnosis.stage import Setting
from visaug.diagnosis.state import State
from visaug.statistics.distance import Error

Ranks = Mapping[str, Ranked]


def ranks(
    setting: Setting, state: State, refined: Sequence[Refined], odds: Sequence[float], earlier: Ranks
) -> Ranks:
    """Candidates for the next effect of a state, with their log posterior odds up to a constant, beside those of earlier steps."""
    found = dict(earlier)
    weights = np.exp(np.maximum(np.array(odds) - max(odds), -700.0))
    for r, weight in zip(refined, weights / weights.sum(), strict=True):
        if r.effect in found and r.effect in state.accepted:
            continue
        spread = np.sqrt(state.fitted.reference.null_scale**2 + r.variance)
        error = setting.errors.distance.error(state.fitted.reference.sets, r.residual, spread)
        own = estimates(r.effect, r.camera, r.coordinates)
        found[r.effect] = Ranked(r.effect, float(weight), None if error is None else error.value, own)
    return found


def chosen_ranks(
    setting: Setting, before: State, chosen: Accepted, after: State, error: Error | None, earlier: Ranks
) -> tuple[Ranks, list[dict[str, Any]]]:
    """The candidates of a step in which one was accepted, and its rivals, if there are any.

    A candidate that does not stand is less probable than the accepted one, and by as much as its gain is less.
    """
    best, top = chosen.best, max(r.gain for r in (chosen.best.refined, *chosen.others))
    standing = [j.refined for j in chosen.standing]
    refused = -ODDS - np.log(max(len(chosen.others), 1))  # all together one in twenty
    behind = [refused + min(r.gain - top, 0.0) for r in chosen.others]
    ranked = ranks(setting, before, [*standing, *chosen.others], [*chosen.odds, *behind], earlier)
    ranked = accepted_rank(ranked, after, best.refined.effect, error, best.otherwise)
    close = [r for r, odds in zip(standing, chosen.odds, strict=True) if odds > -ODDS]
    if len(close) < 2:
        return ranked, []
    cameras = {r.effect: r.camera for r in close}
    text = measurement(cameras, setting.lab.measured[2].statistics, setting.report)
    return ranked, [{"effects": list(cameras), "measure": text}]


def accepted_rank(
    ranked: Ranks, after: State, effect: str, error: Error | None, otherwise: Judged | None = None
) -> Ranks:
    """With intervals of an accepted effect's parameters, from simulated sets of the camera with it.

    Args:
        otherwise: the same effect with other options or values that are about as probable; intervals reach to these too.
    """
    forms = {
        path.split(".", 1)[1]: word
        for path, word in after.fitted.camera.choices().items()
        if path.startswith(f"{effect}.")
    }
    own = replace(
        ranked[effect],
        parameters=_with_those(effect, after, otherwise),
        forms=forms,
        error_after=None if error is None else error.value,
    )
    return {**ranked, effect: own}


def _with_those(effect: str, after: State, otherwise: Judged | None) -> dict[str, FittedValue]:
    """The parameters of an effect, with intervals that also hold those of the same effect with other options."""
    found = estimates(effect, after.camera, *after.numbers)
    if otherwise is None:
        return found
    others = estimates(effect, otherwise.state.camera, *otherwise.state.numbers)
    return {name: own.reaching(others[name]) if name in others else own for name, own in found.items()}


def other_maximum(one: Judged, end: State) -> str | None:
    """The options and values of an accepted effect at the other maximum of its likelihood and at its own.

    None where there is no other, or where neither an option differs nor a value by more than the intervals of both.

    Args:
        one: the effect in its own step.
        end: the last camera.
    """
    if one.otherwise is None:
        return None
    effect, states = one.refined.effect, (one.otherwise.state, end)
    values = [estimates(effect, state.camera, *state.numbers) for state in states]
    words = [state.camera.choices() for state in states]
    there, here = [], []
    for path, word in words[1].items():
        if path.startswith(f"{effect}.") and words[0].get(path, word) != word:
            name = path.split(".", 1)[1]
            there.append(f"{name} {words[0][path]}")
            here.append(f"{name} {word}")
    for name, value in values[1].items():
        other = values[0].get(name)
        if other is not None and value.is_apart(other):
            there.append(f"{name} {other}")
            here.append(f"{name} {value}")
    return f"{', '.join(there)} as with {', '.join(here)}" if here else None


def refitted(ranked: Ranks, chosen: Sequence[Judged], end: State) -> Ranks:
    """With the parameters of accepted effects as they are in the last camera, beside the later ones."""
    found = dict(ranked)
    for one in chosen:
        name = one.refined.effect
        if name in end.accepted:
            found[name] = replace(found[name], parameters=_with_those(name, end, one.otherwise))
    return found


def without_rival(ranked: Ranks, effect: str, probability: float) -> Ranks:
    """With the probability of an effect of which a rival, that had this probability, was accepted beside it.

    The rival is no alternative then.
    """
    return with_probability(ranked, effect, min(ranked[effect].probability / (1 - probability), 1.0))


def with_probability(ranked: Ranks, effect: str, probability: float) -> Ranks:
    """With another probability of an effect."""
    return {**ranked, effect: replace(ranked[effect], probability=probability)}


def swapped_ranks(ranked: Ranks, own: Judged, rival: Judged) -> Ranks:
    """With the probabilities of an effect and of the rival that replaces it exchanged."""
    one, other = ranked[own.refined.effect], ranked[rival.refined.effect]
    return {
        **ranked,
        one.effect: replace(one, probability=other.probability),
        other.effect: replace(other, probability=one.probability),
    }
