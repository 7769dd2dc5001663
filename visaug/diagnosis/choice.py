"""Choice between refined candidates: the first that passes the acceptance tests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.comparison import Laboratory
from visaug.diagnosis.acceptance import (
    OFF,
    State,
    acts_elsewhere,
    disturbs_nothing,
    explains,
    improves,
    is_anothers,
    is_there_again,
    moves_of,
    says_the_same,
)
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.chance import Chance, chance
from visaug.diagnosis.errors import Errors
from visaug.diagnosis.naming import CLOSE, SIGNIFICANT, decided, is_beyond, rivals
from visaug.diagnosis.refinement import Refined
from visaug.diagnosis.signatures import Signatures
from visaug.diagnosis.spread import recurs_so, scatters_again
from visaug.fingerprint import Statistic

DECISIVE = 10.0  # log likelihood: a candidate so far behind is not accepted even if the best one is refused
SURE = 10.0  # least log-likelihood gain of an effect that lowers no error, or is far behind the best
MANY = 2  # with so many effects accepted, a further one must make the camera adequate or lower the error

Standing = list[tuple[Refined, State]]  # candidates with the state of each, the accepted first


@dataclass(frozen=True)
class Accepted:
    """An accepted effect with its state; `standing` are the candidates that were simulated, `others` those that were not."""

    refined: Refined
    state: State
    standing: Standing
    others: list[Refined]


@dataclass(frozen=True)
class Choice:
    """Decides between the candidates of one measured set.

    Args:
        lab: of the measured frames.
        signs: signatures of every trial of the catalogue.
        adding: simulates and refits the camera with a candidate.
        errors: of the measured set.
    """

    lab: Laboratory
    signs: Signatures
    adding: Adding
    errors: Errors

    def accepted(self, state: State, found: list[Refined], by_chance: Chance) -> Accepted | None:
        """The first candidate that passes the acceptance tests, and the simulated states of its rivals; None if there is none.

        If the camera with the first is not adequate, and with another one of almost the same likelihood it is, that one is
        accepted: otherwise a second effect would be fitted to the residuals of a wrong first one. If all rivals are refused,
        each candidate further behind that gains much is tested by itself, unless its shift is parallel to that of a refused,
        more likely one.
        """
        close = rivals(self.lab, found, state, by_chance)
        simulated = [self._simulated(state, r) for r in close]
        ordered = decided(
            self.lab.statistics, state, [(r, after) for r, after in simulated if after is not None]
        )
        behind = [r for r in found if r.effect not in {other.effect for other in close}]
        refused: list[tuple[Refined, np.ndarray]] = []
        accepted = [pair for pair in ordered if self._is_acceptable(state, pair, refused, by_chance)]
        if accepted:
            best = first = accepted[0]
            alike = [pair for pair in accepted if pair[0].gain > first[0].gain - CLOSE]
            if len(alike) > 1:
                best = next((pair for pair in alike if self.holds(pair[1])), first)
            place = next(i for i, pair in enumerate(ordered) if pair is first)
            least = best[0].gain - DECISIVE
            nothing = [replace(r, gain=min(r.gain, least)) for r, after in simulated if after is None]
            standing = [best, *(pair for pair in ordered[place:] if pair is not best)]
            return Accepted(*best, standing, [*nothing, *behind])
        refused += [(r, _moves_of(state, r)) for r, after in simulated if after is None]
        for r in behind:
            is_said = self._is_said(state, r, _moves_of(state, r), refused)
            if r.gain > SURE and not is_said and is_beyond(self.lab, by_chance, state, r):
                asked, after = self._simulated(state, r)
                if after is None:
                    refused.append((r, _moves_of(state, r)))
                elif self._is_acceptable(state, (asked, after), refused, by_chance):
                    others = [other for other in behind if other is not r]
                    return Accepted(asked, after, [(asked, after)], others)
        return None

    def _simulated(self, state: State, candidate: Refined) -> tuple[Refined, State | None]:
        """A candidate with its simulated state, with its second-best options where only those may explain the residuals.

        For example, missing codes at regular distances shift the same bits in every set and fit better than the random ones
        that are measured.
        """
        after = self.adding.where_promising(state, candidate)
        other = candidate.otherwise
        if other is None or (after is not None and explains(self.lab.statistics, state, after)):
            return candidate, after
        reworded = self.adding.where_promising(state, other)
        return (candidate, after) if reworded is None else (other, reworded)

    def _is_acceptable(
        self,
        state: State,
        candidate: tuple[Refined, State],
        refused: list[tuple[Refined, np.ndarray]],
        by_chance: Chance,
    ) -> bool:
        """Whether a simulated candidate passes the tests; otherwise it is appended to the refused, with its shift."""
        r, after = candidate
        moves = moves_of(state, after)
        accepted = (
            not self._is_said(state, r, moves, refused)
            and explains(self.lab.statistics, state, after)
            and recurs_so(state.fitted, after.fitted, np.abs(state.z) > OFF, self.lab.confirming)
            and self._improves(state, after, r.gain, by_chance)
        )
        if not accepted:
            refused.append((r, moves))
        return accepted

    @staticmethod
    def _is_said(
        state: State, candidate: Refined, moves: np.ndarray, refused: Sequence[tuple[Refined, np.ndarray]]
    ) -> bool:
        """Whether a refused candidate of higher likelihood has a parallel shift."""
        return any(
            candidate.gain < other.gain - DECISIVE and says_the_same(state, moves, others)
            for other, others in refused
        )

    def _improves(self, before: State, after: State, gain: float, by_chance: Chance) -> bool:
        both = ((before.fitted, after.fitted), (after.fitted, before.fitted))
        pairs = [(self.errors.found(x, y), self.errors.confirmed(x, y)) for x, y in both]
        # The difference of the fits where the refit follows the effect far; its own shift where the refit compensates it.
        taken = [before.fitted.whole_residual - after.fitted.whole_residual]
        taken += [] if after.moves is None else [self.lab.whole_of(after.moves)]
        beyond = any(by_chance.p_value_of(way) <= SIGNIFICANT for way in taken)
        again, in_order = is_there_again(before, after), disturbs_nothing(before, after)
        has_a_case = beyond and _has_a_case(self.lab.statistics, before, after, gain, again)
        asked = ~is_anothers(before, after)
        own = [self.errors.found(x, y, asked) for x, y in both]
        falls = own[0] is not None and own[1] is not None and own[1].high < own[0].value
        # Tracks of cosmic rays have other places in the hold-out frames: no common shift, but the same variance.
        falls &= again or (in_order and scatters_again(before.fitted, after.fitted))
        return improves(pairs[0], pairs[1], not before.accepted, beyond, has_a_case, again, in_order, falls)

    def holds(self, state: State) -> bool:
        """Whether the camera is adequate: its largest residual is not significant."""
        return chance(self.lab, self.signs, state).p_value > SIGNIFICANT


def _has_a_case(
    statistics: Sequence[Statistic], before: State, after: State, gain: float, again: bool
) -> bool:
    """Whether an effect gains enough likelihood where the earlier effects shift almost nothing, or makes the camera adequate.

    After two effects both are required: a third shift is always similar to some combination of what two forms leave.
    """
    completes = _completes(before, after, again)
    sure = gain > SURE and (len(before.accepted) < MANY or after.p_value > SIGNIFICANT)
    return (sure or completes) and acts_elsewhere(statistics, before, after, completes)


def _completes(before: State, after: State, again: bool) -> bool:
    """Whether the camera is adequate with a second effect; asked of every effect, this would raise the false-alarm rate.

    If no single statistic deviated before, but only the sum along the effect's shift, the form of the first effect may be the
    cause: then the hold-out frames must confirm the effect (`again`).
    """
    stood_out = before.p_value <= SIGNIFICANT
    return len(before.accepted) == 1 and after.p_value > SIGNIFICANT and (stood_out or again)


def _moves_of(state: State, candidate: Refined) -> np.ndarray:
    """(statistics,) shift of the discovery frames by a candidate that was not simulated in full."""
    return state.fitted.residual - candidate.residual
