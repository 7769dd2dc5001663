"""Sets are written as a user would bring them; answers are counted as they should be."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmark import (
    calibrate,
    calibration,
    cameras,
    commands,
    effects,
    getframes_sets,
    judge,
    local,
    pyxel_sets,
    real,
    recipes,
    strengths,
)
from benchmark.camera import Shot, take
from benchmark.sets import plan_of, write_set


def test_seed_lists():
    assert commands.seeds_of("3,10-12") == [3, 10, 11, 12]


@pytest.mark.parametrize(("hits", "of"), [(0, 5), (3, 7), (100, 100), (95, 100)])
def test_wilson_is_scipys(hits, of):
    expected = binomtest(hits, of).proportion_ci(method="wilson")
    assert judge.wilson(hits, of) == pytest.approx((expected.low, expected.high), abs=1e-6)


def test_set_is_complete_and_answers_lie_elsewhere(tmp_path):
    recipe = next(iter(recipes.single(5, 2, "plain")))
    write_set(recipe, tmp_path / "sets", tmp_path / "answers")
    folder = tmp_path / "sets" / recipe.identity
    assert sorted(p.name for p in folder.iterdir()) == [
        "camera.yaml", "chart_clean.npy", "frames.csv", "frames.npz", "scene_clean.npy", "spot_clean.npy",
    ]  # fmt: skip
    frames = np.load(folder / "frames.npz")["frames"]
    with open(folder / "frames.csv", newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == len(frames)
    assert [int(row["sequence"]) for row in rows] == list(range(len(rows)))
    assert all((row["photons"] != "") == (row["kind"] == "flat") for row in rows)
    assert all((row["clean"] != "") == (row["kind"] == "scene") for row in rows)
    told = (folder / "camera.yaml").read_text()
    assert recipe.expect[0] not in told
    assert json.loads((tmp_path / "answers" / f"{recipe.identity}.json").read_text())["expect"] == [
        recipe.expect[0]
    ]


@pytest.mark.parametrize("name", recipes.KINDS)
def test_every_kind_gives_recipes_and_repeats_them(name):
    first, again = (list(recipes.KINDS[name](4, 1, "plain")) for _ in range(2))
    assert first
    assert first == again
    assert len({recipe.identity for recipe in first}) == len(first)


def test_left_out_base_terms_are_hidden_from_the_file(tmp_path):
    left_out = list(recipes.base_left_out(3, 2, "plain"))
    assert left_out
    for recipe in left_out:
        write_set(recipe, tmp_path / "sets", tmp_path / "answers")
        told = (tmp_path / "sets" / recipe.identity / "camera.yaml").read_text()
        gone = "shape: 0.14" if recipe.expect == ("read_noise",) else recipe.expect[0]
        assert (gone in told) == (recipe.expect == ("read_noise",))


def test_strength_words_scale_the_parameter():
    plain = strengths.scaled(0, "row_noise", "default", "plain")
    assert plain
    assert strengths.scaled(0, "row_noise", "default", "half") == pytest.approx(plain / 2)
    assert strengths.scaled(0, "row_noise", "default", "quarter") == pytest.approx(plain / 4)


@pytest.mark.slow
def test_plain_is_so_on_the_specimen_that_a_seed_draws(monkeypatch):
    """A band may lie where it shows well or badly: eight standard deviations on either, to the tolerance of the search."""
    monkeypatch.setattr(calibrate, "BASE_SETS", 10)  # enough to tell that the strength follows the specimen
    calibrate.yardstick.cache_clear()
    kind, found = effects.BY_NAME["fixed_pattern_structure"], {}
    for seed in (calibrate.SEEDS[0] + 2, calibrate.SEEDS[0] + 3):
        whole, half = (
            calibrate.for_specimen(next(r for r in recipes.single(seed, 2, word) if r.expect == (kind.name,)))
            for word in ("plain", "half")
        )
        found[seed] = whole.hidden[0][1]
        shift, _ = calibrate.yardstick(2).shift((kind.at(found[seed]),), (seed,))
        assert shift == pytest.approx(calibrate.TARGET, rel=calibrate.TOLERANCE)
        assert half.hidden[0][1] == pytest.approx(found[seed] / 2)
    assert len(set(found.values())) == 2
    typical = next(iter(recipes.single(1, 2, "typical")))
    assert calibrate.for_specimen(typical) is typical
    calibrate.yardstick.cache_clear()


def diagnosis(accepted, unexplained=None, after=0.05):
    return {"diagnosis": {"accepted": accepted, "unexplained": unexplained, "error": {"after": after}}}


ANSWER = {
    "kind": "single",
    "expect": ["smear"],
    "without": None,
    "axis": ["column"],
    "grows": ["signal"],
    "may_grow": [],
}


@pytest.mark.parametrize(
    ("answer", "said", "right", "wrong"),
    [
        ({}, diagnosis(["smear"]), True, False),
        ({}, diagnosis(["smear", "row_noise"]), False, True),
        ({}, diagnosis([]), False, False),
        ({"expect": []}, diagnosis([]), True, False),
        ({"expect": []}, diagnosis(["prnu"]), False, True),
        ({"without": "smear"}, diagnosis(["blooming"]), False, True),
        ({"without": "smear"}, diagnosis([], {"axis": ["column"], "grows_with": ["signal"]}), True, False),
        ({"without": "smear"}, diagnosis([], {"axis": ["row"], "grows_with": ["signal"]}), False, False),
        (
            {"without": "smear"},
            diagnosis([], {"axis": ["row", "column"], "grows_with": ["signal"]}),
            False,
            False,
        ),
        ({"without": "smear"}, diagnosis([], {"axis": [], "grows_with": ["signal"]}), False, False),
        (
            {"without": "smear"},
            diagnosis(["tap_mismatch"], {"axis": ["column"], "grows_with": ["signal"]}),
            True,
            False,
        ),
        ({"kind": "foreign"}, diagnosis([], {"axis": ["column"], "grows_with": ["signal"]}), True, False),
        ({"kind": "foreign"}, diagnosis(["smear"]) | {"effects": "mine.py"}, True, False),
        ({"kind": "mixed"}, diagnosis(["smear"], {"axis": ["row"], "grows_with": []}), True, False),
        ({"kind": "mixed"}, diagnosis(["smear"]), False, False),
        ({"kind": "mixed"}, diagnosis(["smear", "prnu"], {"axis": ["row"], "grows_with": []}), False, True),
        (
            {"hidden": [1], "expect": []},
            diagnosis([], {"axis": ["column"], "grows_with": ["signal"]}),
            True,
            False,
        ),
        ({"hidden": [1], "expect": []}, diagnosis([]), False, False),
        ({}, {"diagnosis": None}, False, False),
    ],
)
def test_verdicts(answer, said, right, wrong):
    judged = judge.verdict(ANSWER | answer, said)
    assert (judged["right"], judged["wrong"]) == (right, wrong)


def test_report_counts(tmp_path):
    for folder in ("sets_answers", "sets_results"):
        (tmp_path / folder).mkdir()
    for i, accepted in enumerate((["smear"], ["smear"], ["row_noise"])):
        (tmp_path / "sets_answers" / f"{i}.json").write_text(
            json.dumps(ANSWER | {"strength": "plain", "seed": i, "hidden": [1]})
        )
        (tmp_path / "sets_results" / f"{i}.json").write_text(
            json.dumps(diagnosis(accepted) | {"seconds": 2, "status": 0})
        )
    text = judge.report([tmp_path / "sets"])
    low, high = judge.wilson(2, 3)
    assert f"| smear | 2/3 ({100 * low:.0f}-{100 * high:.0f} %) | 1 | 0.05 / 0.05 | 0 | 0 | 2 |" in text


def test_unknown_kind_is_one_line(capsys):
    with pytest.raises(SystemExit) as stop:
        commands.parser().parse_args(["make", "1", "-o", "x", "--kinds", "sngle"])
    assert stop.value.code == 2
    assert "unknown kind sngle" in capsys.readouterr().err


STUB = """
import json, sys
words = sys.argv[1:]
assert words[0] == "diagnose", words
if "bad" in words[1]:
    sys.exit("frames.csv: no such column")
without = words[words.index("--without") + 1] if "--without" in words else None
with open(words[words.index("--json") + 1], "w") as handle:
    json.dump({"accepted": [without], "unexplained": None, "error": {"after": None}}, handle)
with open(words[1] + ".calls", "a") as handle:
    handle.write("x")
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_run_calls_the_program_keeps_failures_and_resumes(workers, tmp_path, monkeypatch):
    (tmp_path / "path" / "visaug").mkdir(parents=True)
    (tmp_path / "path" / "visaug" / "__init__.py").touch()
    (tmp_path / "path" / "visaug" / "__main__.py").write_text(STUB)
    monkeypatch.chdir(tmp_path / "path")  # `python -m` looks there first
    for folder in ("sets", "sets_answers"):
        (tmp_path / folder).mkdir()
    for identity, without in (("good", "smear"), ("bad", None)):
        answer = ANSWER | {"without": without, "strength": "plain", "seed": 1, "hidden": [1]}
        (tmp_path / "sets_answers" / f"{identity}.json").write_text(json.dumps(answer))
    judge.run_all(tmp_path / "sets", "*", None, 60, workers, until_s=0)
    assert not list((tmp_path / "sets_results").iterdir())
    for _ in range(2):
        judge.run_all(tmp_path / "sets", "*", None, 60, workers)
    assert (tmp_path / "sets" / "good.calls").read_text() == "x"
    good, bad = (json.loads((tmp_path / "sets_results" / f"{n}.json").read_text()) for n in ("good", "bad"))
    assert good["diagnosis"]["accepted"] == ["smear"]
    assert bad["diagnosis"] is None
    assert "no such column" in bad["said"]


def test_effects_go_into_real_frames_and_leave_them_alone_at_zero(shared_data):
    window = (slice(100, 300), slice(200, 456))
    plan, frames = real.read(shared_data / "emva1288_ccd12", window, levels=3, stack=4)
    assert {shot.kind for shot in plan} == {"dark", "flat"}
    assert len(plan) == len(frames) == 3 * 4 + 2 * 4
    for name in real.INJECTED:
        same = real.inject(frames, plan, real.CCD, effects.BY_NAME[name].at(0.0), 1)
        assert np.array_equal(same, frames)
    noisy = real.inject(frames, plan, real.CCD, effects.BY_NAME["row_noise"].at(20.0), 1)
    rows = (noisy.astype(float) - frames).mean(2)
    # 20 frames of 200 rows know the spread to 1.2 %
    assert rows.std() == pytest.approx(20.0 / real.CCD.e_per_dn, rel=0.05)


def test_real_untouched_answers_are_taken_off():
    answer = ANSWER | {"kind": "real", "expect": ["smear"]}
    judged = judge.verdict(answer, diagnosis(["row_noise", "smear"]), usual=["row_noise"])
    assert (judged["right"], judged["wrong"]) == (True, False)


def test_other_authors_effects_have_names_of_the_catalogue():
    from visaug.effects import catalogue

    assert set(getframes_sets.EFFECTS) <= set(catalogue())
    assert pyxel_sets.OUTSIDE not in catalogue()
    for module in (getframes_sets, pyxel_sets):
        stated = module.sensor_of(2)
        assert stated.tail == 0.14  # Gaussian
        assert stated.shape == cameras.sensor(2).shape


def test_getframes_follows_the_photon_transfer_curve():
    """Mean and variance of its bias frames against read noise and rounding; 16 frames of 96 x 128 know them to 0.5 %."""
    pytest.importorskip("getframes")
    sensor, plan = getframes_sets.sensor_of(2), tuple(s for s in cameras.plan(2) if s.kind == "bias")
    frames = getframes_sets.taken(sensor, plan, {}, getframes_sets.configuration(sensor, 3), 3).astype(float)
    expected = (sensor.read_e / sensor.e_per_dn) ** 2 + 1 / 12
    assert frames.var(0, ddof=1).mean() == pytest.approx(expected, rel=0.02)
    assert frames.mean() == pytest.approx(sensor.pedestal_dn, abs=0.05)


@pytest.mark.parametrize(
    ("name", "shape", "frames"), [("large_150", (200, 256), 150), ("large_1mpx", (1000, 1000), 60)]
)
def test_sets_of_real_size(name, shape, frames):
    """What lies in one corner, at an edge, at quarter seams, in few pixels of many, and in memory."""
    found = list(recipes.KINDS[name](8, 3, "half"))
    assert {recipe.camera for recipe in found} == {found[0].camera}
    assert cameras.sensor(found[0].camera).shape == shape
    plan = plan_of(found[0])
    assert len(plan) == frames
    assert {shot.kind for shot in plan} == {"bias", "dark", "flat", "scene"}
    assert {entry[0] for recipe in found for entry in recipe.hidden} == {
        "corner_glow", "edge_columns", "quarter_taps", "hot_pixels", "rts_noise", "image_lag", "black_level_drift",
    }  # fmt: skip
    (hot,) = (recipe for recipe in found if recipe.expect == ("hot_pixels",))
    assert hot.hidden[0][1] * np.prod(shape) == pytest.approx(recipes.FEW / 2)
    assert all(calibrate.for_specimen(recipe) is recipe for recipe in found)
    assert found[0].camera not in {cameras.camera_of(seed) for seed in range(200)}


@pytest.fixture(scope="module")
def local_differences():
    """Mean of the longest darks with an effect less those without, e-; 12 frames of one specimen with the same noise."""
    sensor = replace(
        cameras.sensor(0),
        rows=160,
        columns=200,
        e_per_dn=0.05,
        pedestal_dn=3000.0,
        well_e=3000.0,
        dark_e_per_s=0.0,
        dsnu_e=(0.0, 0.0, 0.0),
    )
    plan = [Shot("dark", 2.0, 20.0)] * 12
    plain = take(sensor, plan, {}, 4).mean(0)
    return {
        kind.name: (take(sensor, plan, {}, 4, [kind.at(30.0)]).mean(0) - plain) * sensor.e_per_dn
        for kind in local.KINDS
    }


def test_local_effects_are_where_they_say(local_differences):
    glow, edge, taps = (local_differences[name] for name in ("corner_glow", "edge_columns", "quarter_taps"))
    y, x = np.mgrid[:160, :200]
    distance = min(
        (np.hypot(r - y, c - x) for r in (0, 159) for c in (0, 199)), key=lambda d: glow[d < 10].mean() * -1
    )
    expected = 60 * np.exp(-distance / local.REACH_PX)
    # shot noise of 60 e- in 12 frames is 2.3 e- a pixel at the most; a block of 10 x 10 knows its mean to 0.23
    blocks = (glow - expected).reshape(16, 10, 20, 10).mean((1, 3))
    assert np.abs(blocks).max() < 5 * 0.23
    columns = edge.mean(0)
    assert sorted(np.flatnonzero(columns < -29.9)) in (list(range(12)), list(range(188, 200)))
    assert np.count_nonzero(np.abs(columns) > 0.1) == local.EDGE_COLUMNS
    levels = taps.mean(0).reshape(4, 50)
    assert np.ptp(levels, axis=1).max() < 0.1  # rounding
    assert np.sqrt(np.mean(levels**2)) == pytest.approx(30.0, rel=0.01)
    assert np.diff(np.sort(levels[:, 0])) == pytest.approx([26.7, 27.0, 26.7], abs=0.2)


@pytest.fixture(scope="module")
def wrong_files():
    return list(recipes.wrong_file(3, cameras.SMALL, "plain"))


def test_wrong_files_state_the_mistake_and_hide_nothing(wrong_files, tmp_path):
    kinds = {recipe.mistake[1] for recipe in wrong_files}
    assert kinds >= {"inverse", "unit", "variance", "kelvin", "per_cent", "time_unit", "black_level"}
    inverse = next(recipe for recipe in wrong_files if recipe.mistake[1] == "inverse")
    write_set(inverse, tmp_path / "sets", tmp_path / "answers")
    told = (tmp_path / "sets" / inverse.identity / "camera.yaml").read_text()
    assert f"gain_e_per_dn: {1 / cameras.sensor(cameras.SMALL).e_per_dn:.6g}" in told


@pytest.mark.parametrize(
    ("told", "accepted", "right"),
    [
        ([("gain_e_per_dn", "inverse")], [], True),
        ([], [], False),
        ([("gain_e_per_dn", "inverse"), ("prnu.pixel", "per_cent")], [], False),
        ([("gain_e_per_dn", "inverse")], ["row_noise"], False),
    ],
)
def test_a_mistake_in_the_file_is_right_where_it_alone_is_told(told, accepted, right):
    answer = {"kind": "wrong_file", "expect": [], "without": None, "axis": [], "grows": [], "may_grow": []}
    answer["mistake"] = ["gain_e_per_dn", "inverse"]
    mistakes = [{"key": key, "mistake": kind} for key, kind in told]
    diagnosis = {"accepted": accepted, "unexplained": None, "camera_file": mistakes}
    assert judge.verdict(answer, {"diagnosis": diagnosis})["right"] == right


def test_calibration_error_is_zero_for_true_probabilities_and_large_for_false_ones():
    rng = np.random.default_rng(1)
    p = rng.uniform(0.5, 1, 4000)
    true = [(float(each), bool(rng.random() < each)) for each in p]
    assert calibration.expected_error(true) < 0.04  # 5 bins, standard errors below 0.018
    assert calibration.expected_error([(0.99, k % 2 == 0) for k in range(100)]) == pytest.approx(0.49)


def test_intervals_hold_the_hidden_strength_or_do_not():
    entry = {"effect": "tap_mismatch", "parameters": {"offset_e": {"value": -3.0, "low": -3.2, "high": -2.9}}}
    result = {"diagnosis": {"accepted": ["tap_mismatch"], "ranking": [entry]}}
    for strength, is_inside in ((3.0, True), (2.5, False), (3.3, False)):
        answer = {"hidden": [("tap_mismatch", strength, "default")], "camera": 0}
        assert calibration.covered(answer, result) == [("tap_mismatch", is_inside)]
