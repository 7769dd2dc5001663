"""Effects that scatter more than they move: whether what is off scatters as they do, and how strong that makes them."""

from dataclasses import dataclass

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.parameters import Coordinate, moved
from visaug.diagnosis.reference import Null
from visaug.diagnosis.robust import standardised

WIDENED = 1.5  # factor from which an effect gives a statistic a spread of its own,
WIDE = 2.0  # and from which that spread is nearly all
SCATTERED = 2.0  # times the spread: what moves further tells a strength by its move
TYPICAL = 0.15  # median square of the variance; 0.45 of a normal law, less where few sets make it
FEW = 3  # statistics that tell a strength by their scatter,
SEEN = 4.0  # standard deviations without the effect from which a move counts,
THERE = 0.3  # share of such moves that must be there
RARE = 0.5  # if so many for each of them, at most, tell it by their moves
LEAST = 0.1  # factor below which a set hardly scatters
TIGHT = 10.0  # times from the 2.5th to the 97.5th percentile of a factor that is told well
MIDDLE = 0.7  # median of a factor that is no rule where it is less: a few sets make the mean square
MET = 1.6  # factor to which a strength that was scaled must be right
ALONE = 0.1  # weight of each such statistic by itself in their covariance, which is known from few sets,
LEAST_KNOWN = 0.3  # and the least of its deviation that is taken as known
WITHIN = 5.0  # standard deviations of its spread to which an effect covers what is off
TIMES_FURTHER = 5.0  # squared distance in that covariance, of the furthest simulated set's, that is too far
# statistics covered in the discovery and in the hold-out frames, to ask whether they are off alike
CONFIRMED = 4
COVERS = 0.8  # share of a residual, and of an error, that stays under a spread that explains nothing


def widened(before: Fitted, after: Fitted, times: float = WIDENED) -> np.ndarray:
    """(statistics,) whether an effect gives each a spread of its own, so many times as wide."""
    known = before.reference.null_scale
    return (known > 0) & (after.reference.null_scale > times * known)


def _covered(before: Fitted, after: Fitted, allowance: np.ndarray | float = 0.0) -> np.ndarray:
    """(statistics,) whether an effect gives each a spread of its own, within which it is off.

    What lies beyond is another effect's: a lamp's levels, which noise that rows share widens a little.
    """
    reach = WITHIN * np.hypot(after.reference.null_scale, allowance)
    return widened(before, after) & (np.abs(after.residual) < reach)


def _is_typical(null: Null) -> np.ndarray:
    """(statistics,) whether a set's own residual tells how far sets scatter: where hardly any is off it does not."""
    return np.median(null.residuals**2, axis=0) > TYPICAL * null.residuals.var(0, ddof=1)


def scatters_so(before: Fitted, after: Fitted, moves: np.ndarray, allowance: np.ndarray) -> bool:
    """Whether what an effect scatters more than it moves is off in a way in which its own simulated sets scatter.

    Each level of a lamp that hardly wanders between frames may lie anywhere, but neighbouring ones lie alike: a curved response
    that is within every single spread is none of its walks. Squared Mahalanobis distance; the sets that it is compared with have no
    part in the covariance. It must be some times that of the furthest set: forms differ.

    Args:
        moves: how far the effect moves each statistic.
        allowance: what forms may leave over, per statistic.
    """
    reference, scale = after.reference, after.reference.null_scale
    spread = _covered(before, after, allowance) & _is_typical(reference.null)
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
    """Whether what an effect moves further than it scatters was off that way.

    A lamp that wanders changes within a level, too, from frame to frame; a curved response, which lies within its walk from level
    to level, does not.
    """
    move = before.reference.null.beyond(moves, after.reference.null_scale)
    far = (np.abs(move) > SCATTERED) & (np.abs(before.reference.null.beyond(moves)) > SEEN)
    was = standardised(before.residual, after.reference.null_scale)
    return bool(move[far] @ was[far] >= THERE * (move[far] @ move[far]))


def recurs_so(before: Fitted, after: Fitted, off: np.ndarray, same: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether what an effect covers is off alike in the discovery and in the hold-out frames no more than in its own sets.

    Tracks of cosmic rays lie elsewhere in every frame: they may cover a bright corner, but not one that is bright in all frames.

    Args:
        off: (statistics,) whether each was off before, in the discovery frames.
        same: places of the same statistics among those of the discovery frames, and among those of the hold-out frames.
    """
    reference = after.reference
    stays = np.abs(after.residual) > COVERS * np.abs(before.residual)
    own = (off & stays & widened(before, after, WIDE))[same[0]]
    if np.count_nonzero(own) < CONFIRMED:
        return True
    uses = ((after.residual, reference.null), (after.confirm_residual, reference.confirm_null))
    # the sign alone: where a few tracks make the spread, one statistic in which they happen to be would outweigh all others;
    # beside the median, for most sets lie below a mean that a few tracks make
    find, confirm = (
        np.sign(np.vstack([null.residuals, left]) - np.median(null.residuals, axis=0))[:, place[own]]
        for (left, null), place in zip(uses, same, strict=True)
    )
    alike = (find * confirm).sum(1)
    return bool(alike[-1] <= alike[:-1].max())


def scatters_again(before: Fitted, after: Fitted) -> bool:
    """Whether the hold-out frames are off too where an effect gives them a spread of its own, and lie within it."""
    scale, own = before.reference.confirm_null.scale, after.reference.confirm_null.scale
    off = (own > WIDE * scale) & (np.abs(standardised(before.confirm_residual, scale)) > SEEN)
    within = np.abs(after.confirm_residual) < WITHIN * own
    return bool(np.count_nonzero(off) >= FEW and within[off].mean() >= COVERS)


def only_covers(before: Fitted, after: Fitted, off: np.ndarray) -> bool:
    """Whether what was off, and gets a spread of the effect's, stays nearly as far off as it was: covered, not brought back.

    Args:
        off: (statistics,) whether each was off before.
    """
    scale = before.reference.null_scale
    own = off & _covered(before, after)
    had, left = (np.linalg.norm(standardised(fitted.residual, scale)[own]) for fitted in (before, after))
    return bool(left > COVERS * had)


@dataclass(frozen=True)
class Scatter:
    """How strong an effect is by what it scatters, where its moves do not tell that.

    Attributes:
        factor: by which its strengths want to be multiplied.
        of_sets: (R,) the same of its own simulated sets: how well the scatter tells it.
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
        """Whether it says something: the factor is told well, or is that of hardly any set; not where a few tracks make it."""
        low, middle, high = np.quantile(self.of_sets, (0.025, 0.5, 0.975))
        return bool(middle > MIDDLE and (high < TIGHT * low or not low < self.factor < high))

    @property
    def is_met(self) -> bool:
        """Whether the effect has the strength that its scatter tells: what is drawn rarely does not scatter as its rate."""
        return 1 / MET < self.factor < MET

    @property
    def steps(self) -> np.ndarray:
        """(R, strengths) how far sets' scatter takes the logarithm of the strengths."""
        return np.repeat(np.log(np.maximum(self.of_sets, LEAST))[:, None], len(self.strengths), axis=1)

    def scaled(self, camera: Camera) -> Camera:
        """The camera with the strengths that the scatter tells."""
        step = float(np.log(self.factor))
        return moved(camera, self.strengths, [c.read(camera) + step for c in self.strengths])


def scatter(
    before: Fitted, after: Fitted, moves: np.ndarray, strengths: tuple[Coordinate, ...]
) -> Scatter | None:
    """What the scatter of an effect tells of its strength; None where its moves tell more.

    A lamp that wanders moves no level on the average. What it moves by chance in a few simulations is no derivative of anything, so
    that no fit of means finds how strong it is. The square of what is off does, whatever goes together: its expectation is the
    variance that the camera has without the effect, and the factor squared times what the effect adds to that.

    Args:
        moves: how far the effect moves each statistic.
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
    weights = added / (1 + move**2) ** 2  # least squares: a normal law's square varies as its variance
    whole = float(weights @ added)

    def factors(left: np.ndarray) -> np.ndarray:
        z = standardised(left, null.scale)[..., wide]
        return np.sqrt(np.maximum(((z + move) ** 2 - plain) @ weights / whole, LEAST**2))

    return Scatter(float(factors(after.residual)), factors(null.residuals), strengths)
