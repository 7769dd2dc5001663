"""Numbers as a reader sees them."""

import doctest

import pytest

from visaug.core import wording
from visaug.report.headline import comparison_headline, diagnosis_headline


def test_the_examples_of_the_module():
    assert doctest.testmod(wording).failed == 0


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((30957.4, 30120.0, 31860.0, "photons"), "31000 [30100, 31900] photons"),
        ((-0.01105, -0.04864, 0.008478), "-0.011 [-0.049, 0.008]"),
        ((0.0043271, 0.004205, 0.004519, "1"), "0.00433 [0.00421, 0.00452]"),
        ((2.5e-7, 2.1e-7, 2.9e-7, "1/e-"), "2.50e-07 [2.10e-07, 2.90e-07] 1/e-"),
        ((0.305571, 0.305534, 0.305608), "0.305571 [0.305534, 0.305608]"),
        ((3.0, 3.0, 3.0, "e-"), "3 e-"),
        ((3.25, None, None), "3.25"),
        ((None, None, None), "not known"),
    ],
)
def test_two_digits_of_the_interval(numbers, text):
    assert wording.with_interval(*numbers) == text


def test_headlines_hold_the_answer():
    fits = {"p_value_before": 0.0099, "adequate_before": False, "p_value_after": 0.4, "adequate_after": True}
    place = {"view": "temporal_lines", "share": 0.62, "worst": "rows, bias", "z": 48.08}
    said = comparison_headline({"fits": fits, "where": [place]})
    assert said == (
        "The model does not hold: the frames differ from it (p < 0.01). The largest difference: row and column noise that "
        "changes from frame to frame (rows in bias frames), 48 standard deviations above the model."
    )
    strength = {"sigma_e": {"value": 1.187, "low": 1.103, "high": 1.297, "unit": "e-"}}
    ranking = [{"effect": "row_noise", "probability": 0.9999, "parameters": strength}]
    found = {"accepted": ["row_noise"], "ranking": ranking, "fits": fits, "unexplained": None}
    assert diagnosis_headline(found) == (
        "The missing effect is row_noise (sigma_e = 1.19 [1.10, 1.30] e-; probability > 0.99 among the effects that "
        "were tried and a cause outside the catalogue)."
    )
