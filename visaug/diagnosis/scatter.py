"""Strength of an effect whose shifts are random: from the variance that it adds, not from its mean shift.

A drifting lamp shifts no level on average, and its shifts in a few simulations are chance, so no fit of means determines its
strength. With the effect's strength multiplied by c, a statistic has the law N(c m, s_0^2 + c^2 v), where m is its mean shift, v
the variance that the effect adds and s_0 the standard deviation without it. The strength is the maximum of this likelihood over
c; its interval comes from the same estimate on simulated sets.
"""

from dataclasses import dataclass

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fitting.law import log_density
from visaug.diagnosis.fitting.parameters import Coordinate, moved
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.uses import Use, scales, shifts

# Least median of the squared residual over its variance; 0.45 for a normal distribution, less for rare events
TYPICAL = 0.15
FACTORS = np.geomspace(0.1, 10, 61)
MET = 1.6  # ratio to which an estimated strength must reproduce itself


@dataclass(frozen=True)
class VarianceStrength:
    """Strength of an effect, estimated from the variance that it adds.

    Attributes:
        factor: by which its strengths are to be multiplied.
        of_sets: (R,) the same estimate from each of its own simulated sets.
        strengths: their coordinates; at least one.
        in_variance: whether the variance determines it better than the mean shifts.
    """

    factor: float
    of_sets: np.ndarray
    strengths: tuple[Coordinate, ...]
    in_variance: bool

    @property
    def effect(self) -> str:
        return self.strengths[0].path.split(".")[0]

    @property
    def is_met(self) -> bool:
        """Whether the factor is consistent with 1. Rare events have a variance that does not grow with their rate."""
        return 1 / MET < self.factor < MET

    @property
    def is_in_means(self) -> bool:
        """Whether a fit of the mean shifts is enough: it finds the same strength and determines it better."""
        return self.is_met and not self.in_variance

    @property
    def steps(self) -> np.ndarray:
        """(R, strengths) logarithm of the strengths as estimated from each simulated set."""
        return np.repeat(np.log(self.of_sets)[:, None], len(self.strengths), axis=1)

    def scaled(self, camera: Camera) -> Camera:
        """The camera with the estimated strengths."""
        step = float(np.log(self.factor))
        return moved(camera, self.strengths, [c.read(camera) + step for c in self.strengths])


def scatter(before: Use, after: Use, strengths: tuple[Coordinate, ...]) -> VarianceStrength | None:
    """Strength of an effect from the mean shifts and the variance that it causes; None for an effect without a strength to fit.

    The Fisher information of log c is the sum of (m / s)^2 in the mean and of 2 (v / s^2)^2 in the variance.

    Args:
        before, after: the discovery frames without and with the effect.
        strengths: logarithmic coordinates.
    """
    if not strengths:
        return None
    null, (plain, own) = after.null, scales(before, after)
    used = (plain > 0) & (own > 0)
    known = plain[used] ** 2
    added = np.where(_is_typical(null), np.maximum(own**2 - plain**2, 0.0), 0.0)[used]
    moves = shifts(before, after)[used]

    def factors(left: np.ndarray) -> np.ndarray:
        """(sets,) maximum of the likelihood for residuals (sets, statistics) without the effect."""
        likelihoods = [
            log_density(left - c * moves, np.sqrt(known + c**2 * added), np.sqrt(known)).sum(-1)
            for c in FACTORS
        ]
        return FACTORS[np.argmax(likelihoods, axis=0)]

    (factor,) = factors(before.residual[None, used])
    by_mean = float((moves**2 / (known + added)).sum())
    by_variance = 2 * float(((added / (known + added)) ** 2).sum())
    return VarianceStrength(
        float(factor), factors(null.residuals[:, used] + moves), strengths, by_variance > by_mean
    )


def _is_typical(null: Null) -> np.ndarray:
    """(statistics,) whether a single set shows the variance between sets, which it does not for rare events."""
    return np.median(null.residuals**2, axis=0) > TYPICAL * null.residuals.var(0, ddof=1)
