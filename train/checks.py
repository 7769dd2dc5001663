"""What is refused, or settled, before a study makes any file."""

import hashlib
import re
from pathlib import Path

from visaug.core.errors import InputError
from visaug_train.config import Config, Start
from visaug_train.device import Say, check_device
from visaug_train.noise import batch_noise
from visaug_train.quiet import check_tracking, quiet_ultralytics
from visaug_train.speed import PoseSet
from visaug_train.studies.hidden import hidden_cameras
from visaug_train.studies.target import check_cameras


def check_apart(parts: dict[str, PoseSet], tests: dict[str, PoseSet]) -> None:
    """Refuse test images that train the network, or that choose its weights."""
    for part, poses in parts.items():
        files = {file.resolve() for file in poses.files}
        for name, test in tests.items():
            if shared := files & {file.resolve() for file in test.files}:
                does = "train the network" if part == "train" else "choose the weights `best`"
                raise InputError(
                    f"{len(shared)} of its {len(test)} images also {does}",
                    field=f"data.test.{name}",
                    expected="other images, for instance a `share` of the split: [0.9, 1.0]",
                )


def check_arms(config: Config, announce: Say | None = None) -> None:
    """Refuse, before any training, what could not be trained; `announce` gets a line for what this device does differently.

    Raises:
        InputError: an invalid camera, or training arguments of an arm that are invalid or that this device cannot follow.
    """
    hidden_cameras(config)
    check_cameras(config)
    check_tracking(config.tracking)
    quiet_ultralytics(config.output / "ultralytics-settings")
    from ultralytics.cfg import get_cfg
    from ultralytics.nn.tasks import yaml_model_load

    if not (config.model.endswith(".pt") and Path(config.model).is_file()):
        try:
            yaml_model_load(config.model)
        except (OSError, AssertionError):  # the latter for another suffix
            raise InputError(
                f"no such network: {config.model}",
                field="model",
                expected="a YAML such as yolov8n-pose.yaml, or the file of trained weights (NAME.pt)",
            ) from None
    if config.start and config.start.weights:
        start_weights(config.start)
    given = {"start": {**config.training, **config.start.training}} if config.start else {}
    for name in config.arms:
        arm = config.arm(name)
        if not set(arm.camera_files) & config.cameras.keys():  # else its noise is checked once they are made
            batch_noise(arm)
        given[name] = {**config.training, **arm.training}
    for name, arguments in given.items():
        try:
            get_cfg(overrides=arguments)
        except (SyntaxError, TypeError, ValueError) as error:  # how ultralytics refuses an argument
            plain = re.sub(r"\x1b\[[0-9;]*m", "", str(error)).strip().split("\n")[0]
            raise InputError(f"{name}: {plain}", field="training") from None
    if config.cluster is None or config.cluster.address is None:  # else the nodes decide
        check_device(list(given.values()), announce)


def start_weights(start: Start) -> bytes:
    """The safetensors file that all runs start from.

    Raises:
        InputError: no such file, or another SHA-256 than the config's.
    """
    file = Path(str(start.weights))
    if not file.is_file():
        raise InputError("no such file", file=file, field="start.weights", expected="a safetensors file")
    content = file.read_bytes()
    if (found := hashlib.sha256(content).hexdigest()) != start.sha256:
        raise InputError(f"has the SHA-256 {found}", file=file, expected=str(start.sha256))
    return content
