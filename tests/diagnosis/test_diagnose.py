"""End to end on small sets of an independent camera. Seeds are fixed, so each of these either holds or does not.

A clean camera and row noise are looked for among the whole catalogue in the whole plan. Of most others scripts/test runs a form
with the frames and the effects that the answer depends on; forms with the whole plan or the whole catalogue are marked slow.
"""

import json

import pytest

from benchmark import effects
from benchmark.camera import Shot
from tests.diagnosis.small import CHART, PLAN, SENSOR, frame_set, row_noise
from visaug import Camera, InputError
from visaug.diagnosis import diagnose
from visaug.effects import catalogue

SETS = 120
BIAS, DARK, FLAT = (tuple(s for s in PLAN if s.kind == kind) for kind in ("bias", "dark", "flat"))


def but(*names: str) -> list[str]:
    """The catalogue without these."""
    return sorted(set(catalogue()) - set(names))


OTHERS = but("row_noise", "column_noise", "periodic_banding", "flicker_noise")


@pytest.fixture(scope="module")
def steps() -> list[str]:
    """Of the diagnosis with row noise, as its progress names them."""
    return []


@pytest.fixture(scope="module")
def with_row_noise(stated, steps):
    return diagnose(
        stated, frame_set(3, [row_noise(2.0)]), sets=SETS, progress=lambda step, *_: steps.append(step)
    )


def test_a_clean_camera_lacks_nothing(stated):
    found = diagnose(stated, frame_set(1), sets=SETS)
    assert found.accepted == ()
    assert found.adequate_before
    assert found.unexplained is None


def test_row_noise_is_named_and_measured(with_row_noise):
    found = with_row_noise
    assert found.accepted == ("row_noise",)
    assert not found.adequate_before
    assert found.adequate_after
    sigma = found.ranking[0].parameters["sigma_e"]
    assert sigma.low < 2.0 < sigma.high
    assert found.error_after.value < 0.1
    assert found.camera.values()["row_noise.sigma_e"] == pytest.approx(2.0, rel=0.15)
    assert found.where[0].view in ("temporal_lines", "temporal_spectrum")


def test_progress_names_an_effect_when_it_is_accepted(with_row_noise, steps):
    begun = [step.startswith("row_noise found: ") for step in steps]
    assert begun == sorted(begun)
    assert any(step.startswith("row_noise found: limit of ") for step in steps)
    assert not any(step.startswith("limit of ") for step in steps)


def test_the_answer_as_json(with_row_noise):
    content = json.loads(json.dumps(with_row_noise.to_json()))
    assert content["schema"] == 1
    assert content["error"]["before"] == 1.0
    assert [step["action"] for step in content["steps"]] == ["refit", "add row_noise"]
    for entry in content["ranking"]:  # an interval is known of what was refitted and simulated
        ends = [p[end] for p in entry["parameters"].values() for end in ("low", "high")]
        assert all((end is None) == (entry["effect"] not in content["accepted"]) for end in ends)
    folds = content["frames"]
    assert not set(folds["fit"]) & set(folds["select"])
    assert not (set(folds["fit"]) | set(folds["select"])) & set(folds["confirm"])
    assert sum(map(len, folds.values())) == len(PLAN)


def test_the_same_seed_gives_the_same_answer(stated, tmp_path, monkeypatch):
    """Each call simulates all of its sets itself: it has an empty cache. Twelve bias frames show row noise too."""
    answers, frames = [], frame_set(3, [row_noise(2.0)], plan=BIAS)
    for cache in ("first", "second"):
        monkeypatch.setenv("VISAUG_CACHE", str(tmp_path / cache))
        found = diagnose(stated, frames, without=but("row_noise", "column_noise"), sets=60)
        answers.append(found.to_json())
    assert answers[0]["accepted"] == ["row_noise"]
    assert answers[0] == answers[1]


@pytest.mark.parametrize(
    ("others", "plan"),
    [
        (OTHERS, BIAS + tuple(s for s in FLAT if s.photons in (1000, 9000))),
        pytest.param([], tuple(PLAN), marks=pytest.mark.slow),
    ],
    ids=["alike", "all"],
)
def test_left_out_of_the_catalogue_it_is_not_given_another_name(stated, others, plan):
    """Nor that of one that acts alike."""
    family = ["row_noise", "correlated_row_noise"]  # the second has the first as a special case
    frames = frame_set(3, [row_noise(2.0)], plan=plan)
    found = diagnose(stated, frames, without=[*family, *others], sets=SETS)
    assert found.accepted == ()
    assert found.unexplained is not None
    assert "row" in found.unexplained.axis
    assert "signal" not in found.unexplained.grows_with
    assert repr(found) == f"Diagnosis(unexplained along {', '.join(found.unexplained.axis)})"


@pytest.mark.parametrize(
    ("others", "plan"),
    [(OTHERS, BIAS + FLAT), pytest.param([], tuple(PLAN), marks=pytest.mark.slow)],
    ids=["few", "all"],
)
def test_numbers_that_are_off_are_refitted_and_no_missing_effect(stated, others, plan):
    wrong = stated.replace(
        {"gain_e_per_dn": SENSOR.e_per_dn * 1.04, "read_noise.sigma_e": SENSOR.read_e * 0.95}
    )
    found = diagnose(wrong, frame_set(4, plan=plan), without=others, sets=SETS)
    assert found.accepted == ()
    assert found.camera.values()["gain_e_per_dn"] == pytest.approx(SENSOR.e_per_dn, rel=0.02)
    assert found.camera.values()["read_noise.sigma_e"] == pytest.approx(SENSOR.read_e, rel=0.03)
    assert found.to_json()["steps"][0]["error"] < 0.2
    assert repr(found) == "Diagnosis(nothing missing)"


@pytest.mark.parametrize(
    ("others", "plan"),
    [
        (but("dark_current", "dark_current_nonuniformity", "amplifier_glow", "hot_pixels"), BIAS + DARK),
        pytest.param([], tuple(PLAN), marks=pytest.mark.slow),
    ],
    ids=["alike", "all"],
)
def test_a_base_term_left_out_is_named(stated, others, plan):
    content = stated.to_dict()
    del content["dark_current"]
    found = diagnose(Camera.load(content), frame_set(5, plan=plan), without=others, sets=SETS)
    assert found.accepted == ("dark_current",)


NEED_LIGHT_OR_TIME = {"nonlinearity", "vignetting", "amplifier_glow"}


@pytest.mark.parametrize(
    "others",
    [but("row_noise", *NEED_LIGHT_OR_TIME), pytest.param([], marks=pytest.mark.slow)],
    ids=["few", "all"],
)
def test_bias_frames_alone(stated, others):
    found = diagnose(stated, frame_set(6, plan=BIAS), without=others, sets=SETS)
    assert found.accepted == ()
    assert set(found.cannot_show) >= NEED_LIGHT_OR_TIME
    assert "row_noise" not in found.cannot_show


@pytest.mark.slow
def test_dark_frames_of_one_exposure_alone(stated):
    """They are their own bias frames; 20 e-/s of glow in a corner, 2 s."""
    darks = tuple([PLAN[-16]] * 12)
    assert {(s.kind, s.seconds, s.celsius) for s in darks} == {("dark", 2.0, 30.0)}
    glow = effects.BY_NAME["amplifier_glow"].at(20.0)
    found = diagnose(stated, frame_set(8, [glow], plan=darks), sets=SETS)
    assert found.accepted == ("amplifier_glow",)
    assert {"nonlinearity", "vignetting"} <= set(found.cannot_show)


# a step, whose gain shows in light
STEP = ("tap_mismatch", 3.0, PLAN[0], "fixed_pattern_structure", "flats over the whole range", PLAN[12:])
# alike at one level
BLUR = (
    "interpixel_crosstalk",
    0.01,
    Shot("flat", 0.01, 20.0, 9000.0),
    "brighter_fatter",
    "a test chart with edges",
    CHART,
)


@pytest.mark.parametrize(
    ("hidden", "strength", "shot", "rival", "wanted", "others"),
    [
        (*STEP[:5], but("tap_mismatch", "fixed_pattern_structure")),
        pytest.param(*STEP[:5], [], marks=pytest.mark.slow),
        pytest.param(*BLUR[:5], [], marks=pytest.mark.slow),
    ],
    ids=["step, few", "step, all", "blur, all"],
)
def test_what_frames_cannot_tell_apart_is_ambiguous(stated, hidden, strength, shot, rival, wanted, others):
    effect = effects.BY_NAME[hidden].at(strength)
    alone = diagnose(stated, frame_set(77, [effect], plan=(shot,) * 12), without=others, sets=SETS)
    (pair,) = alone.ambiguous
    assert set(pair["effects"]) == {hidden, rival}
    # bias frames leave the gain of a seam open; where its fit leaves that at 0, flats do not differ (see test_separate.py)
    gains = [r.parameters["gain"].value for r in alone.ranking if "gain" in r.parameters]
    is_open = gains == [0.0] and pair["measure"].startswith("many more frames of every kind")
    assert is_open or pair["measure"].startswith(wanted)
    assert alone.accepted == (alone.ranking[0].effect,)  # under its likeliest name


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "strength", "shot", "_rival", "_wanted", "further"), [STEP, BLUR])
def test_frames_that_were_asked_for_tell_apart(stated, hidden, strength, shot, _rival, _wanted, further):
    effect = effects.BY_NAME[hidden].at(strength)
    both = diagnose(stated, frame_set(77, [effect], plan=(shot,) * 12 + tuple(further)), sets=SETS)
    assert both.accepted == (hidden,)
    assert both.ambiguous == ()


def test_a_wrong_name_is_refused(stated):
    with pytest.raises(InputError, match="no_such_effect"):
        diagnose(stated, frame_set(1), without=["no_such_effect"])


def test_too_few_simulated_sets_to_show_a_difference_are_refused(stated):
    with pytest.raises(InputError, match=r"sets: 40 simulated sets.*at least 50"):
        diagnose(stated, frame_set(1), sets=40)


@pytest.mark.slow
def test_columns_that_the_maker_does_not_mention_beside_pixels_are_found(stated):
    """The file has the DSNU of pixels alone; columns of 1 e- and rows of 0.4 e- are within the intervals."""
    partly = Camera.load({**stated.to_dict(), "dsnu": {"pixel_e": 1.2}})
    found = diagnose(partly, frame_set(5), sets=SETS)
    assert found.accepted == ("dsnu",)
    told = found.ranking[0].parameters
    for part, true in {"column_e": 1.0, "row_e": 0.4, "pixel_e": 1.2}.items():
        assert told[part].low < true < told[part].high
