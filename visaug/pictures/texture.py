"""How much texture of the scene passes for noise in flat blocks, measured on the blocks themselves.

A block of noise of variance v and texture has low coefficients of mean square v (1 + t) and high ones of v (1 + share t). The
distribution of t over the blocks of a level is found from their low coefficients (nonparametric maximum likelihood: N. Laird,
J. Amer. Statist. Assoc. 73 (1978) 805). What t is to be expected of a block follows from it, and the share from how high
coefficients grow with that expectation, over all levels. Where t is 0 there is noise alone.
"""

from dataclasses import dataclass

import numpy as np

from visaug.pictures.blocks import CHOICE, PIXELS_ROUNDED, Blocks, Levels, Rounding, flat_limit, texture_share

_RATIO = 1.06  # of one tried deviation to the next
_DEVIATIONS = 0.1 * _RATIO ** np.arange(125)  # of low coefficients, in DN: up to 140
_EDGES = np.concatenate([[0.0], 0.01 * _RATIO ** (3 * np.arange(85)), [np.inf]])  # bins of their mean square


@dataclass(frozen=True)
class Texture:
    """Texture in the flat blocks of each level."""

    power: np.ndarray  # (levels,) at low coefficients, over the noise
    share: float  # of it that high coefficients hold, and so the noise that is measured
    error: float  # standard error of the share

    def excess(self, deviations: float = 0.0) -> np.ndarray:
        """(levels,) texture over noise in the variance of flat blocks, at the share moved by its standard errors."""
        return np.maximum(self.share + deviations * self.error, 0.0) * self.power

    @property
    def is_white(self) -> bool:
        """Whether it is finer than texture behind a lens: the noise has heavy tails, or the texture is as fine as noise."""
        return self.share - 2 * self.error > texture_share()


def texture_in(blocks: Blocks, levels: Levels, rounding: Rounding, dark: float = -np.inf) -> Texture:
    """Texture in the flat blocks of levels above `dark`; below there is no light to show any."""
    kernel = _kernel(rounding)
    which = np.digitize(blocks.level, levels.edges) - 1
    mean_low = (blocks.coefficients[:, CHOICE] ** 2).mean(1)
    lit = np.flatnonzero(levels.level > dark)
    members = [np.flatnonzero(which == levels.number[j]) for j in lit]
    low = [mean_low[m] for m in members]
    sums = [rounding.sums(blocks.coefficients[m]) for m in members]
    noise = levels.variance[lit].copy()
    share, error = 0.0, 0.0
    expected: list[np.ndarray] = []
    for _ in range(4):
        expected = [_expected(x, v, kernel) for x, v in zip(low, noise, strict=True)]
        groups = [g for j, t in enumerate(expected) for g in _groups(j, t, sums[j], rounding)]
        if not groups:
            break
        noise, share, error = _line(np.array(groups), noise)
    power = np.zeros(len(levels.level))
    for j, x, t in zip(lit, low, expected, strict=True):
        flat = x <= flat_limit(levels.variance[j], rounding)
        power[j] = t[flat].mean() if flat.any() else 0.0
    return Texture(power, share, error)


def _kernel(rounding: Rounding) -> np.ndarray:
    """(deviations, bins) probability of the mean square of the low coefficients of white noise, rounded as JPEG does."""
    steps = rounding.steps[CHOICE]
    rng = np.random.default_rng(0)
    draws = 4000
    normal = rng.normal(size=(draws, len(steps)))
    rounded = rng.normal(0, np.sqrt(PIXELS_ROUNDED), normal.shape)
    found = np.empty((len(_DEVIATIONS), len(_EDGES) - 1))
    for row, deviation in zip(found, _DEVIATIONS, strict=True):
        x = deviation * normal
        if rounding.is_jpeg:
            x = np.rint(x / steps) * steps + rounded
        row[:] = np.histogram((x**2).mean(1), _EDGES)[0]
    found += 1 / draws  # a block beyond every draw is improbable, not impossible
    return found / found.sum(1, keepdims=True)


def _expected(low: np.ndarray, noise: float, kernel: np.ndarray) -> np.ndarray:
    """Of each block the texture over noise that its low coefficients let expect."""
    place = np.log(np.sqrt(noise) / _DEVIATIONS[0]) / np.log(_RATIO)
    first = int(np.clip(np.floor(place), 0, len(kernel) - 2))
    part = float(np.clip(place - first, 0, 1))
    rows = (1 - part) * kernel[first:-1] + part * kernel[first + 1 :]
    texture = _RATIO ** (2.0 * np.arange(len(rows))) - 1
    bins = np.digitize(low, _EDGES) - 1
    count = np.bincount(bins, minlength=len(_EDGES) - 1)
    seen = count > 0
    rows, count = rows[:, seen], count[seen]
    weight = np.full(len(rows), 1 / len(rows))
    for _ in range(150):  # of the likelihood's maximization
        weight *= rows @ (count / (weight @ rows)) / count.sum()
    of_bin = np.zeros(len(seen))
    of_bin[seen] = (weight * texture) @ rows / (weight @ rows)
    return of_bin[bins]


def _groups(
    number: int, texture: np.ndarray, sums: np.ndarray, rounding: Rounding
) -> list[tuple[int, float, float, int]]:
    """Number of the level, mean texture, variance of the high coefficients and number of blocks of groups of like texture."""
    chosen = np.flatnonzero(texture < 4.0)  # blocks beyond hold edges, whose spectrum is another
    chosen = chosen[np.argsort(texture[chosen], kind="stable")]
    parts = [p for p in np.array_split(chosen, max(min(6, len(chosen) // 8), 1)) if len(p)]
    counts = rounding.counts()
    noise = [rounding.variance(sums[p].sum(0), counts * len(p)) for p in parts]
    return [(number, float(texture[p].mean()), v, len(p)) for p, v in zip(parts, noise)]


def _line(groups: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Noise of each level without texture, and the share with its standard error, from noise (1 + share t) of all levels."""
    number, texture, variance, count = groups[:, 0].astype(int), *groups[:, 1:].T
    total = np.maximum(np.bincount(number, count, len(noise)), 1e-9)
    told = total >= 1
    share = error = 0.0
    for _ in range(30):
        before = share
        found = np.bincount(number, count * variance / (1 + share * texture), len(noise)) / total
        noise = np.where(told, found, noise)
        relative = variance / noise[number]
        x, y = (v - (np.bincount(number, count * v, len(noise)) / total)[number] for v in (texture, relative))
        squares = (count * x**2).sum()
        if squares <= 0:
            break
        slope = float((count * x * y).sum() / squares)
        error = float(np.sqrt(((count * x * (y - slope * x)) ** 2).sum()) / squares)
        share = max(slope, 0.0)
        if abs(share - before) < 1e-5:
            break
    return noise, share, error
