"""What is told of the candidates: how probable each is, its numbers, and which of them these frames cannot tell apart."""

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

UNCLEAR = 14.0  # log likelihood within which simulated rivals are told as ambiguous: twice what it is taken as known to,
TEMPER = 4.0  # and by what differences are divided for odds: of 12, known to 7, the sign is wrong once in 20


class Ranking:
    """The candidates of all steps so far, each by its last standing; an accepted one keeps that of its own step.

    Args:
        distance: on the frames that find.
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
        """To come back to by `restore`."""
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
        """Intervals of an accepted effect's numbers, from simulated sets of the camera that has it."""
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
        """Gives a rival the standing of the effect whose place it takes."""
        one, other = self._ranked[effect], self._ranked[rival]
        self._ranked[rival] = replace(other, probability=one.probability)
        self._ranked[effect] = replace(one, probability=other.probability)

    def note_ambiguous(self, simulated: Sequence[Refined], others: Sequence[Refined], report: Report) -> None:
        """Those that these frames cannot tell from the first of the simulated, and the measurement that would.

        Each of the simulated is judged by a law from sets of its own, after a refit of its own: of seven names whose rival was 8 to
        15 behind four were wrong. What was not simulated is judged by the law that the first was found by.
        """
        best = simulated[0].gain
        close = [r for r in simulated if best - r.gain < UNCLEAR]
        close += [r for r in others if best - r.gain < CLOSE]
        if len(close) > 1:
            cameras = {r.effect: r.camera for r in close}
            self.ambiguous.append(
                {"effects": list(cameras), "measure": measurement(cameras, self._at_hand, report)}
            )
