"""What makes a study comparable: one training by one hash, the same device everywhere, corrected comparisons, unseen tests."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import yaml
from scipy.stats import ttest_1samp

from visaug.app.cli import main
from visaug.core.errors import InputError
from visaug_train import checks
from visaug_train.callbacks import keep_batch
from visaug_train.checks import check_apart, check_arms
from visaug_train.config import check_config, load_config
from visaug_train.record import surroundings
from visaug_train.results import Ablation, ArmDifference
from visaug_train.speed import part_of, read_poses
from visaug_train.statistics import holm, paired_interval, paired_p_value
from visaug_train.studies.target import TargetCamera, transductive
from visaug_train.tables import TABLES_2_3, by_chance, difference_table, marked, score_table, weights_table
from visaug_train.training import prepare

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


def study(tmp_path, **changes):
    return check_config(
        {
            "name": "n",
            "output": str(tmp_path / "out"),
            "data": {"rendered": {}},
            "model": "yolov8n-pose.yaml",
            "training": {"epochs": 1, "device": "cpu"},
            "arms": {"baseline": {}, "vis": {"training": {"degrees": 3.0}}},
        }
        | changes
    )


@pytest.mark.parametrize(
    "path", sorted(p for p in CONFIGS.glob("*.yaml") if "arms" in p.read_text() or "extends" in p.read_text())
)
def test_no_config_depends_on_what_happens_to_be_installed(path):
    assert load_config(path).training["augmentations"] == []


def test_the_versions_that_change_a_training_are_recorded():
    assert {"torch", "albumentations", "ultralytics-opencv-headless"} <= surroundings("cpu").keys()


def test_bf16_is_off_where_it_is_not_native_and_said_once(tmp_path):
    arms = {"baseline": {}, "vis": {"training": {"amp": "bf16"}}}
    said: list[str] = []
    check_arms(study(tmp_path, training={"device": "cpu", "amp": "bf16"}, arms=arms), said.append)
    assert len(said) == 1
    assert "bfloat16" in said[0]
    assert checks.followed({"device": "cpu", "amp": "bf16"})["amp"] is False
    assert surroundings("cpu", False)["amp"] is False


def test_bf16_stays_where_it_is_native(tmp_path, monkeypatch):
    monkeypatch.setattr(checks, "has_bf16", lambda _: True)
    check_arms(study(tmp_path, training={"device": "cpu", "amp": "bf16"}), pytest.fail)
    assert checks.followed({"amp": "bf16"}) == {"amp": "bf16"}


@pytest.mark.parametrize(
    ("training", "message"),
    [
        ({"batch": -1}, "training.batch: -1 leaves the batch size to the memory"),
        ({"batch": 0.7}, "training.batch: 0.7 leaves"),
        ({"device": [0, 99]}, "training.device: .* is not a device of this machine"),
        ({"device": "gpu"}, "training.device"),
    ],
)
def test_what_a_device_cannot_do_is_refused_before_any_file_is_made(tmp_path, training, message):
    with pytest.raises(InputError, match=message):
        check_arms(study(tmp_path, training=training))
    assert not list((tmp_path / "out").glob("data*"))


def test_a_smaller_batch_in_one_arm_is_refused():
    keep_batch(16, SimpleNamespace(batch_size=16))
    with pytest.raises(InputError, match="16 images do not fit"):
        keep_batch(16, SimpleNamespace(batch_size=8))


def test_the_cost_counts_every_image_of_every_run(tmp_path, monkeypatch):
    monkeypatch.setattr(checks, "seconds_per_image", lambda *_: 0.5)
    arms = {"baseline": {}, "long": {"training": {"epochs": 7}}}
    config = study(
        tmp_path,
        training={"epochs": 3, "device": "cpu"},
        start={"epochs": 2},
        seeds=[0, 1],
        arms=arms,
    )
    # 100 images: 2 seeds of 3 + 7 epochs, and 2 of the start, are 2,200 at half a second
    assert "4 runs, 2,200 images: about 18 minutes" in checks.cost(config, 100)
    assert "1 run, 900 images: about 8 minutes" in checks.cost(config, 100, ["long"])


def test_a_trial_measures_the_network_and_leaves_the_random_numbers(tmp_path):
    torch.manual_seed(0)
    expected = torch.rand(1)
    torch.manual_seed(0)
    config = study(tmp_path, training={"imgsz": 32, "device": "cpu"})
    assert 0 < checks.seconds_per_image(config, torch.device("cpu")) < 5
    assert torch.rand(1) == expected


def test_shares_of_a_split_do_not_overlap_and_test_images_stay_apart(rendered):
    poses = read_poses(rendered, "synthetic", "train")
    parts = [part_of(poses, share, 0) for share in ((0.0, 0.75), (0.75, 1.0))]
    assert [len(part) for part in parts] == [6, 2]
    assert {f for part in parts for f in part.files} == set(poses.files)
    assert part_of(poses, (0.75, 1.0), 1).files != parts[1].files
    check_apart({"train": parts[0], "val": parts[1]}, {"lightbox": read_poses(rendered, "lightbox")})
    with pytest.raises(InputError, match=r"data\.test\.mine: 2 of its 8 images also choose the weights"):
        check_apart({"val": parts[1]}, {"mine": poses})
    with pytest.raises(InputError, match="also train the network"):
        check_apart({"train": parts[0]}, {"mine": poses})


def test_a_study_whose_test_images_choose_the_weights_is_refused(rendered, tmp_path):
    source = {"domain": "synthetic", "split": "validation"}
    config = study(
        tmp_path, data={"root": str(rendered), "validation": source, "test": {"synthetic": source}}
    )
    with pytest.raises(InputError, match=r"data\.test\.synthetic: 4 of its 4 images also choose"):
        prepare(config)
    assert not list((tmp_path / "out").glob("*ultralytics/images"))


def test_holm_is_the_stepwise_procedure():
    """Rejecting at a level is what the definition says: from the smallest on, p(i) <= level / (N - i), until one fails."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        p = rng.uniform(0, 0.2, 12)
        for level in (0.05, 0.3):
            order, rejected = np.argsort(p), np.zeros(12, bool)
            for i, index in enumerate(order):
                if p[index] > level / (12 - i):
                    break
                rejected[index] = True
            assert ((holm(p) <= level) == rejected).all()
    assert holm(np.array([0.01, np.nan]))[0] == pytest.approx(0.02)


def test_a_p_value_is_students_and_no_bolder_than_the_interval():
    rng = np.random.default_rng(1)
    differences, variance = rng.normal(0.3, 1, (4, 500)), rng.uniform(0, 0.3, 500)
    low, high = paired_interval(differences, variance, 50)
    p = paired_p_value(differences, variance, 50)
    assert not ((p < 0.05) & (low <= 0) & (high >= 0)).any()
    assert (p < 0.05).any()
    only_seeds = paired_p_value(differences, np.zeros(500), 50)
    np.testing.assert_allclose(only_seeds, ttest_1samp(differences, 0, axis=0).pvalue, rtol=1e-9)
    assert paired_p_value(np.zeros((2, 1)), np.zeros(1), 50) == 1
    assert paired_p_value(np.ones((2, 1)), np.zeros(1), 50) == 0
    assert np.isnan(paired_p_value(np.ones((1, 1)), np.full(1, np.nan), 50))


def test_studies_in_which_no_arm_does_anything_have_few_corrected_findings():
    """231 differences of three seeds: at most 5 % of the studies may have any that Holm leaves, so at most 17 of 200
    (p < 0.02 that 5 % give more). Most have some without the correction.
    """
    rng, found, corrected = np.random.default_rng(2), 0, 0
    for _ in range(200):
        differences = rng.normal(0, 0.02, (3, 231)) - rng.normal(0, 0.02, (3, 231))
        p = paired_p_value(differences, np.full(231, 0.003**2), 2400)
        found += bool((p < 0.05).any())
        corrected += bool((holm(p) < 0.05).any())
    assert corrected <= 17
    assert found > 150


def difference(p=0.5, low=-1.0):
    return ArmDifference("vis", "lightbox", "iou", 0.5, 0.2, low, 1.0, p)


def test_the_table_says_what_chance_would_find():
    rows = [difference(0.01, 0.1), difference(0.3, 0.1), *[difference() for _ in range(38)]]
    table = difference_table(rows, "baseline")
    assert [row[-2:] for row in table.rows[:3]] == [["yes", "yes"], ["yes", "no"], ["no", "no"]]
    assert "2 of 40 intervals of 95 % leave out 0; 2.0 would by chance" in table.note
    assert table.note in table.to_markdown()
    assert by_chance([]) == ""


def test_the_papers_keypoint_figures_stand_under_both_definitions():
    table = score_table("t", TABLES_2_3, ["keypoint_ap_paper", "keypoint_ap_coco"])
    row = dict(zip(table.head, table.rows[1]))
    assert row["lightbox: keypoint AP50-95 (paper)"] == row["lightbox: keypoint AP50-95 (COCO)"] == "0.6340"


def test_both_weights_stand_side_by_side():
    scores = {"box_ap": 0.5, "keypoint_ap_paper": 0.1, "keypoint_ap_coco": 0.3}
    better = {key: value + 0.25 for key, value in scores.items()}
    table = weights_table("last", {"vis": {"lightbox": scores}}, "best", {"vis": {"lightbox": better}})
    assert table.head[2:4] == ["box AP50-95, last", "box AP50-95, best"]
    assert table.rows == [
        ["vis", "lightbox", "0.5000", "0.7500", "0.1000", "0.3500", "0.3000", "0.5500"],
    ]


def test_a_camera_made_of_test_pictures_is_marked_in_the_tables(rendered, tmp_path):
    tests = {"lightbox": read_poses(rendered, "lightbox"), "sunlamp": read_poses(rendered, "sunlamp")}
    config = study(tmp_path, arms={"baseline": {}, "mine": {"vis": {"camera": "c.yaml"}}})
    camera = TargetCamera("c", "lightbox", Path("c.yaml"), 3, {}, tests["lightbox"].files[:3])
    seen = transductive(SimpleNamespace(config=config, tests=tests, cameras=(camera,)))  # type: ignore[arg-type]
    assert list(seen) == ["mine"]
    assert "from 3 of the 4 test images of lightbox" in seen["mine"]
    table = marked(difference_table([replace(difference(), arm="mine")], "baseline"), seen)
    assert table.rows[0][0] == "mine †"
    assert "† mine: its camera" in table.note
    other = replace(camera, files=read_poses(rendered, "synthetic", "train").files)
    assert not transductive(SimpleNamespace(config=config, tests=tests, cameras=(other,)))  # type: ignore[arg-type]


def test_runs_of_different_versions_are_said(tmp_path):
    def run(**changed):
        return SimpleNamespace(surroundings={"torch": "2.14", "device": "cpu"} | changed), {}

    made = SimpleNamespace(config=study(tmp_path))
    alike = Ablation(made, {("baseline", 0): run(), ("vis", 0): run()}, ())  # type: ignore[arg-type]
    assert alike.mixed == ""
    mixed = Ablation(made, {("baseline", 0): run(), ("vis", 0): run(torch="2.15")}, ())  # type: ignore[arg-type]
    assert "torch 2.14 (1 run, such as baseline seed 0), 2.15 (1 run, such as vis seed 0)" in mixed.mixed


def test_an_arm_is_named_on_the_command_line(tmp_path, capsys):
    content = yaml.safe_load(study(tmp_path).model_dump_json())
    content["arms"] = {"baseline": {}, "vis": {}}
    (tmp_path / "c.yaml").write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))
    for arm, said in (("baseline", "arm baseline, seed 0 is not trained"), ("x", "x is not an arm")):
        with pytest.raises(SystemExit) as ended:
            main(["evaluate", str(tmp_path / "c.yaml"), "--arm", arm])
        assert ended.value.code == 2
        assert said in capsys.readouterr().err
