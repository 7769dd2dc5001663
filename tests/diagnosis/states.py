"""States and candidates made by hand, for what decides between them."""

from types import SimpleNamespace

import numpy as np

from visaug import Camera
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.parameters import effect_coordinates
from visaug.diagnosis.refinement import Refined


def leaving(residual, camera: Camera, *accepted: str) -> State:
    left = np.array(residual, float)
    coordinates = [c for name in accepted for c in effect_coordinates(camera, name)]
    steps = np.zeros((2, len(coordinates)))
    reference = SimpleNamespace(
        null_scale=np.ones(len(left)), coordinates=coordinates, null_steps=steps, untold=steps[0]
    )
    fitted = Fitted(reference, camera, left, left, left)  # pyright: ignore[reportArgumentType]
    return State(fitted, accepted, np.zeros(len(left)), np.zeros(len(left)))


def refined(effect: str, camera: Camera, gain: float, cost: float) -> Refined:
    own = tuple(effect_coordinates(camera, effect))
    return Refined(effect, camera, own, np.zeros(len(own)), gain, np.zeros(4), np.zeros(4), cost)
