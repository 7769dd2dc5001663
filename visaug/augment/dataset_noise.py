"""The noise that suits a data set: its transfer function by the files, its sensors by the number of channels."""

import copy
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from torch import nn

from visaug.augment.image_io import read_picture
from visaug.augment.sensor_noise import SensorNoise
from visaug.core.errors import InputError


def with_transfer(noise: nn.Module, dataset: Any) -> tuple[nn.Module, str]:
    """The noise with "auto" resolved by the files of a dataset, and what was assumed in words."""
    if not any(isinstance(part, SensorNoise) and part.transfer == "auto" for part in noise.modules()):
        return noise, ""
    transfer, reason = transfer_of_files(image_files(dataset))
    noise = copy.deepcopy(noise)
    for part in noise.modules():
        if isinstance(part, SensorNoise) and part.transfer == "auto":
            part.transfer = transfer
    return noise, f"images taken as {'sRGB' if transfer == 'srgb' else 'linear'} ({reason})"


def with_bands(noise: nn.Module, channels: int) -> tuple[nn.Module, str]:
    """The noise for images of this many channels, none of which ultralytics takes as alpha, and what that means in words."""
    parts = [part for part in noise.modules() if isinstance(part, SensorNoise)]
    if channels in (1, 3) or not parts:
        return noise, ""
    if any(part.mono or any(camera.spec.colour for camera in part.cameras) for part in parts):
        problem = f"images have {channels} channels, which one sensor cannot give"
        expected = "a camera without `colour`, and mono=False or none"
        raise InputError(problem, field="data.yaml: channels", expected=expected)
    noise = copy.deepcopy(noise)
    for part in noise.modules():
        if isinstance(part, SensorNoise):
            part.mono = False
    return noise, f"{channels} channels taken as bands, each with noise of its own"


def transfer_of_files(files: Sequence[str]) -> tuple[str, str]:
    """What most of a few images, evenly spaced among the files, say of their transfer function."""
    found: Counter[tuple[str, str]] = Counter()
    sampled_files = 8  # training images that are looked at for their transfer function
    for file in files[:: max(1, len(files) // sampled_files)][:sampled_files]:
        with suppress(InputError, OSError, KeyError):
            picture = read_picture(Path(file))
            found[picture.transfer, picture.reason] += 1
    return found.most_common(1)[0][0] if found else ("linear", "no file states it")


def image_files(dataset: Any) -> list[str]:
    """Paths of the images of a dataset of ultralytics, or of several as one."""
    files: list[Any] = []
    for part in getattr(dataset, "datasets", [dataset]):
        files += getattr(part, "im_files", None) or [one[0] for one in getattr(part, "samples", ())]
    return [str(file) for file in files]
