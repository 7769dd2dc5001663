"""Which effects are worth simulating in full, and for which of them the measurement speaks."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from visaug.comparison import Laboratory
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.fit import Fitted, Report
from visaug.diagnosis.rank import Chance, Refined, Signatures, best_of_each, log_density, refine

SIGNIFICANT = 0.02  # false-alarm rate of the test whether a camera holds
TRIED = 4  # candidates whose numbers are refined in a step
LEAST_GAIN = 5.0  # in log likelihood: with thirty effects to choose from less is chance
CLOSE, RIVALS = (
    6.0,
    3,
)  # log likelihood within which candidates are rivals; so many of them are simulated in full
EXACT = 0.03  # what a form may leave over where rivals are compared


def candidates(
    lab: Laboratory, signs: Signatures, fitted: Fitted, state: State, without: frozenset[str], report: Report
) -> list[Refined]:
    """The effects that match what a fitted camera leaves best, refined, best first.

    Args:
        fitted: the camera from which they are tried: the state's, or the camera as given.
    """
    matches = best_of_each(signs, fitted, frozenset(state.accepted) | without, state.allowance)
    found: list[Refined] = []
    for m in [m for m in matches if m.gain > max(2.0, 0.25 * matches[0].gain)][:TRIED]:
        beaten = max((r.gain for r in found), default=0.0)
        found.append(refine(lab, fitted, m, report, state.allowance, beaten))
    return sorted(found, key=lambda r: -r.gain)


def rivals(found: Sequence[Refined], state: State, chance: Chance) -> list[Refined]:
    """Those among refined candidates that only a full simulation can tell apart."""
    if not found:
        return []
    least = max(LEAST_GAIN, found[0].gain - max(CLOSE, 0.1 * found[0].gain))
    return [r for r in found if r.gain > least and _is_beyond(chance, state, r)][:RIVALS]


def _is_beyond(chance: Chance, state: State, candidate: Refined) -> bool:
    """Whether what the candidate takes away is more than some signature takes away by chance.

    An effect that brings a spread of its own is not seen by its mean signature and passes.
    """
    if candidate.variance.any():
        return True
    return chance.p_value_of(state.fitted.residual - candidate.residual) <= SIGNIFICANT


def decided(state: State, simulated: Sequence[tuple[Refined, State]]) -> list[tuple[Refined, State]]:
    """Rivals in the order of how well their own simulated sets account for what was measured."""
    if len(simulated) < 2:
        return list(simulated)
    used = np.all([after.fitted.reference.null_scale > 0 for _, after in simulated], axis=0)
    evidence = []
    for _, after in simulated:
        form = EXACT * (state.fitted.residual - after.fitted.residual)
        evidence.append(log_density(after.fitted, np.hypot(state.allowance, form), used))
    top = simulated[0][0].gain
    judged = [
        (replace(r, gain=top + e - max(evidence)), after)
        for (r, after), e in zip(simulated, evidence, strict=True)
    ]
    return sorted(judged, key=lambda pair: -pair[0].gain)
