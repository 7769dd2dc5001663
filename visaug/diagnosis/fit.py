"""Refitting a camera to measured statistics, and the spread of what is left under the camera itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from visaug.camera import Camera
from visaug.comparison.distance import variance
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.parameters import BLACK, WELL, Coordinate, moved

TWINS = 8  # simulations with common random numbers that follow the mean from one camera to another
PAIRS = 3  # the same for each side of a derivative
OUTLIER = 3.0  # residuals beyond so many standard deviations lose their pull on the fit (Cauchy weights)
FAR_BLACK = 3.0  # steps of the black level after which it is first set by the bias frames' mean
FAR = 6.0  # steps of a coordinate after which the reference is made anew

Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Reference:
    """A camera with its own simulated sets: their mean, their spread, and how the mean answers each free number.

    Attributes:
        sets, confirm_sets: (R, statistics) fingerprints, of the frames that find and those that confirm.
        slopes, confirm_slopes: (statistics, coordinates), derivatives of the means.
    """

    camera: Camera
    coordinates: tuple[Coordinate, ...]
    sets: np.ndarray
    confirm_sets: np.ndarray
    slopes: np.ndarray
    confirm_slopes: np.ndarray
    least: np.ndarray
    confirm_least: np.ndarray

    @cached_property
    def mean(self) -> np.ndarray:
        return self.sets.mean(0)

    @cached_property
    def scale(self) -> np.ndarray:
        """Standard deviations; never below what is taken seriously; 0 for a statistic that never varies."""
        return np.maximum(np.sqrt(variance(self.sets)), self.least)

    @cached_property
    def confirm_scale(self) -> np.ndarray:
        return np.maximum(np.sqrt(variance(self.confirm_sets)), self.confirm_least)

    @property
    def priors(self) -> np.ndarray:
        return np.array([c.prior for c in self.coordinates])

    @cached_property
    def deviations(self) -> np.ndarray:
        """Each set less the mean of the others."""
        count = len(self.sets)
        return (self.sets - self.mean) * (count / (count - 1))

    @cached_property
    def null_steps(self) -> np.ndarray:
        """(R, coordinates) how far refitting moves each simulated set: the uncertainty of the coordinates."""
        return adjust(self.deviations, self.slopes, self.scale, self.priors)

    @cached_property
    def null(self) -> np.ndarray:
        """(R, statistics) residuals of the simulated sets, each refitted."""
        return self.deviations - self.null_steps @ self.slopes.T

    @cached_property
    def null_scale(self) -> np.ndarray:
        """Standard deviations of refitted residuals."""
        spread = np.maximum(self.null.std(0, ddof=1), 0.3 * self.scale)
        return np.where(self.scale > 0, np.maximum(spread, self.least), 0.0)

    @cached_property
    def largest(self) -> np.ndarray:
        """(R,) the largest standardised residual of each simulated set, refitted."""
        return np.abs(standardised(self.null, self.null_scale)).max(1)

    @cached_property
    def largest_as_given(self) -> np.ndarray:
        return np.abs(standardised(self.deviations, self.scale)).max(1)


def standardised(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0)


def p_value(largest: float, null: np.ndarray) -> float:
    """p = (1 + #{max|r*| >= max|r|}) / (R + 1)."""
    return float((1 + np.count_nonzero(null >= largest)) / (len(null) + 1))


def make_reference(
    lab: Laboratory,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    sets: int,
    report: Report,
    known: tuple[Sequence[Coordinate], np.ndarray, np.ndarray] | None = None,
) -> Reference:
    """Simulates `sets` sets and the derivatives.

    Args:
        known: coordinates whose derivatives are taken over from a neighbouring camera, and these derivatives.
    """
    label = f"simulating {sets} sets of the camera"
    values, confirm = lab.simulated([(camera, k) for k in range(sets)], lambda n: report(label, n, sets))
    taken = [] if known is None else [c.path for c in known[0]]
    new = [c for c in coordinates if c.path not in taken]
    slopes, confirm_slopes = derivatives(lab, camera, new, report)
    if known is not None:
        kept = [k for k, c in enumerate(known[0]) if c.path in {c.path for c in coordinates}]
        slopes = np.hstack([known[1][:, kept], slopes])
        confirm_slopes = np.hstack([known[2][:, kept], confirm_slopes])
        coordinates = [known[0][k] for k in kept] + new
    least, confirm_least = (np.array([s.least_spread for s in f.statistics]) for f in lab.measured)
    return Reference(
        camera, tuple(coordinates), values, confirm, slopes, confirm_slopes, least, confirm_least
    )


def derivatives(
    lab: Laboratory, camera: Camera, coordinates: Sequence[Coordinate], report: Report
) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of the mean statistics, with common random numbers: two (statistics, coordinates)."""
    coordinates = list(coordinates)
    if not coordinates:
        return np.zeros((len(lab.measured[0].values), 0)), np.zeros((len(lab.measured[1].values), 0))
    at = [c.read(camera) for c in coordinates]
    jobs = []
    for j, coordinate in enumerate(coordinates):
        for sign in (1, -1):
            there = [x + sign * coordinate.step * (k == j) for k, x in enumerate(at)]
            jobs += [(moved(camera, coordinates, there), number) for number in range(PAIRS)]
    both = lab.simulated(jobs, lambda n: report("how statistics answer the camera's numbers", n, len(jobs)))
    slopes = []
    for values in both:
        means = values.reshape(len(coordinates), 2, PAIRS, -1).mean(2)
        slopes.append(
            ((means[:, 0] - means[:, 1]) / (2 * np.array([c.step for c in coordinates])[:, None])).T
        )
    return slopes[0], slopes[1]


def adjust(
    residuals: np.ndarray,
    slopes: np.ndarray,
    scale: np.ndarray,
    priors: np.ndarray,
    offset: np.ndarray | float = 0.0,
    damping: float = 0.0,
    iterations: int = 12,
) -> np.ndarray:
    """The step of the coordinates that best takes residuals away, robustly.

    Args:
        residuals: (n, statistics), measured less modelled, of n sets at once.
        slopes: (statistics, coordinates).
        scale: (statistics,), standard deviations.
        priors: (coordinates,), standard deviations.
        offset: (coordinates,), how far the coordinates already are from where the priors are centred.
        damping: Marquardt's: above 0 the step shrinks, most where the statistics say least.

    Returns:
        (n, coordinates). Statistics that stay beyond `OUTLIER` standard deviations, as a missing effect makes them, are
        weighted down, so that the camera is not bent to explain them.
    """
    if slopes.shape[1] == 0:
        return np.zeros((len(residuals), 0))
    used = scale > 0
    design = slopes[used] / scale[used, None]
    z = residuals[:, used] / scale[used]
    ridge = np.diag(1 / priors**2)
    steps = np.zeros((len(z), design.shape[1]))
    for _ in range(iterations):
        left = np.abs(z - steps @ design.T)
        # where most statistics are off it is the camera's numbers that are; where few are, it is something else
        limit = np.maximum(OUTLIER, OUTLIER * np.median(left, axis=1, keepdims=True))
        weights = 1 / (1 + (left / limit) ** 2)
        normal = np.stack([(design * w[:, None]).T @ design for w in weights]) + ridge
        diagonal = np.einsum("nii->ni", normal)
        diagonal += 1e-9 * diagonal.max(1, keepdims=True)  # numbers that these frames answer alike
        diagonal *= 1 + damping
        pull = (weights * z) @ design - offset / priors**2
        steps = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
    return steps


@dataclass(frozen=True)
class Fitted:
    """A camera refitted to the frames that find.

    Attributes:
        reference: the simulated sets that give the spread.
        camera: the refitted camera.
        residual, confirm_residual: measured less the refitted camera's mean, per statistic.
    """

    reference: Reference
    camera: Camera
    residual: np.ndarray
    confirm_residual: np.ndarray

    @cached_property
    def z(self) -> np.ndarray:
        """Residuals in standard deviations of refitted sets of the camera itself; 0 for a statistic that never varies."""
        return standardised(self.residual, self.reference.null_scale)

    @property
    def p_value(self) -> float:
        """Of the largest standardised residual, against that of the camera's own sets."""
        return p_value(float(np.abs(self.z).max()), self.reference.largest)

    @property
    def slopes(self) -> np.ndarray:
        return self.reference.slopes


def refit(lab: Laboratory, reference: Reference, report: Report, iterations: int = 12) -> Fitted:
    """Fits the reference's coordinates to the frames that find.

    The mean follows the camera by simulations that share their random numbers with the reference's first sets.
    """
    measured, confirm = (f.values for f in lab.measured)
    coordinates, priors = list(reference.coordinates), reference.priors
    steps = np.array([c.step for c in coordinates])
    start = np.array([c.read(reference.camera) for c in coordinates])
    twins = min(TWINS, len(reference.sets))
    at, camera = start.copy(), reference.camera
    mean, confirm_mean = reference.mean, reference.confirm_sets.mean(0)
    best = (_misfit(measured - mean, reference.scale), at, camera, mean, confirm_mean)
    damping, bends = 0.0, np.array([c.path == WELL for c in coordinates], bool)
    share = np.ones(len(start))

    def step_from(at: np.ndarray, mean: np.ndarray) -> np.ndarray:
        left = (measured - mean)[None]
        step = adjust(left, reference.slopes, reference.scale, priors, at - start, damping)[0]
        return share * np.clip(step, -0.6 * priors, 0.6 * priors)

    for i in range(iterations):
        step = _to_bias_level(lab, reference, measured - mean) if i == 0 else None
        step = step_from(at, mean) if step is None else step
        if i and np.all(np.abs(step) < 0.05 * steps):
            break
        camera = moved(camera, coordinates, list(at + step))
        at = np.array([c.read(camera) for c in coordinates])
        found, confirmed = lab.simulated(
            [(camera, k) for k in range(twins)], lambda n: report("refitting the camera", n, twins)
        )
        mean = reference.mean + found.mean(0) - reference.sets[:twins].mean(0)
        confirm_mean = (
            reference.confirm_sets.mean(0) + confirmed.mean(0) - reference.confirm_sets[:twins].mean(0)
        )
        misfit = _misfit(measured - mean, reference.scale)
        if misfit < best[0]:
            best = (misfit, at, camera, mean, confirm_mean)
            damping = 0.1 * damping if damping > 0.02 else 0.0
            share = np.minimum(2 * share, 1.0)
        else:  # too far where statistics bend
            _, at, camera, mean, confirm_mean = best
            if bends.any() and share.min() > 0.05 and np.abs(step[bends] / steps[bends]).max() > 0.1:
                share[bends] *= (
                    0.25  # a flat that was below the full well may be cut by it: no derivative tells
                )
            else:
                damping = max(10 * damping, 0.1)  # more along what the statistics tell well
        if damping > 100:
            break
    _, at, camera, mean, confirm_mean = best
    # what is left of a step is small, or was tried and found worse
    last = step_from(at, mean) if damping == 0 else np.zeros(len(at))
    camera = moved(camera, coordinates, list(at + last)) if coordinates else camera
    return Fitted(
        reference,
        camera,
        measured - mean - reference.slopes @ last,
        confirm - confirm_mean - reference.confirm_slopes @ last,
    )


def _to_bias_level(lab: Laboratory, reference: Reference, left: np.ndarray) -> np.ndarray | None:
    """The step that brings the black level to the mean of the bias frames, where it is far from there; else None.

    Bits and codes follow the black level up and down, so that no step of a robust fit leads across many DN.
    """
    level = [i for i, s in enumerate(lab.statistics) if (s.view, s.name, s.kind) == ("level", "mean", "bias")]
    black = [k for k, c in enumerate(reference.coordinates) if c.path == BLACK]
    if not level or not black or abs(left[level[0]]) < FAR_BLACK * reference.coordinates[black[0]].step:
        return None
    step = np.zeros(len(reference.coordinates))
    step[black[0]] = left[level[0]] / max(reference.slopes[level[0], black[0]], 0.5)
    return step


def _misfit(residual: np.ndarray, scale: np.ndarray) -> float:
    """What the robust fit lowers."""
    return float(np.log1p((standardised(residual, scale) / OUTLIER) ** 2).sum())


def is_far(reference: Reference, camera: Camera, steps: float = FAR) -> bool:
    """Whether a refitted camera left the neighbourhood in which the reference's spread and derivatives hold."""
    moves = [abs(c.read(camera) - c.read(reference.camera)) / c.step for c in reference.coordinates]
    return max(moves, default=0.0) > steps
