"""Which of the refined candidates is accepted: the first that explains what it moves and improves the camera."""

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

DECISIVE = 10.0  # in log likelihood: a rival so far behind is not accepted though the first be refused
SURE = 10.0  # in log likelihood: what an effect must gain that lowers no error beside others, or is far behind its rivals
MANY = 2  # effects beside which a further one must leave nothing, or lower the error

Standing = list[tuple[Refined, State]]  # candidates with the state that each would give, the accepted first


@dataclass(frozen=True)
class Accepted:
    """An effect that was accepted, the state with it, and what stood beside (simulated too) and behind it."""

    refined: Refined
    state: State
    standing: Standing
    others: list[Refined]


@dataclass(frozen=True)
class Choice:
    """What decides between the candidates of one measured set.

    Args:
        signs: of every trial of the catalogue.
        adding: simulates and refits the camera with a candidate.
        errors: of the measured set.
    """

    lab: Laboratory
    signs: Signatures
    adding: Adding
    errors: Errors

    def accepted(self, state: State, found: list[Refined], by_chance: Chance) -> Accepted | None:
        """The first of the candidates that explains what it moves and improves the camera, its rivals simulated.

        Where one that is nearly as likely makes the camera hold and the first does not, it is that one: else a second effect would
        be looked for in what a wrong name leaves. Of those further behind, which no simulation could bring to the front, each that
        gains much is asked by itself if all rivals are refused: what these say wrongly is no reason against other moves.
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
        """A candidate with its simulated state; in other words if it does not explain what it moves, and these may.

        (Codes that are missing evenly move the same bits in every set, and fit better than the random ones that they stand for.)
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
        """Whether a simulated candidate is accepted; if not it joins the refused, with what it moves."""
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
        """Whether one that was refused says the same as a candidate with these moves, and more."""
        return any(
            candidate.gain < other.gain - DECISIVE and says_the_same(state, moves, others)
            for other, others in refused
        )

    def _improves(self, before: State, after: State, gain: float, by_chance: Chance) -> bool:
        both = ((before.fitted, after.fitted), (after.fitted, before.fitted))
        pairs = [(self.errors.found(x, y), self.errors.confirmed(x, y)) for x, y in both]
        # by the refit, where the camera's own numbers follow the effect far; by the effect itself, where they hide it
        taken = [before.fitted.whole_residual - after.fitted.whole_residual]
        taken += [] if after.moves is None else [self.lab.whole_of(after.moves)]
        beyond = any(by_chance.p_value_of(way) <= SIGNIFICANT for way in taken)
        again, in_order = is_there_again(before, after), disturbs_nothing(before, after)
        has_a_case = beyond and _has_a_case(self.lab.statistics, before, after, gain, again)
        asked = ~is_anothers(before, after)
        own = [self.errors.found(x, y, asked) for x, y in both]
        falls = own[0] is not None and own[1] is not None and own[1].high < own[0].value
        # tracks lie elsewhere in the hold-out frames, along no moves, but scatter there as they do here
        falls &= again or (in_order and scatters_again(before.fitted, after.fitted))
        return improves(pairs[0], pairs[1], not before.accepted, beyond, has_a_case, again, in_order, falls)

    def holds(self, state: State) -> bool:
        """Whether a camera leaves no more than chance would."""
        return chance(self.lab, self.signs, state).p_value > SIGNIFICANT


def _has_a_case(
    statistics: Sequence[Statistic], before: State, after: State, gain: float, again: bool
) -> bool:
    """Whether an effect gains enough where the effects before it move next to nothing, or leaves nothing.

    Beside two effects both: of what their forms leave here and there a third one's moves are always like a part.
    """
    completes = _completes(before, after, again)
    sure = gain > SURE and (len(before.accepted) < MANY or after.p_value > SIGNIFICANT)
    return (sure or completes) and acts_elsewhere(statistics, before, after, completes)


def _completes(before: State, after: State, again: bool) -> bool:
    """Whether nothing is left with a second effect. (Asked after every effect that would be by chance too often.)

    What stood out stands out no more. Where nothing did, and only all along the effect's moves together, the form of the first may
    have left that: then the hold-out frames must show it too (`again`).
    """
    stood_out = before.p_value <= SIGNIFICANT
    return len(before.accepted) == 1 and after.p_value > SIGNIFICANT and (stood_out or again)


def _moves_of(state: State, candidate: Refined) -> np.ndarray:
    """How far a candidate that was not simulated in full moves each statistic of the discovery frames."""
    return state.fitted.residual - candidate.residual
