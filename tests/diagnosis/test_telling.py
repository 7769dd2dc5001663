"""What is reported at the end of a search."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tests.diagnosis.states import leaving
from visaug.diagnosis import telling
from visaug.diagnosis.candidates.signatures import Signatures
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.verdict import Verdict
from visaug.statistics import Fingerprint, Statistic

STATISTIC = Statistic("temporal_lines", "rows", "bias", ("time", "row"), "DN", "bias")


@pytest.mark.parametrize("missing", [True, False])
@pytest.mark.parametrize("left", [1.0, 40.0])
@pytest.mark.parametrize("accepted", [(), ("row_noise",)])
def test_a_difference_is_reported_if_and_only_if_the_camera_is_not_adequate(stated, missing, left, accepted):
    state = leaving([0.5, left], stated.with_effect("row_noise"), *accepted)
    measured = Fingerprint((STATISTIC, STATISTIC), np.array([1.0, 2.0]))
    found = telling.residue(measured, state, missing, "flicker_noise")
    assert (found is not None) == missing
    if found is not None:
        assert found.axis == ("time", "row")
        assert found.worst[0] == (STATISTIC.label, left)


def test_a_reported_difference_is_in_standard_deviations_with_the_tolerance(stated):
    state = leaving([4.0, 40.0], stated)
    state = replace(state, explained=(np.zeros(2), np.zeros(2), np.array([0.0, np.sqrt(399.0) / FORM])))
    found = telling.residue(Fingerprint((STATISTIC, STATISTIC), np.ones(2)), state, True, None)
    assert found is not None
    assert [z for _, z in found.worst] == pytest.approx([4.0])  # not the second, of which 40 / 20 stay


@pytest.mark.parametrize(("furthest", "expected"), [(3.8, False), (60.0, True)])
def test_a_difference_in_the_form_of_an_accepted_effect_is_described(stated, furthest, expected):
    """Where the tolerance of its form is larger than the noise, and beyond the largest residual of simulated sets."""
    state = leaving([furthest, 1.0, 0.5], stated.with_effect("row_noise"), "row_noise")
    assert telling.form([STATISTIC] * 3, state) is None
    nothing = np.zeros(3)
    acting = replace(state, explained=(nothing, nothing, np.array([2.0 / FORM, 0.0, 0.0])))
    text = telling.form([STATISTIC] * 3, acting)
    assert (text is not None) == expected
    assert text is None or "row_noise" in text
    assert telling.form([STATISTIC] * 3, replace(acting, accepted=())) is None


@pytest.mark.parametrize(("left", "expected"), [(8.0, True), (60.0, False)])
def test_in_the_view_of_an_effect_its_form_is_what_the_tolerance_covers(stated, left, expected):
    """The effect explains the second of two statistics; in the first its form may leave some standard deviations, and not 60."""
    state = leaving([left, 0.0], stated.with_effect("row_noise"), "row_noise")
    explained, view = np.array([0.0, 2.0 / FORM]), np.zeros(2, int)
    acting = replace(state, explained=(np.zeros(2), np.zeros(2), explained), views=(view, view, view))
    assert (telling.form([STATISTIC] * 2, acting) is not None) == expected


def test_effects_whose_shifts_and_scatter_are_below_the_limit_cannot_be_shown():
    """An effect counts with its strongest trial, by its shift and its scatter together."""
    names = ("row_noise", "row_noise", "smear", "light_drift")
    trials = tuple(Trial(name, ()) for name in names)
    values = np.array([[0.1, 0.0], [0.0, 5.0], [1.0, 1.9], [0.0, 1.0]])
    variances = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 6.0]])
    signs = Signatures(trials, values, variances)
    first = cast(SimpleNamespace, leaving([0.0, 0.0], None).fitted.reference)  # pyrefly: ignore[bad-argument-type]
    assert telling.cannot_show(signs, first) == ("smear",)  # pyrefly: ignore[bad-argument-type]
    first.null_scale = 2 * np.ones(2)
    assert telling.cannot_show(signs, first) == ("row_noise", "smear", "light_drift")  # pyrefly: ignore[bad-argument-type]
    judged = [
        Verdict("row_noise", "absent"),
        Verdict("smear", "not testable"),
        Verdict("light_drift", "not separable"),
    ]
    assert telling.cannot_show(signs, first, judged) == ("smear",)  # pyrefly: ignore[bad-argument-type]


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
