"""Effects with random shifts: their variance between specimens is compared with the residuals, and determines their strength.

The mean of a statistic does not change under such an effect (light drift, cosmic rays, few hot pixels); its variance does.
"""

from dataclasses import dataclass

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.parameters import Coordinate, moved
from visaug.diagnosis.reference import Null
from visaug.diagnosis.robust import standardised

WIDENED = 1.5  # ratio of standard deviations from which an effect adds variance to a statistic,
WIDE = 2.0  # and from which that variance is nearly all of it
SCATTERED = 2.0  # standard deviations of the added variance: a larger shift determines a strength by its mean
# Least median of the squared residual over its variance; 0.45 for a normal distribution, less for rare events
TYPICAL = 0.15
FEW = 3  # least number of statistics that determine a strength by their variance,
SEEN = 4.0  # standard deviations without the effect above which a shift counts,
THERE = 0.3  # least share of such shifts that the residuals must show
RARE = 0.5  # largest ratio of statistics with a shift to those with added variance
LEAST = 0.1  # factor below which a simulated set shows almost no added variance
TIGHT = 10.0  # ratio of the 97.5th to the 2.5th percentile of the factor up to which it is determined
MIDDLE = 0.7  # least median of the factor; less means that a few sets make the mean square
MET = 1.6  # ratio to which an estimated strength must reproduce itself
ALONE = 0.1  # shrinkage of the covariance of these statistics towards its diagonal,
LEAST_KNOWN = 0.3  # and the least standard deviation on it
WITHIN = 5.0  # standard deviations of the added variance within which a residual is covered
TIMES_FURTHER = 5.0  # largest ratio of the squared Mahalanobis distance to that of the furthest simulated set
# least number of covered statistics that discovery and hold-out frames must share for `recurs_so`
CONFIRMED = 4
COVERS = 0.8  # share of a residual, and of an error, above which it counts as covered only


def widened(before: Fitted, after: Fitted, times: float = WIDENED) -> np.ndarray:
    """(statistics,) whether an effect multiplies the standard deviation of each by more than `times`."""
    known = before.reference.null_scale
    return (known > 0) & (after.reference.null_scale > times * known)


def covered(before: Fitted, after: Fitted, allowance: np.ndarray | float = 0.0) -> np.ndarray:
    """(statistics,) whether an effect adds variance to each and the residual lies within it.

    Larger residuals belong to another effect, such as the levels of a drifting lamp, to which row noise adds a little
    variance.
    """
    reach = WITHIN * np.hypot(after.reference.null_scale, allowance)
    return widened(before, after) & (np.abs(after.residual) < reach)


def _is_typical(null: Null) -> np.ndarray:
    """(statistics,) whether a single set shows the variance between sets, which it does not for rare events."""
    return np.median(null.residuals**2, axis=0) > TYPICAL * null.residuals.var(0, ddof=1)


def scatters_so(before: Fitted, after: Fitted, moves: np.ndarray, allowance: np.ndarray) -> bool:
    """Whether the residuals covered by an effect's added variance have the correlations of its simulated sets.

    For example, each level of a slowly drifting lamp is uncertain, but neighbouring levels are correlated: a curved response
    within every single standard deviation is not such a drift. The test is the squared Mahalanobis distance, with a
    covariance from one half of the sets and the other half as reference. It must exceed the largest of those by a factor,
    since forms differ.

    Args:
        moves: mean shift of each statistic by the effect.
        allowance: tolerance of effects' forms, per statistic.
    """
    reference, scale = after.reference, after.reference.null_scale
    spread = covered(before, after, allowance) & _is_typical(reference.null)
    spread &= np.abs(before.reference.null.beyond(moves, scale)) <= SCATTERED
    if np.count_nonzero(spread) < 2:
        return True
    sets = standardised(reference.null.residuals, scale)[:, spread]
    off = standardised(after.residual, scale)[spread]
    forms = np.diag(standardised(allowance, scale)[spread] ** 2)
    distances, furthest = [], []
    for own, others in ((sets[::2], sets[1::2]), (sets[1::2], sets[::2])):
        joint = own.T @ own / len(own)
        alone = np.diag(np.maximum(np.diag(joint), LEAST_KNOWN**2))
        inverse = np.linalg.inv((1 - ALONE) * joint + ALONE * alone + forms)
        distances.append(off @ inverse @ off)
        furthest.append(np.einsum("ri,ij,rj->r", others, inverse, others).max())
    return bool(np.mean(distances) < TIMES_FURTHER * max(furthest))


def moves_are_there(before: Fitted, after: Fitted, moves: np.ndarray) -> bool:
    """Whether the residuals show the effect's mean shifts that exceed its added variance.

    A drifting lamp also changes within a level, from frame to frame; a curved response does not.
    """
    move = before.reference.null.beyond(moves, after.reference.null_scale)
    far = (np.abs(move) > SCATTERED) & (np.abs(before.reference.null.beyond(moves)) > SEEN)
    was = standardised(before.residual, after.reference.null_scale)
    return bool(move[far] @ was[far] >= THERE * (move[far] @ move[far]))


def recurs_so(before: Fitted, after: Fitted, off: np.ndarray, same: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether the covered residuals agree between discovery and hold-out frames no more than in simulated sets of the effect.

    Tracks of cosmic rays have other places in every frame: they may cover a bright corner, but not one that all frames show.

    Args:
        off: (statistics,) whether each deviated before, in the discovery frames.
        same: indices of the common statistics in the discovery frames, and in the hold-out frames.
    """
    reference = after.reference
    stays = np.abs(after.residual) > COVERS * np.abs(before.residual)
    own = (off & stays & widened(before, after, WIDE))[same[0]]
    if np.count_nonzero(own) < CONFIRMED:
        return True
    uses = ((after.residual, reference.null), (after.confirm_residual, reference.confirm_null))
    # The sign alone: with few tracks, a single statistic would outweigh all others. Relative to the median, since few tracks
    # make a mean that most sets lie below.
    find, confirm = (
        np.sign(np.vstack([null.residuals, left]) - np.median(null.residuals, axis=0))[:, place[own]]
        for (left, null), place in zip(uses, same, strict=True)
    )
    alike = (find * confirm).sum(1)
    return bool(alike[-1] <= alike[:-1].max())


def scatters_again(before: Fitted, after: Fitted) -> bool:
    """Whether the hold-out frames deviate where an effect adds variance to them, within that variance."""
    scale, own = before.reference.confirm_null.scale, after.reference.confirm_null.scale
    off = (own > WIDE * scale) & (np.abs(standardised(before.confirm_residual, scale)) > SEEN)
    within = np.abs(after.confirm_residual) < WITHIN * own
    return bool(np.count_nonzero(off) >= FEW and within[off].mean() >= COVERS)


def only_covers(before: Fitted, after: Fitted, off: np.ndarray) -> bool:
    """Whether deviating statistics to which the effect adds variance keep their residuals: covered and not removed.

    Args:
        off: (statistics,) whether each deviated before.
    """
    scale = before.reference.null_scale
    own = off & covered(before, after)
    had, left = (np.linalg.norm(standardised(fitted.residual, scale)[own]) for fitted in (before, after))
    return bool(left > COVERS * had)


@dataclass(frozen=True)
class Scatter:
    """Strength of an effect, estimated from the variance that it adds.

    Attributes:
        factor: by which its strengths are to be multiplied.
        of_sets: (R,) the same estimate from each of its own simulated sets.
        strengths: their coordinates; at least one.
    """

    factor: float
    of_sets: np.ndarray
    strengths: tuple[Coordinate, ...]

    @property
    def effect(self) -> str:
        return self.strengths[0].path.split(".")[0]

    @property
    def tells(self) -> bool:
        """Whether the factor is determined, or would be small in almost all sets; False where few rare events make it."""
        low, middle, high = np.quantile(self.of_sets, (0.025, 0.5, 0.975))
        return bool(middle > MIDDLE and (high < TIGHT * low or not low < self.factor < high))

    @property
    def is_met(self) -> bool:
        """Whether the factor is consistent with 1. Rare events have a variance that does not grow with their rate."""
        return 1 / MET < self.factor < MET

    @property
    def steps(self) -> np.ndarray:
        """(R, strengths) logarithm of the strengths as estimated from each simulated set."""
        return np.repeat(np.log(np.maximum(self.of_sets, LEAST))[:, None], len(self.strengths), axis=1)

    def scaled(self, camera: Camera) -> Camera:
        """The camera with the estimated strengths."""
        step = float(np.log(self.factor))
        return moved(camera, self.strengths, [c.read(camera) + step for c in self.strengths])


def scatter(
    before: Fitted, after: Fitted, moves: np.ndarray, strengths: tuple[Coordinate, ...]
) -> Scatter | None:
    """Strength of an effect from the variance that it adds; None where its mean shifts determine it.

    A drifting lamp shifts no level on average, and its shifts in a few simulations are chance, so no fit of means determines
    its strength. The squared residual does, whatever the correlations: its expectation is the variance without the effect
    plus the squared factor times the variance that the effect adds.

    Args:
        moves: mean shift of each statistic by the effect.
        strengths: logarithmic coordinates.
    """
    null = after.reference.null
    plain = standardised(before.reference.null_scale, null.scale) ** 2
    move = before.reference.null.beyond(moves, null.scale)
    far = np.abs(move) > SCATTERED
    wide = widened(before, after, WIDE) & _is_typical(null) & ~far
    count = np.count_nonzero(wide)
    if not strengths or count < FEW or np.count_nonzero(far) > RARE * count:
        return None
    move, plain = move[wide], plain[wide]
    added = 1 + move**2 - plain
    # Least squares: the variance of a squared normal variable is proportional to its squared variance
    weights = added / (1 + move**2) ** 2
    whole = float(weights @ added)

    def factors(left: np.ndarray) -> np.ndarray:
        z = standardised(left, null.scale)[..., wide]
        return np.sqrt(np.maximum(((z + move) ** 2 - plain) @ weights / whole, LEAST**2))

    return Scatter(float(factors(after.residual)), factors(null.residuals), strengths)
