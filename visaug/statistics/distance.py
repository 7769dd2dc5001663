"""The error: how far a model's frames are from the measured ones, between the camera file as given (1) and a twin (0).

D(A, B) is the mean over views of the mean over a view's statistics of (S_A - S_B)^2 / s^2, where s is the larger of the
statistic's standard deviations under the file as given and under the model in question: an effect brings a spread of its own.
D(measured, model) averages over simulated sets. F is the mean D between independent sets of the model, maps and drift drawn
anew. E = [D(measured, model) - F] / [D(measured, file as given) - F].

It is a distance, not a test: unlike a p-value it does not grow with the number of frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.statistics import Statistic


@dataclass(frozen=True)
class Error:
    """An error with its 95 % interval, which covers the noise of the measured frames and the camera's own maps."""

    value: float
    low: float
    high: float


def variance(sets: np.ndarray) -> np.ndarray:
    """Over simulated sets (R, statistics); exactly 0 for a statistic that differs by rounding alone."""
    spread = sets.var(0, ddof=1)
    return np.where(spread > (1e-9 * sets.mean(0)) ** 2, spread, 0.0)


def least_spread(scale: np.ndarray, least: np.ndarray) -> np.ndarray:
    """(statistics,) lower limits of the standard deviations from few sets; 0 for a statistic that is constant."""
    least_share = 0.3  # of the standard deviation of all sets: that of the others is not taken to be less
    return np.where(scale > 0, np.maximum(least_share * scale, least), 0.0)


def largest_of_each(deviations: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """(R,) the largest deviation of each simulated set in standard deviations of the other sets.

    A set that takes part in its own measure widens it: of a hundred sets, 4.5 standard deviations would count as 4.1, and a
    measured set, which takes no part, would exceed them too often.

    Args:
        deviations: (R, statistics) of each set from the mean of the others.
        floor: (statistics,) standard deviations below which none is taken; 0 for a statistic that never varies.
    """
    squares = deviations**2
    others = np.sqrt((squares.sum(0) - squares) / max(len(squares) - 2, 1))
    scale = np.where(floor > 0, np.maximum(others, floor), np.inf)
    return np.abs(deviations / scale).max(1)


def is_clear(error: Error | None) -> bool:
    """Whether the excess is significant: it must exceed its own noise."""
    return error is not None and error.high - error.low < 1


class Distance:
    """Errors of models of one measured set.

    Args:
        statistics: the measured statistics.
        measured: (statistics,) values.
        given: (R, statistics) of simulated sets of the camera file as given.
        least: (statistics,) smallest spread that is taken seriously.
    """

    def __init__(
        self, statistics: Sequence[Statistic], measured: np.ndarray, given: np.ndarray, least: np.ndarray
    ):
        self.views = np.array([statistic.view for statistic in statistics])
        self.measured, self.given, self.least = measured, given, least

    def error(
        self,
        sets: np.ndarray,
        residual: np.ndarray | None = None,
        follows: np.ndarray | None = None,
        beside: np.ndarray | None = None,
        asked: np.ndarray | None = None,
    ) -> Error | None:
        """Of a model by its simulated sets (R, statistics); None where the file as given shows no excess.

        Where an effect's own spread is so wide that no excess would be left in its units (a handful of tracks in a few
        frames), s is the spread under the file as given alone.

        Args:
            residual: measured less the model's mean, where the sets are of a neighbouring camera.
            follows: standard deviations of the model's spread, where they are better known than from `sets`.
            beside: simulated sets of another model; s is not less than their spread either, so that both errors share their units.
            asked: (statistics,) whether each counts; all if omitted.
        """
        spread = variance(sets) if follows is None else follows**2
        given = variance(self.given)
        wide = spread if beside is None else np.maximum(spread, variance(beside))
        counts = np.ones(len(given), bool) if asked is None else asked
        return self._error(sets, residual, spread, np.maximum(given, wide), counts) or self._error(
            sets, residual, spread, given, counts
        )

    def _error(
        self,
        sets: np.ndarray,
        residual: np.ndarray | None,
        spread: np.ndarray,
        scale: np.ndarray,
        counts: np.ndarray,
    ) -> Error | None:
        scale = np.maximum(scale, self.least**2)
        usable = (scale > 0) & counts
        weight = np.divide(1.0, scale, out=np.zeros_like(scale), where=usable)
        center = sets.mean(0) if residual is None else self.measured - residual
        floor = self._mean(2 * spread * weight, usable)
        far = (self.measured - self.given.mean(0)) ** 2 + variance(self.given)
        before = self._mean(far * weight, usable)
        after = self._mean(((self.measured - center) ** 2 + spread) * weight, usable)
        if before - floor <= 0:
            return None
        deviations = sets - sets.mean(0)
        noise = np.array([self._mean((d**2 + spread) * weight, usable) for d in deviations]) - floor
        value = (after - floor) / (before - floor)
        low, high = np.quantile(noise, [0.025, 0.975]) / (before - floor)
        return Error(float(value), float(value - high), float(value - low))

    def shares(self) -> dict[str, float]:
        """Each view's share of the excess of the camera file as given."""
        scale = np.maximum(variance(self.given), self.least**2)
        usable = scale > 0
        excess = (self.measured - self.given.mean(0)) ** 2 - variance(self.given)
        excess = np.divide(excess, scale, out=np.zeros_like(scale), where=usable)
        means = {}
        for view in dict.fromkeys(self.views):
            here = usable & (self.views == view)
            if here.any():
                means[str(view)] = max(float(excess[here].mean()), 0.0)
        total = sum(means.values())
        return {view: value / total for view, value in means.items()} if total else means

    def _mean(self, terms: np.ndarray, usable: np.ndarray) -> float:
        views = self.views[usable]
        return float(np.mean([terms[usable][views == view].mean() for view in dict.fromkeys(views)]))
