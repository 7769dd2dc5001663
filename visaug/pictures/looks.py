"""What a camera makes of edges, bright areas, black and flat regions, apart from what the scene holds.

Each statistic is a ratio of sums over pictures, whose numerator and denominator grow alike with how much of it a picture shows:
noise of one frequency over noise of another, steps at the grid of JPEG over steps beside it, light scattered into the sky over the
light that is there to be scattered. The spread of a ratio is that from picture to picture.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from visaug.core.constants import MAD
from visaug.pictures.blocks import CHOICE, FLAT_MEAN, INNER, NOISE, SIDE, U, V, blocks_of, texture_share
from visaug.pictures.regions import Regions, as_pixels
from visaug.pictures.symmetry import FEWEST, Sums, area_sums

_FINE, _COARSE = INNER & (U + V > 9), INNER & (U + V > 4) & (U + V < 8)
_ACROSS, _DOWN = INNER & (U + V > 4) & (V > U), INNER & (U + V > 4) & (U > V)


@dataclass(frozen=True)
class Look:
    """A statistic: its view, name and unit, and how pictures (n, H, W) with their regions give its sums."""

    view: str
    name: str
    unit: str
    sums: Callable[[np.ndarray, Regions], tuple[np.ndarray, np.ndarray]]
    texture: float = 0.0  # error, per share of the noise, by texture that passed for noise
    content: float = 0.0  # relative error by what edges the scene holds


def measured(pictures: np.ndarray, regions: Regions) -> Iterator[tuple[Look, float, float, float]]:
    """Each statistic that enough pictures tell: value, standard error, and degrees of freedom of the error."""
    texture = _texture(pictures, regions)
    for look in LOOKS:
        sums = Sums(*(part[:, None] for part in look.sums(pictures, regions)))
        if np.count_nonzero(sums.below) < FEWEST:
            continue
        squares = sums.deviations[:, 0] ** 2
        error = float(np.sqrt(squares.sum()))
        degrees = float(squares.sum() ** 2 / max((squares**2).sum(), 1e-300))
        if error > 0:
            error = math.hypot(error, look.texture * texture, look.content * float(sums.ratio[0]))
            yield look, float(sums.ratio[0]), error, max(degrees - 1, 1.0)


def _texture(pictures: np.ndarray, regions: Regions) -> float:
    """By what share low coefficients of flat blocks exceed high ones, beyond what the choice of flat blocks leaves of noise."""
    power = np.zeros(2)
    for n, picture in enumerate(pictures):
        coefficients = blocks_of(picture)[0][regions.lit[n] >= 0]
        power += [(coefficients[:, which] ** 2).mean(1).sum() for which in (CHOICE, NOISE)]
    return max(float(power[0] / power[1] / FLAT_MEAN - 1), 0.0) if power[1] > 0 else 0.0


def _black(pictures: np.ndarray, regions: Regions) -> tuple[np.ndarray, np.ndarray]:
    dark = as_pixels(regions.dark)
    told = dark.sum((1, 2)) >= 16 * SIDE**2
    level = (pictures * dark).sum((1, 2)) / np.maximum(dark.sum((1, 2)), 1)
    return np.where(told, level, 0.0), told.astype(float)


def _saturation(pictures: np.ndarray, _: Regions) -> tuple[np.ndarray, np.ndarray]:
    """Highest code of pictures in which pixels pile up there."""
    top = pictures.max((1, 2))
    least = [top[:, None, None] - k for k in (1, 11)]
    reached = [(pictures > b) & (pictures <= b + w) for b, w in zip(least, (1, 10))]
    at, below = (np.count_nonzero(these, axis=(1, 2)) for these in reached)
    told = (at >= 20) & (at > 5.0 * below / 10)  # five times as many at the highest code as at those below
    return np.where(told, top, 0.0), told.astype(float)


def _noise_ratio(above: np.ndarray, below: np.ndarray):
    def sums(pictures: np.ndarray, regions: Regions) -> tuple[np.ndarray, np.ndarray]:
        power = np.zeros((2, len(pictures)))
        for n, picture in enumerate(pictures):
            coefficients = blocks_of(picture)[0][(regions.lit[n] >= 0) | regions.dark[n]]
            power[:, n] = [(coefficients[:, which] ** 2).mean(1).sum() for which in (above, below)]
        return power[0], power[1]

    return sums


def _blocking(pictures: np.ndarray, _: Regions) -> tuple[np.ndarray, np.ndarray]:
    """Squared steps between the pixels at the borders of blocks of 8 x 8, over those in their middles."""
    above, below = np.zeros(len(pictures)), np.zeros(len(pictures))
    for axis in (1, 2):
        step = np.diff(pictures, axis=axis).swapaxes(1, axis)
        scale = MAD * np.median(np.abs(step[:, ::3, ::5]), axis=(1, 2))[:, None, None] + 0.5
        square = np.clip(step / scale, -5.0, 5.0) ** 2
        above += square[:, SIDE - 1 :: SIDE].mean((1, 2))
        below += square[:, SIDE // 2 - 1 :: SIDE].mean((1, 2))
    return above, below


def _sharpness(pictures: np.ndarray, _: Regions) -> tuple[np.ndarray, np.ndarray]:
    """Steepest slope per pixel of edges over their whole height, of the sharpest fifth of edges along either axis."""
    found = []
    for picture in pictures:
        ratios = np.concatenate([_edges(p) for p in (picture, picture.T)])
        # Blunt edges are the scene's, the sharpest are the camera's.
        found.append(np.quantile(ratios, 0.8) if len(ratios) >= 20 else np.nan)
    told = np.isfinite(found)
    return np.where(told, found, 0.0), told.astype(float)


STEEPEST = 0.3  # slope along an edge over that across, up to which it is measured
# By it slopes differ by up to 4 %, however the scene's edges are distributed in between: standard deviation of a uniform law.
TILTED = (1 - math.cos(math.atan(STEEPEST))) / math.sqrt(12)


def _edges(picture: np.ndarray) -> np.ndarray:
    """Slope over height of each place where the slope along rows is the steepest of its neighbourhood."""
    slope = np.gradient(picture, axis=1)
    along = np.gradient(picture, axis=0)
    size = np.abs(slope)
    reach = 4  # px on either side of an edge
    width = 2 * reach + 1
    least = ndimage.minimum_filter1d(picture, width, axis=1)
    height = ndimage.maximum_filter1d(picture, width, axis=1) - least
    steepest = size >= ndimage.maximum_filter1d(size, width, axis=1)
    # An edge stands clear of the noise, by 40/255 of full scale, and hardly changes along itself.
    edge = steepest & (height > 40.0) & (np.abs(along) < STEEPEST * size)
    edge[:, :reach] = edge[:, -reach:] = False
    return size[edge] / height[edge]


def _halo(width: int):
    """Light in the sky that goes with the light a Gaussian of this width would scatter there, as a share of it."""

    def sums(pictures: np.ndarray, regions: Regions) -> tuple[np.ndarray, np.ndarray]:
        return _scattered(pictures, regions, lambda light: ndimage.gaussian_filter(light, (0, width, width)))

    return sums


def _streak(pictures: np.ndarray, regions: Regions) -> tuple[np.ndarray, np.ndarray]:
    """The same for light smeared along columns less light smeared along rows."""
    streak = 16  # px

    def smeared(light: np.ndarray) -> np.ndarray:
        return ndimage.gaussian_filter(light, (0, streak, 0)) - ndimage.gaussian_filter(light, (0, 0, streak))

    return _scattered(pictures, regions, smeared)


def _scattered(
    pictures: np.ndarray, regions: Regions, scatter: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    if regions.sky is None:
        return np.zeros(len(pictures)), np.zeros(len(pictures))
    dark = as_pixels(regions.dark)
    light = np.where(dark, 0, np.maximum(pictures - regions.sky, 0)).astype(np.float32)
    expected = scatter(light)
    count = np.maximum(dark.sum((1, 2)), 1)
    mean = (expected * dark).sum((1, 2)) / count
    expected = np.where(dark, expected - mean[:, None, None], 0)
    return (expected * pictures).sum((1, 2)), (expected**2).sum((1, 2))


def _areas(pictures: np.ndarray, _: Regions) -> tuple[np.ndarray, np.ndarray]:
    """Saturated areas along columns less along rows, over some pixels."""
    above, below = area_sums(pictures >= 0.97 * pictures.max())
    return above[:, 1], below[:, 1]


LOOKS = (
    Look("black_level", "level of the black sky", "DN", _black),
    Look("saturation", "code at which pixels saturate", "DN", _saturation),
    Look("noise_spectrum", "fine noise over coarse noise", "1",
         _noise_ratio(_FINE, _COARSE), texture_share(_COARSE)),
    Look("noise_spectrum", "noise along rows over noise along columns", "1", _noise_ratio(_ACROSS, _DOWN)),
    Look("blocking", "steps at the borders of 8 x 8 blocks over steps within", "1", _blocking),
    Look("edges", "slope of the sharpest edges over their height", "1/px", _sharpness, content=TILTED),
    *(Look("halo", f"light scattered over {width} px", "share", _halo(width)) for width in (4, 12)),
    Look("streaks", "light along columns less along rows", "share", _streak),
    Look("streaks", "saturated areas along columns less along rows", "share", _areas),
)  # fmt: skip
