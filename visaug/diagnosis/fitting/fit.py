"""Refits a camera to measured statistics."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fitting.parameters import BLACK, WELL, is_stopped, moved
from visaug.diagnosis.fitting.reference import (
    USES,
    Reference,
    Report,
    far_coordinates,
    make_reference,
)
from visaug.diagnosis.fitting.robust import LIKELIHOOD, OUTLIER, added_by_noise, adjust, misfit, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.statistics import Statistic

STEPPED = 4  # simulations with common random numbers that follow the mean on the way,
CLOSELY = 16  # where a fit is followed closely,
TWINS = 6  # and where it ends, or as many as
LOST = 0.5  # log likelihood is to be lost by their noise at most
FAR_BLACK = 3.0  # steps of the black level after which it is first set by the bias frames' mean
PROMISED = 0.25  # log likelihood; a step for which the derivatives promise less is not simulated
ITERATIONS = 12
NOISY = 0.1  # `Fitted.noise` from which sets are simulated anew
UNKEPT = 2.0  # log likelihood; a fit ends at a step that promised less and makes the rest larger,
DAMPED_OUT = 100.0  # or when steps are shortened so much
BENT = 5.0  # standard deviations of a fit between two cameras that may be of two minima
OFF_BLACK = 5.0  # standard deviations of the bias frames' mean from which a fit begins again at their level


@dataclass(frozen=True)
class Fitted:
    """A camera refitted to the discovery frames.

    Attributes:
        reference: simulated sets that give the variance.
        camera: the refitted camera.
        residual, confirm_residual, whole_residual: measured minus the refitted camera's mean, per statistic of the discovery
            frames, the hold-out frames and all frames.
        noise: variance that following the mean from the reference to the camera adds to residuals, as a share of their own.
            Lost bits answer a step by chance, so that a few sets with common random numbers do not tell it.
        simulation_error: (coordinates,) standard error of the fit that this noise causes.
        by_considered: (coordinates,) the same by parameters that are not fitted, see `visaug.diagnosis.considered`.
        response: (coordinates,) how far the fit follows a true change of each parameter, see `visaug.diagnosis.response`.
    """

    reference: Reference
    camera: Camera
    residual: np.ndarray
    confirm_residual: np.ndarray
    whole_residual: np.ndarray
    noise: float = 0.0
    simulation_error: np.ndarray | float = 0.0
    by_considered: np.ndarray | float = 0.0
    response: np.ndarray | float = 1.0

    @classmethod
    def unfitted(cls, lab: Laboratory, reference: Reference) -> "Fitted":
        """A camera with its parameters as they are."""
        means = (getattr(reference, use).mean for use in USES)
        left = (f.values - mean for f, mean in zip(lab.measured, means, strict=True))
        return cls(reference, reference.camera, *left)

    @cached_property
    def z(self) -> np.ndarray:
        """Residuals in standard deviations of refitted sets of the camera; 0 for a statistic that is constant."""
        return standardised(self.residual, self.reference.null_scale)

    @property
    def residuals(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the discovery, the hold-out and all frames."""
        return self.residual, self.confirm_residual, self.whole_residual

    @property
    def slopes(self) -> np.ndarray:
        return self.reference.slopes

    @property
    def misfit(self) -> float:
        """The objective function of the fit; comparable between cameras with the same reference."""
        return misfit(self.residual, self.reference.scale)


def refit(
    lab: Laboratory,
    reference: Reference,
    report: Report,
    begin: Camera | None = None,
    iterations: int = ITERATIONS,
    known: Fitted | None = None,
) -> Fitted:
    """Fits the reference's coordinates to the discovery frames.

    The mean is followed by simulations that share their random numbers with the reference's first sets. The mean of the bias
    frames is the only statistic that determines the black level. A robust fit that rejects it as an outlier does not recover,
    so the fit is repeated from the measured bias level where it deviates.

    Args:
        begin: a camera similar to the reference's from which to start; the reference's own if omitted.
        known: the fit from another start; returned if a step from this one leads to the same minimum.
    """
    fitted = _descended(lab, reference, report, begin, iterations, known)
    if fitted is known:
        return fitted
    camera = _at_bias_level(lab, fitted)
    if camera is None:
        return fitted
    again = _descended(lab, reference, report, camera, iterations)
    return min(fitted, again, key=lambda f: f.misfit)


def settled(
    lab: Laboratory, fitted: Fitted, sets: int, report: Report, near: Reference | None = None
) -> Fitted:
    """A fit; if it is far from its reference, or noisy, the sets and derivatives are simulated anew at its end.

    Args:
        near: reference of the camera without what was added last. Where only that moved far, its derivatives are reused.
    """
    far, is_noisy = far_coordinates(fitted.reference, fitted.camera), fitted.noise >= NOISY
    if not far and not is_noisy:
        return fitted
    known = None if near is None or is_noisy or far & {c.path for c in near.coordinates} else near
    anew = make_reference(lab, fitted.camera, fitted.reference.coordinates, sets, report, known)
    return refit(lab, replace(anew, is_erratic=True) if is_noisy else anew, report)


def followed(lab: Laboratory, fitted: Fitted, report: Report) -> Fitted:
    """A fit that goes on with more simulations where its derivatives promise a better one.

    Few simulations add noise to the objective function everywhere but at the reference, so that a fit stays near it where
    the frames hardly tell two parameters apart. Here that noise is subtracted.
    """
    reference = fitted.reference
    offset = np.array([c.read(fitted.camera) - c.read(reference.camera) for c in reference.coordinates])
    (step,) = adjust(
        fitted.residual[None],
        reference.slopes,
        reference.scale,
        reference.priors,
        offset,
        noise=reference.noise,
    )
    if _promised(reference, fitted.residual, step, True) < UNKEPT:
        return fitted
    return _descended(lab, reference, report, fitted.camera, closely=True)


def is_apart(reference: Reference, camera: Camera, at: np.ndarray) -> bool:
    """Whether a camera is more than `BENT` standard deviations of a fit from coordinates."""
    away = np.abs([c.read(camera) for c in reference.coordinates] - at)
    return bool((away > BENT * reference.null_steps.std(0)).any())


def _descended(
    lab: Laboratory,
    reference: Reference,
    report: Report,
    begin: Camera | None,
    iterations: int = ITERATIONS,
    known: Fitted | None = None,
    closely: bool = False,
) -> Fitted:
    """The fit from one start.

    Args:
        closely: whether more simulations follow the mean, and what their noise adds to the objective function is subtracted.
            They are the last ones, whose noise is not that of the derivatives: with the same noise in both, the fit would
            follow the truth by less than it should.
    """
    measured = lab.measured[0].values
    coordinates, priors = list(reference.coordinates), reference.priors
    steps = np.array([c.step for c in coordinates])
    start = np.array([c.read(reference.camera) for c in coordinates])
    count = len(reference.sets)
    numbers = np.arange(max(count - CLOSELY, 0), count) if closely else np.arange(min(STEPPED, count))
    noise_of_slopes = np.zeros(len(start)) if reference.noise is None else reference.noise

    def met(there: Camera) -> tuple[float, np.ndarray, Camera, np.ndarray]:
        place, mean, by_noise = np.array([c.read(there) for c in coordinates]), reference.mean, 0.0
        if there is not reference.camera:
            moves = lab.finding([(there, int(k)) for k in numbers]) - reference.sets[numbers]
            mean = mean + moves.mean(0)
            if closely:
                noise = moves.var(0, ddof=1) / len(numbers)
                by_noise = added_by_noise(measured - mean, reference.scale, noise)
        return misfit(measured - mean, reference.scale) - by_noise, place, there, mean

    def point_at(place: np.ndarray) -> tuple[float, np.ndarray, Camera, np.ndarray]:
        return met(moved(camera, coordinates, place.tolist()))

    best = met(reference.camera if begin is None else begin)
    _, at, camera, mean = best
    damping, bends = 0.0, np.array([c.path == WELL for c in coordinates], bool)
    share = np.ones(len(start))

    def step_from(at: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """The step within the bounds: a coordinate that would leave them stops there, and the others are fitted without it."""
        step, free = np.zeros(len(at)), np.full(len(at), True)
        while free.any():
            left = (measured - mean - reference.slopes @ step)[None]
            own, offset = reference.slopes[:, free], (at - start)[free]
            step[free] = adjust(
                left, own, reference.scale, priors[free], offset, damping, noise=noise_of_slopes[free]
            )[0]
            step[free] = (share * np.clip(step, -0.6 * priors, 0.6 * priors))[free]
            there = moved(camera, coordinates, list(at + step))
            beyond = at + step - [c.read(there) for c in coordinates]
            farthest = int(np.abs(beyond / steps).argmax())
            if not free[farthest] or not is_stopped(coordinates[farthest], there, (at + step)[farthest]):
                break
            step[farthest] -= beyond[farthest]
            free[farthest] = False
            step[free] = 0.0
        return step

    for i in range(iterations):
        left, promised = measured - mean, np.inf
        step = _to_bias_level(lab, reference, left) if i == 0 else None
        if step is None:
            step = step_from(at, mean)
            promised = _promised(reference, left, step, closely)
            if promised < PROMISED:
                break
        if known is not None and not is_apart(reference, known.camera, at + step):
            return known
        report("refitting the camera", i, iterations)
        there = point_at(at + step)
        if there[0] >= best[0]:  # a long step along a curved valley needs a second one, back to its floor
            there = point_at(there[1] + step_from(there[1], there[3]))
        if there[0] < best[0]:
            best = there
            _, at, camera, mean = best
            damping = 0.1 * damping if damping > 0.02 else 0.0
            share = np.minimum(2 * share, 1.0)
        else:  # too far where statistics bend
            _, at, camera, mean = best
            if bends.any() and share.min() > 0.05 and np.abs(step[bends] / steps[bends]).max() > 0.1:
                share[bends] *= (
                    0.25  # a flat below the full well may be clipped after the step, which no derivative shows
                )
            elif promised < UNKEPT:
                damping = 2 * DAMPED_OUT
            else:
                damping = max(10 * damping, 0.1)  # more along what the statistics tell well
        if damping > DAMPED_OUT:
            break
    if np.any(share[bends] < 1):  # by itself, for it may have been held for what other numbers did
        _, at, camera, mean = best
        left, own = (measured - mean)[None], reference.slopes[:, bends]
        step = np.zeros(len(at))
        step[bends] = adjust(left, own, reference.scale, priors[bends], (at - start)[bends])[0]
        alone = point_at(at + np.clip(step, -0.6 * priors, 0.6 * priors))
        best = min(best, alone, key=lambda fit: fit[0])
    _, at, camera, _ = best
    means, noise, error = _means_at(
        lab, reference, camera, numbers if closely else np.arange(min(TWINS, count))
    )
    last = step_from(at, means[0])  # what the derivatives still promise; damped where a longer step was worse
    camera = moved(camera, coordinates, list(at + last)) if coordinates else camera
    left = (
        f.values - mean - getattr(reference, use).slopes @ last
        for f, mean, use in zip(lab.measured, means, USES, strict=True)
    )
    return Fitted(reference, camera, *left, noise=noise, simulation_error=error)


def _promised(reference: Reference, left: np.ndarray, step: np.ndarray, closely: bool) -> float:
    """Log likelihood that a step of the coordinates gains by the derivatives.

    Args:
        left: residuals before it.
        closely: whether what noise of the derivatives adds to the residuals after it is subtracted.
    """
    less = misfit(left, reference.scale) - misfit(left - reference.slopes @ step, reference.scale)
    noise = reference.noise if closely and reference.noise is not None else np.zeros(len(step))
    return LIKELIHOOD * (less + float((noise * step**2).sum()) / OUTLIER**2)


def _means_at(
    lab: Laboratory, reference: Reference, camera: Camera, numbers: np.ndarray
) -> tuple[list[np.ndarray], float, np.ndarray]:
    """Mean statistics of each use of the frames at a camera, with the random numbers of some of the reference's sets.

    Also the noise that this adds to residuals and to coordinates, see `Fitted`. More sets are simulated where the noise of
    these takes more than `LOST` of the log likelihood, unless it is so much that the reference is to be simulated anew.
    """
    samples = [getattr(reference, use) for use in USES]
    if camera is reference.camera:
        return [sample.mean for sample in samples], 0.0, np.zeros(len(reference.coordinates))

    def moved_by(these: np.ndarray) -> list[np.ndarray]:
        there = lab.simulated([(camera, int(k)) for k in these])
        return [values - sample.sets[these] for sample, values in zip(samples, there, strict=True)]

    def noise_of(moves: np.ndarray) -> np.ndarray:
        return standardised(moves.std(0, ddof=1) / np.sqrt(len(moves)), reference.scale) ** 2

    moves = moved_by(numbers)
    noise = noise_of(moves[0])
    wanted = math.ceil(len(numbers) * noise.sum() / 2 / LOST)
    more = np.setdiff1d(np.arange(len(reference.sets)), numbers)[: max(wanted - len(numbers), 0)]
    if more.size and noise.mean() < NOISY:
        moves = [np.vstack(both) for both in zip(moves, moved_by(more), strict=True)]
        noise = noise_of(moves[0])
    left = moves[0] - moves[0].mean(0)
    steps = reference.refitted(left).std(0, ddof=1) / np.sqrt(len(left))
    means = [sample.mean + own.mean(0) for sample, own in zip(samples, moves, strict=True)]
    return means, float(noise.mean()), steps


def _to_bias_level(lab: Laboratory, reference: Reference, left: np.ndarray) -> np.ndarray | None:
    """The step that brings the black level to the mean of the bias frames, if that is far; else None.

    Bits and codes change periodically with the black level, so a robust fit cannot step across many DN.
    """
    told = _black_level(lab, reference)
    if told is None or abs(left[told.level]) < FAR_BLACK * reference.coordinates[told.black].step:
        return None
    step = np.zeros(len(reference.coordinates))
    step[told.black] = left[told.level]
    return step


def _at_bias_level(lab: Laboratory, fitted: Fitted) -> Camera | None:
    """The camera with the black level at the mean of the bias frames, if that deviates; else None."""
    told = _black_level(lab, fitted.reference)
    if told is None or abs(fitted.z[told.level]) < OFF_BLACK:
        return None
    coordinate = fitted.reference.coordinates[told.black]
    return moved(fitted.camera, [coordinate], [coordinate.read(fitted.camera) + fitted.residual[told.level]])


class _BlackLevel(NamedTuple):
    level: int  # the statistic that is the mean of the bias frames
    black: int  # the coordinate that is the black level, which moves the mean by 1 DN each


def _black_level(lab: Laboratory, reference: Reference) -> _BlackLevel | None:
    """Places of the black level; None without bias frames, or if the black level is not free."""
    level = bias_level(lab.statistics)
    black = next((k for k, c in enumerate(reference.coordinates) if c.path == BLACK), None)
    if level is None or black is None:
        return None
    return _BlackLevel(level, black)


def bias_level(statistics: Sequence[Statistic]) -> int | None:
    """Index of the statistic that is the mean level of the bias frames; None if there are none."""
    for i, s in enumerate(statistics):
        if (s.view, s.name, s.kind) == ("level", "mean", "bias"):
            return i
    return None
