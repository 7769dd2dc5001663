"""The end of a search: the camera that is kept, and all that is reported."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.special import expit

from visaug.diagnosis.considered import considered, considering
from visaug.diagnosis.fitting.robust import p_value, standardised
from visaug.diagnosis.outside import LIKELIER, log_odds_outside
from visaug.diagnosis.ranking import other_maximum, refitted
from visaug.diagnosis.result import Diagnosis, Ranked, Step
from visaug.diagnosis.stage import History, SearchStage, Setting
from visaug.diagnosis.state import State
from visaug.diagnosis.telling import cannot_show, form, residue
from visaug.diagnosis.verdict import Verdict
from visaug.diagnosis.verdicts import verdicts
from visaug.statistics.distance import is_clear
from visaug.statistics.places import places
from visaug.statistics.tail import SIGNIFICANT


def outcome(setting: Setting, history: History, nearest: str | None) -> Diagnosis:
    """The diagnosis.

    Args:
        nearest: an effect that reduces the error but was not accepted.
    """
    lab, first = setting.lab, setting.first
    z = standardised(lab.measured[0].values - first.mean, first.scale)
    p_given = p_value(float(np.abs(z).max()), first.largest_as_given)
    p_before = history[0].p_value
    end, steps = kept(setting, history, p_given)
    end = replace(end, state=considering(lab, end.state))
    chosen = [stage.standing[0] for stage in history if stage.standing]
    end = replace(end, ranked=refitted(end.ranked, chosen, end.state))
    significant = p_given <= SIGNIFICANT or p_before <= SIGNIFICANT
    excess = bool(end.state.accepted) or (significant and is_clear(end.error))
    statistics = lab.measured[2].statistics
    outside = float(expit(log_odds_outside(end.state, statistics))) if end.state.accepted else None
    is_left = end.is_missing or (outside or 0.0) > LIKELIER
    effects = () if lab.units else verdicts(setting, end)
    return Diagnosis(
        camera=end.state.camera,
        accepted=end.state.accepted,
        error_after=end.error if excess else None,
        p_value_before=p_before,
        p_value_after=end.p_value,
        adequate_before=p_before > SIGNIFICANT,
        adequate_after=not end.is_missing,
        where=places(setting.errors.distance, lab.statistics, z),
        ranking=_ranking(end, outside or 0.0),
        outside=outside,
        steps=steps if excess else (),
        frames=_sequence_numbers(setting),
        ambiguous=tuple(pair for pair in end.ambiguous if _is_open(set(pair["effects"]), end)),
        unexplained=residue(lab.measured[2], end.state, is_left, nearest),
        form=form(statistics, end.state),
        cannot_show=cannot_show(setting.signs, first, effects),
        used=lab.selection,
        warnings=(
            *lab.warnings,
            *rises(steps),
            *erratic(end, effects),
            *several_maxima(history, end.state),
            *not_fitted(end.state),
        ),
        effects=effects,
        errors=setting.errors,
    )


def _is_open(effects: set[str], end: SearchStage) -> bool:
    """Whether one of these effects is accepted and another is not."""
    return bool(effects & set(end.state.accepted)) and not effects <= set(end.state.accepted)


def _ranking(end: SearchStage, outside: float) -> tuple[Ranked, ...]:
    """The candidates by their probability, what is outside the catalogue taken off; of equal ones an accepted effect is first."""
    found = (replace(r, probability=r.probability * (1 - outside)) for r in end.ranked.values())
    return tuple(sorted(found, key=lambda r: (-r.probability, r.effect not in end.state.accepted)))


def kept(setting: Setting, history: History, p_given: float) -> tuple[SearchStage, tuple[Step, ...]]:
    """The last stage; the camera file as given, where no effect was found and the frames are farther from the refitted file.

    The file as given is not refitted, and is judged as it is.
    """
    end = history[-1]
    steps = tuple(Step(stage.action, stage.error) for stage in history)
    if end.state.accepted or end.error is None or end.error.value <= 1:
        return end, steps
    given = State.plain(setting.unfitted, end.state.views)
    error = setting.errors.told(given.fitted)
    return replace(end, state=given, p_value=p_given, error=error), (Step("keep the camera file", error),)


def rises(steps: Sequence[Step]) -> list[str]:
    """A warning for each step with which the error rises beyond the intervals of both errors.

    The criterion weighs the evidence of all statistics, and none counts more than the logarithm of its deviation: an effect that
    explains many and contradicts a few is accepted. The error counts the few in full.
    """
    return [
        f"error_rises: with {now.action.removeprefix('add ')} the error on hold-out frames rises from {was.error.value:.2g} to "
        f"{now.error.value:.2g}: it explains some differences and contradicts others, so a further effect is missing or it is "
        "not the cause; the camera without it is nearer to the frames"
        for was, now in pairwise(steps)
        if was.error and now.error and now.error.low > was.error.high
    ]


def erratic(end: SearchStage, effects: Sequence[Verdict]) -> list[str]:
    """A warning where limits of absent effects take statistics to follow a strength, and they answer small steps by chance."""
    absent = sum(v.verdict == "absent" for v in effects)
    if not (absent and end.state.fitted.reference.is_erratic):
        return []
    why = "statistics of this camera answer the smallest step of a parameter by chance, as lost bits make them do"
    return [f"limits: {why}; the limits of effects that are called absent ({absent}) can be too low"]


def several_maxima(history: History, end: State) -> list[str]:
    """A warning for each accepted effect that other options or values of its own describe about as well."""
    own = [stage.standing[0] for stage in history if stage.standing]
    found = [
        (one.refined.effect, other_maximum(one, end)) for one in own if one.refined.effect in end.accepted
    ]
    return [
        f"maxima: {name}: about as likely with {other}; its intervals hold both"
        for name, other in found
        if other
    ]


def not_fitted(state: State) -> list[str]:
    """A warning for each parameter of an accepted effect that is kept at its value and whose uncertainty the intervals contain."""
    values = state.camera.values()
    return [
        f"considered: {path} ({p.source}) is not fitted: {values[path]:g} with a standard deviation of {p.unknown:g}, which the "
        f"intervals of {effect} contain"
        for effect in state.accepted
        for path, p in considered(effect).items()
    ]


def _sequence_numbers(setting: Setting) -> dict[str, list[int]]:
    sequences, folds = setting.lab.sequences, setting.lab.folds
    return {
        name: list(dict.fromkeys(sequences[i] for i in getattr(folds, name)))
        for name in ("fit", "select", "confirm")
    }
