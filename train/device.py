"""What the device decides of a study: arguments that it can follow, and the time that it takes."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import torch

from visaug.core.errors import InputError
from visaug.core.wording import counted
from visaug_train.config import Config

Say = Callable[[str], None]


def check_device(given: Sequence[dict[str, Any]], say: Say | None = None) -> None:
    """Refuse training arguments that this device cannot follow; `say` gets a line where bf16 is off (see `followed`).

    Args:
        given: the arguments of every run.
        say: gets a line.

    Raises:
        InputError: a device that is not there, or a batch size that would be chosen by the device's memory.
    """
    for arguments in given:
        batch = arguments.get("batch", 16)
        if not batch >= 1:
            raise InputError(
                f"{batch} leaves the batch size to the memory of the device, run by run",
                field="training.batch",
                expected="a number of images, the same in all arms",
            )
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
        raise InputError(
            f"{device!r} is not a device of this machine",
            field="training.device",
            expected=f"cpu{f', or a GPU from 0 to {count - 1}' if count else '; there is no GPU'}",
        ) from None


def has_bf16(device: Any) -> bool:
    """Whether a training on it can run in bfloat16, which GPUs have from Ampere on."""
    return selected(device).type == "cuda" and torch.cuda.is_bf16_supported(including_emulation=False)


def cost(config: Config, images: int, arms: Sequence[str] | None = None) -> str:
    """How long a training takes, in a sentence: images times the seconds that the network takes for one on this device.

    Args:
        config: of the study.
        images: for training.
        arms: that are trained with the first seed; left out, all of them with all seeds.
    """
    names, seeds = (config.arms, len(config.seeds)) if arms is None else (arms, 1)
    epochs = [{**config.training, **config.arm(name).training}.get("epochs", 100) for name in names]
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
    on_gpu = device.type == "cuda"
    with torch.random.fork_rng(devices=[]):
        model: Any = YOLO(config.model, task="pose", verbose=False).model
    network = model.to(device).train()
    for parameter in network.parameters():
        parameter.requires_grad_(True)
    # Of the trial: steps after the one that warms up, and images in each; seconds on a CPU, and enough to fill a GPU.
    trial_steps, cpu_images, gpu_images = 2, 2, 16
    batch = torch.zeros(gpu_images if on_gpu else cpu_images, 3, side, side, device=device)
    began = 0.0
    for step in range(trial_steps + 1):
        if step == 1:  # the first warms up
            _wait(device)
            began = time.perf_counter()
        with torch.autocast(device.type, dtype=dtype, enabled=on_gpu and bool(amp)):
            output = network(batch)
        _total(output).backward()
    _wait(device)
    return (time.perf_counter() - began) / trial_steps / len(batch)


def _total(output: Any) -> torch.Tensor:
    """The sum of all tensors in a network's output."""
    if isinstance(output, torch.Tensor):
        return output.float().sum()
    parts = output.values() if isinstance(output, dict) else output
    return torch.stack([_total(part) for part in parts if part is not None]).sum()


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
