"""The error's own law: 1 for the file as given, 0 for a twin, whatever the number of statistics a view has."""

import numpy as np
import pytest

from visaug.statistics import Statistic
from visaug.statistics.distance import Distance, largest_of_each

STATISTICS = tuple(Statistic("a" if i < 20 else "b", f"s{i}", "bias", ("row",)) for i in range(30))


def sets(mean, spread=1.0, count=400, seed=0):
    return mean + spread * np.random.default_rng(seed).standard_normal((count, 30))


@pytest.mark.parametrize(
    ("count", "low", "high"), [(80, 0.875, 1.0), pytest.param(200, 0.90, 0.99, marks=pytest.mark.slow)]
)
def test_a_twin_has_error_zero_and_the_given_file_one(count, low, high):
    given, model = sets(0.0), sets(5.0, seed=1)
    errors = []
    for k in range(count):
        measured = sets(5.0, count=1, seed=10 + k)[0]
        distance = Distance(STATISTICS, measured, given, np.zeros(30))
        if k < 20:
            assert distance.error(given).value == pytest.approx(1, abs=0.01)
        errors.append(distance.error(model))
    values = np.array([e.value for e in errors])
    # errors of spread about 0.01: their mean is within 5 standard errors of 0, false alarm 6e-7
    assert abs(values.mean()) < 5 * values.std() / np.sqrt(count) + 0.002
    inside = np.mean([e.low <= 0 <= e.high for e in errors])
    # binomial: outside this in 1 of 480 runs (200) or 640 (80, which sees no intervals that are too wide)
    assert low <= inside <= high


def test_views_count_alike():
    measured = np.zeros(30)
    measured[25] = 10
    shares = Distance(STATISTICS, measured, sets(0.0), np.zeros(30)).shares()
    assert shares["b"] > 0.95


def test_a_spread_of_its_own_is_no_error():
    """An effect that draws anew in every camera widens the statistics: s is the larger spread."""
    given = sets(0.0)
    wide = sets(0.0, spread=6.0, seed=2)
    measured = sets(0.0, spread=6.0, count=1, seed=3)[0]
    error = Distance(STATISTICS, measured, given, np.zeros(30)).error(wide)
    assert error is None or error.low <= 0 <= error.high


def test_two_models_are_held_against_each_other_in_the_same_units():
    """One statistic is so far off that it is all of the excess; a model that gives it the spread it has leaves the others to count.

    In units of their own the plain model, whose number was bent to meet that statistic, would seem to have hardly an error.
    """
    measured, given = np.full(30, 5.0), sets(0.0)
    measured[0] = 5000.0
    plain, found = given + np.append(5000.0, np.zeros(29)), sets(5.0, seed=4)
    found[:, 0] = sets(5000.0, spread=5000.0, seed=5)[:, 0]
    distance = Distance(STATISTICS, measured, given, np.zeros(30))
    assert distance.error(plain).value < 0.01
    alike = distance.error(plain, beside=found)
    assert alike.value > 0.9
    assert distance.error(found, beside=plain).high < alike.low


def test_nothing_to_lower():
    given = sets(0.0)
    assert Distance(STATISTICS, given.mean(0), given, np.zeros(30)).error(given) is None


def test_what_is_not_asked_has_no_say():
    """One statistic far off hides what a model gains in another, unless it is left out."""
    measured = np.zeros(30)
    measured[[3, 25]] = 20.0, 500.0
    given, model = sets(0.0), sets(0.0, seed=1)
    model[:, 3] += 20
    distance = Distance(STATISTICS, measured, given, np.zeros(30))
    asked = np.arange(30) != 25
    whole, own = distance.error(model), distance.error(model, asked=asked)
    assert whole is not None
    assert whole.value == pytest.approx(1, abs=0.01)
    assert own is not None
    assert own.value < 0.1


def test_a_set_that_lacks_nothing_exceeds_the_simulated_ones_as_often_as_each_of_them_does():
    """600 times 60 sets of 150 normal statistics and one more: its largest deviation is among the largest 3 of 61 in 4.9 %.

    The standard deviation of the share is 0.9 %; a false alarm of this test has a probability below 1e-3. With the spread of
    all 60 sets in place of that of the others the share is 15 %.
    """
    rng, few, floor = np.random.default_rng(3), 0, np.full(150, 1e-3)
    for _ in range(600):
        sets, measured = rng.normal(size=(60, 150)), rng.normal(size=150)
        null = largest_of_each((sets - sets.mean(0)) * 60 / 59, floor)
        largest = np.abs((measured - sets.mean(0)) / sets.std(0, ddof=1)).max()
        few += np.count_nonzero(null >= largest) < 3
    assert few / 600 == pytest.approx(3 / 61, abs=0.03)


def test_a_statistic_that_never_varies_exceeds_nothing():
    deviations = np.zeros((5, 2))
    deviations[:, 1] = [1, -1, 2, 0, -2]
    largest = largest_of_each(deviations, np.array([0.0, 0.1]))
    assert np.isfinite(largest).all()
    assert largest[3] == 0


def test_each_set_is_measured_by_the_spread_of_the_others():
    """Four sets that deviate by 1 and one by 10: the other three have 3 squares of 1 and 2 degrees of freedom, or 102."""
    deviations = np.array([[1.0], [-1.0], [1.0], [-10.0]])
    expected = [1 / np.sqrt(102 / 2)] * 3 + [10 / np.sqrt(3 / 2)]
    np.testing.assert_allclose(largest_of_each(deviations, np.array([1e-6])), expected)


def test_the_least_spread_is_a_standard_deviation():
    """Of a statistic whose sets vary by 1 only; with a least spread of 10 its excess of 20 counts as 2, of the other as 20."""
    measured, given = np.full(30, 20.0), sets(0.0)
    least = np.zeros(30)
    least[:20] = 10.0  # of view a
    shares = Distance(STATISTICS, measured, given, least).shares()
    assert shares["b"] / shares["a"] == pytest.approx(100, rel=0.02)
    model = sets(20.0, seed=6)
    model[:, 20:] -= 10.0  # half of the deviation of view b is left, none of view a
    error = Distance(STATISTICS, measured, given, least).error(model)
    assert error.value == pytest.approx(0.25 * 400 / 404, abs=0.01)


def test_the_interval_of_a_skewed_error_covers_the_truth():
    """Of one statistic the error is a squared normal number: z^2 - 1 ends at 4 above and at 1 below.

    The interval covers 0 where z^2 is between its 2.5 and its 97.5 % quantile: binomial(400, 0.95) is below 366 in 1 of 500 runs.
    With its ends exchanged it would cover 0 where z^2 is below 2, in 84 %.
    """
    statistic, rng = STATISTICS[:1], np.random.default_rng(9)
    given, model = sets(0.0)[:, :1], sets(20.0, seed=7)[:, :1]
    measured = 20 + rng.standard_normal((400, 1))
    errors = [Distance(statistic, one, given, np.zeros(1)).error(model) for one in measured]
    assert np.mean([e.low <= 0 <= e.high for e in errors]) >= 0.915
