"""Regions of pictures in which the scene is known to be smooth: the black sky, and flat lit parts.

What is left there after the scene has been taken off is noise and fixed pattern, and is looked at like dark frames and flats.
The regions are chosen once, on the measured pictures, and a simulated picture is looked at in the same ones: whatever the
choice does to a statistic, it does to both. Lit blocks are chosen by low coefficients of their DCT, and only high ones are kept,
which in white noise are independent of the choice.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from visaug.core.constants import MAD
from visaug.pictures import blocks
from visaug.pictures.blocks import EDGE, SIDE, Levels, Rounding, U, V, blocks_of, cut, is_flat

_FAR = 4.0  # robust standard deviations of the sky's blocks
_MOST_DN = 15.0  # of the sky's spread: more is no sky
KEPT = U + V > 4  # coefficients that the choice does not look at
_BASIS = np.asarray(fft.idctn(np.eye(SIDE * SIDE).reshape(-1, SIDE, SIDE), axes=(1, 2), norm="ortho"))
_KEPT_BASIS = _BASIS.reshape(SIDE * SIDE, -1)[KEPT.ravel()]
# (64, 64) projection of a block on the coefficients that are kept
_FINE = (_KEPT_BASIS.T @ _KEPT_BASIS).astype(np.float32)


@dataclass(frozen=True)
class Regions:
    """Blocks of 8 x 8 pixels of n pictures."""

    dark: np.ndarray  # (n, R, C), in the black sky and away from anything lit
    lit: np.ndarray  # (n, R, C), the class by level of flat lit blocks; -1 elsewhere
    levels: tuple[float, ...]  # (classes,) mean level of each class, in 1/255 of full scale
    sky: float | None  # level of the sky; None where there is none

    def of(self, numbers: np.ndarray) -> "Regions":
        return Regions(self.dark[numbers], self.lit[numbers], self.levels, self.sky)

    def without_saturated(self, pictures: np.ndarray, saturated: float) -> "Regions":
        """Away from saturated pixels: what spills out of them is no noise of a flat region."""
        full = cut(pictures).max((2, 4)) >= saturated
        near = np.asarray(ndimage.binary_dilation(full, np.ones((1, 3, 3), bool)), bool)
        return Regions(self.dark & np.logical_not(near), np.where(near, -1, self.lit), self.levels, self.sky)


def find_regions(
    pictures: np.ndarray, saturated: float, rounding: Rounding, black: float | None = None
) -> Regions:
    """The regions of pictures (n, H, W) in 1/255 of full scale; H and W are multiples of 8.
    `saturated`: level from which a pixel is saturated.
    `black`: level of no light as the camera's file states it; None where it is not known. Pictures of one level are of the
    sky only if it lies there.
    """
    parts = [blocks_of(p) for p in pictures]
    coefficients, level, usable = (np.stack(part) for part in zip(*parts, strict=True))
    usable &= cut(pictures).max((2, 4)) < saturated
    sky, spread = _sky(coefficients, level)
    if sky is not None and (black is None or sky > black + _MOST_DN):
        # Where fewer blocks are brighter than the rest, all pictures are of one level, which may be any.
        sky = sky if np.mean(level > sky + _FAR * spread) >= 0.01 else None
    near = level < (_level_at(level, sky, spread) + _FAR * spread if sky is not None else -np.inf)
    dark = ndimage.binary_erosion(near, np.ones((1, 3, 3), bool), border_value=1)
    lit = usable & ~near & (level > 3 + (sky or 0))
    number = np.broadcast_to(np.arange(len(pictures))[:, None, None], level.shape)
    chosen = blocks.Blocks(coefficients[lit], level[lit], number[lit], level[lit])
    levels = blocks.noise_by_level(chosen, rounding, len(pictures))
    lit &= _without_structure(coefficients, level, lit, levels, rounding)
    return _by_level(dark, lit, level, sky)


def _sky(coefficients: np.ndarray, level: np.ndarray) -> tuple[float | None, float]:
    """Level of the black sky and the spread of its blocks: the dark cluster of all blocks, where it is without structure.
    The cluster grows from the darkest fifth until no block lies within four of its own robust standard deviations.
    """
    flat = level.ravel()
    limit = np.quantile(flat, 0.2)
    for _ in range(20):
        inside = flat[flat <= limit]
        middle = float(np.median(inside))
        spread = max(MAD * float(np.median(np.abs(inside - middle))), 0.5)
        limit, before = middle + _FAR * spread, limit
        if abs(limit - before) < 1e-6:
            break
    dark = level <= limit
    if dark.mean() < 0.05 or spread > _MOST_DN:
        return None, 0.0
    power = coefficients[dark] ** 2
    low, high = (float(np.median(power[:, which].mean(1))) for which in (blocks.CHOICE, blocks.NOISE))
    is_none = high == 0 or low > 1.5 * high + 0.1  # all of one code, or with structure
    return (None, 0.0) if is_none else (middle, spread)


def _level_at(level: np.ndarray, sky: float, spread: float) -> np.ndarray:
    """(R, C) level of the sky at each place: that at which several pictures agree there, should it lie beside the common one.
    Halves and columns of a sensor may differ by more than the noise; what recurs at a place is no dim part of a scene.
    """
    # of the pictures that show sky there
    least, common = (np.quantile(level, q, axis=0) for q in (0.05, 0.3))
    agree = (common - least < _FAR * spread) & (common < sky + _MOST_DN) & (len(level) >= 10)
    return np.where(agree, common, sky)


def _without_structure(
    coefficients: np.ndarray, level: np.ndarray, lit: np.ndarray, levels: Levels, rounding: Rounding
) -> np.ndarray:
    """Blocks whose low coefficients are no larger than noise explains, those along rows and columns included."""
    if not len(levels.level) or not lit.any():
        return np.zeros(lit.shape, bool)
    flat = lit & is_flat(coefficients, levels.variance_at(level), rounding)
    for line in (coefficients[..., 1:4, 0], coefficients[..., 0, 1:4]):
        power = (line**2).mean(-1)
        flat &= power < EDGE * np.median(power[flat]) if flat.any() else False
    return flat


def _by_level(dark: np.ndarray, lit: np.ndarray, level: np.ndarray, sky: float | None) -> Regions:
    classes = np.full(lit.shape, -1)
    count = min(3, int(lit.sum()) // 40)  # blocks of a class
    levels = []
    if count:
        edges = np.quantile(level[lit], np.linspace(0, 1, count + 1)[1:-1])
        classes[lit] = np.digitize(level[lit], edges)
        levels = [float(level[classes == k].mean()) for k in range(count)]
    return Regions(dark, classes, tuple(levels), sky)


def dark_residuals(pictures: np.ndarray, dark: np.ndarray) -> np.ndarray:
    """Pictures (n, H, W) less what changes slowly over the sky, about their mean level over the sky; that level elsewhere."""
    weight = dark.astype(np.float32)
    total = max(float(weight.sum()), 1.0)
    means = cut(pictures).mean((2, 4), dtype=np.float32) * weight
    spread = [ndimage.gaussian_filter(x, (0, 2.5, 2.5), mode="constant") for x in (means, weight)]
    smooth = np.divide(spread[0], spread[1], out=np.zeros_like(means), where=spread[1] > 1e-6)
    left = (pictures - as_pixels(smooth)) * as_pixels(weight)
    return _as_if_everywhere(left, dark) + np.float32(means.sum(dtype=np.float64) / total)


def lit_residuals(pictures: np.ndarray, regions: Regions) -> list[np.ndarray]:
    """For each class, pictures (n, H, W) of its level with the fine structure of its blocks; the level elsewhere."""
    parts = cut(pictures).transpose(0, 1, 3, 2, 4)
    found = []
    for k, level in enumerate(regions.levels):
        here = regions.lit == k
        fine = np.zeros(parts.shape, np.float32)
        fine[here] = (parts[here].reshape(-1, SIDE * SIDE) @ _FINE).reshape(-1, SIDE, SIDE)
        fine = fine.transpose(0, 1, 3, 2, 4).reshape(pictures.shape)
        found.append(_as_if_everywhere(fine, here) + np.float32(level))
    return found


def as_pixels(values: np.ndarray) -> np.ndarray:
    """What blocks (n, R, C) have, for each of their pixels: (n, H, W)."""
    return values.repeat(SIDE, 1).repeat(SIDE, 2)


def _as_if_everywhere(left: np.ndarray, where: np.ndarray) -> np.ndarray:
    """What is left in regions, with the variance over all pixels that it has there, however many they are."""
    return left / np.float32(np.sqrt(max(float(where.mean()), 1e-6)))
