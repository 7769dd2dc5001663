"""The response of a fit to a true change of a parameter, and the intervals that follow from it."""

from dataclasses import replace

import numpy as np
import pytest

from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.parameters import effect_coordinates
from visaug.diagnosis.fitting.reference import Reference, SimulatedStatistics, differences
from visaug.diagnosis.response import with_responses
from visaug.diagnosis.scatter import least_response
from visaug.diagnosis.state import State, lengthened

GAINS = np.full(50, 400.0)  # of 50 statistics, in standard deviations


class Bent:
    """Sets whose statistics follow a coordinate by a share of what the reference takes for their derivatives."""

    def __init__(self, camera, share, coordinate):
        self.coordinate, self.at, self.share = coordinate, coordinate.read(camera), share

    def simulated(self, jobs, report=None):
        return [np.array([self._set(camera, number) for camera, number in jobs])] * 3

    def finding(self, jobs, report=None):
        return self.simulated(jobs)[0]

    def _set(self, camera, number):
        noise = np.random.default_rng(number).normal(size=50)
        return self.share * GAINS * (self.coordinate.read(camera) - self.at) + noise


def state_of(stated, share, accepted, prior=None):
    camera = stated.with_effect("row_noise", sigma_e=2.0)
    (coordinate,) = effect_coordinates(camera, "row_noise")
    lab = Bent(camera, share, replace(coordinate, prior=prior or coordinate.prior))
    sets = lab.simulated([(camera, k) for k in range(60)])
    samples = [SimulatedStatistics(values, GAINS[:, None], np.zeros(50)) for values in sets]
    reference = Reference(camera, (lab.coordinate,), *samples)
    nothing = np.zeros(50)
    fitted = Fitted(reference, camera, nothing, nothing, nothing)
    state = replace(State.plain(fitted, (np.zeros(50, int),) * 3), accepted=accepted)
    return with_responses(lab, state, lambda *_: None), reference  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("share", [0.5, 0.8])
def test_an_interval_is_divided_by_the_response(stated, share):
    """The sets share their random numbers, so that the response is exact."""
    state, reference = state_of(stated, share, ("row_noise",))
    _, steps, _ = state.numbers
    np.testing.assert_allclose(steps, reference.spread_steps / share, rtol=1e-2)


def test_a_parameter_that_the_fit_does_not_follow_has_the_interval_of_its_prior(stated):
    state, reference = state_of(stated, 0.1, ("row_noise",))
    _, steps, undetermined = state.numbers
    assert steps.std() == 0
    assert undetermined == pytest.approx(reference.priors)


@pytest.mark.parametrize("prior", [6e-4, 1e-3])
def test_what_the_prior_takes_of_a_step_is_no_lack_of_response(stated, prior):
    """Standard deviations of 1 / (400 sqrt(50)) = 3.5e-4 from the statistics alone."""
    state, reference = state_of(stated, 1.0, ("row_noise",), prior)
    assert reference.determined[0] == pytest.approx(1 / (1 + (3.54e-4 / prior) ** 2), rel=0.1)
    assert state.fitted.response == pytest.approx([1.0], abs=0.03)


@pytest.mark.parametrize("step", [0.15, 0.25, 5.0])
def test_steps_end_at_the_bounds_of_a_parameter(stated, step):
    """From 0.1 in [-0.1, 0.2]: 0.15 and 0.25 go downwards where they pass the upper bound, and beyond both a step is shorter."""
    camera = stated.with_effect("amplifier_glow", b_per_c=0.1)
    (coordinate,) = [c for c in effect_coordinates(camera, "amplifier_glow") if c.path.endswith("b_per_c")]
    lab = Bent(camera, 1.0, coordinate)
    sets = lab.simulated([(camera, k) for k in range(4)])
    quotients, *_ = differences(lab, camera, [coordinate], {0: step}, range(4), sets, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    np.testing.assert_allclose(quotients, 400.0)


def test_parameters_of_other_effects_are_not_simulated_again(stated):
    state, reference = state_of(stated, 0.5, ("column_noise",))
    assert state.fitted.response == 1.0
    np.testing.assert_array_equal(state.numbers[1], reference.spread_steps)


def test_a_response_within_its_error_of_one_is_one():
    assert least_response(np.array([0.8, 1.1, 0.9, 1.0])) == 1.0
    assert least_response(np.array([1.3, 1.31, 1.32, 1.3])) == 1.0
    assert least_response(np.array([0.5, 0.52, 0.48, 0.5])) == pytest.approx(0.5)
    assert least_response(np.array([-0.5, -0.52, -0.48, -0.5])) == 0.0


def test_what_trades_off_with_a_parameter_is_as_uncertain_as_that():
    """Of three parameters the second moves by -2 times the first's steps and by noise of its own, the third is independent.

    A regression on 400 sets has a standard error of 0.05 here, and the third's is taken for 0.
    """
    rng = np.random.default_rng(0)
    first, own, third = rng.normal(size=(3, 400))
    steps, priors = np.column_stack([first, own - 2 * first, third]), np.full(3, 50.0)
    longer, by_priors = lengthened(steps, np.array([0.5, 1.0, 1.0]), priors)
    np.testing.assert_allclose(longer[:, 0], 2 * first)
    assert longer[:, 1].var() == pytest.approx(1 + (2 * 2) ** 2, rel=0.25)
    np.testing.assert_array_equal(longer[:, 2], third)
    assert not by_priors.any()
    held, by_priors = lengthened(steps, np.array([0.0, 1.0, 1.0]), priors)
    assert not held[:, 0].any()
    np.testing.assert_array_equal(held[:, 1:], steps[:, 1:])
    np.testing.assert_allclose(by_priors, [50, 50, 0])  # no more than the prior of the second itself
    _, wide = lengthened(steps, np.array([0.0, 1.0, 1.0]), np.array([50.0, 500.0, 50.0]))
    np.testing.assert_allclose(wide, [50, 100, 0], rtol=0.1)


def test_a_fit_that_follows_every_parameter_keeps_its_steps():
    steps = np.random.default_rng(0).normal(size=(60, 3))
    longer, by_priors = lengthened(steps, np.ones(3), np.ones(3))
    np.testing.assert_array_equal(longer, steps)
    assert not by_priors.any()
