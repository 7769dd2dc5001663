"""Uncertainty by parameters that are considered and not fitted."""

import math
from dataclasses import replace

import numpy as np
import pytest

from visaug.diagnosis.considered import considered, considering
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.parameters import effect_coordinates, place_is_held
from visaug.diagnosis.fitting.reference import Reference, SimulatedStatistics
from visaug.diagnosis.result import estimates
from visaug.diagnosis.state import State
from visaug.effects import Parameter

SHARE, WIDTH, SURROUND = np.eye(3)[:, :, None] * np.full(
    20, 40.0
)  # shifts of 60 statistics, in standard deviations
SLOPES = np.stack([SHARE.ravel(), WIDTH.ravel()], 1)  # per unit of the logarithm of share and of width


class Halo:
    """Statistics of which the surround changes some as the share does and others as nothing else does.

    A surround that is darker by 1 lowers the first by as much as a share that is less by 0.3 in its logarithm.
    """

    def __init__(self, camera):
        self.first = camera.values()

    def finding(self, jobs, report=None):
        return np.array([self._set(camera.values(), number) for camera, number in jobs])

    def _set(self, values, number):
        share, width = (
            math.log(values[p] / self.first[p]) for p in ("veiling_glare.share", "veiling_glare.width_px")
        )
        surround = values["veiling_glare.surround"] - self.first["veiling_glare.surround"]
        noise = np.random.default_rng(number).normal(size=60)
        return SLOPES @ [share + 0.3 * surround, width] + 0.01 * surround * SURROUND.ravel() + noise


def state_of(stated, accepted, **values):
    camera = stated.with_effect("veiling_glare", share=0.02, width_px=30.0, **values)
    coordinates = tuple(effect_coordinates(camera, "veiling_glare"))
    lab = Halo(camera)
    sets = lab.finding([(camera, k) for k in range(60)])
    sample = SimulatedStatistics(sets, SLOPES, np.zeros(60))
    reference = Reference(camera, coordinates, sample, sample, sample)
    nothing = np.zeros(60)
    fitted = Fitted(reference, camera, nothing, nothing, nothing)
    state = State.plain(fitted, (np.zeros(60, int),) * 3)
    return considering(lab, replace(state, accepted=accepted))  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    "surround", [1.0, 0.2]
)  # from the second, the standard deviation below is out of bounds
def test_intervals_contain_what_the_light_beyond_the_frame_changes(stated, surround):
    """0.3 of the share's logarithm for a standard deviation of 1 of the surround, beside what the noise of the sets gives."""
    state = state_of(stated, ("veiling_glare",), surround=surround)
    by_share, by_width = state.fitted.by_considered
    assert by_share == pytest.approx(0.3, rel=0.01)
    assert by_width == pytest.approx(0.0, abs=0.003)
    share = estimates("veiling_glare", state.camera, *state.numbers)["share"]
    assert share.value == pytest.approx(0.02)
    assert share.low == pytest.approx(0.02 * math.exp(-1.96 * 0.3), rel=0.02)
    assert share.high == pytest.approx(0.02 * math.exp(1.96 * 0.3), rel=0.02)


def test_nothing_is_simulated_for_effects_that_were_not_accepted(stated):
    state = state_of(stated, ())
    assert state.fitted.by_considered == 0.0
    assert considered("row_noise") == {}


def test_a_considered_parameter_is_never_fitted():
    """Fitted as well, it would take up its own change, and nothing would be left for the others."""
    for own in (Parameter(1.0, unknown=1.0, trials=(0.2,)), Parameter(1.0, unknown=1.0, strength=True)):
        assert place_is_held(own)
        assert not place_is_held(replace(own, unknown=0.0))
