"""An accepted effect is judged again beside the next one, and compared with its rivals."""

from dataclasses import replace

from scipy.special import expit

from visaug.diagnosis.choice import Judged
from visaug.diagnosis.criterion import Evidence, between, evidence
from visaug.diagnosis.ranking import accepted_rank, swapped_ranks, with_probability, without_rival
from visaug.diagnosis.stage import History, SearchStage, Setting
from visaug.diagnosis.state import State
from visaug.effects import catalogue
from visaug.statistics.tail import SIGNIFICANT


def reconsidered(setting: Setting, history: History) -> History:
    """The history with the effect before the last replaced by a rival that is more probable with the last, or left out.

    Rivals are those that the criterion accepted. As long as a further effect is missing, a wrong effect can fit better. And the
    last effect may explain everything by itself; the first stays if the criterion accepts it beside the last.
    """
    *_, before, last = history
    if len(last.state.accepted) < 2:
        return history
    own, *others = before.standing
    earlier = history[: len(before.state.accepted)]
    rivals = {j.refined.effect for j in others if j.accepts}
    if last.state.accepted[-1] not in rivals:
        alone = _without(setting, earlier[-1].state, own, last)
        if alone is not None:
            return (*earlier, alone)
    for rival in others:
        if not rival.accepts:
            continue
        effect = rival.refined.effect
        if effect == last.state.accepted[-1]:
            alone, p_value = setting.tested(rival.state)
            if p_value > SIGNIFICANT and not _beside(setting, alone, last.state, own).accepts:
                return (*earlier, _stage(setting, last, (own, rival), alone, p_value, (rival, own)))
            ranked = without_rival(last.ranked, own.refined.effect, before.ranked[effect].probability)
            last = replace(last, ranked=ranked)
        is_base = any(catalogue()[j.refined.effect].base for j in (own, rival))
        if effect in last.state.accepted or is_base:
            continue
        swapped = setting.adding.swapped(last.state, own.refined.effect, rival.state)
        odds = between(history[0].state, swapped, last.state)
        if odds + own.evidence.cost > rival.evidence.cost:
            swapped, p_value = setting.tested(swapped)
            first = replace(
                before,
                state=rival.state,
                error=setting.errors.told(rival.state.fitted),
                standing=(rival, own),
            )
            second = _stage(setting, last, (own, rival), swapped, p_value, last.standing[:1])
            return (*earlier, first, second)
    return (*history[:-1], last)


def _without(setting: Setting, earlier: State, own: Judged, last: SearchStage) -> SearchStage | None:
    """The last stage without the effect before its last one; None if that is needed."""
    effect = own.refined.effect
    if catalogue()[effect].base:
        return None
    alone = setting.adding.without(earlier, last.state, effect)
    beside = _beside(setting, alone, last.state, own)
    if beside.accepts:
        return None
    alone, p_value = setting.tested(alone)
    if p_value <= SIGNIFICANT:
        return None
    error = setting.errors.told(alone.fitted)
    ranked = with_probability(last.ranked, effect, float(expit(beside.odds)))
    stays = last.standing[0]
    ranked = accepted_rank(ranked, alone, stays.refined.effect, error, stays.otherwise)
    return replace(last, state=alone, p_value=p_value, error=error, ranked=ranked)


def _beside(setting: Setting, without: State, both: State, own: Judged) -> Evidence:
    """The evidence of an effect beside the last one."""
    return evidence(without, both, len(own.refined.coordinates), setting.adding.effects)


def _stage(
    setting: Setting,
    last: SearchStage,
    exchanged: tuple[Judged, Judged],
    state: State,
    p_value: float,
    standing: tuple[Judged, ...],
) -> SearchStage:
    """The last stage with another state, in which one of two effects gave way to the other."""
    error = setting.errors.told(state.fitted)
    ranked = swapped_ranks(last.ranked, *exchanged)
    for one in (exchanged[1], *standing):
        if one.refined.effect in state.accepted:
            ranked = accepted_rank(ranked, state, one.refined.effect, error, one.otherwise)
    return replace(last, state=state, p_value=p_value, error=error, standing=standing, ranked=ranked)
