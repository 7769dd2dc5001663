"""Tests whether a complete camera would leave residuals as large, in one statistic or along some effect's signature."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from visaug.diagnosis.candidates.signatures import Signatures
from visaug.diagnosis.fitting.law import Metric, each_half
from visaug.diagnosis.fitting.robust import standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.state import State
from visaug.statistics.tail import is_decided, tail_factor

SOMEWHERE = 3.0  # times as unlikely must one large residual be as a match, to count as much: what no effect matches is seldom faint


@dataclass(frozen=True)
class Half:
    """Covariance of the residuals from half of the simulated sets, and residuals whitened by it.

    Attributes:
        residual: (statistics used,) of the measurement.
        others: (R / 2, statistics used) of the sets of the other half.
    """

    metric: Metric
    residual: np.ndarray
    others: np.ndarray


@dataclass(frozen=True)
class Chance:
    """The largest match of the residuals of all frames with any signature, and the same for simulated sets.

    Matches use the covariance of the simulated sets, since faint effects shift many correlated statistics. To avoid testing
    sets with their own covariance, each half of the sets is whitened by the covariance of the other half, and the measurement
    by both.

    A covariance of many statistics from few sets is too small in some directions and too large in others. A match is
    therefore standardised by the root mean square of all sets and the measurement in its direction.

    Attributes:
        halves: of the simulated sets.
        match, matches: the largest match of the measurement, and (R,) of simulated sets.
        largest, largests: the largest standardised residual of the measurement, and (R,) of these sets.
    """

    halves: Sequence[Half]
    match: float
    matches: np.ndarray
    largest: float
    largests: np.ndarray

    @property
    def p_value(self) -> float:
        """Probability, for a complete camera, of a residual or a match at least as unlikely.

        The smaller of both p-values is compared with the smaller of both of every simulated set.
        """
        return float(np.mean(self._least <= self._least[-1]))

    @property
    def is_decided(self) -> bool:
        """Whether more simulated sets would hardly change the verdict, see `visaug.statistics.tail.is_decided`."""
        *others, own = -np.log(np.maximum(self._least, 1e-300))
        return is_decided(own, np.array(others))

    @cached_property
    def _least(self) -> np.ndarray:
        """(R + 1,) the smaller p-value of each simulated set and, last, of the measurement."""
        somewhere = SOMEWHERE * _ranks(self.largest, self.largests)
        return np.minimum(_ranks(self.match, self.matches), somewhere)


def chance(lab: Laboratory, signed: Signatures, state: State) -> Chance:
    """For the mean signatures of all effects that are not accepted yet, without tolerance of their forms."""
    reference = state.fitted.reference
    null = reference.whole_null
    judged = [
        Half(m, m.white(state.fitted.whole_residual), others)
        for m, _, others in each_half(null, state.whole.allowance)
    ]
    chosen = [i for i, trial in enumerate(signed.trials) if trial.effect not in state.accepted]
    shapes = lab.whole_of(signed.values[chosen])
    seen = np.sqrt((standardised(shapes, null.scale) ** 2).sum(1)) > 0.5
    largest = float(np.abs(state.whole.z).max())
    return Chance(judged, *_matches(judged, shapes[seen]), largest, reference.largest)


def _ranks(value: float, null: np.ndarray) -> np.ndarray:
    """Tail probabilities of each value of the null and, last, of the measured one, within all of them together.

    Beyond the largest null value the tail is extrapolated: a hundred sets resolve no probability below 0.01 by counting.
    """
    everything = np.append(null, value)
    order = np.sort(everything)
    ranks = (len(order) - np.searchsorted(order, everything)) / len(order)
    ranks[-1] *= tail_factor(value, null)
    return ranks


def _matches(halves: Sequence[Half], shapes: np.ndarray) -> tuple[float, np.ndarray]:
    """The largest match of the measurement with a signature, and (R,) of the simulated sets, in standard deviations; at least 0."""
    count = sum(len(half.others) for half in halves)
    measured, simulated = np.zeros(len(shapes)), np.zeros((count, len(shapes)))
    for place, half in enumerate(halves):
        white = half.metric.white(shapes)
        length = np.sqrt((white**2).sum(1, keepdims=True))
        ways = np.divide(white, length, out=np.zeros_like(white), where=length > 0)
        measured += ways @ half.residual / len(halves)
        simulated[1 - place :: 2] = half.others @ ways.T
    spread = np.sqrt((measured**2 + (simulated**2).sum(0)) / (count + 1))
    matches = standardised(
        np.vstack([simulated, measured]), np.broadcast_to(spread, (count + 1, len(spread)))
    )
    best = matches.max(1, initial=0.0)
    return float(best[-1]), best[:-1]
