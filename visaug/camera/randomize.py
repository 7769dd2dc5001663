"""Per-image camera parameters: Gaussian about the nominal value, truncated to physical bounds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.special import ndtr, ndtri
from torch import Tensor

from visaug.camera.paths import place_of

if TYPE_CHECKING:
    from visaug.camera.camera import Camera


def draw(camera: "Camera", count: int, rng: np.random.Generator) -> dict[str, Tensor]:
    """Every number of the camera for `count` images, (count,) float32 each, by path.

    A spread s in `randomize` is a standard deviation relative to the nominal value, `{std: s}` an absolute one. The Gaussian
    is truncated, not clipped, at the parameter's bounds, so no value piles up there.
    """
    values = {}
    for path, nominal in camera.values().items():
        spread = camera.spec.randomize.get(path)
        values[path] = torch.full((count,), nominal)
        if spread is None:
            continue
        deviation = spread["std"] if isinstance(spread, Mapping) else spread * abs(nominal)
        if deviation > 0 and np.isfinite(nominal):
            parameter = place_of(path).parameter
            low, high = ndtr((parameter.low - nominal) / deviation), ndtr((parameter.high - nominal) / deviation)
            drawn = nominal + deviation * ndtri(low + (high - low) * rng.random(count))
            values[path] = torch.from_numpy(drawn.clip(parameter.low, parameter.high)).float()
    return values
