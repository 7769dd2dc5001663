"""A strength that is estimated from variance: what it answers to, and what is reported where it does not."""

from types import SimpleNamespace

import numpy as np
import pytest

from visaug.diagnosis.fitting.parameters import Coordinate, intervals
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.uses import Use
from visaug.diagnosis.scatter import ANSWERS, VarianceStrength, scatter
from visaug.diagnosis.state import State

SIGMA = Coordinate("light_drift.sigma", True, 0.1, 1.5)
SETS, DRIFTING = 60, 30  # simulated sets; statistics that a drift moves at random, by 4 standard deviations
LATCHED = 300.0  # standard deviations by which one statistic moves, whatever the strength


def sets_of(strength: float, seed: int, latched: bool, count: int = SETS) -> np.ndarray:
    """(count, statistics) of sets that share their random numbers between strengths; the last statistic latches."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((count, DRIFTING + 1))
    drift = 4 * strength * rng.standard_normal((count, DRIFTING + 1))
    drift[:, -1] = LATCHED if latched and strength else 0.0
    return noise + drift


def use(sets: np.ndarray, measured: np.ndarray) -> Use:
    nothing = np.zeros(sets.shape[1])
    null = Null(sets - sets.mean(0), nothing + 0.1, np.zeros((sets.shape[1], 0)), np.zeros(0))
    return Use(measured - sets.mean(0), sets, null, nothing)


def told_of(true_strength: float, seed: int, latched: bool) -> VarianceStrength:
    """The estimate, by sets of strength 1, of the strength of a set."""
    measured = sets_of(true_strength, 1000 + seed, latched, 1)[0]
    before, after = (use(sets_of(c, seed, latched), measured) for c in (0.0, 1.0))
    told = scatter(before, after, (SIGMA,))
    assert told is not None
    stronger = sets_of(1.5, seed, latched) - sets_of(1.0, seed, latched).mean(0)
    return told.answering(before, after, stronger, 1.5)


def test_an_estimate_that_follows_the_strength_covers_it(stated):
    """Of 100 sets 95 are expected inside; fewer than 86 come once in 7,000 runs."""
    inside, camera = 0, stated.with_effect("light_drift", sigma=0.01)
    for seed in range(100):
        told = told_of(1.3, seed, latched=False)
        assert told.is_told
        _, low, high = intervals([SIGMA], told.estimated(camera), told.steps, told.undetermined)[SIGMA.path]
        assert low is not None
        assert high is not None
        inside += low < 0.013 < high
    assert inside >= 86


def test_a_statistic_that_no_strength_moves_further_leaves_the_strength_untold(stated):
    """It holds the estimate at 1 with next to no spread; the interval is then that of the prior, 1.96 x 1.5 in the logarithm."""
    camera = stated.with_effect("light_drift", sigma=0.01)
    told = told_of(3.0, 0, latched=True)
    assert np.log(told.of_sets).std() < 0.1
    assert told.answer < ANSWERS
    value, low, high = intervals([SIGMA], told.estimated(camera), told.steps, told.undetermined)[SIGMA.path]
    assert value == pytest.approx(0.01)
    assert np.log([low, high]) - np.log(value) == pytest.approx([-1.96 * 1.5, 1.96 * 1.5])


def test_an_estimate_that_follows_half_the_strength_is_reported_as_twice_as_far_and_twice_as_wide(stated):
    """In the logarithm."""
    camera = stated.with_effect("light_drift", sigma=0.01)
    nothing = np.zeros(0)
    reference = SimpleNamespace(
        coordinates=(), spread_steps=np.zeros((9, 0)), undetermined=nothing, priors=nothing
    )
    fitted = SimpleNamespace(
        camera=camera, reference=reference, simulation_error=nothing, by_considered=0.0, response=1.0
    )
    told = VarianceStrength(1.2, np.geomspace(0.9, 1.1, 9), (SIGMA,), in_variance=True, answer=0.5)
    state = State(fitted, ("light_drift",), None, None, (told,))  # pyrefly: ignore[bad-argument-type]
    assert state.camera.values()["light_drift.sigma"] == pytest.approx(0.01 * 1.2**2)
    _, steps, undetermined = state.numbers
    np.testing.assert_allclose(steps[:, 0], 2 * np.log(np.geomspace(0.9, 1.1, 9)))
    assert undetermined == pytest.approx([0.0])
