"""What a set of pictures has in common: its black sky; and the spread of a figure from picture to picture."""

import math
from collections.abc import Callable

import numpy as np

from visaug.pictures.blocks import NOISE, Blocks, Levels, Rounding
from visaug.pictures.curve import Sky
from visaug.pictures.files import PictureSet

_ONLY_ROUNDING_DN2 = 0.12  # a code's rounding alone gives 1/12


def jackknife(figures: Callable[[np.ndarray], np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Value, standard error and degrees of freedom of figures of `count` weighted pictures, by leaving out groups of them."""
    value = figures(np.ones(count))
    if (groups := min(count, 12)) < 2:
        return value, np.full(len(value), np.nan), 1
    member = np.arange(count) % groups
    left = np.array([figures((member != g).astype(float)) for g in range(groups)])
    spread = np.sqrt((groups - 1) * np.mean((left - left.mean(0)) ** 2, 0))
    return value, spread, groups - 1


def find_sky(blocks: Blocks, levels: Levels) -> Sky | None:
    """The black sky: the darkest level around which a tenth or more of all blocks lie, where it is flat and stands alone.
    None where levels go on above it as those of dark surfaces do, where others are darker, or where nothing is brighter: then it
    may be any level.
    Offsets of rows and columns spread the levels of its blocks. Those below its level hold no light and give the spread.
    """
    steps = np.arange(0.0, blocks.level.max(initial=0.0) + 0.25, 0.25)
    ordered = np.sort(blocks.level)
    sky_dn = 2.0
    inside = np.searchsorted(ordered, steps + sky_dn) - np.searchsorted(ordered, steps - sky_dn)
    enough = inside >= max(0.1 * len(ordered), 1)
    if not enough.any():
        return None
    first = int(np.argmax(enough))
    end = first + int(np.argmin(np.append(enough[first:], False)))
    most = steps[first + int(np.argmax(inside[first:end]))]
    dark = float(np.median(ordered[np.abs(ordered - most) <= sky_dn]))
    if levels.structure[np.argmin(np.abs(levels.level - dark))] > 0.1:
        return None
    below = dark - ordered[ordered < dark]
    spread = float(np.median(below)) / 0.6745 if len(below) else 0.0  # the normal quartile
    reach = Sky(dark, 0.0, spread).reach
    within, beyond = np.diff([np.count_nonzero(ordered <= dark + k * reach) for k in (0, 1, 2)])
    darker = np.count_nonzero(ordered < dark - reach)
    # A surface of changing brightness has about as many blocks just above the sky's reach as within, here a quarter of them at
    # most. Dead lines are few, and nothing is darker than no light.
    if beyond > 0.25 * within or darker > 0.05 * within or not np.any(ordered > dark + reach):
        return None
    near = np.abs(blocks.level - dark) < reach
    seen = np.unique(blocks.picture[near])
    means = [np.median(blocks.level[near & (blocks.picture == n)]) for n in seen]
    # The blocks of a picture stand in about as many columns as the root of their number. Offsets of columns recur, so that
    # they do not average out over the pictures.
    columns = math.sqrt(np.count_nonzero(near) / len(seen))
    error = math.hypot(float(np.std(means)) / math.sqrt(len(means)), spread / math.sqrt(columns))
    return Sky(float(np.median(means)), float(max(error, 0.01)), spread)


def is_rendered(blocks: Blocks, levels: Levels, rounding: Rounding) -> bool:
    """Whether there is rounding and no noise: at the flat levels, or in the smoothest tenth of the lit blocks.
    Of a camera even the smoothest lit blocks hold its noise. JPEG may round it away there, so its files are judged by levels: lit
    ones where there are any, for rounding hides the noise of a quiet camera's black sky.
    """
    lit_dn = 30.0
    lit = blocks.coefficients[blocks.level > lit_dn]
    fine = np.quantile((lit[:, NOISE] ** 2).mean(1), 0.1) if len(lit) >= 10 else np.inf
    if fine < _ONLY_ROUNDING_DN2 and not rounding.is_jpeg:
        return True
    weight = levels.blocks.sum(0)
    if weight[levels.level > lit_dn].any():
        weight = np.where(levels.level > lit_dn, weight, 0)
    rounded = rounded_away(levels, rounding) if rounding.is_jpeg else levels.variance < _ONLY_ROUNDING_DN2
    return bool(weight[rounded].sum() > 0.9 * weight.sum() > 0)


def rounded_away(levels: Levels, rounding: Rounding) -> np.ndarray:
    """(levels,) whether JPEG has rounded the noise away, so that its variance is known from above alone; False without JPEG."""
    if not rounding.is_jpeg:
        return np.zeros(len(levels.level), bool)
    return levels.variance < 1.01 * rounding.least  # the least that can be found, which all smaller ones give


def no_noise(pictures: PictureSet) -> str:
    """What is said of pictures that `is_rendered`."""
    if pictures.top_dn > 255:
        return (
            "no sensor noise found: smooth regions vary by less than 0.35/255 of full scale, as in renders; if the converter has "
            "fewer bits than the files, give --bit-depth"
        )
    return (
        "no sensor noise found: smooth regions vary by no more than the rounding of their codes, as in renders and screenshots"
        + (", or where JPEG has rounded noise away" if pictures.is_jpeg else "")
    )
