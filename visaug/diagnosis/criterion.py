"""The criterion by which an effect is accepted: its posterior odds, and the evidence that it would have if it were the cause.

Each statistic of the discovery and of the hold-out frames has, under a model M with residual r, the density

    p(r | M) = (1 - e) N(r; 0, s_M^2 + t^2) + e / (2 (1 + log R) max(|r|, 3 s)),

a normal distribution with the standard deviation s_M of the model's own refitted simulated sets and the model discrepancy t of
the accepted effects, and a log-uniform distribution for what effects outside the model cause; s is the standard deviation
without the effect, e and R are `OUTLIERS` and `RANGE` of `visaug.diagnosis.fitting.law`. A statistic that the effect shifts far in
few specimens has a mixture of two normal distributions with it (`visaug.diagnosis.fitting.law.rare`); where all sets with the
effect give one value, s_M is 0 and t remains. The evidence of an effect is

    L(r) = sum of log p(r_1 | M_1) - log p(r_0 | M_0)

with r_0 and r_1 the residuals without and with it. The sum takes statistics as independent, so L is treated as one statistic
whose law is simulated, with the effect and without it (S. N. Wood, Nature 466 (2010) 1102: synthetic likelihood). Both models
are fitted to the sets with it, as to the measurement. An effect is accepted if the posterior odds that follow are large, and if
it explains as much of the measurement as of sets that are simulated with it (D. R. Cox, Proc. 4th Berkeley Symp. 1 (1961) 105:
tests of separate families of hypotheses). For that second test statistics that vary together count as one (C. Varin, N. Reid
and D. Firth, Stat. Sin. 21 (2011) 5: weights of a composite likelihood): a drift moves a dozen statistics of a frame by one random
number, and a frame that drew little of it would else count a dozen times.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import stats

from visaug.diagnosis.fitting.law import FORM, Rare, log_density, rare
from visaug.diagnosis.fitting.reference import CERTAIN
from visaug.diagnosis.fitting.robust import adjust, standardised
from visaug.diagnosis.fitting.uses import Use, scales, shifts
from visaug.diagnosis.state import State

ODDS = 3.0  # least log posterior odds of an accepted effect against no effect: one in twenty
SHARE = 0.55  # least evidence of an accepted effect, relative to the median of its own simulated sets,
RARE = 0.1  # unless more than this share of these sets has less
NORMAL = 0.05  # skewness below which a distribution is taken as normal


@dataclass(frozen=True)
class Evidence:
    """Evidence of one effect.

    Attributes:
        found, confirmed: log likelihood ratio on the discovery and on the hold-out frames.
        cost: half the logarithm of the sample size for each parameter, plus the logarithm of the number of effects.
        of_sets: (R,) log likelihood ratio, on all statistics, of sets simulated with the effect,
        of_null: and of sets simulated without it.
        joint: log likelihood ratio in which statistics that vary together count as one,
        joint_of_sets: (R,) and of sets simulated with the effect.
    """

    found: float
    confirmed: float
    cost: float
    of_sets: np.ndarray
    of_null: np.ndarray
    joint: float
    joint_of_sets: np.ndarray

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
        """The joint ratio relative to the median of simulated sets with the effect; 1 is expected of the true effect."""
        return _share(self.joint, self.joint_of_sets)

    @property
    def is_reached(self) -> bool:
        """Whether the effect explains as much as it would if it were the cause."""
        return _reaches(self.joint, self.joint_of_sets)

    @property
    def accepts(self) -> bool:
        return self.odds > ODDS and self.is_reached

    @property
    def is_decided(self) -> bool:
        """Whether each half of the simulated sets alone decides alike."""
        of_sets = ("of_sets", "of_null", "joint_of_sets")
        halves = (replace(self, **{name: getattr(self, name)[k::2] for name in of_sets}) for k in (0, 1))
        return len({one.accepts for one in (self, *halves)}) == 1


def _share(ratio: float, of_sets: np.ndarray) -> float:
    expected = float(np.median(of_sets))
    return ratio / expected if expected > 0 else 0.0


def _reaches(ratio: float, of_sets: np.ndarray) -> bool:
    """Whether a log likelihood ratio is about as large as in sets that are simulated with the effect."""
    return _share(ratio, of_sets) >= SHARE or float(np.mean(of_sets <= ratio)) > RARE


def evidence(before: State, after: State, parameters: int, effects: int = 1) -> Evidence:
    """The evidence of the last effect of a state.

    Args:
        before, after: the states without and with it.
        parameters: number of its free parameters. Each costs half the logarithm of the number of statistics that determine it
            (G. Schwarz, Ann. Stat. 6 (1978) 461), as far as the frames and not its prior determine it.
        effects: K. The prior probability that no effect is missing is 1/2, that of each of K effects 1/(2K).
    """
    ratios = _ratios(before, after)
    measured = [ratio.of_measurement for ratio in ratios]
    found, confirmed = (float(each.sum()) for each in measured)
    count = sum(np.count_nonzero(np.abs(ratio.moves) > ratio.before.null.scale) for ratio in ratios)
    free = parameters - float((1 - after.fitted.reference.determined[_own(before, after)]).sum())
    cost = free * max(0.5 * np.log(max(count, 1)), 1.0) + np.log(effects)
    left = _refitted(before, [ratio.with_effect for ratio in ratios])
    of_sets = [ratio.of(own, ratio.after.null.residuals) for ratio, own in zip(ratios, left, strict=True)]
    return Evidence(
        found,
        confirmed,
        float(cost),
        np.asarray(sum(each.sum(-1) for each in of_sets)),
        _without_effect(before, after, ratios),
        float(sum(each @ ratio.weights for ratio, each in zip(ratios, measured, strict=True))),
        np.asarray(sum(each @ ratio.weights for ratio, each in zip(ratios, of_sets, strict=True))),
    )


def _own(before: State, after: State) -> list[int]:
    """Places of the coordinates that a state has beyond an earlier one."""
    earlier = {c.path for c in before.fitted.reference.coordinates}
    return [k for k, c in enumerate(after.fitted.reference.coordinates) if c.path not in earlier]


def _without_effect(before: State, after: State, ratios: "tuple[_Ratio, _Ratio]") -> np.ndarray:
    """(R,) log likelihood ratio of sets without the effect, to which its parameters are fitted as to the measurement.

    The fit is linear, from a strength of 0, at which standard deviations are those without the effect, along its own derivatives.
    An effect whose strength is not fitted, since it is an integer or is estimated from variance (`visaug.diagnosis.scatter`),
    stays as it is.
    """
    fitted = after.fitted.reference
    is_scatter = len(after.scatters) > len(before.scatters)
    if is_scatter or not _own(before, after):
        null = [ratio.before.null.residuals for ratio in ratios]
        return _summed(ratios, null, [left - ratio.moves for ratio, left in zip(ratios, null, strict=True)])
    steps = adjust(before.find.null.residuals, fitted.slopes, before.fitted.reference.scale, fitted.priors)
    return np.asarray(sum(ratio.gained(steps) for ratio in ratios))


def between(before: State, one: State, other: State) -> float:
    """Log odds of one effect against another, of equal prior probability, from the ratio of their likelihoods.

    Odds for an effect are at most the ratio itself where that does not reach the ratio of sets with this effect: causes outside
    both have moved it, and a ratio that neither effect predicts would speak for the one whose sets differ more.

    Args:
        before: the state without either; `one` and `other` have one of them more.
    """
    of_one, of_other = _ratios(before, one), _ratios(before, other)
    value = sum(
        float(a.of_measurement.sum() - b.of_measurement.sum()) for a, b in zip(of_one, of_other, strict=True)
    )
    in_one = _against(before, of_one, other, of_other)
    in_other = -_against(before, of_other, one, of_one)
    odds = log_odds(value, in_one, in_other)
    if odds > 0 and not _reaches(value, in_one):
        return min(odds, value)
    if odds < 0 and not _reaches(-value, -in_other):
        return max(odds, value)
    return odds


def _against(
    before: State, own: "Sequence[_Ratio]", rival: State, of_rival: "Sequence[_Ratio]"
) -> np.ndarray:
    """(R,) log likelihood of an effect less that of a rival, of sets that are simulated with the effect."""
    sets = [ratio.with_effect for ratio in own]
    without = _refitted(before, sets)
    by_rival = _refitted(rival, [part - ratio.moves for part, ratio in zip(sets, of_rival, strict=True)])
    return _summed(own, without, [ratio.after.null.residuals for ratio in own]) - _summed(
        of_rival, without, by_rival
    )


def _summed(
    ratios: "Sequence[_Ratio]", without: Sequence[np.ndarray], own: Sequence[np.ndarray]
) -> np.ndarray:
    """(R,) log likelihood ratio of residuals (R, statistics) of both uses of the frames, without the effect and with it."""
    return np.asarray(sum(ratio.of(*pair).sum(-1) for ratio, *pair in zip(ratios, without, own, strict=True)))


def _refitted(state: State, residuals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Residuals (R, statistics) of both uses of the frames after a linear fit of the state's parameters to the first."""
    fitted, uses = state.fitted.reference, (state.find, state.confirm)
    steps = adjust(residuals[0], fitted.slopes, fitted.scale, fitted.priors)
    return [left - steps @ use.null.slopes.T for left, use in zip(residuals, uses, strict=True)]


def log_odds(value: float, of_one: np.ndarray, of_other: np.ndarray) -> float:
    """Log odds of two models from a statistic of the measurement and of (R,) simulated sets of each.

    The log likelihood ratio takes statistics as independent. A random fixed pattern is the same in every frame, so its statistics
    are correlated. The simulated distributions of the ratio contain these correlations.

    Beyond the mean of either a value counts as the mean: more evidence for a model is none against it. 0 where the mean of `one` is
    not the larger.
    """
    if of_one.mean() <= of_other.mean():
        return 0.0
    within = float(np.clip(value, of_other.mean(), of_one.mean()))
    return _log_density(within, of_one) - _log_density(within, of_other)


def _log_density(value: float, of_sets: np.ndarray) -> float:
    """Of a gamma distribution with the mean, the variance and the skewness of the sets (Pearson's type III).

    A log likelihood ratio is a weighted sum of chi-squared variables (J. T. Kent, Biometrika 69 (1982) 19). A tail that is
    shorter than normal is taken as normal.
    """
    mean, spread = of_sets.mean(), max(of_sets.std(ddof=1), 1e-9)
    side = 1.0 if value >= mean else -1.0
    beyond = side * (value - mean) / spread
    skewness = side * float(np.mean(((of_sets - mean) / spread) ** 3))
    skewness = min(skewness, 8**0.5)  # that of chi-squared with one degree of freedom
    if skewness < NORMAL:
        return float(stats.norm.logpdf(beyond)) - np.log(spread)
    shape, scale = 4 / skewness**2, skewness / 2
    return float(stats.gamma.logpdf(beyond, shape, -2 / skewness, scale)) - np.log(spread)


@dataclass(frozen=True)
class _Ratio:
    """Log likelihood ratio of an effect on one use of the frames."""

    before: Use
    after: Use

    @cached_property
    def moves(self) -> np.ndarray:
        return shifts(self.before, self.after)

    @property
    def with_effect(self) -> np.ndarray:
        """(R, statistics) residuals, without the effect, of sets that are simulated with it."""
        return self.after.null.residuals + self.moves

    @property
    def of_measurement(self) -> np.ndarray:
        """(statistics used,) of the measurement."""
        return self.of(self.before.residual, self.before.residual - self.moves)

    @cached_property
    def weights(self) -> np.ndarray:
        """(statistics used,) 1 / (1 + sum of the squared correlations with others) among sets that are simulated with the effect.

        Of n statistics of a use that follow from one random number each has the weight 1 / n. Correlations within their noise are
        0.
        """
        sets = self.after.null.residuals[:, self._used]
        z = standardised(sets, np.broadcast_to(np.sqrt((sets**2).sum(0)), sets.shape))
        squares = (z.T @ z) ** 2
        np.fill_diagonal(squares, 0.0)
        return 1 / (1 + np.where(squares > CERTAIN**2 / len(sets), squares, 0.0).sum(0))

    @cached_property
    def _is_fixed(self) -> np.ndarray:
        """What the effect moves to a value that is the same in all sets: with lost bits no code has its lowest bit set."""
        plain = self.before.null.scale
        return (plain > 0) & (self.after.null.scale == 0) & (np.abs(self.moves) > plain)

    @cached_property
    def _used(self) -> np.ndarray:
        return ((self.before.null.scale > 0) & (self.after.null.scale > 0)) | self._is_fixed

    @cached_property
    def _spreads(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the statistics used: standard deviations without and with the effect, see `scales`."""
        plain, own = scales(self.before, self.after)
        return np.where(self._is_fixed, self.before.null.scale, plain)[self._used], own[self._used]

    @cached_property
    def _scales(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the statistics used: standard deviations with and without the effect, and the unit of outliers."""
        unit, own = self._spreads
        allowed = self.before.allowance[self._used]
        with_it = np.sqrt(own**2 + allowed**2 + (FORM * self.moves[self._used]) ** 2)
        return with_it, np.hypot(unit, allowed), unit

    def gained(self, steps: np.ndarray) -> np.ndarray:
        """(R,) log likelihood that sets without the effect gain by steps (R, coordinates) of the parameters with it."""
        residual = self.before.null.residuals
        left = residual - steps @ self.after.null.slopes.T
        _, scale, unit = self._scales
        new, old = (log_density(part[:, self._used], scale, unit) for part in (left, residual))
        return (new - old).sum(-1)

    @cached_property
    def _rare(self) -> Rare | None:
        """Of the statistics used, what the effect shifts in few specimens: their residuals are those with the effect."""
        plain, own = self._spreads
        sets = np.where(own > plain, self.with_effect[:, self._used], 0.0)
        count = min(len(use.null.residuals) for use in (self.before, self.after))
        changes = (self.with_effect[:count] - self.before.null.residuals[:count])[:, self._used]
        found = rare(sets, changes, plain, self.before.allowance[self._used])
        if found is None:
            return None
        return replace(found, middles=found.middles - self.moves[self._used][found.places])

    def of(self, without: np.ndarray, own: np.ndarray) -> np.ndarray:
        """(..., statistics used) of residuals (..., statistics) without the effect and with it."""
        with_it, plain, unit = self._scales
        return log_density(own[..., self._used], with_it, unit, self._rare) - log_density(
            without[..., self._used], plain, unit
        )


def _ratios(before: State, after: State) -> tuple[_Ratio, _Ratio]:
    """On the discovery and on the hold-out frames."""
    return _Ratio(before.find, after.find), _Ratio(before.confirm, after.confirm)
