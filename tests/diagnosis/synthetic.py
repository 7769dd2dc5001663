"""Sets of a camera without and with an effect, made with NumPy: independent normal statistics of standard deviation 1.

The first `FIND` statistics are those of the discovery frames, the others those of the hold-out frames.
"""

import numpy as np

from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.parameters import Coordinate
from visaug.diagnosis.fitting.reference import Reference, SimulatedStatistics
from visaug.diagnosis.fitting.uses import Use
from visaug.diagnosis.state import State

FIND, ALL = 200, 300
PLAIN, WITH = 200, 120  # numbers of simulated sets without and with the effect


def state(measured: np.ndarray, sets: np.ndarray, slope: np.ndarray | None = None) -> State:
    """The state of a camera from measured statistics (`ALL`,) and simulated sets (R, `ALL`).

    Args:
        slope: (`ALL`,) derivatives of the statistics by one free parameter, to which the measurement was fitted; None without
            parameters.
    """
    slopes = np.zeros((ALL, 0)) if slope is None else slope[:, None]
    coordinates = () if slope is None else (Coordinate("row_noise.sigma_e", False, 0.1, 1e3),)
    samples, residuals = [], []
    for use in (slice(FIND), slice(FIND, ALL), slice(None)):
        values = sets[:, use]
        count = values.shape[1]
        samples.append(SimulatedStatistics(values, slopes[use], np.zeros(count)))
        residuals.append(measured[use] - values.mean(0))
    reference = Reference(None, coordinates, *samples)  # pyrefly: ignore[bad-argument-type]
    fitted = Fitted(reference, None, *residuals)  # pyrefly: ignore[bad-argument-type]
    find, confirm, whole = (
        np.arange(len(left)) for left in residuals
    )  # each statistic has a view of its own
    return State.plain(fitted, (find, confirm, whole))


def pair(
    seed: int,
    truth: np.ndarray | float,
    shift: np.ndarray | float,
    true_scatter: np.ndarray | float = 0.0,
    scatter: np.ndarray | float = 0.0,
    are_common: bool = True,
    counts: tuple[int, int] = (PLAIN, WITH),
) -> tuple[State, State]:
    """States without and with an effect that shifts the means by `shift`, where the measured frames are shifted by `truth`.

    Args:
        true_scatter, scatter: standard deviations that are added to those of the measured frames and of sets with the effect.
        are_common: whether sets with the effect share their random numbers with those without.
        counts: numbers of simulated sets without and with the effect.
    """
    rng = np.random.default_rng(seed)
    numbers = rng.standard_normal((max(counts), ALL))
    plain = numbers[: counts[0]]
    own = numbers[: counts[1]] if are_common else rng.standard_normal((counts[1], ALL))
    own = own + shift + scatter * rng.standard_normal(own.shape)
    measured = rng.standard_normal(ALL) + truth + true_scatter * rng.standard_normal(ALL)
    before = state(measured, plain)
    return before, before.with_effect("row_noise", state(measured, own).fitted)


def shifted(every: int, size: float) -> np.ndarray:
    """(`ALL`,) a shift of every so many statistics, in both signs."""
    places = np.arange(ALL)
    signs = np.where(places // every % 2, -1.0, 1.0)
    return np.where(places % every == 0, size * signs, 0.0)


def uses(pair: tuple[State, State]) -> tuple[Use, Use]:
    """The discovery frames of both states."""
    before, after = pair
    return before.find, after.find
