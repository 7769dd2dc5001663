"""Whether a camera that lacks nothing would leave as much: somewhere, or along some effect's signature."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.comparison import Laboratory
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.fit import p_value, standardised
from visaug.diagnosis.rank import Metric, Signatures, law


@dataclass(frozen=True)
class Chance:
    """How well the best signature matches what is left in all frames, and how well the best of them matches by chance.

    A match is judged in the metric of the simulated sets' covariance, or faint effects that move many correlated statistics
    would not be seen. That covariance would fit the very sets that chance is judged by, so each half of them is judged by the
    covariance of the other half, and the measurement by both.

    Attributes:
        metrics: of the two halves.
        residual: what the measurement leaves, white in each of them.
        gain, gains: half the square of the best match of the measurement, and (R,) of simulated sets of the camera itself.
        largest, largests: the largest standardised residual of the measurement, and (R,) of these sets.
    """

    metrics: Sequence[Metric]
    residual: Sequence[np.ndarray]
    gain: float
    gains: np.ndarray
    largest: float
    largests: np.ndarray

    @property
    def p_value(self) -> float:
        """That a camera which lacks nothing leaves as much somewhere, or is matched as well by some signature.

        The less likely of the two counts, held against the less likely of the two of every simulated set.
        """
        least = np.minimum(_ranks(self.gain, self.gains), _ranks(self.largest, self.largests))
        return float(np.mean(least <= least[-1]))

    def p_value_of(self, shape: np.ndarray) -> float:
        """Of one way (statistics of all frames,) in which the measurement differs, against the best signature by chance."""
        gains = [
            float(_matches(m.white(shape)[None], r[None])[0])
            for m, r in zip(self.metrics, self.residual, strict=True)
        ]
        return p_value(float(np.mean(gains)), self.gains)


def chance(lab: Laboratory, signed: Signatures, state: State) -> Chance:
    """Of the mean signatures of all effects that are not accepted yet, their form as it is."""
    reference = state.fitted.reference
    null = reference.whole_null
    halves = (null.residuals[::2], null.residuals[1::2])
    metrics = [law(null, state.whole_allowance, sets=half) for half in halves]
    chosen = [i for i, trial in enumerate(signed.trials) if trial.effect not in state.accepted]
    shapes = lab.whole_of(signed.values[chosen])
    seen = np.sqrt((standardised(shapes, null.scale) ** 2).sum(1)) > 0.5
    best, residuals = [], []
    gains = np.zeros(len(null.residuals))
    for place, m in enumerate(metrics):
        directions = m.white(shapes[seen])
        residuals.append(m.white(state.fitted.whole_residual))
        best.append(_matches(directions, residuals[-1][None])[0])
        gains[1 - place :: 2] = _matches(directions, m.white(halves[1 - place]))
    largest = float(np.abs(state.whole_z).max())
    return Chance(metrics, residuals, float(np.mean(best)), gains, largest, reference.largest)


def _ranks(value: float, null: np.ndarray) -> np.ndarray:
    """The share that is as large, of each of the null and last of the value, all of them taken together."""
    everything = np.append(null, value)
    order = np.sort(everything)
    return (len(order) - np.searchsorted(order, everything)) / len(order)


def _matches(shapes: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Half the square of each residual's best match with a shape, (n,), all of them white."""
    length = np.sqrt((shapes**2).sum(1))
    directions = shapes[length > 0] / length[length > 0, None]
    return 0.5 * np.max(np.maximum(residuals @ directions.T, 0) ** 2, axis=1, initial=0.0)
