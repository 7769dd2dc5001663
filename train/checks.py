"""What is refused, or settled, before a study makes any file; and what its device decides: arguments that it can follow, time."""

import hashlib
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from visaug.core.errors import InputError
from visaug.core.wording import counted
from visaug_train.config import LARGEST_SIDE, Config, Start
from visaug_train.datasets import keypoints_of
from visaug_train.geometry import Keypoints
from visaug_train.noise import batch_noise
from visaug_train.quiet import check_tracking, quiet_ultralytics
from visaug_train.speed import PoseSet
from visaug_train.studies.hidden import hidden_cameras
from visaug_train.studies.target import check_cameras

Say = Callable[[str], None]
A_NETWORK = "a pose network, such as yolov8n-pose.yaml"
# of ultralytics
OPTIMIZERS = ("auto", "Adam", "Adamax", "AdamW", "NAdam", "RAdam", "RMSprop", "SGD", "MuSGD")


def check_apart(parts: dict[str, PoseSet], tests: dict[str, PoseSet]) -> None:
    """Refuse test images that train the network, or that choose its weights."""
    for part, poses in parts.items():
        files = {file.resolve() for file in poses.files}
        for name, test in tests.items():
            if shared := files & {file.resolve() for file in test.files}:
                does = "train the network" if part == "train" else "choose the weights `best`"
                problem = f"{len(shared)} of its {len(test)} images also {does}"
                expected = "other images, for instance a `share` of the split: [0.9, 1.0]"
                raise InputError(problem, field=f"data.test.{name}", expected=expected)


def check_target(source: str, keypoints: Keypoints, trained: PoseSet, poses: PoseSet) -> None:
    """Refuse images of another spacecraft than the one whose points a network was trained to find.

    `source` is the config's `keypoints`: a file's points are taken for any spacecraft.
    """
    if source != "tango" or (poses.keypoints is None and poses.spacecraft == trained.spacecraft):
        return
    own = keypoints_of(source, poses)
    known = np.isfinite(own.points_m).all() and np.isfinite(keypoints.points_m).all()
    if len(own) != len(keypoints) or (known and not np.allclose(own.points_m, keypoints.points_m)):
        problem = f"shows {own.name}, whose points are not those of {keypoints.name}, which the network finds"
        raise InputError(problem, field=poses.name, expected=f"images of {keypoints.name}")


def check_arms(config: Config, announce: Say | None = None) -> None:
    """Refuse, before any training, cameras and training arguments that are invalid or that this device cannot follow;
    `announce` gets a line for what it does differently.
    """
    hidden_cameras(config)
    check_cameras(config)
    check_tracking(config.tracking)
    quiet_ultralytics(config.output / "ultralytics-settings")
    from ultralytics.cfg import get_cfg

    check_network(config.model)
    if config.start and config.start.weights:
        start_weights(config.start)
    given = {"start": {**config.training, **config.start.training}} if config.start else {}
    given |= {name: config.arguments(name) for name in config.arms}
    for name in config.arms:
        arm = config.arm(name)
        if not set(arm.camera_files) & config.cameras.keys():  # else its noise is checked once they are made
            batch_noise(arm)
    for name, arguments in given.items():
        try:
            get_cfg(overrides=arguments)
        except (SyntaxError, TypeError, ValueError) as error:  # how ultralytics refuses an argument
            plain = re.sub(r"\x1b\[[0-9;]*m", "", str(error)).strip().split("\n")[0]
            raise InputError(f"{name}: {plain}", field="training") from None
        side, optimizer = arguments.get("imgsz", 640), str(arguments.get("optimizer", "auto"))
        if isinstance(side, bool) or not isinstance(side, int) or not 0 < side <= LARGEST_SIDE:
            problem, expected = f"{name}: is {side!r}", f"a whole number of pixels up to {LARGEST_SIDE}"
            raise InputError(problem, field="training.imgsz", expected=expected)
        if optimizer.lower() not in map(str.lower, OPTIMIZERS):
            problem, expected = f"{name}: {optimizer} is not an optimizer", ", ".join(OPTIMIZERS)
            raise InputError(problem, field="training.optimizer", expected=f"one of {expected}")
    if config.cluster is None or config.cluster.address is None:  # else the nodes decide
        check_device(list(given.values()), announce)


def check_network(model: str) -> None:
    """Refuse what ultralytics makes no pose network of: no file or no network, or a network of another task."""
    from ultralytics import YOLO
    from ultralytics.nn.tasks import yaml_model_load

    if not (model.endswith(".pt") and Path(model).is_file()):
        try:
            yaml_model_load(model)
        except (OSError, AssertionError):  # the latter for another suffix
            expected = "a YAML such as yolov8n-pose.yaml, or the file of trained weights (NAME.pt)"
            raise InputError(f"no such network: {model}", field="model", expected=expected) from None
        except Exception:
            raise InputError(f"{model} is no network", field="model", expected=A_NETWORK) from None
    try:
        with torch.random.fork_rng(devices=[]):
            network: Any = YOLO(model, task="pose", verbose=False).model
        head = type(network.model[-1]).__name__
        has_points = hasattr(network.model[-1], "kpt_shape")
    except Exception as error:  # of ultralytics' parser and of torch: of any type
        plain = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        problem = f"no network can be built of {model} ({plain})"
        raise InputError(problem, field="model", expected=A_NETWORK) from None
    if not has_points:
        raise InputError(f"{model} has the head {head}", field="model", expected=A_NETWORK)


def start_weights(start: Start) -> bytes:
    """The safetensors file that all runs start from; refused with another SHA-256 than the config's."""
    file = Path(str(start.weights))
    if not file.is_file():
        raise InputError("no such file", file=file, field="start.weights", expected="a safetensors file")
    content = file.read_bytes()
    if (found := hashlib.sha256(content).hexdigest()) != start.sha256:
        raise InputError(f"has the SHA-256 {found}", file=file, expected=str(start.sha256))
    return content


def check_device(given: Sequence[dict[str, Any]], say: Say | None = None) -> None:
    """Refuse a device that is not there, and a batch size that would be chosen by its memory; `say` gets a line where bf16 is
    off (see `followed`).
    """
    for arguments in given:
        batch = arguments.get("batch", 16)
        if not batch >= 1:
            problem = f"{batch} leaves the batch size to the memory of the device, run by run"
            expected = "a number of images, the same in all arms"
            raise InputError(problem, field="training.batch", expected=expected)
        selected(arguments.get("device"))
    if say is not None and any(followed(arguments) != arguments for arguments in given):
        say("amp: bf16 is off: this device has no native bfloat16; trainings take float32")


def followed(arguments: dict[str, Any]) -> dict[str, Any]:
    """Training arguments as this device follows them: `amp: bf16` is off where bfloat16 is not native.

    A run's hash holds what was asked, its record what was done, so that a network can be evaluated on another device.
    """
    if arguments.get("amp") == "bf16" and not has_bf16(arguments.get("device")):
        return {**arguments, "amp": False}
    return arguments


def selected(device: Any) -> torch.device:
    """The device that a training takes for an argument `device`; refused where it is not there."""
    from ultralytics.utils.torch_utils import select_device

    try:
        return torch.device(select_device("" if device is None else device, verbose=False))
    except (ValueError, RuntimeError, AssertionError):
        count = torch.cuda.device_count()
        expected = f"cpu, or a GPU from 0 to {count - 1}" if count else "cpu; there is no GPU"
        problem = f"{device!r} is not a device of this machine"
        raise InputError(problem, field="training.device", expected=expected) from None


def has_bf16(device: Any) -> bool:
    """Whether a training on it can run in bfloat16, which GPUs have from Ampere on."""
    return selected(device).type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False)


def cost(config: Config, images: int, arms: Sequence[str] = ()) -> str:
    """How long the training of all runs (of `arms`: with the first seed) takes, in a sentence: `images` times the seconds that
    the network takes for one on this device.
    """
    names, seeds = (arms, 1) if arms else (config.arms, len(config.seeds))
    epochs = [config.arguments(name).get("epochs", 100) for name in names]
    total = images * (seeds * sum(epochs) + ((config.start and config.start.epochs) or 0))
    device = selected(config.training.get("device"))
    seconds = seconds_per_image(config, device)
    hours = total * seconds / 3600
    said = f"{hours:.1f} hours" if hours >= 1 else f"{60 * hours:.0f} minutes"
    return (
        f"cost: {counted(len(names) * seeds, 'run')}, {total:,} images: about {said} on {device} at "
        f"{1000 * seconds:.1f} ms each, by a trial of the network alone; reading, noise and evaluation come "
        "on top, and what is finished is not trained again"
    )


def seconds_per_image(config: Config, device: torch.device) -> float:
    """Of a training step, forward and backward, of the study's network."""
    from ultralytics import YOLO

    side = -(-int(config.training.get("imgsz", 640)) // 32) * 32
    amp = followed(config.training).get("amp", True)
    dtype = torch.bfloat16 if amp == "bf16" else torch.float16
    with torch.random.fork_rng(devices=[]):
        model: Any = YOLO(config.model, task="pose", verbose=False).model
    network = model.to(device).train()
    for parameter in network.parameters():
        parameter.requires_grad_(True)
    on_gpu = device.type == "cuda"
    # enough to fill a GPU; seconds on a CPU
    batch = torch.zeros(16 if on_gpu else 2, 3, side, side, device=device)
    seconds = []
    for _ in range(3):
        began = time.perf_counter()
        with torch.autocast(device.type, dtype=dtype, enabled=on_gpu and bool(amp)):
            output = network(batch)
        _total(output).backward()
        next(network.parameters()).grad.sum().item()  # the last that is computed: a GPU is waited for
        seconds.append(time.perf_counter() - began)
    return sum(seconds[1:]) / 2 / len(batch)  # the first warms up


def _total(output: Any) -> torch.Tensor:
    """The sum of all tensors in a network's output."""
    if isinstance(output, torch.Tensor):
        return output.float().sum()
    parts = output.values() if isinstance(output, dict) else output
    return torch.stack([_total(part) for part in parts if part is not None]).sum()
