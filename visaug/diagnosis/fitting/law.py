"""A Gaussian distribution of the residuals of a complete camera after its refit, and a correction for its sampling error."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from visaug.core.constants import MAD
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.robust import shrunk

FORM = 0.1  # model discrepancy of an effect's form, relative to what the effect explains,
ROUGH = 0.3  # and of its first signatures, whose parameters are not fitted yet

OUTLIERS = 0.01  # share of the statistics that effects outside the model shift
LEAST = 3.0  # the smallest outlier, in standard deviations,
RANGE = 1e4  # and the ratio of the largest to the smallest
# Least median of a squared residual over its mean; 0.45 for a normal distribution, less for rare events
TYPICAL = 0.15
FEW_SETS = 3  # sets that tell the width of a part of a distribution


@dataclass(frozen=True)
class Metric:
    """Gaussian distribution of the residuals of a complete camera, with the camera's parameters marginalised.

    The covariance is that of the simulated sets, plus that of the free parameters, plus a model-discrepancy term proportional
    to each large residual: a real glow or lag does not have exactly the catalogue's form, and without this term every form
    would be rejected for a strong effect.
    """

    used: np.ndarray
    scale: np.ndarray
    covariance: np.ndarray  # of standardised residuals

    @cached_property
    def factor(self) -> np.ndarray:
        return np.linalg.cholesky(self.covariance)

    @cached_property
    def precision(self) -> np.ndarray:
        return cho_solve((self.factor, True), np.eye(len(self.factor)), check_finite=False)  # pyrefly: ignore[bad-return]

    def z(self, vector: np.ndarray) -> np.ndarray:
        """Standardised residuals: (..., statistics)."""
        return vector[..., self.used] / self.scale

    def white(self, vector: np.ndarray) -> np.ndarray:
        z = self.z(vector)
        flat = z.reshape(-1, z.shape[-1]).T
        solved = solve_triangular(self.factor, flat, lower=True, check_finite=False)
        return solved.T.reshape(z.shape)  # pyrefly: ignore[missing-attribute]

    def widened(self, variance: np.ndarray) -> "Metric":
        """With the variance that an effect adds, per statistic (drift, tracks, sparse defects)."""
        return Metric(self.used, self.scale, self.covariance + np.diag(variance[self.used] / self.scale**2))

    def widened_log_likelihood(self, residual: np.ndarray, variance: np.ndarray) -> float:
        """`widened(variance).log_likelihood(residual)`, faster if few variances are positive.

        Woodbury's identity for a change of k diagonal entries.
        """
        extra = variance[self.used] / self.scale**2
        wide = np.flatnonzero(extra)
        z = self.z(residual)
        flat = self.precision @ z
        root = np.sqrt(extra[wide])
        inner = np.eye(len(wide)) + root[:, None] * self.precision[np.ix_(wide, wide)] * root
        factor = np.linalg.cholesky(inner)
        freed = solve_triangular(factor, root * flat[wide], lower=True, check_finite=False)
        square = float(z @ flat - freed @ freed)  # pyrefly: ignore[unsupported-operation]
        return -0.5 * square - float(np.log(np.diag(self.factor)).sum() + np.log(np.diag(factor)).sum())

    def log_likelihood(self, residual: np.ndarray) -> float:
        """Log likelihood of a residual, up to a constant."""
        return float(-0.5 * np.sum(self.white(residual) ** 2) - np.log(np.diag(self.factor)).sum())


def metric(fitted: Fitted, form: float, allowance: np.ndarray | float = 0.0) -> Metric:
    """The metric of the residual of a fitted camera.

    Args:
        form: relative model discrepancy of the effect that causes large residuals.
        allowance: tolerance of accepted effects' forms, per statistic.
    """
    return law(fitted.reference.null, np.hypot(form * fitted.residual, allowance))


def law(null: Null, left: np.ndarray, sets: np.ndarray | None = None) -> Metric:
    """Covariance of the residual of a refitted camera: of its simulated sets, of its free parameters, and of `left`.

    Args:
        left: tolerance of effects' forms, per statistic.
        sets: residuals of some of the simulated sets; of all if omitted.
    """
    used = null.scale > 0
    scale = null.scale[used]
    slopes = null.slopes[used] / scale[:, None] * null.priors
    correlation = null.correlation if sets is None else shrunk(sets[:, used] / scale)
    covariance = correlation + slopes @ slopes.T + np.diag((left[used] / scale) ** 2)
    return Metric(used, scale, covariance)


def each_half(null: Null, left: np.ndarray) -> list[tuple[Metric, np.ndarray, np.ndarray]]:
    """The covariance of each half of the simulated sets, with the residuals of the other half, to which it may be applied:
    as they are (R / 2, statistics), and whitened (R / 2, statistics used).
    """
    key = np.asarray(left).tobytes()
    found = null.halves.get(key)
    if found is None:
        first, second = null.residuals[::2], null.residuals[1::2]
        pairs = ((law(null, left, sets=own), others) for own, others in ((first, second), (second, first)))
        found = [(m, others, m.white(others)) for m, others in pairs]
        null.halves.clear()  # the last alone is kept: each holds matrices of all statistics
        null.halves[key] = found
    return found


def scatter_along(null: Null, left: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(n,) variance of simulated sets in directions (n, statistics), relative to that of `law`; at least 1.

    A covariance of many statistics from few sets is too small in some directions, which inflates matches there by chance;
    this factor corrects for it.
    """
    found = np.zeros(len(ways))
    for m, _, others in each_half(null, left):
        white = m.white(ways)
        squares = (white**2).sum(1)
        along = ((others @ white.T) ** 2).mean(0)
        found += 0.5 * np.divide(along, squares, out=np.ones_like(squares), where=squares > 0)
    return np.maximum(found, 1.0)


def log_density(
    residual: np.ndarray, scale: np.ndarray, unit: np.ndarray, rare: "Rare | None" = None
) -> np.ndarray:
    """Log density of residuals (..., statistics): normal, with log-uniform outliers for what effects outside the model cause.

    Args:
        scale: standard deviations.
        unit: outliers lie beyond `LEAST` times this.
        rare: statistics that have a mixture of two normal distributions in place of one.
    """
    size = np.abs(residual)
    normal = _normal(residual, scale)
    if rare is not None:
        parts = (
            share * _normal(residual[..., rare.places] - middle, width)
            for share, middle, width in zip(rare.shares, rare.middles, rare.widths, strict=True)
        )
        normal[..., rare.places] = sum(parts)
    outlier = 1 / (2 * (1 + np.log(RANGE)) * np.maximum(size, LEAST * unit))
    return np.log((1 - OUTLIERS) * normal + OUTLIERS * outlier)


def _normal(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * (residual / scale) ** 2) / (scale * np.sqrt(2 * np.pi))


@dataclass(frozen=True)
class Rare:
    """Statistics that an effect shifts far in few specimens of a camera and hardly in the others.

    Attributes:
        places: (n,) which they are.
        shares, middles, widths: (2, n) of the specimens without and with such a shift: how many, and mean and standard
            deviation of their residuals.
    """

    places: np.ndarray
    shares: np.ndarray
    middles: np.ndarray
    widths: np.ndarray


def rare(sets: np.ndarray, changes: np.ndarray, scale: np.ndarray, allowed: np.ndarray) -> Rare | None:
    """The statistics that an effect shifts far in fewer than half of the sets and hardly in the others; None if there are none.

    Far is beyond `LEAST` standard deviations, and as many robust ones of the sets. An effect that makes a statistic wider changes
    it in every set, so that the squared change has no small median compared to its mean. A shift has the tolerance of the
    effect's form, `FORM`.

    Args:
        sets: (R, statistics) residuals, without the effect, of sets that are simulated with it.
        changes: (n, statistics) by the effect, of sets that share their random numbers with and without it.
        scale: standard deviations without the effect: the least width of either part.
        allowed: residual that may stay, per statistic.
    """
    robust = MAD * np.median(np.abs(sets), 0)
    is_far = np.abs(sets) > LEAST * np.maximum(np.hypot(scale, allowed), robust)
    count, squares = is_far.sum(0), changes**2
    is_apart = np.median(squares, 0) < TYPICAL * squares.mean(0)
    places = np.flatnonzero((count >= FEW_SETS) & (count < len(sets) / 2) & is_apart)
    if not len(places):
        return None
    found = []
    for part in (~is_far[:, places], is_far[:, places]):
        number = part.sum(0)
        middle = np.where(part, sets[:, places], 0.0).sum(0) / number
        spread = np.where(part, (sets[:, places] - middle) ** 2, 0.0).sum(0) / (number - 1)
        variance = np.maximum(spread, scale[places] ** 2) + allowed[places] ** 2
        found.append((number / len(sets), middle, np.sqrt(variance)))
    shares, middles, widths = (np.array(values) for values in zip(*found, strict=True))
    widths[1] = np.hypot(widths[1], FORM * middles[1])
    return Rare(places, shares, middles, widths)
