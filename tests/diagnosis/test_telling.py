"""What of a rest is a finding."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tests.diagnosis.states import leaving
from visaug.comparison import Error
from visaug.diagnosis import telling
from visaug.fingerprint import Fingerprint, Statistic

STATISTIC = Statistic("scene", "slope", "scene spot", ("level",))


@pytest.mark.parametrize(("furthest", "told"), [(3.8, False), (60.0, True)])
def test_an_error_that_surely_stays_is_told_where_something_stands_out(stated, furthest, told):
    """Of a faint effect the error is mostly noise, and 0.9 of it may stay though the camera holds."""
    state = leaving([furthest, 1.0, 0.5], stated.with_effect("row_noise"), "row_noise")
    reference = cast(SimpleNamespace, state.fitted.reference)
    reference.whole_null, reference.largest = SimpleNamespace(scale=np.ones(3)), np.linspace(2.5, 5.0, 120)
    assert telling.is_far_off(Error(0.9, 0.3, 1.4), state) is told
    assert telling.form([STATISTIC] * 3, state) is None  # where the effect does not act
    acting = replace(state, whole_allowance=np.array([2.0, 0.0, 0.0]))
    assert (telling.form([STATISTIC] * 3, acting) is None) is not told


@pytest.mark.parametrize(("left", "told"), [([0, 27], True), ([0, 6], False), ([60, 0], False)])
def test_a_trace_is_told_where_it_stands_far_out_and_no_accepted_effect_acts(stated, left, told):
    """A glow leaves 1 % of the error. It moves the first statistic by 400 standard deviations, the second, of dust, not at all."""
    glowing = stated.with_effect("amplifier_glow", rate_e_per_s=20.0)
    state = leaving([0, 0], glowing, "amplifier_glow")
    z = np.array(left, float)
    reference = SimpleNamespace(whole_null=SimpleNamespace(scale=np.ones(2)))
    fitted = SimpleNamespace(reference=reference, whole_residual=z)
    state = replace(state, fitted=fitted, whole_allowance=np.array([60.0, 0.0]))
    errors = SimpleNamespace(found=lambda fitted: Error(0.01, 0.005, 0.015))
    assert telling.is_worth_telling(errors, state) is told  # pyright: ignore[reportArgumentType]


def test_the_excess_of_a_logarithm_is_that_of_what_was_measured():
    """4 DN^2 where 1 was expected, and a level 3 DN low."""
    measured = Fingerprint(
        (
            Statistic("fixed_pattern", "pixels", "bias", ("pixel",), "log DN^2"),
            Statistic("level", "mean", "bias", ("level",), "DN"),
        ),
        np.array([np.log(4.0), 1e4]),
    )
    assert telling._excess(measured, np.array([np.log(4.0), -3.0])) == pytest.approx([3.0, -3.0])
