"""The hold-out frames decide whether a refit without a new effect is kept; what the criterion accepted stays."""

from types import SimpleNamespace

import pytest

from tests.diagnosis.states import leaving
from visaug.diagnosis import outcome
from visaug.diagnosis.result import Step
from visaug.diagnosis.stage import SearchStage
from visaug.diagnosis.verdict import Verdict
from visaug.statistics.distance import Error


@pytest.mark.parametrize(
    ("error", "accepted", "keeps_file"),
    [(1.16, (), True), (0.97, (), False), (1.16, ("row_noise",), False)],
    ids=["a refit that raises the error", "one that lowers it", "an accepted effect"],
)
def test_a_refit_that_raises_the_error_is_not_kept_and_an_accepted_effect_is(
    stated, error, accepted, keeps_file
):
    """An effect is judged by the criterion that accepted it, not by one error, which may rise by chance."""
    camera = stated.with_effect("row_noise") if accepted else stated
    unfitted = leaving([9.0] * 4, stated).fitted
    setting = SimpleNamespace(
        unfitted=unfitted,
        errors=SimpleNamespace(told=lambda fitted: Error(1.0, 0.9, 1.1) if fitted is unfitted else None),
    )
    states = [leaving([1.0] * 4, camera, *accepted[:n]) for n in range(len(accepted) + 1)]
    history = tuple(SearchStage(state, 0.01, Error(error, error - 0.1, error + 0.1)) for state in states)
    end, steps = outcome.kept(setting, history, 0.5)  # pyrefly: ignore[bad-argument-type]
    assert (end.state.fitted is unfitted) == keeps_file
    assert end.state.accepted == accepted
    assert end.p_value == (0.5 if keeps_file else 0.01)
    assert [step.action for step in steps] == (
        ["keep the camera file"] if keeps_file else ["refit", *(f"add {name}" for name in accepted)]
    )


def test_an_effect_with_which_the_error_clearly_rises_is_named_in_a_warning():
    errors = [
        Error(0.99, 0.97, 1.0),
        Error(1.05, 0.98, 1.1),
        Error(1.3, 1.2, 1.4),
        Error(0.4, 0.3, 0.5),
        None,
    ]
    actions = ["refit", "add dust", "add smear", "add row_noise", "add image_lag"]
    steps = [Step(action, error) for action, error in zip(actions, errors, strict=True)]
    (warning,) = outcome.rises(steps)
    assert warning.startswith("error_rises: with smear the error on hold-out frames rises from 1.1 to 1.3")
    assert outcome.rises(steps[:2]) == outcome.rises([]) == []


def test_limits_beside_an_erratic_camera_are_named_in_a_warning():
    found = [Verdict("dust", "named"), Verdict("smear", "absent", limit=0.1), Verdict("lag", "not testable")]
    ends = [
        SimpleNamespace(
            state=SimpleNamespace(fitted=SimpleNamespace(reference=SimpleNamespace(is_erratic=yes)))
        )
        for yes in (True, False)
    ]
    (warning,) = outcome.erratic(ends[0], found)  # pyrefly: ignore[bad-argument-type]
    assert warning.startswith("limits: ")
    assert "called absent (1) can be too low" in warning
    assert outcome.erratic(ends[0], found[:1]) == []  # pyrefly: ignore[bad-argument-type]
    assert outcome.erratic(ends[1], found) == []  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("accepted", "is_open"),
    [(("dust",), True), (("smear", "fringing"), True), (("dust", "fringing"), False), (("smear",), False)],
)
def test_effects_are_ambiguous_while_one_is_accepted_and_another_is_not(accepted, is_open):
    """Both may be there: then nothing is left open."""
    end = SimpleNamespace(state=SimpleNamespace(accepted=accepted))
    assert outcome._is_open({"dust", "fringing"}, end) is is_open  # pyrefly: ignore[bad-argument-type]


def test_a_parameter_that_is_considered_and_not_fitted_is_told_in_a_warning(stated):
    camera = stated.with_effect("row_noise", sigma_e=1.0).with_effect("veiling_glare", surround=0.5)
    (warning,) = outcome.not_fitted(leaving([0.0], camera, "row_noise", "veiling_glare"))
    assert warning.startswith("considered: veiling_glare.surround (light beyond the frame")
    assert "not fitted: 0.5 with a standard deviation of 1," in warning
