"""Patterns at the same place of many pictures, and noise common to the pixels of a row or column.

J. Lukas, J. Fridrich and M. Goljan, IEEE Trans. Information Forensics and Security 1 (2006) 205: a sensor's pattern is the
mean of the noise residuals of its pictures. Here variances are wanted and no pattern: the product of two means over
different pictures has the pattern's variance as its expectation, whatever the noise, and the product of two blocks of one
row of blocks that of the row noise.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import fft, stats

from visaug.pictures.blocks import EDGE, LINE, NOISE, SIDE, Levels, Rounding, blocks_of, is_flat
from visaug.pictures.curve import Sky, VarianceLaw
from visaug.pictures.files import PictureSet

FALSE_ALARMS = 1e-3  # of one pattern or noise that is said to be there


@dataclass(frozen=True)
class VariancePart:
    """A variance in (1/255 of linear full scale)^2, or squared fractions, its standard error and the degrees of freedom of that."""

    variance: float
    error: float
    degrees: float = np.inf

    @property
    def found(self) -> bool:
        """Above zero at that rate of false alarms."""
        return bool(self.variance > stats.t.isf(FALSE_ALARMS, self.degrees) * self.error)

    def minus(self, other: "VariancePart | None") -> "VariancePart":
        if other is None:
            return self
        fewest = min(self.degrees, other.degrees)
        return VariancePart(self.variance - other.variance, float(np.hypot(self.error, other.error)), fewest)


@dataclass(frozen=True)
class Pattern:
    """Parts by name: pixel, prnu; row, column (all of it), row_fixed, column_fixed (what recurs). None: not told."""

    pixel: VariancePart | None = None
    prnu: VariancePart | None = None
    row: VariancePart | None = None
    row_fixed: VariancePart | None = None
    column: VariancePart | None = None
    column_fixed: VariancePart | None = None


@dataclass
class _Halves:
    """Weighted sums of coefficients at each place, for two halves of the pictures."""

    sums: list = field(default_factory=lambda: [0.0, 0.0])
    weights: list = field(default_factory=lambda: [0.0, 0.0])

    def add(self, half: int, values: np.ndarray, weights: np.ndarray) -> None:
        self.sums[half] = self.sums[half] + values
        self.weights[half] = self.weights[half] + weights

    def covariance(self) -> VariancePart | None:
        """Mean product of the halves' means over the places that both saw."""
        a, b = (np.asarray(w, float) for w in self.weights)
        if not a.ndim or not b.ndim:
            return None
        seen = (a > 0) & (b > 0)
        first, second = (np.asarray(s)[seen] / w[seen][:, None] for s, w in zip(self.sums, (a, b)))
        return _mean_product((first * second).mean(1), a[seen], b[seen])

    def line_covariance(self) -> VariancePart | None:
        """The same over lines of places, without the products of a place with itself, which hold the pixels' pattern."""
        a, b = (np.asarray(w, float) for w in self.weights)
        if a.ndim < 2 or b.ndim < 2:
            return None
        first, second = (np.asarray(s) for s in self.sums)
        pairs = a.sum(1) * b.sum(1) - (a * b).sum(1)
        products = (first.sum(1) * second.sum(1) - (first * second).sum(1)).mean(1)
        seen = pairs > 0
        return _mean_product(products[seen] / pairs[seen], a.sum(1)[seen], b.sum(1)[seen])


def _mean_product(products: np.ndarray, a: np.ndarray, b: np.ndarray) -> VariancePart | None:
    """Weighted mean over places, with its standard error from place to place."""
    if len(products) < 8:
        return None
    weight = a * b / (a + b)
    value = float(weight @ products / weight.sum())
    error = np.sqrt((weight**2) @ (products - value) ** 2) / weight.sum()
    return VariancePart(value, float(error), _degrees(weight))


def _degrees(weights: np.ndarray) -> float:
    """Degrees of freedom of a standard error from the scatter of values of these weights."""
    return max(float(weights.sum() ** 2 / (weights**2).sum()) - 1, 1.0)


def recurring(
    pictures: PictureSet, levels: Levels, rounding: Rounding, law: VarianceLaw, sky: Sky | None
) -> Pattern:
    """Patterns and line noise of the pictures, referred to the linear picture by the law's slope."""
    plain, lit = _Places(), _Places()
    lines = {axis: _Lines() for axis in (0, 1)}
    usable = _usable(pictures, levels, sky)
    for n in range(len(pictures)):
        coefficients, level, whole = blocks_of(pictures.read(n))
        slope = law.slope_at(level)
        flat = whole & is_flat(coefficients, levels.variance_at(level), rounding) & (slope > 0.1)
        x = law.light_at(level)
        linear = coefficients / np.maximum(slope, 0.1)[..., None, None]
        dark = flat & (level < sky.level + sky.reach) if sky else flat
        noise = linear[..., NOISE & usable]
        if noise.shape[-1]:
            plain.add(n % 2, noise, dark.astype(float), x)
            lit.add(n % 2, noise, np.where(flat & (x > 10.0), x, 0.0), x)  # brighter ones tell their response
        for axis, kept in lines.items():
            kept.add(n % 2, linear, dark, axis, usable)
    return Pattern(*_dark_and_response(plain, lit), *lines[0].parts(), *lines[1].parts())


class _Places:
    """Means over pictures of the coefficients at each place under weights w, which are offsets plus response times light."""

    def __init__(self) -> None:
        self._kept = [_Halves() for _ in range(3)]  # of values, offsets and light

    def add(self, half: int, values: np.ndarray, weight: np.ndarray, x: np.ndarray) -> None:
        added = values * weight[..., None], weight[..., None], (weight * x)[..., None]
        for kept, each in zip(self._kept, added):
            kept.add(half, each, weight)

    def products(self) -> tuple[VariancePart, float, float] | None:
        """Mean product of the halves, and how much of it an offset and a response of variance 1 would make."""
        value, offset, light = (kept.covariance() for kept in self._kept)
        if value is None or offset is None or light is None:
            return None
        return value, offset.variance, light.variance


def _dark_and_response(plain: _Places, lit: _Places) -> tuple[VariancePart | None, VariancePart | None]:
    """Variances of offset and response, from two weightings that see them in different shares."""
    first, second = plain.products(), lit.products()
    if first is None:
        return None, None
    value, offset, light = first
    if second is None or second[2] <= 0:
        if not light < 4.0 * offset:  # squared light below which a response adds nothing to offsets
            return None, None
        return VariancePart(value.variance / offset, value.error / offset, value.degrees), None
    shares = np.array([[offset, light], second[1:]])
    if abs(np.linalg.det(shares)) < 0.05 * offset * second[2]:
        return None, None  # one level only: the two cannot be parted
    inverse = np.linalg.inv(shares)
    variance = inverse @ [value.variance, second[0].variance]
    error = np.sqrt(inverse**2 @ [value.error**2, second[0].error ** 2])
    dark, response = (VariancePart(float(v), float(e)) for v, e in zip(variance, error))
    return dark, response


def _usable(pictures: PictureSet, levels: Levels, sky: Sky | None) -> np.ndarray:
    """Coefficients that JPEG does not round coarser than two standard deviations of the noise, at the sky and in lit regions."""
    if not pictures.is_jpeg:
        return np.ones((8, 8), bool)
    variance = float(np.median(levels.variance))
    if sky:
        variance = min(variance, float(levels.variance_at(sky.level)))
    return pictures.steps <= 2 * np.sqrt(variance)


_POLYNOMIALS = fft.dct(np.arange(SIDE)[:, None] ** np.arange(1.0, 4.0), axis=0, norm="ortho")
# (8, 3): how much of the coefficients 1 to 3 of a cubic is found in each other one
_LEAK = np.where(LINE[:, None], _POLYNOMIALS @ np.linalg.inv(_POLYNOMIALS[1:4]), 0.0)
# Variance of what is left of a coefficient of white noise, over that of the noise
_KEPT = 1 + (_LEAK**2).sum(1)
APART = 2  # blocks on each side of one with which it may share content


class _Lines:
    """Rows (axis 0) or columns (axis 1): coefficients of the other frequency 0.
    The noise of a line is common to all blocks along it, however far apart, and content to neighbours: a picture's variance is
    the mean product of blocks that are more than APART from each other. Slopes and bumps of the content, which reach farther,
    are taken off as the cubic that the coefficients 1 to 3 tell.
    """

    def __init__(self) -> None:
        self._pictures: list[tuple[float, float]] = []
        self._halves = _Halves()

    def add(self, half: int, linear: np.ndarray, flat: np.ndarray, axis: int, usable: np.ndarray) -> None:
        if axis == 1:
            linear, flat, usable = linear.transpose(1, 0, 3, 2), flat.T, usable.T
        line = linear[..., 0]  # (R, C, 8): vertical frequencies
        low = (line[..., 1:4] ** 2).mean(-1)
        if flat.any():
            flat = flat & (low < EDGE * np.median(low[flat]))
        told = LINE & usable[:, 0]
        values = (line - line[..., 1:4] @ _LEAK.T)[..., told] / np.sqrt(_KEPT[told]) * flat[..., None]
        if not values.shape[-1]:
            return
        count = flat.sum(1)
        products = (values.sum(1) ** 2 - _near(values)).mean(-1)
        pairs = count**2.0 - _near(flat[..., None].astype(float))[:, 0]
        weight = pairs / np.maximum(count, 1)
        ratio = np.divide(products, pairs, out=np.zeros(len(pairs)), where=pairs > 0)
        if weight.sum() > 0:
            self._pictures.append((float(weight @ ratio), float(weight.sum())))
        self._halves.add(half, values, flat.astype(float))

    def parts(self) -> tuple[VariancePart | None, VariancePart | None]:
        """Variance of one line's offset, all of it and what recurs; an offset r gives coefficients of variance 8 r^2."""
        total = None
        if len(self._pictures) > 2:
            values, weights = np.array(self._pictures).T
            value = values.sum() / weights.sum()
            rest = values - value * weights
            error = np.sqrt((rest**2).sum() * len(rest) / (len(rest) - 1)) / weights.sum()
            total = VariancePart(float(value / 8), float(error / 8), _degrees(weights))
        fixed = self._halves.line_covariance() if len(self._pictures) > 3 else None
        return total, fixed and VariancePart(fixed.variance / 8, fixed.error / 8, fixed.degrees)


def _near(values: np.ndarray) -> np.ndarray:
    """Sum over the blocks of each line (R, C, k) of the products with itself and with those at most APART from it."""
    total = (values**2).sum(1)
    for step in range(1, APART + 1):
        total = total + 2 * (values[:, step:] * values[:, :-step]).sum(1)
    return total
