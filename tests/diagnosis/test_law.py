"""The density of one residual."""

from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from scipy.stats import loguniform, norm

from visaug.diagnosis.fitting.law import LEAST, OUTLIERS, RANGE, log_density, rare


def density(residual: float, scale: float = 1.0, unit: float = 1.0) -> float:
    return float(np.exp(log_density(np.array([residual]), np.array([scale]), np.array([unit])))[0])


def test_density_is_a_normal_one_with_log_uniform_outliers():
    for unit, scale in ((1.0, 1.0), (2.0, 5.0)):
        start = 3.0 * unit
        for size in np.array([1.0001, 1.5, 4.0, 300.0]) * start:
            beyond = np.log(RANGE) / (1 + np.log(RANGE))  # the rest lies below the smallest
            outlier = beyond * loguniform.pdf(size, start, RANGE * start) / 2  # of both signs
            expected = (1 - OUTLIERS) * norm.pdf(size, 0, scale) + OUTLIERS * outlier
            for residual in (size, -size):
                np.testing.assert_allclose(density(residual, scale, unit), expected, rtol=1e-9)


def test_small_residuals_have_a_normal_density():
    """The outliers add less than the hundredth part of a normal density that they take away."""
    sizes = np.linspace(0, 2, 9)
    one = np.ones(9)
    np.testing.assert_allclose(log_density(sizes, one, one), norm.logpdf(sizes), atol=0.03)


def test_density_integrates_to_one():
    """Below `LEAST` units the outliers have the constant density of the smallest one."""
    for unit, scale in ((1.0, 1.0), (0.5, 3.0)):
        edges = unit * LEAST * np.array([0, 0.3, 1, 3, 10, 100, 1e3, RANGE])
        total = 2 * sum(quad(density, a, b, args=(scale, unit))[0] for a, b in pairwise(edges))
        assert abs(total - 1) < 2e-4


def test_a_large_residual_costs_the_logarithm_of_its_size():
    """A normal density costs 4950 at 100 standard deviations."""
    one = np.ones(2)
    near, far = log_density(np.array([10.0, 100.0]), one, one)
    np.testing.assert_allclose(near - far, np.log(10), atol=1e-6)


def test_no_outlier_is_smaller_than_three_units():
    """Below that their density is constant. The normal part is narrow here and adds nothing."""
    found = [density(residual, scale=0.05, unit=1.0) for residual in (1.5, 2.99, 6.0)]
    np.testing.assert_allclose(
        found, OUTLIERS / (2 * (1 + np.log(RANGE)) * np.array([3.0, 3.0, 6.0])), rtol=0.01
    )


def test_a_rare_shift_has_a_mixture_of_two_normal_laws():
    """A fifth of 20,000 sets is shifted by 30 with a standard deviation of 4, and has a tolerance of a tenth of that.

    Standard errors of the two shares are 1 and 2 %, of densities within two standard deviations 5 %.
    """
    rng = np.random.default_rng(0)
    sets = np.clip(rng.normal(0, 1, (20_000, 3)), -LEAST, LEAST)
    sets[:, 1] += np.where(rng.random(20_000) < 0.2, rng.normal(30, 4, 20_000), 0)
    sets[:, 0] = rng.uniform(-1, 1, 20_000)
    sets[:, 2] += 30  # in every set
    found = rare(sets, sets, np.ones(3), np.zeros(3))
    assert found is not None
    assert found.places.tolist() == [1]
    for residual in (-1.0, 0.0, 2.0, 22.0, 30.0, 38.0):
        at, one = np.full(3, residual), np.ones(3)
        mixture = 0.8 * norm.pdf(residual, 0, 1) + 0.2 * norm.pdf(residual, 30, 5)
        outlier = OUTLIERS / (2 * (1 + np.log(RANGE)) * max(abs(residual), LEAST))
        expected = np.log((1 - OUTLIERS) * mixture + outlier)
        plain, mixed = log_density(at, one, one), log_density(at, one, one, found)
        np.testing.assert_allclose(mixed[[0, 2]], plain[[0, 2]])
        np.testing.assert_allclose(mixed[1], expected, atol=0.1)
    assert rare(sets[:, [0, 2]], sets[:, [0, 2]], np.ones(2), np.zeros(2)) is None


def test_what_an_effect_makes_wider_is_no_rare_shift():
    """Normal statistics of twice the standard deviation: 13 % of the sets lie beyond three of those without the effect."""
    sets = 2 * np.random.default_rng(0).standard_normal((120, 300))
    assert rare(sets, sets, np.ones(300), np.zeros(300)) is None


def test_a_residual_that_may_stay_widens_both_parts():
    sets = np.zeros((100, 1))
    sets[:20] = 30.0
    alone, beside = (rare(sets, sets, np.ones(1), np.full(1, allowed)) for allowed in (0.0, 2.0))
    assert alone is not None
    assert beside is not None
    np.testing.assert_allclose(alone.widths[:, 0], np.sqrt([1, 1 + 3**2]))
    np.testing.assert_allclose(beside.widths[:, 0], np.sqrt([1 + 4, 1 + 4 + 3**2]))
