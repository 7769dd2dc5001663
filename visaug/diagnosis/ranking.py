"""The reported candidates: the probability of each, its parameters, and which of them these frames do not distinguish."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from visaug.comparison import Distance, Error
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.naming import CLOSE
from visaug.diagnosis.reference import Report
from visaug.diagnosis.refinement import Refined
from visaug.diagnosis.result import Ranked, estimates
from visaug.diagnosis.separate import measurement
from visaug.fingerprint import Statistic

UNCLEAR = 14.0  # log-likelihood difference within which simulated rivals are ambiguous: twice its assumed uncertainty
TEMPER = (
    4.0  # divides log-likelihood differences for the odds: with 12, known to 7, the sign is wrong once in 20
)


class Ranking:
    """The candidates of all steps so far, each with its last result; an accepted one keeps that of its own step.

    Args:
        distance: on the discovery frames.
        at_hand: statistics of all frames.
    """

    def __init__(self, distance: Distance, at_hand: Sequence[Statistic]):
        self._distance, self._at_hand = distance, at_hand
        self._ranked: dict[str, Ranked] = {}
        self.ambiguous: list[dict[str, Any]] = []

    @property
    def ranked(self) -> tuple[Ranked, ...]:
        """The most probable first."""
        return tuple(sorted(self._ranked.values(), key=lambda r: -r.probability))

    def standings(self) -> dict[str, Ranked]:
        """A copy for `restore`."""
        return dict(self._ranked)

    def restore(self, standings: dict[str, Ranked]) -> None:
        self._ranked = dict(standings)

    def rank(self, state: State, refined: Sequence[Refined]) -> None:
        """Candidates for the next effect of a state, the best first."""
        top = refined[0].gain
        weights = np.exp([max((r.gain - top) / TEMPER, -700.0) for r in refined])
        for r, weight in zip(refined, weights / weights.sum(), strict=True):
            if r.effect in self._ranked and r.effect in state.accepted:
                continue
            spread = np.sqrt(state.fitted.reference.null_scale**2 + r.variance)
            error = self._distance.error(state.fitted.reference.sets, r.residual, spread)
            own = estimates(r.effect, r.camera, r.coordinates)
            value = None if error is None else error.value
            self._ranked[r.effect] = Ranked(r.effect, float(weight), value, own)

    def accept(self, after: State, effect: str, error: Error | None) -> None:
        """Adds intervals of an accepted effect's parameters, from simulated sets of the camera with it."""
        forms = {
            path.split(".", 1)[1]: word
            for path, word in after.fitted.camera.choices().items()
            if path.startswith(f"{effect}.")
        }
        self._ranked[effect] = replace(
            self._ranked[effect],
            parameters=estimates(effect, after.fitted.camera, *after.numbers),
            forms=forms,
            error_after=None if error is None else error.value,
        )

    def rename(self, effect: str, rival: str) -> None:
        """Gives a rival the probability of the effect that it replaces."""
        one, other = self._ranked[effect], self._ranked[rival]
        self._ranked[rival] = replace(other, probability=one.probability)
        self._ranked[effect] = replace(one, probability=other.probability)

    def note_ambiguous(self, simulated: Sequence[Refined], others: Sequence[Refined], report: Report) -> None:
        """Notes the candidates that these frames do not distinguish from the first, and the measurement that would.

        Simulated candidates have a likelihood from their own sets after their own refit, and the wider limit `UNCLEAR`. Others are
        compared with the likelihood by which the first was found.
        """
        best = simulated[0].gain
        close = [r for r in simulated if best - r.gain < UNCLEAR]
        close += [r for r in others if best - r.gain < CLOSE]
        if len(close) > 1:
            cameras = {r.effect: r.camera for r in close}
            self.ambiguous.append(
                {"effects": list(cameras), "measure": measurement(cameras, self._at_hand, report)}
            )
