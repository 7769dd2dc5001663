"""Strength of an effect whose shifts are random: from the variance that it adds, not from its mean shift.

A drifting lamp shifts no level on average, and its shifts in a few simulations are chance, so no fit of means determines its
strength. With the effect's strength multiplied by c, a statistic has the law N(c m, s_0^2 + c^2 v), where m is its mean shift, v
the variance that the effect adds and s_0 the standard deviation without it. The strength is the maximum of this likelihood over
c. Not every mean shift grows with c, so the response of the estimate to the strength is simulated (`answer`). The interval is that
of the estimates of simulated sets, divided by this response.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fitting.law import TYPICAL, log_density
from visaug.diagnosis.fitting.parameters import Coordinate, moved
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.uses import Use, scales, shifts

FACTORS = np.geomspace(0.1, 10, 61)
MET = 1.6  # ratio to which an estimated strength must reproduce itself
ANSWERS = 0.3  # smallest response of an estimate to the strength; below it the interval is that of the prior


@dataclass(frozen=True)
class VarianceStrength:
    """Strength of an effect, estimated from the variance that it adds.

    Attributes:
        factor: by which its strengths are to be multiplied.
        of_sets: (R,) the same estimate from each of its own simulated sets.
        strengths: their coordinates; at least one.
        in_variance: whether the variance determines it better than the mean shifts.
        answer: ratio by which the logarithm of the estimate follows that of the strength.
    """

    factor: float
    of_sets: np.ndarray
    strengths: tuple[Coordinate, ...]
    in_variance: bool
    answer: float = 1.0

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
    def is_told(self) -> bool:
        """Whether the estimate answers to the strength."""
        return self.answer >= ANSWERS

    @property
    def steps(self) -> np.ndarray:
        """(R, strengths) logarithm of the strengths as estimated from each simulated set; 0 where the frames do not tell them."""
        own = np.log(self.of_sets) / self.answer if self.is_told else np.zeros(len(self.of_sets))
        return np.repeat(own[:, None], len(self.strengths), axis=1)

    @property
    def undetermined(self) -> np.ndarray:
        """(strengths,) standard deviation that comes from the priors because the frames do not determine them."""
        return np.array([0.0 if self.is_told else c.prior for c in self.strengths])

    def estimated(self, camera: Camera) -> Camera:
        """A camera of the simulated strength, with the strength estimated from the measurement."""
        return self.scaled(camera, 1 / self.answer) if self.is_told else camera

    def answering(self, before: Use, after: Use, others: np.ndarray, ratio: float) -> "VarianceStrength":
        """With its answer, from residuals (n, statistics) of sets whose strength is `ratio` times as large.

        They share random numbers with the first n sets of `after`, see `scatter`. An answer within two standard errors of 1 is 1.
        """
        more = np.log(_factors(before, after)(others)) - np.log(self.of_sets[: len(others)])
        return replace(self, answer=least_response(more / np.log(ratio)))

    def scaled(self, camera: Camera, power: float = 1.0) -> Camera:
        """The camera with its strengths multiplied by a power of the factor."""
        step = power * float(np.log(self.factor))
        return moved(camera, self.strengths, [c.read(camera) + step for c in self.strengths])


def least_response(found: np.ndarray) -> float:
    """The response from independent estimates (n,): 1 where it is within two standard errors of 1 or above, at least 0.

    From four estimates, a response of 1 is taken for less in 7 % of all cases (Student's t with 3 degrees of freedom).
    """
    mean, error = found.mean(), found.std(ddof=1) / np.sqrt(len(found))
    return 1.0 if mean + 2 * error > 1 else max(float(mean), 0.0)


def scatter(before: Use, after: Use, strengths: tuple[Coordinate, ...]) -> VarianceStrength | None:
    """Strength of an effect from the mean shifts and the variance that it causes; None for an effect without a strength to fit.

    The Fisher information of log c is the sum of (m / s)^2 in the mean and of 2 (v / s^2)^2 in the variance.

    Args:
        before, after: the discovery frames without and with the effect.
        strengths: logarithmic coordinates.
    """
    if not strengths:
        return None
    null, (plain, own), moves = after.null, scales(before, after), shifts(before, after)
    added = _added(null, plain, own)
    factors = _factors(before, after)
    used = (plain > 0) & (own > 0)
    total = plain[used] ** 2 + added[used]
    by_mean = float((moves[used] ** 2 / total).sum())
    by_variance = 2 * float(((added[used] / total) ** 2).sum())
    (factor,) = factors(before.residual[None] - moves)
    return VarianceStrength(float(factor), factors(null.residuals), strengths, by_variance > by_mean)


def _factors(before: Use, after: Use) -> Callable[[np.ndarray], np.ndarray]:
    """The estimate of the factor, (sets,), for residuals (sets, statistics) with the effect."""
    plain, own = scales(before, after)
    used = (plain > 0) & (own > 0)
    known, moves = plain[used] ** 2, shifts(before, after)[used]
    added = _added(after.null, plain, own)[used]

    def factors(left: np.ndarray) -> np.ndarray:
        likelihoods = [
            log_density(left[:, used] + (1 - c) * moves, np.sqrt(known + c**2 * added), np.sqrt(known)).sum(
                -1
            )
            for c in FACTORS
        ]
        return FACTORS[np.argmax(likelihoods, axis=0)]

    return factors


def _added(null: Null, plain: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(statistics,) variance that the effect adds to typical sets."""
    return np.where(_is_typical(null), np.maximum(own**2 - plain**2, 0.0), 0.0)


def _is_typical(null: Null) -> np.ndarray:
    """(statistics,) whether a single set shows the variance between sets, which it does not for rare events."""
    return np.median(null.residuals**2, axis=0) > TYPICAL * null.residuals.var(0, ddof=1)
