"""Per-image camera parameters: Gaussian about the nominal value, truncated to physical bounds."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from visaug.camera.paths import place_of

if TYPE_CHECKING:
    from visaug.camera.camera import Camera


class Spreads(NamedTuple):
    """Gaussians truncated, not clipped, at [low, high], so that no value piles up there; tensors (P,), float64.

    `below` and `above` are the probabilities of the Gaussian up to the bounds. Units are the parameters'. `step`
    is 1 where a draw is rounded, as only whole numbers make sense, else 0.
    """

    paths: tuple[str, ...]
    nominal: Tensor
    deviation: Tensor
    low: Tensor
    high: Tensor
    below: Tensor
    above: Tensor
    step: Tensor

    def values(self, uniform: Tensor) -> dict[str, Tensor]:
        """Values by path, (N,) float32 each, from uniform numbers (N, P) in [0, 1), float64."""
        normal = torch.special.ndtri(self.below + (self.above - self.below) * uniform)
        values = torch.clamp(self.nominal + self.deviation * normal, self.low, self.high)
        values = torch.where(self.step > 0, values.round(), values).float()
        return dict(zip(self.paths, values.unbind(1)))


def spreads(camera: "Camera") -> Spreads:
    """Which numbers of a camera differ from image to image, and how.

    A spread s in `randomize` is a standard deviation relative to the nominal value, `{std: s}` an absolute one.
    """
    found = {}
    values = camera.values()
    for path, spread in camera.spec.randomize.items():
        nominal = values[path]
        deviation = spread["std"] if isinstance(spread, Mapping) else spread * abs(nominal)
        if deviation > 0 and np.isfinite(nominal):
            parameter = place_of(path).parameter
            # A black level must leave the converter a range: half of it at the least is the signal's.
            high = (
                min(parameter.high, 2 ** (camera.bit_depth - 1))
                if path == "black_level_dn"
                else parameter.high
            )
            found[path] = nominal, deviation, parameter.low, max(high, nominal), float(parameter.integer)
    table = torch.tensor(list(found.values()), dtype=torch.float64).reshape(-1, 5)
    nominal, deviation, low, high, step = table.T
    below, above = (
        torch.special.ndtr((low - nominal) / deviation),
        torch.special.ndtr((high - nominal) / deviation),
    )
    return Spreads(tuple(found), nominal, deviation, low, high, below, above, step)


def draw(camera: "Camera", count: int, rng: np.random.Generator) -> dict[str, Tensor]:
    """Every number of the camera for `count` images, (count,) float32 each, by path."""
    values = {path: torch.full((count,), nominal) for path, nominal in camera.values().items()}
    drawn = spreads(camera)
    return values | drawn.values(torch.from_numpy(rng.random((count, len(drawn.paths)))))
