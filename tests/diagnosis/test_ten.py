"""Ten small sets of the benchmark: effects written apart from the package, named right.

scripts/test runs two at once, one temporal and one curved, and the user's own in bias frames, among effects that act alike; the
others, the whole plan and the whole catalogue are marked slow. tests/diagnosis/test_diagnose.py has one temporal effect among the
whole catalogue in the whole plan.

The effects are strong (see docs/results.md for faint ones); seeds are fixed, so each either holds or does not.
"""

from pathlib import Path

import pytest

from benchmark import effects, foreign
from tests.diagnosis.small import PLAN, frame_set
from visaug import FrameSet
from visaug.diagnosis import diagnose
from visaug.effects import catalogue

SETS = 120
KNOWN = effects.BY_NAME | {kind.name: kind for kind in foreign.KINDS}
USER_FILE = Path(__file__).resolve().parents[2] / "benchmark" / "user_effects.py"
SINGLE = [
    ("column_noise", 1.2),
    ("nonlinearity", 0.03),
    ("image_lag", 0.02),
    ("periodic_banding", 1.0),
    ("amplifier_glow", 20.0),
    ("interpixel_crosstalk", 0.02),
    ("tap_mismatch", 6.0),
    ("bit_truncation", 2.0),
]
ALIKE = {"row_noise", "column_noise", "nonlinearity", "tone_curve"}
OTHERS = sorted(set(catalogue()) - ALIKE)
WHOLE = tuple(PLAN)
BIAS = tuple(shot for shot in PLAN if shot.kind == "bias")
UNDARK = tuple(shot for shot in PLAN if shot.kind != "dark")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "strength"), SINGLE)
def test_one_effect(stated, name, strength):
    found = diagnose(stated, frame_set(30, [KNOWN[name].at(strength)]), sets=SETS)
    assert found.accepted == (name,)
    assert found.error_after is not None
    assert found.error_after.low < 0.1


@pytest.mark.parametrize(
    ("others", "plan"),
    [(OTHERS, UNDARK), pytest.param([], WHOLE, marks=pytest.mark.slow)],
    ids=["alike", "all"],
)
def test_two_effects(stated, others, plan):
    hidden = effects.in_order([KNOWN["row_noise"].at(1.5), KNOWN["nonlinearity"].at(0.03)])
    found = diagnose(stated, frame_set(31, hidden, plan=plan), without=others, sets=SETS)
    assert set(found.accepted) == {"row_noise", "nonlinearity"}
    assert found.adequate_after


def of_a_users_own(plan=WHOLE) -> FrameSet:
    return frame_set(32, [KNOWN["patchwork"].at(1.5)], plan=plan)


@pytest.mark.slow
def test_without_the_class_that_the_user_wrote_it_is_unexplained(stated):
    assert diagnose(stated, of_a_users_own(), sets=SETS).unexplained is not None


@pytest.mark.parametrize(
    ("others", "plan"),
    [(OTHERS, BIAS), pytest.param([], WHOLE, marks=pytest.mark.slow)],
    ids=["alike", "all"],
)
def test_an_effect_of_the_users_own_is_accepted(stated, others, plan):
    found = diagnose(stated, of_a_users_own(plan), effects=[USER_FILE], without=others, sets=SETS)
    assert found.accepted == ("patchwork",)
