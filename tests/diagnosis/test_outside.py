"""A cause outside the catalogue: what is left by an effect that resembles it, or that is a small part of it by chance."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate, stats

from tests.diagnosis.synthetic import ALL, pair, shifted
from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.outside import OWN, PRIOR, log_odds_outside, log_ratios
from visaug.statistics import Statistic

STATISTICS = [Statistic(f"view {i // 50}", str(i), "bias", ("pixel",)) for i in range(ALL)]
VIEWS = np.arange(ALL) // 50
EFFECT = np.where(VIEWS == 5, shifted(5, 20.0), 0.0)
SHOWN = 400**0.5 / 5**0.5  # root mean square of the effect in its view
UNTOUCHED = np.where(np.arange(ALL) % 5 > 0, np.where(np.arange(ALL) % 2, 1.25**0.5, -(1.25**0.5)), 0.0)


def left(size: float, view: int = 5) -> np.ndarray:
    """A deviation relative to the effect's, in one view and in statistics that the effect does not change."""
    return np.where(view == VIEWS, size * SHOWN * UNTOUCHED, 0.0)


def odds(truth: np.ndarray) -> np.ndarray:
    return np.array([log_odds_outside(pair(seed, truth, EFFECT)[1], STATISTICS) for seed in range(20)])


def chi_squared(freedom: int) -> np.ndarray:
    """Mean squares with a mean of 1 and a variance of 2 / freedom."""
    return 1 + np.sqrt(2 / freedom * 199 / 200) * np.array([-1.0, 1.0] * 100)


@pytest.mark.parametrize(
    ("of_left", "shown", "most"), [(0.8, 3.0, 3.0), (2.0, 5.0, 50.0), (40.0, 20.0, 20.0), (30.0, 8.0, 8.0)]
)
def test_ratios_are_those_of_integrals_over_what_is_left(of_left, shown, most):
    laws = (stats.halfnorm(scale=FORM * shown), stats.halfcauchy(scale=most), stats.loguniform(*OWN))

    def likelihood(size: float, law) -> float:  # of chi-squared with 10 degrees of freedom
        expected = (1 + size**2) / 10
        return float(stats.chi2.pdf(of_left / expected, 10) / expected * law.pdf(size))

    places = [0, *np.geomspace(1e-3, 1e5, 60)]
    form, resembles, further = (
        sum(integrate.quad(likelihood, low, high, args=(law,))[0] for low, high in pairwise(places))
        for law in laws
    )
    beyond = [most, *(place for place in places if place > most)]
    small = sum(integrate.quad(likelihood, low, high, args=(laws[2],))[0] for low, high in pairwise(beyond))
    found = log_ratios(of_left, chi_squared(10), shown, most)
    assert found == pytest.approx(np.log(np.array([resembles, small, further]) / form), abs=0.06)


@pytest.mark.parametrize("size", [0.0, 0.05, 0.2])
def test_of_a_strong_effect_resemblance_is_the_ratio_of_the_densities(size):
    """Where noise is negligible the relative size of what is left is known."""
    expected = np.log(stats.halfcauchy.pdf(size) / stats.halfnorm.pdf(size, scale=FORM))
    resembles, *_ = log_ratios(1 + (size * 1e3) ** 2, chi_squared(200), 1e3, 1e3)
    assert resembles == pytest.approx(expected, abs=0.1)


def test_statistics_without_spread_tell_nothing():
    assert log_ratios(0.0, np.zeros(60), 0.0, 0.0) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_what_the_cause_itself_leaves_tells_little_and_never_certainty():
    """The other cause may have just the form of the effect: the prior odds of that remain.

    Fewer than 3 % of sets reach twice these by chance, more than 3 of 20 with a probability below 1 %. The seeds are fixed.
    """
    found = odds(EFFECT)
    assert np.count_nonzero(found > np.log(2 * PRIOR)) <= 3
    assert found.min() > np.log(PRIOR) - 0.4


@pytest.mark.parametrize("size", [FORM, 0.03**0.5])
def test_another_form_leaves_a_little_also_where_the_effect_changes_nothing(size):
    """Down to 97 % of the squared deviation explained, in statistics that the catalogue's form leaves as they are; 3 sets of
    20 for what other views show by chance, as above.
    """
    assert np.count_nonzero(odds(EFFECT + left(size)) > np.log(1 / 9)) <= 3


def test_as_much_left_as_explained_tells_another_cause():
    assert odds(EFFECT + left(1.0)).min() > np.log(2)


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_what_is_left_elsewhere_may_have_a_cause_of_its_own(size):
    assert np.abs(odds(EFFECT + left(size, view=2))).max() < np.log(6)


def test_little_left_elsewhere_has_a_cause_of_its_own():
    """A deviation that any test sees, but which is small beside the effect: the resemblance would have to be chance."""
    strong = pair(0, 50 * EFFECT + left(0.3, view=2), 50 * EFFECT)[1]
    assert log_odds_outside(strong, STATISTICS) < np.log(1 / 4)


@pytest.mark.parametrize("size", [30.0, 1e2, 3e3])
def test_beside_much_that_is_left_a_small_part_is_as_likely_chance_as_an_effect(size):
    """Of a rest so large the resemblance is unlikely; whether the effect is a part of it by chance, nothing tells."""
    assert np.abs(odds(EFFECT + left(size, view=2))).max() < np.log(2)


def test_one_cause_in_place_of_two_effects_is_twice_as_probable():
    one = pair(0, EFFECT + left(1.0), EFFECT)[1]
    two = replace(one, accepted=("an effect", "another"))
    of_one, of_two = (log_odds_outside(state, STATISTICS) for state in (one, two))
    assert of_two - of_one == pytest.approx(np.log(2), abs=0.01)
