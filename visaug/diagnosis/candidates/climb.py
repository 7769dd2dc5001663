"""Maximum likelihood of an effect's parameters from a first match: damped Gauss-Newton on simulated means."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from visaug.camera import Camera
from visaug.diagnosis.candidates.matches import Match
from visaug.diagnosis.candidates.signatures import FEW, MORE, cleared, is_mostly_taken
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import Metric
from visaug.diagnosis.fitting.parameters import Coordinate, moved
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue

NEAR = 3.0  # steps within which the derivatives of the camera's parameters are valid
FOLLOWED = 3  # largest number of times that the camera's parameters are moved along
HOPELESS = 1000.0  # log likelihood behind the best that the camera's parameters cannot make up for
STRONGER, FARTHEST = 3.0, 5  # times a strength that is tried next at the start; how often
NOISY = 1.0  # loss of log likelihood that the noise of a few simulations may cause
LEAST_SHARE = 0.02  # that a derivative's true size is taken to have of its noisy one


@dataclass(frozen=True)
class ClimbPoint:
    """Coordinates with their gain and the shift of every statistic: mean, and (twins, statistics)."""

    at: np.ndarray
    gain: float
    move: np.ndarray
    moves: np.ndarray

    @property
    def variance(self) -> np.ndarray:
        """Variance that the effect adds, per statistic."""
        return self.moves.var(0, ddof=1)


class Climb:
    """Likelihood of the measurement as a function of an effect's parameters, with the camera's parameters following."""

    def __init__(
        self,
        lab: Laboratory,
        fitted: Fitted,
        law: Metric,
        match: Match,
        camera: Camera,
        own: Sequence[Coordinate],
    ):
        self.lab, self.fitted, self.camera = lab, fitted, camera
        self.twins = MORE if match.variance.any() else FEW
        self.base = np.zeros((0, len(fitted.residual)))
        self.nothing = law.log_likelihood(fitted.residual)
        self.law = law.widened(match.variance)
        self.answers = self.law.white(fitted.slopes.T)
        self.coordinates = (*fitted.reference.coordinates, *own)
        self.theirs = len(self.coordinates) - len(own)  # of these are the camera's
        self.steps = np.array([c.step for c in self.coordinates])
        self.priors = np.array([c.prior for c in self.coordinates])
        strengths = {f"{match.trial.effect}.{key}" for key in catalogue()[match.trial.effect].strengths()}
        self.strengths = np.array([c.path in strengths for c in self.coordinates])

    def start(self, cameras: Sequence[Camera]) -> ClimbPoint:
        """The best of some cameras."""
        found: list[np.ndarray] = []
        for camera in cameras:
            at = np.array([c.read(camera) for c in self.coordinates])
            if all(np.any(np.abs(at - other) > self.steps) for other in found):
                found.append(at)
        best = self.settled(found[0])
        for at in found[1:]:
            best = max(best, self.settled(at, best), key=lambda point: point.gain)
        return best

    def upwards(self, best: ClimbPoint) -> ClimbPoint:
        """The start, or a larger strength that gains more: near zero derivatives vanish or are noise."""
        logarithmic = np.array([c.logarithmic for c in self.coordinates])
        for _ in range(FARTHEST if self.strengths.any() else 0):
            more = np.where(logarithmic, best.at + np.log(STRONGER), STRONGER * best.at)
            point = self.settled(np.where(self.strengths, more, best.at), best)
            if point.gain <= best.gain:
                break
            best = point
        return best

    def settled(self, at: np.ndarray, beside: ClimbPoint | None = None) -> ClimbPoint:
        """The effect's parameters as given, with the camera's parameters refitted to them.

        Args:
            beside: the best point so far.
        """
        best = self._simulated(at, self.twins if beside is None else len(beside.moves))
        for _ in range(FOLLOWED):
            step = self._following(self.law.white(self.fitted.residual - best.move))
            hopeless = beside is not None and best.gain < beside.gain - HOPELESS
            if hopeless or not self._is_far(step, self.fitted.residual - best.move):
                break
            if len(best.moves) < MORE:  # the same random numbers are no longer the same noise
                best = self._again(best)
            point = self._simulated(best.at + step, MORE)
            if point.gain < best.gain:
                break
            best = point
        return best

    def step(self, point: ClimbPoint) -> np.ndarray:
        """The step of all coordinates from a point."""
        effect = np.arange(self.theirs, len(point.at))
        step = np.zeros(len(point.at))
        aside = [point.at + self.steps * (np.arange(len(step)) == j) for j in effect]
        moves = self._moves(aside, len(point.moves))
        design = self.law.white((moves - point.moves) / self.steps[effect, None, None])
        left = self.law.white(self.fitted.residual - point.moves)
        step[effect] = newton(design, left, self.priors[effect])
        step = self._short(step)
        theirs = self._following(left.mean(0) - step[effect] @ design.mean(1))
        further = step[effect] @ ((moves - point.moves).mean(1) / self.steps[effect, None])
        return step + theirs if self._is_far(theirs, self.fitted.residual - point.move - further) else step

    def _following(self, left: np.ndarray) -> np.ndarray:
        """Expected step of the camera's parameters for whitened residuals.

        They have Gaussian priors, so this is a Gaussian posterior mean.
        """
        step = np.zeros(len(self.coordinates))
        step[: self.theirs] = self.priors[: self.theirs] ** 2 * (self.answers @ left)
        return self._short(step)

    def _is_far(self, step: np.ndarray, left: np.ndarray) -> bool:
        """Whether the camera's parameters have to be moved by a step that reduces a residual, and not only derivatives used."""
        after = left - self.fitted.slopes @ step[: self.theirs]
        scale = self.fitted.reference.null_scale
        return bool(np.any(np.abs(step) > NEAR * self.steps)) or is_mostly_taken(left, after, scale)

    def _short(self, step: np.ndarray) -> np.ndarray:
        return np.clip(step, -0.6 * self.priors, 0.6 * self.priors)

    def _simulated(self, at: np.ndarray, twins: int) -> ClimbPoint:
        at = self._within(at)
        (moves,) = self._moves([at], twins)
        point = self._point(at, moves)
        if twins < MORE and self._noise(moves) > max(NOISY, 0.1 * abs(point.gain)):
            return self._again(point)
        return point

    def _again(self, point: ClimbPoint) -> ClimbPoint:
        """A point by further simulations."""
        (more,) = self._moves([point.at], MORE, len(point.moves))
        return self._point(point.at, np.vstack([point.moves, more]))

    def _point(self, at: np.ndarray, moves: np.ndarray) -> ClimbPoint:
        move = cleared(moves, self.fitted.reference.null_scale)
        gain = self.law.log_likelihood(self.fitted.residual - move) - self.nothing
        return ClimbPoint(at, gain, move, moves)

    def _noise(self, moves: np.ndarray) -> float:
        """Loss of log likelihood by the noise of the mean of some shifts (twins, statistics)."""
        return 0.5 * float((self.law.white(moves - moves.mean(0)) ** 2).sum()) / (len(moves) - 1) / len(moves)

    def _moves(self, points: Sequence[np.ndarray], twins: int, done: int = 0) -> np.ndarray:
        """(points, twins - done, statistics) shifts, by the simulations from number `done` on."""
        cameras = [moved(self.camera, self.coordinates, list(at)) for at in points]
        values = self.lab.finding([(camera, k) for camera in cameras for k in range(done, twins)])
        if len(self.base) < twins:
            more = range(len(self.base), twins)
            self.base = np.vstack([self.base, self.lab.finding([(self.fitted.camera, k) for k in more])])
        return values.reshape(len(points), twins - done, -1) - self.base[done:twins]

    def _within(self, at: np.ndarray) -> np.ndarray:
        """The nearest point within the bounds of the camera's parameters."""
        camera = moved(self.camera, self.coordinates, list(at))
        return np.array([c.read(camera) for c in self.coordinates])


def newton(design: np.ndarray, left: np.ndarray, priors: np.ndarray) -> np.ndarray:
    """Gauss-Newton step (coordinates,).

    Derivatives of random effects are noisy, and their noise shortens the step (regression dilution). Therefore only products
    of different twins, whose noise is independent, enter the normal matrix.

    Args:
        design: (coordinates, twins, statistics), derivatives, whitened.
        left: (twins, statistics), residuals, whitened.
    """
    twins, wide = len(left), np.diag(1 / priors**2)
    whole, total = design.sum(1), left.sum(0)
    if twins < MORE:  # too few to tell the noise
        return np.linalg.solve(whole @ whole.T / twins**2 + wide, whole @ total / twins**2)
    own = np.einsum("itn,jtn->ij", design, design)
    pairs = twins * (twins - 1)
    curvature = (whole @ whole.T - own) / pairs
    pull = (whole @ total - np.einsum("itn,tn->i", design, left)) / pairs
    share, ways = eigh(curvature + wide, own / twins + wide)
    return ways @ ((ways.T @ pull) / np.clip(share, LEAST_SHARE, 1.0))  # pyrefly: ignore[missing-attribute]
