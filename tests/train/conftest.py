"""A tiny rendered dataset, made once."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("YOLO_OFFLINE", "1")
os.environ.setdefault("YOLO_AUTOINSTALL", "0")
os.environ.setdefault("YOLO_VERBOSE", "false")
os.environ.setdefault("ULTRALYTICS_SAFE_LOAD", "1")

from visaug_train.render.dataset import RenderSettings, render_dataset


@pytest.fixture(scope="session", autouse=True)
def ultralytics_settings(tmp_path_factory: pytest.TempPathFactory) -> None:
    """ultralytics keeps its settings in a folder of the tests."""
    os.environ.setdefault("YOLO_CONFIG_DIR", str(tmp_path_factory.mktemp("ultralytics")))


@pytest.fixture(scope="session")
def settings() -> RenderSettings:
    return RenderSettings(
        width=160,
        height=100,
        images={
            "synthetic": {"train": 8, "validation": 4, "test": 4},
            "lightbox": {"test": 4},
            "sunlamp": {"test": 4},
        },
        linear_frames=True,
    )


@pytest.fixture(scope="session")
def rendered(tmp_path_factory: pytest.TempPathFactory, settings: RenderSettings) -> Path:
    return render_dataset(tmp_path_factory.mktemp("rendered"), settings)
