"""A whole small study: interrupted, gone on with, one arm failing; and the arithmetic of differences."""

import os
import pickle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import yaml
from torch import nn
from ultralytics import YOLO
from ultralytics.nn.tasks import yaml_model_load

from visaug.core.errors import InputError
from visaug_train import callbacks, training
from visaug_train.config import check_config
from visaug_train.evaluate import evaluate
from visaug_train.geometry import Keypoints, project_targets
from visaug_train.metrics import Detections
from visaug_train.results import Ablation, ablate
from visaug_train.speed import read_poses
from visaug_train.training import Run, read_curves

CAMERA = str(Path(__file__).resolve().parents[2] / "configs" / "demo_camera.yaml")
TANGO = Keypoints.load()


def study_config(rendered, output, **changes):
    return check_config(
        {
            "name": "small",
            "output": str(output),
            "data": {"root": str(rendered)},
            "training": {
                "epochs": 2,
                "imgsz": 64,
                "batch": 8,
                "amp": False,
                "device": "cpu",
                "mosaic": 0.0,
                "fliplr": 0.0,
            },
            "arms": {
                "baseline": {"gaussian": {}},
                "vis": {"like": "baseline", "vis": {"camera": CAMERA}},
                "broken": {"gaussian": {"p": 0.123}},
            },
            "bootstrap": 20,
        }
        | changes
    )


class Broken(nn.Module):
    def forward(self, images):
        raise RuntimeError("this arm fails")


def weights_of(run):
    return YOLO(str(run / "weights" / "best.pt")).model.state_dict()


@pytest.mark.slow
def test_a_study_goes_on_where_it_was_and_outlives_a_failing_arm(rendered, tmp_path, monkeypatch):
    real = training.batch_noise
    monkeypatch.setattr(
        training,
        "batch_noise",
        lambda arm: Broken() if arm.gaussian and arm.gaussian.p == 0.123 else real(arm),
    )
    config = study_config(rendered, tmp_path / "out")

    def stop(title, done, _total):
        if title.startswith("training baseline") and done == 2:
            raise KeyboardInterrupt  # in the second epoch, after the first was saved

    with pytest.raises(KeyboardInterrupt):
        ablate(config, stop)
    (half,) = (tmp_path / "out" / "runs").glob("baseline-*")
    assert not (half / "run.json").exists()
    last = half / "weights" / "last.pt"
    os.truncate(last, last.stat().st_size // 2)  # as a kill in the midst of ultralytics' writing leaves it

    ablation = ablate(config)
    assert {arm for arm, _ in ablation.scored} == {"baseline", "vis"}
    assert [f.arm for f in ablation.failures] == ["broken"]
    assert "this arm fails" in ablation.failures[0].error
    assert read_curves(half / "results.csv")["epoch"] == [1, 2]
    assert ablation.interval_covers.startswith("the intervals cover the choice of test images only")

    undisturbed = ablate(study_config(rendered, tmp_path / "other", arms={"baseline": {"gaussian": {}}}))
    assert undisturbed.summaries["baseline", 0] == ablation.summaries["baseline", 0]
    (whole,) = (tmp_path / "other" / "runs").glob("baseline-*")
    assert weights_of(whole).keys() == weights_of(half).keys()
    assert all(torch.equal(value, weights_of(half)[name]) for name, value in weights_of(whole).items())

    stamps = {f: f.stat().st_mtime_ns for f in (tmp_path / "out" / "runs").glob("[bv][ai]*/weights/*.pt")}
    again = ablate(config)
    assert stamps == {f: f.stat().st_mtime_ns for f in stamps}
    assert again.to_json()["runs"] == ablation.to_json()["runs"]

    written = again.write(tmp_path / "tables").read_text()
    assert "| baseline |" in written
    assert "Failed: broken, seed 0" in written
    assert len((tmp_path / "tables" / "images" / "vis-seed0-lightbox.csv").read_text().splitlines()) == 5


def test_a_failing_arm_is_told_and_what_is_trained_is_kept(rendered, tmp_path, monkeypatch):
    real = training.batch_noise
    monkeypatch.setattr(
        training,
        "batch_noise",
        lambda arm: Broken() if arm.gaussian and arm.gaussian.p == 0.123 else real(arm),
    )
    arms = {"broken": {"gaussian": {"p": 0.123}}, "baseline": {"gaussian": {}}}
    config = study_config(rendered, tmp_path / "out", arms=arms)
    config.training["epochs"] = 1
    ablation = ablate(config)
    assert {arm for arm, _ in ablation.scored} == {"baseline"}
    assert [(f.arm, "this arm fails" in f.error) for f in ablation.failures] == [("broken", True)]

    stamps = {f: f.stat().st_mtime_ns for f in (tmp_path / "out" / "runs").glob("baseline-*/weights/*.pt")}
    again = ablate(config)
    assert stamps
    assert stamps == {f: f.stat().st_mtime_ns for f in stamps}
    assert again.to_json()["runs"] == ablation.to_json()["runs"]
    written = again.write(tmp_path / "tables").read_text()
    assert "| baseline |" in written
    assert "Failed: broken, seed 0" in written


def test_a_training_stopped_after_its_last_epoch_is_finished_not_repeated(rendered, tmp_path, monkeypatch):
    config = study_config(rendered, tmp_path / "out", arms={"baseline": {"gaussian": {}}})
    config.training["epochs"] = 1

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(training, "write_json", killed)  # run.json is what comes after the training
        ablate(config)
    (run,) = (tmp_path / "out" / "runs").iterdir()
    trained = weights_of(run)
    (run / "weights" / "best.pt").write_bytes(b"torn")  # killed in the midst of stripping it
    told = []
    ablation = ablate(config, lambda title, *_: told.append(title))
    assert not ablation.failures
    assert not any(title.startswith("training") for title in told)
    assert all(torch.equal(value, trained[name]) for name, value in weights_of(run).items())
    assert not list((run / "weights").glob("resume*"))


class Evil:
    def __reduce__(self):
        return os.mkdir, ("evil",)


def test_neither_a_checkpoint_nor_a_network_runs_code(rendered, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for content in (b"", b"no archive", pickle.dumps(Evil())):
        (tmp_path / "weights").mkdir(exist_ok=True)
        (tmp_path / "weights" / callbacks.STATE).write_bytes(content)
        assert callbacks.load_state(tmp_path) is None
    torch.save(
        {"exact": Evil(), "ema": 1, "optimizer": 1, "epoch": 1}, tmp_path / "weights" / callbacks.STATE
    )
    assert callbacks.load_state(tmp_path) is None

    network = yaml_model_load("yolov8n-pose.yaml") | {"activation": "(__import__('os').mkdir('evil'),)[0]"}
    (tmp_path / "yolov8n-mine.yaml").write_text(yaml.safe_dump(network))
    with pytest.raises(InputError, match="activation"):
        ablate(study_config(rendered, tmp_path / "out", model="yolov8n-mine.yaml"))
    assert not (tmp_path / "evil").exists()


def constructed(rendered, shifts):
    """An ablation of made-up detections: keypoints off by `shifts[arm][seed]` pixels."""
    config = study_config(
        rendered, "unused", seeds=[0, 1], bootstrap=200, arms={"baseline": {}, "better": {}}
    )
    poses = read_poses(rendered, "lightbox")
    targets = project_targets(poses.camera, TANGO, poses.quaternions, poses.translations)
    scored = {}
    for arm, by_seed in shifts.items():
        for seed, shift in enumerate(by_seed):
            detections = [
                Detections(box[None] + shift, points[None] + shift, np.ones((1, 11)), np.ones(1))
                for box, points in zip(targets.boxes, targets.points)
            ]
            run = Run(arm, seed, Path("x"), Path("y"), 1.0, {})
            scored[arm, seed] = run, {"lightbox": evaluate("lightbox", poses, TANGO, detections)}
    study = SimpleNamespace(config=config, tests={"lightbox": poses}, keypoints=TANGO, hidden=())
    return Ablation(study, scored, ())  # type: ignore[arg-type]


def test_differences_are_means_over_seeds_and_lie_in_their_intervals(rendered):
    ablation = constructed(rendered, {"baseline": [3.0, 2.0], "better": [1.0, 0.5]})
    found = {d.measure: d for d in ablation.differences}
    means = [
        np.mean([ablation.summaries[arm, s]["lightbox"]["iou"] for s in (0, 1)])
        for arm in ("baseline", "better")
    ]
    assert found["iou"].difference == pytest.approx(means[1] - means[0])
    assert 0 < found["iou"].low <= found["iou"].difference <= found["iou"].high
    assert "2 training seeds" in ablation.interval_covers
    assert ablation.tables()["differences"].to_csv().count("yes") >= 3


def test_equal_arms_do_not_differ(rendered):
    ablation = constructed(rendered, {"baseline": [2.0, 2.0], "better": [2.0, 2.0]})
    assert ablation.differences
    assert all(d.difference == d.low == d.high == 0 for d in ablation.differences)


def test_tables_have_the_papers_form(rendered):
    made = constructed(rendered, {"baseline": [3.0, 2.0], "better": [1.0, 0.5]}).tables()
    assert made["detection"].head == ["arm", "lightbox: box AP50-95", "lightbox: IoU mean"]
    assert [row[0] for row in made["keypoints"].rows] == ["baseline", "better"]
    assert made["keypoints"].to_markdown().count("\n") == 6


def test_an_overview_says_in_words_what_is_clear(rendered):
    """Two seeds: Student's t with one degree of freedom, 12.7 times the standard error."""
    clear = constructed(rendered, {"baseline": [9.0, 9.0], "better": [0.1, 0.1]}).tables()["overview"]
    assert clear.head == ["test set", "baseline", "better"]
    assert clear.rows[0][0] == "lightbox"
    assert "(better: +" in clear.rows[0][2]
    lottery = constructed(rendered, {"baseline": [9.0, 9.0], "better": [0.1, 8.0]}).tables()["overview"]
    assert "(not clear: +" in lottery.rows[0][2]


def test_tables_are_written_for_papers(rendered):
    ablation = constructed(rendered, {"baseline": [3.0, 2.0], "better": [1.0, 0.5]})
    ablation.config.published = True
    made = ablation.tables()
    assert "0.8280" in next(row for row in made["detection"].rows if row[0] == "the paper: baseline")[2]
    assert ["SLN (YOLOv5s)", "0.9538", "0.9851"] in made["comparison"].rows
    latex = made["detection"].to_latex()
    assert latex.count(r"\\") == len(made["detection"].rows) + 1
    assert r"$\pm$" in latex
    assert made["poses"].head[2:4] == ["E_t mean, m", "E_t median, m"]
    assert r"E\_t" in made["poses"].to_latex()
