"""Refitting a camera to measured statistics, and the spread of what is left under the camera itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from visaug.camera import Camera
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.parameters import Coordinate, moved

FIRST = 40  # simulated sets for the first scale of every statistic
PAIRS = 3  # pairs of simulations with common random numbers for each derivative
OUTLIER = 3.0  # residuals beyond so many standard deviations lose their pull on the fit (Cauchy weights)


@dataclass(frozen=True)
class Jacobian:
    """How the mean of every statistic answers each coordinate: (statistics, coordinates), frames that find and confirm."""

    find: np.ndarray
    confirm: np.ndarray


def jacobian(lab: Laboratory, camera: Camera, coordinates: Sequence[Coordinate], report=None, pairs: int = PAIRS) -> Jacobian:
    """Central differences with common random numbers."""
    at = [c.read(camera) for c in coordinates]
    jobs = []
    for j, coordinate in enumerate(coordinates):
        for sign in (1, -1):
            there = [x + sign * coordinate.step * (k == j) for k, x in enumerate(at)]
            camera_there = moved(camera, list(coordinates), there)
            jobs += [(camera_there, number) for number in range(pairs)]
    if not jobs:
        return Jacobian(np.zeros((len(lab.statistics), 0)), np.zeros((len(lab.measured[1].values), 0)))
    both = lab.simulated(jobs, report)
    slopes = []
    for values in both:
        means = values.reshape(len(coordinates), 2, pairs, -1).mean(2)
        steps = np.array([c.step for c in coordinates])[:, None]
        slopes.append(((means[:, 0] - means[:, 1]) / (2 * steps)).T)
    return Jacobian(*slopes)


def spread_of(values: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Standard deviation of every statistic, never below what is taken seriously."""
    return np.maximum(values.std(0, ddof=1), least)


def adjust(residuals: np.ndarray, slopes: np.ndarray, scale: np.ndarray, priors: np.ndarray, iterations: int = 12) -> np.ndarray:
    """The step of the coordinates that best takes residuals away, robustly.

    Args:
        residuals: (n, statistics), measured less modelled, of n sets at once.
        slopes: (statistics, coordinates).
        scale: (statistics,), standard deviations.
        priors: (coordinates,), standard deviations.

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
    weights = np.ones_like(z)
    for _ in range(iterations):
        normal = np.einsum("ni,ij,ik->njk", weights, design, design, optimize=True) + ridge
        pull = (weights * z) @ design
        steps = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
        weights = 1 / (1 + ((z - steps @ design.T) / OUTLIER) ** 2)
    return steps


@dataclass(frozen=True)
class Fitted:
    """A camera refitted to the frames that find, with the spread of everything under itself.

    Attributes:
        camera: the refitted camera.
        coordinates, steps: what was free, and the last step beyond `camera` that the bootstrap's mean asks for.
        mean, confirm_mean: mean statistics of its simulated sets, after that step.
        sets, confirm_sets: (R, statistics) fingerprints of its simulated sets.
        scale, confirm_scale: their standard deviations.
        residual: measured less modelled after refitting, frames that find.
        null: (R, statistics) the same for simulated sets, each refitted.
        null_steps: (R, coordinates) how far refitting moved each simulated set: the uncertainty of the coordinates.
    """

    camera: Camera
    coordinates: tuple[Coordinate, ...]
    slopes: Jacobian
    mean: np.ndarray
    confirm_mean: np.ndarray
    sets: np.ndarray
    confirm_sets: np.ndarray
    scale: np.ndarray
    confirm_scale: np.ndarray
    residual: np.ndarray
    null: np.ndarray
    null_steps: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Residuals in standard deviations of refitted sets of the camera itself; 0 for a statistic that never varies."""
        return standardised(self.residual, self.null_scale)

    @property
    def null_scale(self) -> np.ndarray:
        return np.where(self.scale > 0, np.maximum(self.null.std(0, ddof=1), 0.3 * self.scale), 0.0)

    @property
    def null_z(self) -> np.ndarray:
        return standardised(self.null, self.null_scale)

    @property
    def p_value(self) -> float:
        """Of the largest standardised residual, against that of the camera's own sets."""
        return p_value(self.z, self.null_z)


def standardised(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0)


def p_value(z: np.ndarray, null: np.ndarray) -> float:
    """p = (1 + #{max|r*| >= max|r|}) / (R + 1)."""
    largest = np.abs(null).max(1)
    return float((1 + np.count_nonzero(largest >= np.abs(z).max())) / (len(null) + 1))


def refit(
    lab: Laboratory,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    sets: int,
    report: Callable[[str, int, int], None],
    iterations: int = 3,
    label: str = "refitting the camera",
) -> Fitted:
    """Fits the coordinates to the frames that find, then simulates and refits `sets` sets of the fitted camera."""
    coordinates = list(coordinates)
    measured, confirm = (f.values for f in lab.measured)
    least, confirm_least = ([s.least_spread for s in f.statistics] for f in lab.measured)
    priors = np.array([c.prior for c in coordinates])
    first, _ = lab.simulated([(camera, k) for k in range(FIRST)], lambda n: report(f"{label}: spread", n, FIRST))
    scale = spread_of(first, np.array(least))
    start = np.array([c.read(camera) for c in coordinates])
    at = start.copy()
    mean = first.mean(0)
    count = 2 * PAIRS * len(coordinates)
    slopes = jacobian(lab, camera, coordinates, lambda n: report(f"{label}: derivatives", n, count))
    for i in range(iterations):
        # the prior holds the distance from the file's value, not from the last iterate
        toward = (measured - mean)[None] + (slopes.find @ (at - start))[None]
        step = start + adjust(toward, slopes.find, scale, priors)[0] - at
        step = np.clip(step, -0.6 * priors, 0.6 * priors)
        at = at + step
        camera = moved(camera, coordinates, list(at))
        at = np.array([c.read(camera) for c in coordinates])
        if np.all(np.abs(step) < 0.02 * np.array([c.step for c in coordinates])) and i:
            break
        values, _ = lab.simulated([(camera, k) for k in range(FIRST)], lambda n: report(f"{label}: step {i + 1}", n, FIRST))
        mean = values.mean(0)
        scale = spread_of(values, np.array(least))
        if i == 0 and np.any(np.abs(step) > 4 * np.array([c.step for c in coordinates])):
            slopes = jacobian(lab, camera, coordinates, lambda n: report(f"{label}: derivatives", n, count))
    values, confirm_values = lab.simulated([(camera, 1000 + k) for k in range(sets)],
                                           lambda n: report(f"{label}: bootstrap", n, sets))
    scale, confirm_scale = spread_of(values, np.array(least)), spread_of(confirm_values, np.array(confirm_least))
    mean, confirm_mean = values.mean(0), confirm_values.mean(0)
    residual = measured - mean
    step = adjust(residual[None], slopes.find, scale, priors)[0]
    # leave one out: a simulated set is compared with the mean of the others, as the measured one is with the mean of all
    null = (values - mean) * (sets / (sets - 1))
    null_steps = adjust(null, slopes.find, scale, priors)
    return Fitted(
        camera=moved(camera, coordinates, list(at + step)) if coordinates else camera,
        coordinates=tuple(coordinates),
        slopes=slopes,
        mean=mean + slopes.find @ step,
        confirm_mean=confirm_mean + slopes.confirm @ step,
        sets=values,
        confirm_sets=confirm_values,
        scale=scale,
        confirm_scale=confirm_scale,
        residual=residual - slopes.find @ step,
        null=null - null_steps @ slopes.find.T,
        null_steps=null_steps,
    )
