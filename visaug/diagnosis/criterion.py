"""The criterion by which an effect is accepted: its posterior odds, and the evidence that it would have if it were the cause.

Each statistic of the discovery and of the hold-out frames has, under a model M with residual r, the density

    p(r | M) = (1 - e) N(r; 0, s_M^2 + t^2) + e / (2 (1 + log R) max(|r|, 3 s)),

a normal distribution with the standard deviation s_M of the model's own refitted simulated sets and the model discrepancy t of
the accepted effects' forms, and a log-uniform distribution for what effects outside the model cause. The evidence of an effect is

    E(r) = sum of log p(r_1 | M_1) - log p(r_0 | M_0)

with r_0 and r_1 the residuals without and with it. The sum takes statistics as independent, so E is treated as one statistic
whose law is simulated: Student's t with the mean and the variance of E in sets with the effect, and in sets without it (Wood,
Nature 466 (2010) 1102: synthetic likelihood). An effect is accepted if the posterior odds that follow exceed those of a wrong
effect, and if E reaches the evidence of sets that are simulated with the effect (Cox 1961: tests of separate families).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from visaug.diagnosis.state import State
from visaug.fitting.law import FORM, log_density
from visaug.fitting.uses import Use, scales, shifts

ODDS = 3.0  # least log posterior odds of an accepted effect: at most one in twenty is wrong
SHARE = 0.55  # least evidence of an accepted effect, relative to the median of its own simulated sets,
RARE = 0.1  # unless more than this share of these sets has less


@dataclass(frozen=True)
class Evidence:
    """Evidence of one effect.

    Attributes:
        found, confirmed: log likelihood ratio on the discovery and on the hold-out frames.
        cost: log likelihood that the effect's free parameters gain by fitting noise, and that one of many effects does.
        of_sets: (R,) log likelihood ratio, on all statistics, of sets simulated with the effect,
        of_null: and of sets simulated without it.
    """

    found: float
    confirmed: float
    cost: float
    of_sets: np.ndarray
    of_null: np.ndarray

    @property
    def score(self) -> float:
        """Log likelihood ratio less the cost of the parameters (Schwarz 1978): by it candidates are compared."""
        return self.found + self.confirmed - self.cost

    @property
    def odds(self) -> float:
        """Log posterior odds of the effect against the camera without it."""
        return log_odds(self.found + self.confirmed, self.of_sets, self.of_null) - self.cost

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


def evidence(before: State, after: State, parameters: int, effects: int = 1) -> Evidence:
    """The evidence of the last effect of a state.

    Args:
        before, after: the states without and with it.
        parameters: number of its free parameters. Each costs half the logarithm of the number of statistics that determine it
            (G. Schwarz, Ann. Stat. 6 (1978) 461).
        effects: number of effects that are as probable before, all together as probable as none.
    """
    ratios = _ratios(before, after)
    found, confirmed = (float(ratio(ratio.before.residual)) for ratio in ratios)
    count = sum(np.count_nonzero(np.abs(ratio.moves) > ratio.before.null.scale) for ratio in ratios)
    cost = parameters * max(0.5 * np.log(max(count, 1)), 1.0) + np.log(effects)
    of_sets = sum(ratio(ratio.with_effect) for ratio in ratios)
    of_null = sum(ratio(ratio.before.null.residuals) for ratio in ratios)
    return Evidence(found, confirmed, float(cost), np.asarray(of_sets), np.asarray(of_null))


def between(before: State, one: State, other: State) -> float:
    """Log odds of one effect against another, of equal prior probability, from the ratio of their likelihoods.

    Args:
        before: the state without either; `one` and `other` have one of them more.
    """
    pairs = tuple(zip(_ratios(before, one), _ratios(before, other), strict=True))
    value = sum(float(a(a.before.residual) - b(a.before.residual)) for a, b in pairs)
    of_one = sum(a(a.with_effect) - b(a.with_effect) for a, b in pairs)
    of_other = sum(a(b.with_effect) - b(b.with_effect) for a, b in pairs)
    return log_odds(value, np.asarray(of_one), np.asarray(of_other))


def log_odds(value: float, of_one: np.ndarray, of_other: np.ndarray) -> float:
    """Log odds of two models from a statistic of the measurement and of (R,) simulated sets of each (Wood 2010; Cox 1961).

    A ratio of likelihoods takes statistics as independent, and a pattern that is fixed by chance shows in every frame. The
    distributions of the ratio hold these correlations. They are normal; few sets tell their mean and variance as Student's t.
    """
    return _log_density(value, of_one) - _log_density(value, of_other)


def _log_density(value: float, of_sets: np.ndarray) -> float:
    count = len(of_sets)
    scale = of_sets.std(ddof=1) * np.sqrt(1 + 1 / count)
    return float(stats.t.logpdf(value, count - 1, of_sets.mean(), max(scale, 1e-9)))


@dataclass(frozen=True)
class _Ratio:
    """Log likelihood ratio of an effect on one use of the frames, of residuals (..., statistics) without the effect."""

    before: Use
    after: Use

    @cached_property
    def moves(self) -> np.ndarray:
        return shifts(self.before, self.after)

    @property
    def with_effect(self) -> np.ndarray:
        """(R, statistics) residuals, without the effect, of sets that are simulated with it."""
        return self.after.null.residuals + self.moves

    @cached_property
    def _used(self) -> np.ndarray:
        return (self.before.null.scale > 0) & (self.after.null.scale > 0)

    @cached_property
    def _scales(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the statistics used: standard deviations with and without the effect, and the unit of outliers."""
        unit, own = (scale[self._used] for scale in scales(self.before, self.after))
        allowed = self.before.allowance[self._used]
        with_it = np.sqrt(own**2 + allowed**2 + (FORM * self.moves[self._used]) ** 2)
        return with_it, np.hypot(unit, allowed), unit

    def __call__(self, residual: np.ndarray) -> np.ndarray:
        left, (with_it, without, unit) = residual[..., self._used], self._scales
        own = log_density(left - self.moves[self._used], with_it, unit)
        return (own - log_density(left, without, unit)).sum(-1)


def _ratios(before: State, after: State) -> tuple[_Ratio, _Ratio]:
    """On the discovery and on the hold-out frames."""
    return _Ratio(before.find, after.find), _Ratio(before.confirm, after.confirm)
