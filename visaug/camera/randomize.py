"""Per-image camera parameters: the laws of `randomize`, within the parameters' bounds, and their correlations."""

from collections.abc import Mapping
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from visaug.camera.paths import place_of
from visaug.effects import Parameter

if TYPE_CHECKING:
    from visaug.camera.camera import Camera


class Law(IntEnum):
    """Laws of a number that differs from image to image. `torch.compile` compares tensors with `.value` alone."""

    NORMAL = 0
    UNIFORM = 1
    LOG_UNIFORM = 2


class Spreads(NamedTuple):
    """Laws of the numbers that differ from image to image; tensors (P,), float64, in the parameters' units.

    A normal law is truncated, not clipped, at [low, high], so that no value piles up there: `below` and `above` are the
    Gaussian's probabilities up to the bounds. The other laws lie between low and high.

    Attributes:
        law: a `Law` each.
        step: 1 where a draw is rounded, as only whole numbers make sense, else 0.
        factor: (P, P), the Cholesky factor of the correlations of the underlying normals; None where there are none.
    """

    paths: tuple[str, ...]
    law: Tensor
    nominal: Tensor
    deviation: Tensor
    low: Tensor
    high: Tensor
    below: Tensor
    above: Tensor
    step: Tensor
    factor: Tensor | None
    even: bool  # any law is uniform or log-uniform
    whole: bool  # any draw is rounded

    def values(self, uniform: Tensor) -> dict[str, Tensor]:
        """Values by path, (N,) float32 each, from independent uniform numbers (N, P) in [0, 1), float64."""
        if self.factor is not None:
            normals = torch.special.ndtri(uniform.clamp(2.0**-53, 1 - 2.0**-53))
            uniform = torch.special.ndtr(normals @ self.factor.T)
        normal = torch.special.ndtri(torch.lerp(self.below, self.above, uniform))
        values = torch.clamp(torch.addcmul(self.nominal, self.deviation, normal), self.low, self.high)
        if self.even:
            values = torch.where(
                self.law == Law.UNIFORM.value, torch.lerp(self.low, self.high, uniform), values
            )
            rising = torch.exp(torch.lerp(self.low.log(), self.high.log(), uniform))
            values = torch.where(self.law == Law.LOG_UNIFORM.value, rising, values)
        if self.whole:
            values = torch.where(self.step > 0, values.round(), values)
        values = values.float()
        return dict(zip(self.paths, values.unbind(1)))


def spreads(camera: "Camera") -> Spreads:
    """Which numbers of a camera differ from image to image, and how.

    A number s in `randomize` is the standard deviation of a Gaussian, relative to the nominal value; {std: s} the same in the
    parameter's unit; {half_normal: s} that Gaussian's upper half, from the nominal value upwards; {uniform: [a, b]} and
    {log_uniform: [a, b]} lie between a and b, whatever the nominal value is. `correlated` gives correlations of the
    Gaussians (of the underlying Gaussians, for another law).
    """
    values = camera.values()
    found = {}
    for path, spread in camera.spec.randomize.items():
        row = _law(spread, values[path], _bounds(camera, path))
        if row is not None:
            found[path] = row
    table = torch.tensor(list(found.values()), dtype=torch.float64).reshape(-1, 6)
    law, nominal, deviation, low, high, step = table.T
    below, above = (torch.special.ndtr((end - nominal) / deviation) for end in (low, high))
    matrix = correlations(camera.spec.correlated, tuple(found))
    factor = None if matrix is None else torch.from_numpy(np.linalg.cholesky(matrix))
    even, whole = bool((law != Law.NORMAL.value).any()), bool(step.any())
    return Spreads(tuple(found), law, nominal, deviation, low, high, below, above, step, factor, even, whole)


def _bounds(camera: "Camera", path: str) -> Parameter:
    parameter = place_of(path).parameter
    if path != "black_level_dn":
        return parameter
    # It must leave the converter a range: at least half of it is the signal's.
    return Parameter(low=0.0, high=max(2.0 ** (camera.bit_depth - 1), camera.spec.black_level_dn))


def _law(spread: Any, nominal: float, bounds: Parameter) -> tuple[float, ...] | None:
    """Law, nominal value, deviation, low, high and rounding; None where nothing varies."""
    step = float(bounds.integer)
    kind, size = next(iter(spread.items())) if isinstance(spread, Mapping) else ("relative", spread)
    if kind in ("uniform", "log_uniform"):
        low, high = size
        return (Law.UNIFORM if kind == "uniform" else Law.LOG_UNIFORM, low, 1.0, low, high, step)
    deviation = size * abs(nominal) if kind == "relative" else size
    if deviation <= 0 or not np.isfinite(nominal):
        return None
    low = nominal if kind == "half_normal" else bounds.low
    return Law.NORMAL, nominal, deviation, low, bounds.high, step


def correlations(pairs: list[tuple[str, str, float]], paths: tuple[str, ...]) -> np.ndarray | None:
    """The matrix of correlations of what varies, (P, P); None where no pair of it is correlated."""
    matrix = np.eye(len(paths))
    for one, other, coefficient in pairs:
        if one in paths and other in paths:
            i, j = paths.index(one), paths.index(other)
            matrix[i, j] = matrix[j, i] = coefficient
    return matrix if (matrix != np.eye(len(paths))).any() else None


def draw(camera: "Camera", count: int, rng: np.random.Generator) -> dict[str, Tensor]:
    """Every number of the camera for `count` images, (count,) float32 each, by path."""
    values = {path: torch.full((count,), nominal) for path, nominal in camera.values().items()}
    drawn = spreads(camera)
    return values | drawn.values(torch.from_numpy(rng.random((count, len(drawn.paths)))))
