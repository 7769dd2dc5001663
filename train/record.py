"""What decides the outcome of a run, and what surrounded it: the values, not the names of files."""

import hashlib
import platform
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import visaug
from visaug.augment.journal import content_of
from visaug.camera import Camera
from visaug.core.documents import read_json
from visaug.effects.catalogue import sources_of
from visaug_train.arms import Arm
from visaug_train.config import Config

PACKAGES = ("torch", "torchvision", "numpy", "ultralytics", "ultralytics-opencv-headless")
# where albumentations is installed, ultralytics adds augmentations of its own by default
PACKAGES = (*PACKAGES, "opencv-python-headless", "albumentations")
# Entries of a run's surroundings that may change its outcome: the report says where runs differ in them.
COMPARED = ("visaug", *PACKAGES, "device", "amp")


def decides(config: Config, arm: Arm, data_yaml: Path) -> dict[str, Any]:
    """Network, arguments, noise, cameras by value, data: the content of a run's hash."""
    return {
        "visaug": visaug.__version__,
        "model": Path(config.model).name,
        "model_sha256": _file_digest(config.model),
        "training": {**config.training, **arm.training},
        "start": start_decides(config),
        **_noise(arm),
        **({"clean_epochs": arm.clean_epochs} if arm.clean_epochs else {}),
        "data": {**read_json(data_yaml.with_name("conversion.json")), "linked": None},  # what, not where
    }


def start_decides(config: Config) -> dict[str, Any] | None:
    """The same of the network that all runs start from."""
    if config.start is None:
        return None
    arm = config.arm(config.start.like) if config.start.like else Arm()
    start = config.start.model_dump(mode="json", exclude={"weights"}, exclude_none=True)
    return {**start, **_noise(arm), "noise_training": arm.training}


def _noise(arm: Arm) -> dict[str, Any]:
    """An arm's noise with its cameras by value: where their files lie decides nothing."""
    files = list(arm.camera_files)

    def numbered(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: numbered(value) for key, value in part.items()}
        if isinstance(part, list):
            return [numbered(value) for value in part]
        return f"camera {files.index(part)}" if isinstance(part, str) and part in files else part

    noise = arm.model_dump(mode="json", exclude={"training", "why", "like", "clean_epochs"})
    added = {entry["name"] for part in (arm.vis, arm.white) if part is not None for entry in part.effects}
    sources = {"effects": own} if (own := sources_of(added)) else {}
    return {"noise": numbered(noise), "cameras": [camera_values(name) for name in files], **sources}


def camera_values(source: Camera | str) -> dict[str, Any]:
    """Every value of a camera, and what it takes from files: a shipped camera that changes is another one."""
    camera = Camera.load(source)
    values = {key: value for key, value in camera.to_dict().items() if key != "source"}
    return values | taken_from_files(camera)


def taken_from_files(camera: Camera) -> dict[str, Any]:
    """Checksums of a camera's measured maps, and of the files that define effects of one's own."""
    maps = {key: hashlib.sha256(value.numpy().tobytes()).hexdigest() for key, value in camera.maps.items()}
    found = {"maps_sha256": maps, "effects_sha256": sources_of(camera.effect_names)}
    return {key: value for key, value in found.items() if value}


def surroundings(device: Any = None, amp: Any = None) -> dict[str, Any]:
    """Versions, the device and the precision that it trained in; recorded beside a run, no part of its hash."""
    import torch

    found = {"python": platform.python_version(), "visaug": visaug.__version__}
    for name in PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    wanted = str(device) if device not in (None, "") else ""
    on_cpu = wanted == "cpu" or not torch.cuda.is_available()
    where = platform.processor() or platform.machine() if on_cpu else torch.cuda.get_device_name()
    device = f"cpu: {where}" if on_cpu else f"cuda: {where}"
    return {**found, "device": device, "threads": torch.get_num_threads(), "amp": amp}


def _file_digest(path: str) -> str | None:
    """Of a file of weights; a YAML that comes with ultralytics is known by its name and version."""
    file = Path(path)
    return _digest_at(file, file.stat().st_mtime_ns) if file.is_file() else None


@lru_cache
def _digest_at(file: Path, _changed: int) -> str:
    return content_of(file)
