"""Statistics of one use of the frames, and what an effect changes in them: their means and their standard deviations."""

from dataclasses import dataclass

import numpy as np

from visaug.diagnosis.fitting.reference import CERTAIN, Null
from visaug.diagnosis.fitting.robust import drawn_to_zero, standardised


@dataclass(frozen=True)
class Use:
    """Statistics of one use of the frames (discovery, hold-out, all).

    Attributes:
        residual: measured minus modelled.
        sets: (R, statistics) of simulated sets of the camera.
        null: residuals of these sets after a refit.
        allowance: residual that may stay because accepted effects do not have exactly the catalogue's forms.
    """

    residual: np.ndarray
    sets: np.ndarray
    null: Null
    allowance: np.ndarray

    @property
    def scale(self) -> np.ndarray:
        """(statistics,) standard deviations with the tolerance; 0 for a statistic that is constant."""
        return np.where(self.null.scale > 0, np.hypot(self.null.scale, self.allowance), 0.0)

    @property
    def z(self) -> np.ndarray:
        return standardised(self.residual, self.scale)


def shifts(before: Use, after: Use) -> np.ndarray:
    """(statistics,) change of the model's mean by the last effect, shrunk to 0 where it is within the noise of the simulated sets.

    Sets of two cameras share their random numbers, so that the differences of pairs tell a change better than those of means.
    """
    count = min(len(before.sets), len(after.sets))
    pairs = after.sets[:count] - before.sets[:count]
    paired = pairs.var(0, ddof=1) / count
    apart = sum(use.sets.var(0, ddof=1) / len(use.sets) for use in (before, after))
    further_before, further_after = (use.sets.mean(0) - use.sets[:count].mean(0) for use in (before, after))
    control = np.where(paired < apart, further_before - further_after, 0.0)
    return drawn_to_zero(before.residual - after.residual + control, np.minimum(paired, apart))


def scales(before: Use, after: Use) -> tuple[np.ndarray, np.ndarray]:
    """(statistics,) standard deviations without and with an effect; one for both where they differ by less than their noise.

    R sets tell a standard deviation to 1 / sqrt(2 R), and a thousand such errors would add up to a likelihood of their own. Only
    sets that share their random numbers are compared: a rare event that is in none of the sets without the effect may be in
    further ones with it, and is then not caused by it.
    """
    counts = np.array([len(use.sets) for use in (before, after)])
    pair = np.array([use.null.scale for use in (before, after)])
    both = np.where(pair.min(0) > 0, np.sqrt(counts @ pair**2 / counts.sum()), 0.0)
    shared = counts.min()
    first, second = (use.null.scale_of(shared) for use in (before, after))
    ratio = np.divide(second, first, out=np.ones_like(both), where=both > 0)
    alike = np.abs(np.log(np.where(ratio > 0, ratio, 1.0))) < CERTAIN * np.sqrt(1 / shared)
    without, with_it = np.where(alike, both, pair)
    return without, with_it
