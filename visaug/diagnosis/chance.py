"""Whether a camera that lacks nothing would leave as much: somewhere, or along some effect's signature."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.comparison import Laboratory
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.law import Metric, each_half
from visaug.diagnosis.robust import p_value, standardised
from visaug.diagnosis.signatures import Signatures

SOMEWHERE = 3.0  # times as unlikely must one large residual be as a match, to count as much: what no effect matches is seldom faint

TAIL = 0.9  # quantile from which the largest of the null count as its tail


@dataclass(frozen=True)
class Half:
    """A covariance of the residuals, from half of the simulated sets, and what is judged by it.

    Attributes:
        residual: (statistics used,) what the measurement leaves, white in it.
        others: (R / 2, statistics used) what the sets of the other half leave, white in it.
    """

    metric: Metric
    residual: np.ndarray
    others: np.ndarray


@dataclass(frozen=True)
class Chance:
    """How well the best signature matches what is left in all frames, and how well the best of them matches by chance.

    A match is judged in the metric of the simulated sets' covariance, or faint effects that move many correlated statistics
    would not be seen. That covariance would fit the very sets that chance is judged by, so each half of them is judged by the
    covariance of the other half, and the measurement by both.

    A covariance of many statistics from few sets is too small along some ways and too large along others, so a match counts in
    standard deviations of what all sets and the measurement, alike, show along that way. Else the one signature along which sets
    scatter most would set the bar for all.

    Attributes:
        halves: of the simulated sets.
        match, matches: of the measurement with its best signature, and (R,) of simulated sets with theirs.
        largest, largests: the largest standardised residual of the measurement, and (R,) of these sets.
    """

    halves: Sequence[Half]
    match: float
    matches: np.ndarray
    largest: float
    largests: np.ndarray

    @property
    def p_value(self) -> float:
        """That a camera which lacks nothing leaves as much somewhere, or is matched as well by some signature.

        The less likely of the two counts, held against the less likely of the two of every simulated set.
        """
        somewhere = SOMEWHERE * _ranks(self.largest, self.largests)
        least = np.minimum(_ranks(self.match, self.matches), somewhere)
        return float(np.mean(least <= least[-1]))

    def p_value_of(self, shape: np.ndarray) -> float:
        """Of one way (statistics of all frames,) in which the measurement differs, against the best signature by chance."""
        match, _ = _matches(self.halves, shape[None])
        return p_value(match, self.matches)


def chance(lab: Laboratory, signed: Signatures, state: State) -> Chance:
    """Of the mean signatures of all effects that are not accepted yet, their form as it is."""
    reference = state.fitted.reference
    null = reference.whole_null
    judged = [
        Half(m, m.white(state.fitted.whole_residual), m.white(others))
        for m, others in each_half(null, state.whole_allowance)
    ]
    chosen = [i for i, trial in enumerate(signed.trials) if trial.effect not in state.accepted]
    shapes = lab.whole_of(signed.values[chosen])
    seen = np.sqrt((standardised(shapes, null.scale) ** 2).sum(1)) > 0.5
    largest = float(np.abs(state.whole_z).max())
    return Chance(judged, *_matches(judged, shapes[seen]), largest, reference.largest)


def _ranks(value: float, null: np.ndarray) -> np.ndarray:
    """The share that is as large, of each of the null and last of the value, all of them taken together.

    Beyond the largest of the null the value's share falls on as an exponential tail does, whose length is the mean excess over
    the ninth tenth (Pickands 1975): from a hundred sets no share below a hundredth could be counted.
    """
    everything = np.append(null, value)
    order = np.sort(everything)
    ranks = (len(order) - np.searchsorted(order, everything)) / len(order)
    beyond = value - float(null.max())
    if beyond > 0:
        start = float(np.quantile(null, TAIL))
        excess = null[null > start] - start
        ranks[-1] *= np.exp(-beyond / max(float(excess.mean()) if len(excess) else 0.0, 1e-9))
    return ranks


def _matches(halves: Sequence[Half], shapes: np.ndarray) -> tuple[float, np.ndarray]:
    """The best match of the measurement with a shape, and (R,) of the simulated sets, in standard deviations; at least 0."""
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
