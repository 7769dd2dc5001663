"""Per-image camera parameters: Gaussian about the nominal value, truncated to physical bounds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from visaug.camera.paths import place_of

if TYPE_CHECKING:
    from visaug.camera.camera import Camera


class Spread(NamedTuple):
    """A Gaussian truncated, not clipped, at [low, high], so no value piles up there. Units are the parameter's."""

    nominal: float
    deviation: float
    low: float
    high: float


def spreads(camera: "Camera") -> dict[str, Spread]:
    """Which numbers of a camera differ from image to image, and how, by path.

    A spread s in `randomize` is a standard deviation relative to the nominal value, `{std: s}` an absolute one.
    """
    found = {}
    values = camera.values()
    for path, spread in camera.spec.randomize.items():
        nominal = values[path]
        deviation = spread["std"] if isinstance(spread, Mapping) else spread * abs(nominal)
        if deviation > 0 and np.isfinite(nominal):
            parameter = place_of(path).parameter
            found[path] = Spread(nominal, deviation, parameter.low, parameter.high)
    return found


def truncated_normal(uniform: Tensor, spread: Spread) -> Tensor:
    """Values of the spread's law from uniform numbers in [0, 1), float64 in, float32 out."""
    nominal, deviation, low, high = (torch.tensor(number, dtype=torch.float64) for number in spread)
    below, above = torch.special.ndtr((low - nominal) / deviation), torch.special.ndtr((high - nominal) / deviation)
    value = nominal + deviation * torch.special.ndtri(below + (above - below) * uniform)
    return torch.minimum(torch.maximum(value, low), high).float()


def draw(camera: "Camera", count: int, rng: np.random.Generator) -> dict[str, Tensor]:
    """Every number of the camera for `count` images, (count,) float32 each, by path."""
    values = {path: torch.full((count,), nominal) for path, nominal in camera.values().items()}
    for path, spread in spreads(camera).items():
        values[path] = truncated_normal(torch.from_numpy(rng.random(count)), spread)
    return values
