"""Choice between refined candidates: the one with the largest posterior odds, if the criterion accepts it."""

from collections.abc import Sequence
from dataclasses import dataclass

from visaug.diagnosis.adding import Adding
from visaug.diagnosis.criterion import Evidence, evidence
from visaug.diagnosis.refinement import Refined
from visaug.diagnosis.state import State

CLOSE = 0.25  # share of the best gain within which candidates are rivals
RIVALS = 3  # number of rivals that are simulated together


@dataclass(frozen=True)
class Judged:
    """A candidate with its simulated state and its evidence."""

    refined: Refined
    state: State
    evidence: Evidence

    @property
    def odds(self) -> float:
        return self.evidence.odds


@dataclass(frozen=True)
class Accepted:
    """An accepted effect; `standing` are the candidates that were accepted too, itself first, `others` all that were not."""

    standing: list[Judged]
    others: list[Refined]

    @property
    def best(self) -> Judged:
        return self.standing[0]


def accepted(state: State, found: Sequence[Refined], adding: Adding) -> Accepted | None:
    """The most probable candidate, if the criterion accepts it; None otherwise.

    Candidates are simulated a few at a time, the largest gain first, until the most probable one so far is accepted. If it is
    refused, so are all less probable ones: part of what it explains would pass for theirs.

    Args:
        found: candidates, the largest gain first.
    """
    tried: list[Judged] = []
    rest = [r for r in found if r.gain > 0]
    while rest:
        close = [r for r in rest if r.gain > (1 - CLOSE) * rest[0].gain][:RIVALS]
        rest = rest[len(close) :]
        for r in close:
            forms = [r] if r.otherwise is None else [r, r.otherwise]
            judged = [_judged(state, form, adding) for form in forms]
            tried.append(max(judged, key=lambda one: (one.evidence.accepts, one.odds)))
        tried.sort(key=lambda one: -one.odds)
        if tried[0].evidence.accepts:
            standing = [one for one in tried if one.evidence.accepts]
            names = {one.refined.effect for one in standing}
            return Accepted(standing, [r for r in found if r.effect not in names])
    return None


def _judged(state: State, candidate: Refined, adding: Adding) -> Judged:
    after = adding.sketched(state, candidate)
    if not adding.is_hopeless(state, candidate, after):
        after = adding.completed(state, candidate, after)
    return Judged(candidate, after, evidence(state, after, len(candidate.coordinates)))
