"""Whether every pixel has read noise of its own: from the variances of single pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visaug.characterization.moments import GroupMoments
from visaug.frames import FrameSet

_FRAMES = 6  # halves of three frames each tell a variance apart from its chance


@dataclass(frozen=True)
class PixelNoiseSpread:
    """Spread of the pixels' own read noise: standard deviation of log sigma, and a map.

    Attributes:
        variance: of log sigma, and its standard error; it may be negative by chance.
        deviation_dn: (H, W) standard deviation of every pixel, rounding taken off, DN.
    """

    variance: tuple[float, float]
    deviation_dn: np.ndarray

    @property
    def spread(self) -> float:
        return math.sqrt(max(self.variance[0], 0.0))

    @property
    def established(self) -> bool:
        beyond = 3.0  # standard errors of the variance, 6 of its root
        value, error = self.variance
        return value > beyond * error


def pixel_noise(frames: FrameSet, still: GroupMoments) -> PixelNoiseSpread | None:
    """Of six or more frames without light, else None.

    Pixels of one law have variances that scatter by chance, the more so the heavier its tails, but those of two
    halves of the frames scatter independently. Their logarithms covary by what pixels differ in, 4 s^2 where s
    is the spread of log sigma.
    """
    if still.n < _FRAMES:
        return None
    halves = still.group.indices[0::2], still.group.indices[1::2]
    offsets = dict(zip(still.group.indices, still.frame_means))
    first, second = (_variance(frames, half, offsets) for half in halves)
    logs = [np.log(np.maximum(v, 1 / 12)) for v in (first, second)]
    logs = [v - v.mean() for v in logs]
    product = logs[0] * logs[1]
    variance = 0.25 * float(product.mean()), 0.25 * float(product.std() / math.sqrt(product.size))
    mixed = (first * (len(halves[0]) - 1) + second * (len(halves[1]) - 1)) / (still.n - 2)
    return PixelNoiseSpread(variance, np.sqrt(np.maximum(mixed - 1 / 12, 0.0)))


def shrunk(noise: PixelNoiseSpread, rms_dn: float) -> np.ndarray:
    """The map without the chance of few frames: the logarithms drawn to their mean until they spread as the pixels' own do,
    scaled to the camera's read noise (rms), (H, W) DN.
    """
    logs = np.log(np.maximum(noise.deviation_dn, 0.1 * rms_dn))
    total = float(logs.std())
    kept = min(noise.spread / total, 1.0) if total > 0 else 0.0
    deviations = np.exp(logs.mean() + kept * (logs - logs.mean()))
    return deviations * rms_dn / math.sqrt(float((deviations**2).mean()))


def _variance(frames: FrameSet, indices: tuple[int, ...], offsets: dict[int, float]) -> np.ndarray:
    """Of every pixel over frames whose own mean is taken out, DN^2."""
    shape, n = frames.shape(indices[0]), len(indices)
    total, squares = np.zeros(shape), np.zeros(shape)
    for i in indices:
        values = frames.read(i) - offsets[i]
        total += values
        squares += values**2
    return np.maximum(squares - total**2 / n, 0.0) / (n - 1)
