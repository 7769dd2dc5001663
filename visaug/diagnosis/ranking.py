"""The reported candidates: the probability of each, its parameters, and which of them these frames do not distinguish."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.choice import Accepted, Judged
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.fitting.reference import Report
from visaug.diagnosis.result import Ranked, estimates
from visaug.diagnosis.separate import measurement
from visaug.diagnosis.state import State
from visaug.statistics import Statistic
from visaug.statistics.distance import Distance, Error


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

    def rank(self, state: State, refined: Sequence[Refined], odds: Sequence[float]) -> None:
        """Candidates for the next effect of a state, with their log posterior odds up to a constant."""
        weights = np.exp(np.maximum(np.array(odds) - max(odds), -700.0))
        for r, weight in zip(refined, weights / weights.sum(), strict=True):
            if r.effect in self._ranked and r.effect in state.accepted:
                continue
            spread = np.sqrt(state.fitted.reference.null_scale**2 + r.variance)
            error = self._distance.error(state.fitted.reference.sets, r.residual, spread)
            own = estimates(r.effect, r.camera, r.coordinates)
            value = None if error is None else error.value
            self._ranked[r.effect] = Ranked(r.effect, float(weight), value, own)

    def choose(self, before: State, chosen: Accepted, error: Error | None, report: Report) -> None:
        """Ranks the candidates of a step in which one was accepted, and notes its rivals.

        A refused candidate is less probable than the accepted one, and by as much as its gain is less.
        """
        best, top = chosen.best, max(r.gain for r in (chosen.best.refined, *chosen.others))
        standing = [j.refined for j in chosen.standing]
        refused = -ODDS - np.log(max(len(chosen.others), 1))  # all together one in twenty
        behind = [refused + min(r.gain - top, 0.0) for r in chosen.others]
        self.rank(before, [*standing, *chosen.others], [*chosen.odds, *behind])
        self.accept(best.state, best.refined.effect, error)
        close = [r for r, odds in zip(standing, chosen.odds, strict=True) if odds > -ODDS]
        if len(close) > 1:
            cameras = {r.effect: r.camera for r in close}
            self.ambiguous.append(
                {"effects": list(cameras), "measure": measurement(cameras, self._at_hand, report)}
            )

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

    def swap(self, own: Judged, rival: Judged) -> None:
        """Gives a rival the probability of the effect that it replaces."""
        one, other = self._ranked[own.refined.effect], self._ranked[rival.refined.effect]
        self._ranked[rival.refined.effect] = replace(other, probability=one.probability)
        self._ranked[own.refined.effect] = replace(one, probability=other.probability)
