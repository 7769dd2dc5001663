"""The line of dark frames against exposure: its stated error is that of repeated measurements."""

import math

import numpy as np
import pytest

from visaug.characterization.dark_current import DarkPoint, slopes
from visaug.core.intervals import t_quantile


def test_error_of_dark_current_is_its_spread():
    """400 lines: their standardized slopes have variance 1 within 5 of its standard deviations, sqrt(2 / 399)."""
    rng = np.random.default_rng(71)
    exposures_s, frames, scatter, rate = (0.1, 5.0), (4, 9), 0.09, 2.0
    errors = []
    for _ in range(400):
        points = [
            DarkPoint(
                20.0, t, n, 60 + rate * t + math.sqrt(scatter / n) * rng.standard_normal(), scatter, math.inf
            )
            for t, n in zip(exposures_s, frames, strict=True)
        ]
        (line,) = slopes(points)
        errors.append((line.value - rate) / line.error)
    assert abs(np.var(errors) - 1) < 5 * math.sqrt(2 / 399)


def line_of_variances(rng, exposures_s, pixels=3000, frames=(4, 9)):
    """The line through dark variances of 4 DN^2 and 50 DN^2/s, each known to its own chance."""
    points = []
    for t, n in zip(exposures_s, frames * len(exposures_s), strict=False):
        df = (n - 1) * pixels
        v = (4 + 50 * t) * rng.chisquare(df) / df
        points.append(DarkPoint(20.0, t, n, v, 2 * v**2 * n / df, math.inf))
    return slopes(points)[0]


def test_error_of_dark_current_variance_is_its_spread():
    """400 lines through two exposures, of which the longer scatters 60 times as much: see the test above."""
    rng = np.random.default_rng(84)
    lines = [line_of_variances(rng, (0.1, 5.0)) for _ in range(400)]
    assert abs(np.var([(line.value - 50) / line.error for line in lines]) - 1) < 5 * math.sqrt(2 / 399)


@pytest.mark.parametrize("exposures_s", [(0.1, 0.2, 0.5, 5.0), (0.7, 1.4, 2.1, 2.8, 3.5, 4.2, 5.0)])
def test_intervals_of_dark_current_variance_cover_it(exposures_s):
    """400 lines: more than 35 of the 95 % intervals miss once in 1,000 such tests (binomial)."""
    rng = np.random.default_rng(85)
    lines = [line_of_variances(rng, exposures_s, frames=(4,)) for _ in range(400)]
    missed = sum(abs(line.value - 50) > t_quantile(line.df) * line.error for line in lines)
    assert missed <= 35
