"""How well the effects' signatures match by chance what a camera leaves that lacks nothing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.diagnosis.fit import Fitted, p_value, standardised
from visaug.diagnosis.rank import Metric, Signatures, law


@dataclass(frozen=True)
class Chance:
    """How well the best signature matches what is left, and how well the best of them matches by chance.

    A match is judged in the metric of the simulated sets' covariance, or faint effects that move many correlated statistics
    would not be seen. That covariance would fit the very sets that chance is judged by, so each half of them is judged by the
    covariance of the other half, and the measurement by both.

    Attributes:
        metrics: of the two halves.
        residual: what the measurement leaves, white in each of them.
        gain: half the square of the best match of the measurement.
        by_chance: (R,) the same for simulated sets of the camera itself.
    """

    metrics: Sequence[Metric]
    residual: Sequence[np.ndarray]
    gain: float
    by_chance: np.ndarray

    @property
    def p_value(self) -> float:
        """That a camera which lacks nothing is matched as well by some signature."""
        return p_value(self.gain, self.by_chance)

    def p_value_of(self, shape: np.ndarray) -> float:
        """The same for one way (statistics,) in which the measurement differs, against the best of all signatures by chance."""
        gains = [
            float(_matches(m.white(shape)[None], r[None])[0])
            for m, r in zip(self.metrics, self.residual, strict=True)
        ]
        return p_value(float(np.mean(gains)), self.by_chance)


def chance(signed: Signatures, fitted: Fitted, allowance: np.ndarray, accepted: Sequence[str]) -> Chance:
    """Of the mean signatures of all effects that are not accepted yet, their form as it is."""
    reference = fitted.reference
    null = reference.null
    halves = (null[::2], null[1::2])
    metrics = [law(reference, allowance, null=half) for half in halves]
    chosen = [i for i, trial in enumerate(signed.trials) if trial.effect not in accepted]
    seen = np.sqrt((standardised(signed.values[chosen], reference.null_scale) ** 2).sum(1)) > 0.5
    shapes = signed.values[chosen][seen]
    best, residuals = [], []
    by_chance = np.zeros(len(null))
    for place, m in enumerate(metrics):
        directions = m.white(shapes)
        residuals.append(m.white(fitted.residual))
        best.append(_matches(directions, residuals[-1][None])[0])
        by_chance[1 - place :: 2] = _matches(directions, m.white(halves[1 - place]))
    return Chance(metrics, residuals, float(np.mean(best)), by_chance)


def _matches(shapes: np.ndarray, residuals: np.ndarray) -> np.ndarray:
    """Half the square of each residual's best match with a shape, (n,), all of them white."""
    length = np.sqrt((shapes**2).sum(1))
    directions = shapes[length > 0] / length[length > 0, None]
    return 0.5 * np.max(np.maximum(residuals @ directions.T, 0) ** 2, axis=1, initial=0.0)
