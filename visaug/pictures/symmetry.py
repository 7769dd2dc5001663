"""What a camera does to the brightness of its scenes, told by a symmetry that scenes have and the camera breaks.

Scenes that change from picture to picture have no preferred axis: over many of them saturated areas are as long along columns as
along rows. Each statistic is a ratio of sums over pictures; how far single pictures are from it gives its spread. Of saturated
areas it is zero on the average. Whether surfaces darken outwards is a matter of the scenes too (a target lies in the middle), so
that other pictures with such scenes are needed for an expectation.
"""

from dataclasses import dataclass

import numpy as np

from visaug.pictures.blocks import SIDE, cut
from visaug.statistics.statistic import Statistic

FEWEST = 6  # pictures that tell
_RAMP = (np.arange(SIDE) - (SIDE - 1) / 2) / (SIDE * SIDE * (SIDE**2 - 1) / 12)  # slope of a block's pixels
_LAGS = (1, 4, 12)

STATISTICS = (
    Statistic("falloff", "loss in the corner, inner field", "lit regions", ("smooth",), "fraction", "flat"),
    Statistic("falloff", "loss in the corner, outer field", "lit regions", ("smooth",), "fraction", "flat"),
    *(
        Statistic(
            "saturated_areas", f"along columns less along rows, {lag} px on", "saturated regions", ("column",), "share", "scene"
        )
        for lag in _LAGS
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Sums:
    """Numerator and denominator of each statistic of each picture, (n, statistics)."""

    above: np.ndarray
    below: np.ndarray

    def of(self, pictures: np.ndarray) -> "Sums":
        return Sums(self.above[pictures], self.below[pictures])

    @property
    def told(self) -> np.ndarray:
        """(statistics,) whether enough pictures tell it."""
        return np.count_nonzero(self.below > 0, axis=0) >= FEWEST

    @property
    def ratio(self) -> np.ndarray:
        """(statistics,) over all pictures; 0 where hardly any tells."""
        return np.where(self.told, self.above.sum(0) / np.maximum(self.below.sum(0), 1e-9), 0.0)

    @property
    def variance(self) -> np.ndarray:
        """(statistics,) squared standard error of the ratio, at least that of one pixel."""
        pixel = np.divide(self.told, self.below.sum(0), out=np.zeros(len(self.told)), where=self.told)
        return np.maximum((self.deviations**2).sum(0), pixel**2)

    @property
    def freedom(self) -> np.ndarray:
        """(statistics,) degrees of freedom of `variance`, at least 1 (Satterthwaite 1946).
        A sum of squares d^2 has at most the variance of the sum of d^4: few pictures with large weights tell an error badly.
        """
        fourth = (self.deviations**4).sum(0)
        degrees = np.divide(2 * self.variance**2, fourth, out=np.ones_like(fourth), where=fourth > 0)
        return np.maximum(degrees, 1.0)

    @property
    def deviations(self) -> np.ndarray:
        """(n, statistics) how far the ratio moves by each picture (jackknife); the root of their sum of squares is its error."""
        total = np.maximum(self.below.sum(0), 1e-9)
        share = np.minimum(self.below / total, 0.9)
        return (self.above - self.ratio * self.below) / total / (1 - share) * self.told


def symmetry_sums(
    pictures: np.ndarray, flat: np.ndarray, black: float, saturated: float, corner: tuple, size: tuple
) -> Sums:
    """The sums of pictures (n, H, W), from `flat` (n, R, C), lit blocks without structure.
    `black`, `saturated`: level of no light, and from which a pixel is saturated.
    `corner`, `size`: row and column at which the pictures begin on the sensor; the sensor's rows and columns.
    """
    falloff = _falloff(pictures, flat, black, corner, size)
    areas = area_sums(pictures >= saturated)
    return Sums(*(np.concatenate(parts, 1) for parts in zip(falloff, areas, strict=True)))


def _falloff(pictures: np.ndarray, flat: np.ndarray, black: float, corner: tuple, size: tuple):
    """Loss of light in the corner from the slope of shading along the radius: V = 1 - a (r / corner)^2 has slope -2 a r."""
    blocks = cut(pictures)
    light = np.maximum(blocks.mean((2, 4)) - black, 1.0)
    # Relative change per pixel, of which 3 % still count as shading.
    ramps = [np.tensordot(blocks.sum(summed), _RAMP, ([side], [0])) for summed, side in ((4, 2), (2, 3))]
    slopes = [np.clip(ramp / light, -0.03, 0.03) for ramp in ramps]
    half = np.hypot(*size) / 2
    middles = [np.arange(n) * SIDE + SIDE / 2 for n in light.shape[1:]]
    y, x = ((middles[k] + corner[k] - size[k] / 2) / half for k in (0, 1))
    along = -(slopes[0] * y[:, None] + slopes[1] * x[None, :]) * half / 2
    square = y[:, None] ** 2 + x[None, :] ** 2
    parts = [flat & part for part in (square < 0.3, square >= 0.3)]
    above, below = (np.stack([(of * here).sum((1, 2)) for here in parts], 1) for of in (along, square))
    return above, below


def area_sums(full: np.ndarray):
    """Pixels of saturated areas that still are in one some pixels on, along columns less along rows, over all of them."""
    above = []
    for lag in _LAGS:
        column = np.count_nonzero(full[:, lag:] & full[:, : max(full.shape[1] - lag, 0)], axis=(1, 2))
        row = np.count_nonzero(full[:, :, lag:] & full[:, :, : max(full.shape[2] - lag, 0)], axis=(1, 2))
        above.append(np.asarray(column - row, float))
    count = np.count_nonzero(full, axis=(1, 2)).astype(float)
    return np.stack(above, 1), np.repeat(count[:, None], len(_LAGS), 1)
