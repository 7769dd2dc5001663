"""The criterion by which an effect is accepted: its posterior odds, and the evidence that it would have if it were the cause.

Each statistic of the discovery and of the hold-out frames has, under a model M with residual r, the density

    p(r | M) = (1 - e) N(r; 0, s_M^2 + t^2) + e / (2 (1 + log R) max(|r|, 3 s)),

a normal distribution with the standard deviation s_M of the model's own refitted simulated sets and the model discrepancy t of
the accepted effects' forms, and a log-uniform distribution for what effects outside the model cause. The evidence of an effect is

    E(r) = sum of log p(r_1 | M_1) - log p(r_0 | M_0)

with r_0 and r_1 the residuals without and with it. It is accepted if the posterior odds exceed those of a wrong effect, and if E
reaches the evidence of sets that are simulated with the effect (Cox 1961: tests of separate families of hypotheses).
"""

from dataclasses import dataclass

import numpy as np

from visaug.diagnosis.law import FORM, log_density
from visaug.diagnosis.state import State
from visaug.diagnosis.uses import Use, scales, shifts

ODDS = 3.0  # least log posterior odds of an accepted effect: one in twenty is wrong
SHARE = 0.55  # least evidence of an accepted effect, relative to the median of its own simulated sets,
RARE = 0.1  # unless more than this share of these sets has less


@dataclass(frozen=True)
class Evidence:
    """Evidence of one effect.

    Attributes:
        found, confirmed: log likelihood ratio on the discovery and on the hold-out frames.
        cost: log likelihood that the effect's free parameters gain by fitting noise.
        of_sets: (R,) log likelihood ratio, on all statistics, of sets simulated with the effect.
    """

    found: float
    confirmed: float
    cost: float
    of_sets: np.ndarray

    @property
    def odds(self) -> float:
        """Log posterior odds of the effect against the camera without it."""
        return self.found + self.confirmed - self.cost

    @property
    def share(self) -> float:
        """Log likelihood ratio relative to the median of simulated sets with the effect; 1 is expected of the true effect."""
        expected = float(np.median(self.of_sets))
        return (self.found + self.confirmed) / expected if expected > 0 else 0.0

    @property
    def is_reached(self) -> bool:
        """Whether the effect explains as much as it would if it were the cause."""
        reached = float(np.mean(self.of_sets <= self.found + self.confirmed))
        return self.share >= SHARE or reached > RARE

    @property
    def accepts(self) -> bool:
        return self.odds > ODDS and self.is_reached


def evidence(before: State, after: State, parameters: int) -> Evidence:
    """The evidence of the last effect of a state.

    Args:
        before, after: the states without and with it.
        parameters: number of its free parameters. Each costs half the logarithm of the number of statistics that determine it
            (G. Schwarz, Ann. Stat. 6 (1978) 461).
    """
    found, of_found, count = _ratio(before.find, after.find)
    confirmed, of_confirmed, more = _ratio(before.confirm, after.confirm)
    cost = parameters * max(0.5 * np.log(max(count + more, 1)), 1.0)
    return Evidence(found, confirmed, float(cost), of_found + of_confirmed)


def _ratio(before: Use, after: Use) -> tuple[float, np.ndarray, int]:
    """Log likelihood ratio of the measurement and (R,) of sets with the effect, and how many statistics it shifts beyond noise."""
    used = (before.null.scale > 0) & (after.null.scale > 0)
    every = shifts(before, after)
    shifted = int(np.count_nonzero(np.abs(every) > before.null.scale))
    moves = every[used]
    unit, own = (scale[used] for scale in scales(before, after))
    plain = np.hypot(unit, before.allowance[used])
    own = np.sqrt(own**2 + before.allowance[used] ** 2 + (FORM * moves) ** 2)

    def ratio(left: np.ndarray) -> np.ndarray:
        """Of residuals (..., used) without the effect."""
        return (log_density(left - moves, own, unit) - log_density(left, plain, unit)).sum(-1)

    of_sets = ratio(after.null.residuals[:, used] + moves)
    return float(ratio(before.residual[used])), of_sets, shifted
