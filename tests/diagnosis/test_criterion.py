"""The evidence of an effect that is the cause, of one that is not, and of noise."""

import numpy as np
import pytest

from tests.diagnosis.synthetic import ALL, FIND, PLAIN, WITH, pair, shifted
from visaug.diagnosis import criterion
from visaug.diagnosis.criterion import Evidence, evidence

EFFECT = shifted(5, 4.0)  # 60 of 300 statistics
HIT = EFFECT != 0
DRAWS = 50


def drawn(truth, shift, parameters: int = 1, **further) -> list[Evidence]:
    return [evidence(*pair(seed, truth, shift, **further), parameters) for seed in range(DRAWS)]


@pytest.mark.parametrize("size", [2.0, 4.0, 40.0])
def test_the_cause_is_accepted_and_has_the_evidence_of_its_own_sets(size):
    """All but one in 50. The share differs from 1 by the noise of 60 residuals, at most 0.3 in the median draw."""
    shift = size / 4 * EFFECT
    found = drawn(shift, shift)
    assert sum(e.accepts for e in found) >= DRAWS - 1
    shares = np.array([e.share for e in found])
    assert abs(np.median(shares) - 1) < 0.1
    assert np.median(np.abs(shares - 1)) < 0.3


def test_evidence_of_simulated_sets_has_the_law_of_that_of_the_measurement():
    """Ranks of the measurement among its simulated sets are uniform: of 50 draws, 17 to 33 are in the lower half.

    False alarms: 2 % for exactly uniform ranks. The seeds are fixed.
    """
    ranks = [np.mean(e.of_sets <= e.found + e.confirmed) for e in drawn(EFFECT, EFFECT)]
    assert 17 <= np.count_nonzero(np.array(ranks) < 0.5) <= 33


def test_an_effect_that_shifts_some_of_the_deviating_statistics_and_others_is_refused():
    """Two of three of its shifts are there. Its odds are large; it has a third of the evidence that it would have as the cause."""
    truth = np.where(np.arange(ALL) // 5 % 3 < 2, EFFECT, 0.0)
    found = drawn(truth, EFFECT)
    assert all(e.odds > 5 * criterion.ODDS for e in found)
    assert np.median([e.share for e in found]) < criterion.SHARE
    assert sum(e.accepts for e in found) <= 5


@pytest.mark.parametrize("size", [1.0, 4.0, 40.0])
def test_an_effect_with_wrong_signs_is_refused(size):
    """It shifts the same statistics by as much, half of them the wrong way.

    Where that makes large residuals larger it costs no more than the logarithm of 2 each, and the odds can be large. It has
    less than half of the evidence that it would have as the cause.
    """
    right = size / 4 * EFFECT
    wrong = np.where(np.arange(ALL) // 10 % 2, right, -right)
    found = drawn(right, wrong)
    assert not any(e.accepts for e in found)
    assert np.median([e.share for e in found]) < 0.5


def fitted_to_noise(seed: int) -> Evidence:
    """The evidence of an effect whose strength is fitted to the noise of the discovery frames."""
    (before, _), along = pair(seed, 0.0, 0.0), np.ones(FIND) / np.sqrt(FIND)
    strength = float(along @ before.find.residual)
    shift = np.append(strength * along, np.zeros(ALL - FIND))
    return evidence(*pair(seed, 0.0, shift), 1)


def test_noise_is_accepted_as_rarely_as_its_odds_say():
    """One strength gains chi-squared / 2 with one degree of freedom, and costs 1: log odds above 3 have a probability of 0.5 %.

    False alarms: 1e-3 for more than 5 of 200.
    """
    accepted = sum(fitted_to_noise(seed).accepts for seed in range(200))
    assert accepted <= 5
    assert sum(fitted_to_noise(seed).odds > 0 for seed in range(200)) >= 10  # of 200 a fifth gain more than 1


def test_a_shift_that_is_not_there_is_refused():
    assert not any(e.accepts for e in drawn(0.0, EFFECT))


def test_each_parameter_costs_half_the_logarithm_of_the_number_of_shifted_statistics():
    costs = [evidence(*pair(0, EFFECT, EFFECT), parameters).cost for parameters in (0, 1, 4)]
    one = 0.5 * np.log(np.count_nonzero(HIT))
    np.testing.assert_allclose(costs, [0, one, 4 * one])
    single = np.where(np.arange(ALL) == 0, 8.0, 0.0)
    assert evidence(*pair(0, single, single), 3).cost == 3  # at least 1 each


def test_odds_are_the_evidence_less_the_cost():
    one = Evidence(20.0, 5.0, 4.0, np.full(9, 30.0))
    assert one.odds == 21
    assert one.share == pytest.approx(25 / 30)


@pytest.mark.parametrize(
    ("found", "of_sets", "accepts"),
    [
        (10.0, [10.0] * 10, True),
        (2.9, [2.9] * 10, False),  # the odds are too small
        (10.0, [18.0] * 10, True),
        (10.0, [19.0] * 10, False),  # falls short
        (10.0, [9.0] * 2 + [100.0] * 8, True),  # sets with the effect have less in one of five cases
        (10.0, [9.0] + [100.0] * 9, False),
        (10.0, [-50.0] * 6 + [100.0] * 4, True),  # its sets are not told from those without
    ],
)
def test_odds_and_reach_must_both_hold(found, of_sets, accepts):
    assert Evidence(found, 0.0, 0.0, np.array(of_sets)).accepts is accepts


def test_outliers_that_the_effect_hardly_shifts_do_not_change_the_decision():
    """A further effect shifts other statistics by 100, which this effect shifts by 0.5 the wrong way.

    A normal density would refuse it.
    """
    other = shifted(5, 100.0)
    elsewhere = np.roll(other, 2)
    shift = EFFECT - 0.005 * elsewhere
    alone, beside = drawn(EFFECT, EFFECT), drawn(EFFECT + elsewhere, shift)
    assert sum(e.accepts for e in alone) >= DRAWS - 1
    assert sum(e.accepts for e in beside) >= DRAWS - 1
    odds = [np.median([e.odds for e in found]) for found in (alone, beside)]
    assert abs(odds[1] / odds[0] - 1) < 0.05
    assert 0.5 * 100 * np.count_nonzero(elsewhere) > 5 * odds[0]  # what a normal density would have cost


def test_one_statistic_alone_is_not_worth_more_than_the_logarithm_of_its_size():
    """The residual of one statistic, 1000 standard deviations, limits the evidence of an effect that removes it."""
    single = np.where(np.arange(ALL) == 3, 1000.0, 0.0)
    found = evidence(*pair(1, single, single), 1)
    assert found.accepts
    assert found.found < 12


def test_few_sets_and_many_give_the_same_evidence():
    """The noise of simulated means and standard deviations adds no likelihood: the same within 10 % in the median."""
    common, apart = (drawn(EFFECT, EFFECT, are_common=c) for c in (True, False))
    medians = [np.median([e.found + e.confirmed for e in found]) for found in (common, apart)]
    assert WITH < PLAIN
    assert abs(medians[1] / medians[0] - 1) < 0.1


def test_an_effect_that_changes_no_standard_deviation_gains_nothing_by_their_noise():
    """Sets with common random numbers and no shift: the two numbers of sets alone make standard deviations differ."""
    assert all(abs(e.found + e.confirmed) < 0.01 for e in drawn(0.0, 0.0))


def test_an_effect_of_pure_scatter_is_accepted_where_it_is_and_refused_where_it_is_not():
    """It multiplies the standard deviation of 60 statistics by 3. The residuals of a camera without it are too small."""
    extra = np.where(HIT, np.sqrt(8.0), 0.0)
    there = drawn(0.0, 0.0, true_scatter=extra, scatter=extra)
    absent = drawn(0.0, 0.0, scatter=extra)
    assert sum(e.accepts for e in there) >= DRAWS - 1
    assert not any(e.accepts for e in absent)
