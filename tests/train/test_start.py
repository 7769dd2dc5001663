"""The network that all runs start from: trained once, known by its hash, and really loaded."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from visaug_train import training
from visaug_train.batch_noise import GaussianNoise
from visaug_train.callbacks import close_noise
from visaug_train.config import check_config
from visaug_train.training import prepare, start_network, train_run


@pytest.fixture
def study(rendered, tmp_path):
    return prepare(
        check_config(
            {
                "name": "small",
                "output": str(tmp_path / "out"),
                "data": {"root": str(rendered)},
                "start": {"epochs": 7, "training": {"lrf": 0.5}},
                "training": {"epochs": 2, "imgsz": 64},
                "arms": {"baseline": {"gaussian": {}}, "blurred": {"blur": {}}},
            }
        )
    )


def test_arms_and_seeds_share_one_start(study, monkeypatch):
    calls = []

    def train(config, noise, arguments, data_yaml, folder, seed, title, progress, clean_epochs=0):
        calls.append((config.model, len(noise), arguments["epochs"], folder.name.rsplit("-", 1)[0]))
        (folder / "weights").mkdir(parents=True)
        (folder / "results.csv").write_text("epoch,train/pose_loss\n1,2.0\n")
        return 1.0

    monkeypatch.setattr(training, "_train", train)
    for seed in (0, 1):
        train_run(study, "blurred", seed)
    start = start_network(study)
    assert calls == [
        ("yolov8n-pose.yaml", 0, 7, "start-seed0"),
        (start, 1, 2, "blurred-seed0"),
        (start, 1, 2, "blurred-seed1"),
    ]
    assert Path(start).name == "last.pt"
    other = study.config.model_copy(update={"start": study.config.start.model_copy(update={"epochs": 8})})
    changed = type(study)(other, study.data_yaml, study.keypoints, study.tests, study.training_images)
    assert training.run_folder(changed, "blurred", 0) != training.run_folder(study, "blurred", 0)


@pytest.mark.parametrize(("model", "loaded"), [("yolov8n-pose.yaml", False), ("start.pt", True)])
def test_weights_are_loaded_where_there_are_some(study, tmp_path, monkeypatch, model, loaded):
    """ultralytics drops the weights of a .pt in silence where `pretrained` is False."""
    import ultralytics

    asked = {}

    class Network:
        def __init__(self, path, **_):
            asked["path"] = path

        def add_callback(self, *_):
            pass

        def train(self, **arguments):
            asked.update(arguments)

    monkeypatch.setattr(ultralytics, "YOLO", Network)
    config = study.config.model_copy(update={"model": model})
    training._train(
        config,
        training.batch_noise(config.arm("blurred")),
        {},
        study.data_yaml,
        tmp_path / "run",
        0,
        "",
        None,
    )
    assert asked["path"] == model
    assert asked["pretrained"] is loaded


def test_the_last_epochs_can_be_clean(study):
    trainer = SimpleNamespace(epoch=0, epochs=3, noise=GaussianNoise(p=1.0, std=(0.1, 0.1)))
    noisy = []
    for trainer.epoch in range(3):
        close_noise(1, trainer)
        noisy.append(isinstance(trainer.noise, GaussianNoise))
    assert noisy == [True, True, False]
    close_noise(0, kept := SimpleNamespace(epoch=2, epochs=3, noise=GaussianNoise(p=1.0, std=(0.1, 0.1))))
    assert isinstance(kept.noise, GaussianNoise)
    arm = study.config.arms["baseline"].model_copy(update={"clean_epochs": 1})
    closing = study.config.model_copy(update={"arms": {"baseline": arm}})
    changed = type(study)(closing, study.data_yaml, study.keypoints, study.tests, study.training_images)
    assert training.run_folder(changed, "baseline", 0) != training.run_folder(study, "baseline", 0)
