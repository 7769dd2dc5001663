"""The harness from the command line, with a network in whose place stands the truth with an error of some pixels."""

import json
import shutil

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from visaug.app.cli.root import program
from visaug_train import checks, training
from visaug_train.geometry import Keypoints, project_targets
from visaug_train.metrics import Detections
from visaug_train.speed import read_poses

TANGO = Keypoints.load()
OFF_PX = {"last": 0.5, "best": 3.0}


@pytest.fixture
def stubbed(rendered, monkeypatch):
    def train(config, noise, arguments, data_yaml, folder, *_, **__):
        (folder / "weights").mkdir(parents=True)
        for name in OFF_PX:
            (folder / "weights" / f"{name}.pt").write_bytes(b"")
        (folder / "results.csv").write_text("epoch,train/pose_loss\n1,2.0\n")
        return 1.0

    def predict(weights, poses, *_, **__):
        true = poses if poses.labelled else read_poses(rendered, poses.domain)
        targets = project_targets(true.camera, TANGO, true.quaternions, true.translations)
        off = OFF_PX[weights.stem]
        return [
            Detections(box[None] + off, points[None] + off, np.ones((1, 11)), np.ones(1))
            for box, points in zip(targets.boxes, targets.points)
        ]

    monkeypatch.setattr(training, "_train", train)
    monkeypatch.setattr(training, "predict", predict)
    monkeypatch.setattr(checks, "seconds_per_image", lambda *_: 0.1)


def call(*words):
    result = CliRunner().invoke(program, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result


@pytest.fixture
def config(rendered, tmp_path):
    content = {
        "name": "n",
        "output": str(tmp_path / "out"),
        "data": {"root": str(rendered), "test": {"lightbox": {"domain": "lightbox"}}},
        "model": "yolov8n-pose.yaml",
        "training": {"epochs": 1, "imgsz": 160, "device": "cpu", "amp": "bf16"},
        "arms": {"baseline": {}, "vis": {"gaussian": {}}},
        "bootstrap": 5,
    }
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
    return tmp_path / "c.yaml"


def test_one_arm_is_trained_and_both_of_its_weights_are_scored(stubbed, config, tmp_path):
    said = call("train", config, "--arm", "baseline").output
    assert "cost: 1 run, 8 images" in said
    assert "bf16 is off" in said
    assert [p.name.split("-")[0] for p in (tmp_path / "out" / "runs").iterdir()] == ["baseline"]
    call("evaluate", config, "--arm", "baseline", "--json", tmp_path / "s.json")
    scores = json.loads((tmp_path / "s.json").read_text())["lightbox"]
    assert scores["weights"] == "last"
    assert scores["oks"]["coco"] > scores["best"]["oks"]["coco"] > 0


def test_a_trained_network_writes_a_submission_for_images_without_labels(stubbed, config, rendered, tmp_path):
    call("train", config, "--arm", "vis")
    data = shutil.copytree(rendered, tmp_path / "unlabelled")
    listing = data / "sunlamp" / "test.json"
    names = [record["filename"] for record in json.loads(listing.read_text())]
    listing.write_text(json.dumps([{"filename": name} for name in names]))
    words = ("--data", data, "--domain", "sunlamp", "--poses", tmp_path / "sub.csv")
    assert "4 images without labels" in call("evaluate", config, *words).output
    lines = (tmp_path / "sub.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == names
    found = np.array([line.split(",")[5:] for line in lines], float)
    np.testing.assert_allclose(found, read_poses(rendered, "sunlamp").translations, atol=0.3)


def test_a_study_reports_both_weights_and_forgets_old_failures(stubbed, config, tmp_path):
    old = tmp_path / "out" / "failures" / "vis-seed0.txt"
    old.parent.mkdir(parents=True)
    old.write_text("of an earlier try")
    said = call("ablate", config).output
    assert "cost: 2 runs, 16 images" in said
    assert not old.exists()
    tables = (tmp_path / "out" / "tables.md").read_text()
    assert "Weights of the same runs: last and best" in tables
    assert "would by chance if no arm did anything" in tables
    run = json.loads((tmp_path / "out" / "ablation.json").read_text())["runs"][0]
    assert run["scores"]["lightbox"]["iou"] > run["best"]["lightbox"]["iou"]
    assert "torch" in run["surroundings"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "would by chance if no arm did anything" in page


def test_what_was_recognised_is_said_beside_the_scores(rendered, tmp_path):
    poses = read_poses(rendered, "lightbox")
    lines = [
        ",".join([file.stem, *(f"{v:.9g}" for v in (*np.roll(q, -1), *(1000 * r)))])
        for file, q, r in zip(poses.files, poses.quaternions, poses.translations)
    ]
    (tmp_path / "p.csv").write_text("\n".join(lines))
    result = call("evaluate", "--predictions", tmp_path / "p.csv", "--data", rendered, "--domain", "lightbox")
    assert "note: lightbox: the quaternions are scalar last" in result.stderr
    assert "note: lightbox: the positions are in millimetres" in result.stderr
    assert "0.0000" in result.stdout


def test_prepare_is_a_command(rendered, tmp_path):
    packed = shutil.make_archive(str(tmp_path / "set"), "zip", rendered)
    said = call("prepare", packed, "-o", tmp_path / "data", "--coco", "--size", "80x50").output
    assert "lightbox/test: 4 images" in said
    assert (tmp_path / "data-coco" / "lightbox-test.json").is_file()
    assert (tmp_path / "data-80x50" / "data.yaml").is_file()


def test_another_set_is_split_as_the_config_says_and_keeps_the_files_of_the_own_one(
    stubbed, rendered, tmp_path
):
    speed = tmp_path / "speed"
    source = read_poses(rendered, "synthetic", "train")
    shutil.copytree(source.files[0].parent, speed / "images" / "train")
    shutil.copy(rendered / "camera.json", speed)
    shutil.copy(rendered / "synthetic" / "train.json", speed)
    content = {
        "name": "n",
        "output": str(tmp_path / "out"),
        "data": {
            "root": str(speed),
            "split_seed": 1,
            "train": {"domain": "speed", "split": "train"},
            "validation": {"domain": "speed", "split": "validation"},
            "test": {"speed": {"domain": "speed", "split": "test"}},
        },
        "training": {"epochs": 1, "imgsz": 160, "device": "cpu"},
        "arms": {"baseline": {}},
    }
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
    call("train", tmp_path / "c.yaml")
    call("evaluate", tmp_path / "c.yaml")
    (table,) = (tmp_path / "out" / "runs").glob("*/speed.csv")
    own = table.read_text()
    call("evaluate", tmp_path / "c.yaml", "--data", speed, "--domain", "speed")
    assert table.read_text() == own
    assert len(list(table.parent.glob("speed*.csv"))) == 2
    call("evaluate", tmp_path / "c.yaml", "--data", speed, "--domain", "speed", "--split", "train")
    assert table.read_text() == own
    assert len(list(table.parent.glob("speed*.csv"))) == 4


def test_an_arm_goes_with_a_config(rendered, tmp_path):
    words = ["evaluate", "--predictions", "p.csv", "--data", rendered, "--domain", "lightbox", "--arm", "vis"]
    result = CliRunner().invoke(program, [str(word) for word in words])
    assert "--arm: goes with CONFIG" in str(result.exception) + result.output
