"""Covariances of halves of the simulated sets are computed once for each tolerance."""

import numpy as np

from visaug.diagnosis.fitting.law import each_half, law, scatter_along
from visaug.diagnosis.fitting.reference import Null


def a_null() -> Null:
    rng = np.random.default_rng(1)
    sets = rng.normal(size=(40, 7))
    return Null(sets - sets.mean(0), np.full(7, 0.1), rng.normal(size=(7, 2)), np.ones(2))


def test_the_kept_halves_are_those_of_the_tolerance_asked_for():
    null = a_null()
    for size in (0.0, 0.5, 0.0):
        left = np.full(7, size)
        for k, (metric, others, white) in enumerate(each_half(null, left)):
            own, other = null.residuals[k::2], null.residuals[1 - k :: 2]
            assert np.array_equal(metric.covariance, law(null, left, sets=own).covariance)
            assert np.array_equal(others, other)
            assert np.array_equal(white, metric.white(other))


def test_the_same_tolerance_gives_the_same_matrices_without_new_work():
    null, left = a_null(), np.full(7, 0.5)
    first = each_half(null, left)
    assert each_half(null, left.copy())[0][0] is first[0][0]
    ways = np.eye(7)
    assert np.array_equal(scatter_along(null, left, ways), scatter_along(a_null(), left, ways))
