"""Tracking by ultralytics' own hooks: TensorBoard writes where the run lies; what is not installed is refused."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from visaug.core.errors import InputError
from visaug_train import checks, quiet
from visaug_train.config import check_config


def config_of(rendered, output, tracking):
    return {
        "name": "tracked",
        "output": str(output),
        "data": {"root": str(rendered)},
        "training": {"epochs": 1, "imgsz": 64, "batch": 8, "amp": False, "device": "cpu", "workers": 0},
        "arms": {"baseline": {"gaussian": {}}},
        "tracking": tracking,
    }


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("tensorboard") is None, reason="tensorboard is not installed")
def test_tensorboard_gets_the_curves(rendered, tmp_path):
    file = tmp_path / "config.yaml"
    file.write_text(yaml.safe_dump(config_of(rendered, tmp_path / "out", ["tensorboard"])))
    # A process of its own that does not know it is a test: there ultralytics' hook would be idle.
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "GITHUB"))}
    environment["YOLO_CONFIG_DIR"] = str(tmp_path)
    command = [sys.executable, "-m", "visaug", "train", str(file)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr[-2000:]
    (events,) = Path(tmp_path / "out" / "runs").glob("baseline-*/events.out.tfevents*")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    accumulator = EventAccumulator(str(events))
    accumulator.Reload()
    scalars = accumulator.Tags()["scalars"]
    assert "metrics/mAP50-95(P)" in scalars
    assert any(name.startswith("train/") for name in scalars)


def test_a_tool_that_is_not_installed_is_refused_before_training(rendered, tmp_path, monkeypatch):
    monkeypatch.setattr(quiet, "find_spec", lambda name: None)
    config = check_config(config_of(rendered, tmp_path / "out", ["mlflow"]))
    with pytest.raises(InputError, match=r"tracking.*pip install mlflow"):
        checks.check_arms(config)


def test_a_tracker_that_cannot_start_is_heard_of_and_the_rest_is_not(capsys):
    from ultralytics.utils import LOGGER

    quiet.set_tracking(["mlflow"])
    try:
        LOGGER.warning("MLflow: Failed to initialize")
        LOGGER.warning("something of ultralytics' own")
    finally:
        quiet.set_tracking([])
    LOGGER.warning("MLflow: no longer asked for")
    assert capsys.readouterr().err.splitlines() == ["MLflow: Failed to initialize"]
