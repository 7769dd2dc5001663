"""Effects that scatter more than they move: how strong they are, and whether what is off scatters so."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.diagnosis.residuals import spread, state
from tests.diagnosis.small import frame_set
from visaug.diagnosis import diagnose
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.parameters import Coordinate
from visaug.diagnosis.reference import Null
from visaug.diagnosis.spread import (
    moves_are_there,
    only_covers,
    recurs_so,
    scatter,
    scatters_again,
    scatters_so,
)

SIGMA = (Coordinate("light_drift.sigma", True, 0.1, 1.5),)
STILL = np.zeros(6)


def test_what_scatters_together_must_be_off_together():
    """A lamp that hardly wanders puts all levels high or low; a curved response puts some high and some low."""
    before = state([30.0] * 6)

    def so(z, scale: float, together: float = 0.0, moves=STILL) -> bool:
        after = spread(state(z), scale, together)
        return scatters_so(before.fitted, after.fitted, moves, after.allowance)

    assert so([20.0] * 6, 20.0, 0.99)
    assert not so([30.0, -30.0] * 3, 20.0, 0.99)
    assert so([30.0, -30.0] * 3, 20.0)  # where each is drawn by itself
    assert so([30.0, -30.0] * 3, 1.0, 0.99)  # no spread of its own
    assert so([30.0, -30.0] * 3, 20.0, 0.99, np.full(6, 90.0))  # it moves them further than it scatters them
    assert so(
        [20.0] * 4 + [-450.0, 450.0], 20.0, 0.99
    )  # the last two are none of its: a lamp's levels beside noise of rows
    assert not so([30.0, -30.0] * 2 + [-450.0, 450.0], 20.0, 0.99)


def test_a_spread_over_what_stays_off_only_covers_it():
    """Tracks of cosmic rays in the place of hot pixels: any residual is one of theirs, and none is brought back."""
    before, off = state([30.0] * 3).fitted, np.ones(3, bool)
    assert only_covers(before, spread(state([28.0] * 3), 20.0).fitted, off)
    assert not only_covers(before, spread(state([15.0] * 3), 20.0).fitted, off)
    assert not only_covers(before, spread(state([28.0] * 3), 1.0).fitted, off)  # no spread of its own
    lamp = state([72.0, 72.0, 450.0]).fitted  # rows that share noise, beside a lamp that they widen a little
    assert not only_covers(lamp, spread(state([0.1, 0.1, 450.0]), 2.0).fitted, off)


def test_what_scatters_is_seen_again_where_the_frames_that_confirm_are_off_within_its_spread():
    """Tracks of cosmic rays lie elsewhere in other frames; that they are there is told by how far these are off."""

    def again(was: list[float], left: list[float], scale: float) -> bool:
        after = spread(state(left), scale)
        after.fitted.reference.confirm_null = after.fitted.reference.null
        return scatters_again(state(was).fitted, after.fitted)

    far, left = [60.0] * 4, [50.0, -20.0, 40.0, 10.0]
    assert again(far, left, 20.0)
    assert not again([0.5] * 4, left, 20.0)  # these frames are in order
    assert not again(far, left, 1.0)  # no spread of its own
    assert not again(far, [250.0, -200.0, 40.0, 10.0], 20.0)  # beyond it
    assert not again([60.0, 60.0, 1.0, 1.0], left, 20.0)  # two statistics are a coincidence


def test_what_lies_elsewhere_in_every_frame_is_not_off_alike_in_all():
    """A bright corner in the place of cosmic rays: within the spread of their tracks, but so in all frames."""
    places = np.arange(20)
    before, off, same = state([30.0] * 20).fitted, np.ones(20, bool), (places, places)
    pattern = np.where(places % 3, 30.0, -27.0)

    def so(confirm, is_fixed: bool = False, scale: float = 20.0, off=off) -> bool:
        after = spread(state(pattern), scale).fitted
        after.confirm_residual, null = np.array(confirm), after.reference.null
        # each set paired with another, so that what is in the one is not in the other
        fresh = replace(null, residuals=null.residuals[::-1])
        after.reference.confirm_null = null if is_fixed else fresh
        return recurs_so(before, after, off, same)

    assert not so(0.9 * pattern)
    assert so(np.roll(pattern, 1))  # other places
    assert so(0.9 * pattern, is_fixed=True)  # an effect that is so in all frames
    assert so(0.9 * pattern, scale=1.0)  # no spread of its own
    assert so(0.9 * pattern, off=~off)  # nothing was off


def test_a_mean_that_few_sets_make_is_no_place_to_count_signs_from():
    """Where few sets of a hundred have the tracks that make the spread, most others lie below their mean, in both uses."""
    places, rng = np.arange(12), np.random.default_rng(8)
    before, off = state([30.0] * 12).fitted, np.ones(12, bool)
    after = spread(state([28.0] * 12), 20.0).fitted
    after.confirm_residual = np.full(12, 25.0)

    def rare() -> Null:
        sets = rng.lognormal(0.0, 2.0, (100, 12))
        return Null(20 * (sets - sets.mean(0)), np.ones(12), np.zeros((12, 0)), np.ones(0))

    null = after.reference.null = rare()
    after.reference.null_scale, after.reference.confirm_null = null.scale, rare()
    assert (np.sign(null.residuals).sum(1) == -12).any()
    assert not recurs_so(before, after, off, (places, places))


@pytest.mark.parametrize("true", [0.5, 1.0, 4.0])
def test_the_square_of_what_is_off_tells_the_strength(true):
    """400 draws of ten levels that scatter `true` times as far as simulated: the mean square is chi-squared, 4000 degrees.

    False alarms: 1e-3.
    """
    before, rng = state([0.0] * 10), np.random.default_rng(3)
    after = spread(state([0.0] * 10), 20.0)
    own = after.fitted.reference.null_scale
    squares = []
    for _ in range(400):
        after.fitted.residual[:] = np.sqrt(true**2 * (own**2 - 1) + 1) * rng.standard_normal(10)
        told = scatter(before.fitted, after.fitted, np.zeros(10), SIGMA)
        assert told is not None
        squares.append(told.factor**2)
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 4000) / 4000
    assert low < np.mean(squares) / true**2 < high


def test_its_uncertainty_is_that_of_simulated_sets():
    """Of ten independent levels the square has 10 degrees of freedom: the factor's central 95 % are sqrt(chi2 / 10)."""
    after = spread(state([20.0] * 10), 20.0)
    told = scatter(state([0.0] * 10).fitted, after.fitted, np.zeros(10), SIGMA)
    assert told is not None
    assert told.tells
    assert told.is_met
    expected = np.sqrt(chi2.ppf([0.025, 0.5, 0.975], 10) / 10)
    # of 60 sets the outer quantiles are those of one or two
    np.testing.assert_allclose(np.quantile(told.of_sets, [0.025, 0.5, 0.975]), expected, rtol=0.25)


def test_what_moves_further_than_it_scatters_tells_its_strength_itself():
    after = spread(state([20.0] * 10), 20.0)
    before = state([0.0] * 10).fitted
    assert scatter(before, after.fitted, np.array([90.0] * 5 + [0.0] * 5), SIGMA) is None
    assert scatter(before, after.fitted, np.zeros(10), ()) is None
    assert scatter(before, spread(state([2.0] * 10), 1.0).fitted, np.zeros(10), SIGMA) is None


def test_a_lamp_that_wanders_changes_within_a_level_too():
    """The last statistic is the step from frame to frame: a walk over the levels moves it; a curved response has none."""
    moves = np.array([0.0] * 5 + [60.0])
    after = spread(state([20.0] * 6), 20.0)
    assert moves_are_there(state([30.0] * 5 + [50.0]).fitted, after.fitted, moves)
    assert not moves_are_there(state([30.0] * 5 + [0.0]).fitted, after.fitted, moves)
    assert moves_are_there(state([30.0] * 6).fitted, after.fitted, STILL)


def test_what_the_cameras_own_numbers_undo_is_no_move():
    """In a few simulations a slow walk brings all levels up alike: the quantum efficiency follows, the scatter tells the rest."""
    before, after = state([0.0] * 10), spread(state([20.0] * 10), 20.0)
    alike = np.full(10, 90.0)
    assert scatter(before.fitted, after.fitted, alike, SIGMA) is None
    null = before.fitted.reference.null
    before.fitted.reference.null = Null(null.residuals, null.floor, np.full((10, 1), 50.0), np.array([30.0]))
    assert scatter(before.fitted, after.fitted, alike, SIGMA) is not None


def wandering(light: np.ndarray, strength: float, moment) -> np.ndarray:
    return light * (1 + strength * moment.now().standard_normal())


def test_the_strength_of_a_drifting_lamp_is_told(stated):
    """Simulated by the NumPy camera, 0.5 % from frame to frame."""
    from benchmark.camera import Hidden

    found = diagnose(stated, frame_set(12, [Hidden("lamp", "light", wandering, 0.005)]), sets=120)
    assert found.accepted == ("light_drift",)
    sigma = found.ranking[0].parameters["sigma"]
    assert sigma.low < 0.005 < sigma.high
    assert sigma.high < 6 * sigma.low  # five levels tell a factor of two either way


def test_where_all_that_an_effect_acts_on_holds_no_other_numbers_of_it_are_asked():
    """Three statistics: the effect scatters one, moves another, and leaves the third alone."""

    def holds(z, scale: float = 20.0) -> bool:
        after = spread(state(z), np.array([scale, 1.0, 1.0]))
        return Adding._holds_where_it_acts(
            state([30.0, 30.0, 90.0]), replace(after, moves=np.array([0.0, 30.0, 0.0]))
        )

    assert holds([30.0, 0.0, 90.0])  # what stays off is another effect's
    assert not holds([30.0, 20.0, 0.0])
    assert not holds([300.0, 0.0, 0.0])
    assert holds([30.0, 0.0, 90.0], scale=1.0)  # it has no spread there, so nothing of its own is off
