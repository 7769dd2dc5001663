"""The line of dark frames against exposure: its stated error is that of repeated measurements."""

import math

import numpy as np

from visaug.characterization.dark_current import DarkPoint, slopes


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
