"""What a set of pictures has in common: its black sky; and the spread of a figure from picture to picture."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from visaug.fingerprint.pictures.blocks import Blocks, Levels
from visaug.fingerprint.pictures.curve import Sky

_GROUPS = 12
_SKY_SHARE = 0.1
_SKY_DN = 2.0


def jackknife(
    figures: Callable[[np.ndarray], np.ndarray], pictures: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Value, standard error and degrees of freedom of figures of weighted pictures, by leaving out groups of them."""
    value = figures(np.ones(pictures))
    groups = min(pictures, _GROUPS)
    if groups < 2:
        return value, np.full(len(value), np.nan), 1
    member = np.arange(pictures) % groups
    left = np.array([figures((member != g).astype(float)) for g in range(groups)])
    spread = np.sqrt((groups - 1) * np.mean((left - left.mean(0)) ** 2, 0))
    return value, spread, groups - 1


def find_sky(blocks: Blocks, levels: Levels) -> Sky | None:
    """The black sky: the darkest flat level, where a tenth or more of all blocks lie within 2 DN of it."""
    first = blocks.level[np.abs(blocks.level - levels.level[0]) < _SKY_DN]
    dark = np.median(first) if len(first) else levels.level[0]
    near = np.abs(blocks.level - dark) < _SKY_DN
    if near.mean() < _SKY_SHARE or levels.structure[0] > 0.1:
        return None
    means = [np.median(blocks.level[near & (blocks.picture == n)]) for n in np.unique(blocks.picture[near])]
    error = np.std(means) / math.sqrt(len(means))
    return Sky(float(np.median(means)), float(max(error, 0.01)))
