"""Choice between refined candidates: the most probable one, if the criterion accepts it."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from visaug.camera.paths import place_of
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.criterion import ODDS, Evidence, between, evidence
from visaug.diagnosis.result import FittedValue, estimates
from visaug.diagnosis.state import State
from visaug.effects import catalogue

CLOSE = 0.25  # share of the best gain within which candidates are rivals
RIVALS = 3  # number of rivals that are simulated together


@dataclass(frozen=True)
class Judged:
    """A candidate with its simulated state and its evidence.

    Attributes:
        otherwise: the same effect with other options or values, if these are accepted too and about as probable.
    """

    refined: Refined
    state: State
    evidence: Evidence
    otherwise: "Judged | None" = None

    @property
    def has_idle_part(self) -> bool:
        """Whether one of its fitted strengths is 0: an effect without it would explain as much."""
        values = self.state.fitted.camera.values()
        return any(
            values[c.path] == 0 for c in self.refined.coordinates if place_of(c.path).parameter.strength
        )

    @cached_property
    def becomes(self) -> str | None:
        """An effect of which this one is a special case as far as these frames tell: they do not show what sets it apart."""
        effect, camera = self.refined.effect, self.state.camera
        told = estimates(effect, camera, *self.state.numbers)
        values = camera.values() | camera.choices()
        for case, other in catalogue()[effect].special_cases:
            if all(
                _holds(told[key], value) if key in told else values[f"{effect}.{key}"] == value
                for key, value in case.items()
            ):
                return other
        return None

    @property
    def accepts(self) -> bool:
        """Whether the criterion accepts the effect, and the frames show what sets it apart from others."""
        return self.evidence.accepts and self.becomes is None

    def stands_before(self, named: Collection[str]) -> bool:
        """Whether one with a smaller score cannot be named: this one is accepted, or what it explains is none of theirs.

        Args:
            named: effects that are accepted, or that the camera has.
        """
        if self.evidence.accepts:
            return self.becomes not in named
        return not self.evidence.is_reached


def _holds(told: FittedValue, value: float) -> bool:
    """Whether the 95 % interval of a fitted parameter holds a value.

    Of a logarithm, which has no 0, the interval holds it if it reaches to a factor of e to each side: 1.96 relative standard
    deviations are more than 1 then.
    """
    if math.isclose(told.value, value):
        return True
    if told.low is None or told.high is None:
        return False
    if value == 0 < told.low:
        return told.high / told.low > math.e**2
    return told.low <= value <= told.high


@dataclass(frozen=True)
class Accepted:
    """An accepted effect.

    Attributes:
        standing: the candidates that were accepted, the most probable first, then refused ones that are about as probable.
        odds: log posterior odds of each of these against the first.
        others: all further candidates.
    """

    standing: tuple[Judged, ...]
    odds: list[float]
    others: list[Refined]

    @property
    def best(self) -> Judged:
        return self.standing[0]


def accepted(state: State, found: Sequence[Refined], adding: Adding) -> Accepted | None:
    """The most probable candidate, if the criterion accepts the one with the largest score; None otherwise.

    Candidates are simulated a few at a time, the largest gain first, until the one with the largest score so far is accepted. If
    it is refused since it falls short of what it would explain as the cause, so are all others: part of what it explains would
    pass for theirs. One that is refused since the frames do not show what sets it apart stands back where the effect that it is
    then is accepted, or is there, and else none is accepted either. One that is refused for its odds alone, having more parameters
    than the frames tell, stands back for others.

    Args:
        found: candidates, the largest gain first.
    """
    tried: list[Judged] = []
    present = set(state.fitted.camera.effect_names)
    rest = [r for r in found if r.gain > 0]
    while rest:
        close = [r for r in rest if r.gain > (1 - CLOSE) * rest[0].gain][:RIVALS]
        rest = rest[len(close) :]
        for r in close:
            forms = [r] if r.otherwise is None else [r, r.otherwise]
            best, *others = sorted(
                (_judged(state, form, adding) for form in forms),
                key=lambda one: (one.accepts, one.evidence.score),
                reverse=True,
            )
            alike = [one for one in others if one.accepts and one.evidence.score > best.evidence.score - ODDS]
            tried.append(replace(best, otherwise=alike[0]) if alike else best)
        named = {one.refined.effect for one in tried if one.accepts} | present
        ahead = [one for one in tried if one.stands_before(named)]
        first = max(ahead or tried, key=lambda one: one.evidence.score)
        if first.accepts:
            return _chosen(state, first, tried, found)
    return None


def _chosen(state: State, first: Judged, tried: list[Judged], found: Sequence[Refined]) -> Accepted:
    """The accepted candidates by their odds against the one with the largest score, which another replaces only beyond doubt.

    One that is less than `ODDS` more probable counts as equally probable. Of equally probable ones those with a strength of 0 are
    last. A refused one, which explains less than it would as the cause, is a rival too if it is better than nothing and not
    `ODDS` less probable than the accepted one: another cause can move both ratios.
    """
    standing = [one for one in tried if one.accepts]
    odds = np.array([0.0 if one is first else odds_between(state, one, first) for one in standing])
    beyond = odds.max() if odds.max() > ODDS else 0.0
    odds = np.minimum(odds - beyond, 0.0)
    order = sorted(
        range(len(standing)), key=lambda k: (-odds[k], standing[k].has_idle_part, standing[k] is not first)
    )
    ranked = [(standing[k], float(odds[k])) for k in order]
    for one in tried:
        if one.becomes is None and not one.accepts and one.evidence.odds > ODDS:
            against = min(odds_between(state, one, ranked[0][0]), 0.0)
            if against > -ODDS:
                ranked.append((one, against))
    names = {one.refined.effect for one, _ in ranked}
    return Accepted(
        tuple(one for one, _ in ranked),
        [odds for _, odds in ranked],
        [r for r in found if r.effect not in names],
    )


def odds_between(state: State, one: Judged, other: Judged) -> float:
    """Log posterior odds of one candidate for the next effect of a state against another."""
    return between(state, one.state, other.state) + other.evidence.cost - one.evidence.cost


def _judged(state: State, candidate: Refined, adding: Adding) -> Judged:
    after = adding.with_candidate(state, candidate)
    return Judged(candidate, after, evidence(state, after, len(candidate.coordinates), adding.effects))
