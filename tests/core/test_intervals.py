import numpy as np
import pytest
from scipy import stats

from visaug.core.intervals import jackknife, mean_error, root, variance_combination, widen


def test_one_mean_square_has_the_exact_chi_square_interval():
    value, low, high = variance_combination([(2.0, 3.0, 12)])
    assert value == 6.0
    assert low == pytest.approx(6.0 * 12 / stats.chi2.ppf(0.975, 12))
    assert high == pytest.approx(6.0 * 12 / stats.chi2.ppf(0.025, 12))


@pytest.mark.parametrize(("variance", "rows"), [(1.0, 12), (0.05, 40), (0.0, 30)])
def test_difference_of_mean_squares_covers_the_variance_component(variance, rows):
    """2000 draws: coverage of 95 % has a standard error of 0.5 %; outside 93.5 to 100 % by chance once in
    700.
    """
    rng = np.random.default_rng(3)
    columns, df = 20, (rows - 1) * 19
    row = (columns * variance + 1) * rng.chisquare(rows - 1, 2000) / (rows - 1)
    pixel = rng.chisquare(df, 2000) / df
    hits = 0
    for a, b in zip(row, pixel):
        _, low, high = variance_combination([(1 / columns, a, rows - 1), (-1 / columns, b, df)])
        hits += low <= variance <= high
    assert hits / 2000 > 0.935


def test_negative_estimates_give_zero_and_not_nan():
    value, low, high = root(variance_combination([(1.0, 1.0, 50), (-1.0, 2.0, 50)]))
    assert value == low == 0.0
    # no interval of zero width: sqrt(50 / 32.4 - 1) from the first mean square alone is 0.74
    assert high > 0.3


def test_widening_adds_relative_errors_in_quadrature():
    value, low, high = widen((10.0, 9.9, 10.1), 0.05)
    assert (value, low) == (
        10.0,
        pytest.approx(10 * np.exp(-np.hypot(np.log(10 / 9.9), 1.96 * 0.05)), rel=1e-5),
    )
    assert high == pytest.approx(10 * np.exp(np.hypot(np.log(1.01), 1.96 * 0.05)), rel=1e-5)


def test_jackknife_of_a_mean_is_its_standard_error():
    values = np.random.default_rng(0).normal(5, 2, 20)
    value, error, df = jackknife(lambda w: {"mean": float((values * w).sum() / w.sum())}, 20)["mean"]
    assert value == pytest.approx(values.mean())
    assert error == pytest.approx(values.std(ddof=1) / np.sqrt(20))
    assert df == 19


def test_degrees_of_freedom_of_a_mean_follow_satterthwaite():
    error, df = mean_error([(4.0, 10), (1.0, 5)])
    assert error == pytest.approx(np.sqrt(5))
    assert df == pytest.approx(25 / (16 / 10 + 1 / 5))
