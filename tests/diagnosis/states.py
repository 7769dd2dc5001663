"""States and candidates made by hand."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from visaug import Camera
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.choice import Judged
from visaug.diagnosis.criterion import ODDS, SHARE
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.parameters import effect_coordinates
from visaug.diagnosis.state import State


def leaving(residual, camera: Camera, *accepted: str) -> State:
    """A state with these residuals, in standard deviations, of discovery, hold-out and all frames."""
    left = np.array(residual, float)
    coordinates = [c for name in accepted for c in effect_coordinates(camera, name)]
    steps = np.zeros((2, len(coordinates)))
    null, sample = SimpleNamespace(scale=np.ones(len(left))), SimpleNamespace(sets=None)
    reference = SimpleNamespace(
        null_scale=null.scale, coordinates=coordinates, null_steps=steps, spread_steps=steps, undetermined=steps[0], sets=None,
        find=sample, null=null, confirm=sample, confirm_null=null, whole=sample, whole_null=null,
        largest=np.linspace(2.5, 5.0, 120), camera=camera, priors=steps[0],
    )  # fmt: skip
    fitted = Fitted(reference, camera, left, left, left)  # pyrefly: ignore[bad-argument-type]
    nothing, own = np.zeros(len(left)), np.arange(len(left))  # each statistic has a view of its own
    return State(fitted, accepted, (nothing, nothing, nothing), (own, own, own))


def refined(effect: str, camera: Camera, gain: float, cost: float = 1.0) -> Refined:
    own = tuple(effect_coordinates(camera, effect))
    return Refined(effect, camera, own, np.zeros(len(own)), gain, np.zeros(4), np.zeros(4), cost)


@dataclass(frozen=True)
class Stated:
    """Evidence with a given score. Its odds decrease with the score, so that code which uses one for the other fails a test."""

    score: float
    share: float = 1.0
    cost: float = 0.0

    @property
    def odds(self) -> float:
        return 1000 - self.score if self.score > ODDS else self.score

    @property
    def is_decided(self) -> bool:
        return True

    @property
    def is_reached(self) -> bool:
        return self.share >= SHARE

    @property
    def accepts(self) -> bool:
        return self.odds > ODDS and self.is_reached


def judged(candidate: Refined, state: State, cost: float = 0.0) -> Judged:
    return Judged(candidate, state, Stated(100.0, cost=cost))  # pyrefly: ignore[bad-argument-type]
