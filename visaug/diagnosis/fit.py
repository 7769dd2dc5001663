"""Refitting a camera to measured statistics, and the spread of what is left under the camera itself."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from visaug.camera import Camera
from visaug.comparison.distance import variance
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.parameters import BLACK, WELL, Coordinate, moved
from visaug.fingerprint import Statistic

STEPPED, TWINS = (
    4,
    8,
)  # simulations with common random numbers that follow the mean on the way, and where it ends
PAIRS, MORE_PAIRS = 3, 8  # the same for each side of a derivative, and of one that noise is much of:
NOISY = 0.05  # from this share of it on
OUTLIER = 3.0  # residuals beyond so many standard deviations lose their pull on the fit (Cauchy weights)
FAR_BLACK = 3.0  # steps of the black level after which it is first set by the bias frames' mean
OFF_BLACK = 5.0  # standard deviations of the bias frames' mean from which a fit begins again at their level
FAR = 6.0  # steps of a coordinate after which the reference is made anew

Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Sample:
    """What simulations say of one use of the frames.

    Attributes:
        sets: (R, statistics) fingerprints of simulated sets.
        slopes: (statistics, coordinates), derivatives of their means.
        least: (statistics,) spread below which none is taken seriously.
    """

    sets: np.ndarray
    slopes: np.ndarray
    least: np.ndarray

    @cached_property
    def mean(self) -> np.ndarray:
        return self.sets.mean(0)

    @cached_property
    def scale(self) -> np.ndarray:
        """Standard deviations; never below what is taken seriously; 0 for a statistic that never varies."""
        return np.maximum(np.sqrt(variance(self.sets)), self.least)

    @cached_property
    def deviations(self) -> np.ndarray:
        """Each set less the mean of the others."""
        count = len(self.sets)
        return (self.sets - self.mean) * (count / (count - 1))


@dataclass(frozen=True)
class Null:
    """What a camera that lacks nothing leaves in one use of the frames, refitted.

    Attributes:
        residuals: (R, statistics) of the simulated sets.
        floor: (statistics,) standard deviations below which none is taken; 0 for a statistic that never varies.
        slopes: (statistics, coordinates).
        priors: (coordinates,)
    """

    residuals: np.ndarray
    floor: np.ndarray
    slopes: np.ndarray
    priors: np.ndarray

    @cached_property
    def scale(self) -> np.ndarray:
        """(statistics,) standard deviations; 0 for a statistic that never varies."""
        return np.where(self.floor > 0, np.maximum(self.residuals.std(0, ddof=1), self.floor), 0.0)

    @cached_property
    def largest(self) -> np.ndarray:
        """(R,) the largest residual of each set in standard deviations of the others: a set does not widen its own measure."""
        squares = self.residuals**2
        others = np.sqrt((squares.sum(0) - squares) / max(len(squares) - 2, 1))
        scale = np.where(self.floor > 0, np.maximum(others, self.floor), 0.0)
        return np.abs(standardised(self.residuals, scale)).max(1)

    def beyond(self, moves: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
        """What the camera's own numbers cannot do of some moves (statistics,), in standard deviations.

        Least squares, with the numbers' priors.

        Args:
            scale: standard deviations to go by; this camera's where left out.
        """
        scale = self.scale if scale is None else scale
        along, design = standardised(moves, scale), standardised(self.slopes.T, scale)
        normal = design @ design.T + np.diag(1 / self.priors**2)
        return along - design.T @ np.linalg.solve(normal, design @ along)


USES = ("find", "confirm", "whole")


@dataclass(frozen=True)
class Reference:
    """A camera with its own simulated sets: their mean, their spread, and how the mean answers each free number.

    Effects are found on the frames of `find`, their errors told on those of `confirm`; whether anything is missing is asked of
    all frames together, `whole`. Without a word it is the frames that find.
    """

    camera: Camera
    coordinates: tuple[Coordinate, ...]
    find: Sample
    confirm: Sample
    whole: Sample

    def arrays(self) -> dict[str, np.ndarray]:
        """All that was simulated, by name, and the paths of the coordinates in their order."""
        simulated = {
            f"{use}_{part}": getattr(getattr(self, use), part)
            for use in USES
            for part in ("sets", "slopes", "least")
        }
        return {**simulated, "paths": np.array([c.path for c in self.coordinates], str)}

    @classmethod
    def from_arrays(
        cls, camera: Camera, coordinates: Sequence[Coordinate], arrays: dict[str, np.ndarray]
    ) -> "Reference":
        """From what `arrays` gave."""
        samples = (Sample(*(arrays[f"{use}_{part}"] for part in ("sets", "slopes", "least"))) for use in USES)
        by_path = {c.path: c for c in coordinates}
        return cls(camera, tuple(by_path[path] for path in arrays["paths"]), *samples)

    @property
    def sets(self) -> np.ndarray:
        return self.find.sets

    @property
    def mean(self) -> np.ndarray:
        return self.find.mean

    @property
    def scale(self) -> np.ndarray:
        return self.find.scale

    @property
    def slopes(self) -> np.ndarray:
        return self.find.slopes

    @property
    def priors(self) -> np.ndarray:
        return np.array([c.prior for c in self.coordinates])

    @cached_property
    def null_steps(self) -> np.ndarray:
        """(R, coordinates) how far refitting moves each simulated set: the uncertainty of the coordinates."""
        return adjust(self.find.deviations, self.slopes, self.scale, self.priors)

    @cached_property
    def untold(self) -> np.ndarray:
        """(coordinates,) standard deviation of what the frames leave to the priors: refitted sets of the camera do not show it."""
        if not self.coordinates:
            return np.zeros(0)
        design = standardised(self.slopes.T, self.scale) * self.priors[:, None]
        gain = np.linalg.inv(design @ design.T + np.eye(len(self.priors)))
        return self.priors * np.sqrt((gain**2).sum(1))

    def _null_of(self, sample: Sample) -> Null:
        residuals = sample.deviations - self.null_steps @ sample.slopes.T
        floor = np.where(sample.scale > 0, np.maximum(0.3 * sample.scale, sample.least), 0.0)
        return Null(residuals, floor, sample.slopes, self.priors)

    @cached_property
    def null(self) -> Null:
        """Of the frames that find."""
        return self._null_of(self.find)

    @cached_property
    def confirm_null(self) -> Null:
        """Of the frames that confirm."""
        return self._null_of(self.confirm)

    @cached_property
    def whole_null(self) -> Null:
        """Of all frames."""
        return self._null_of(self.whole)

    @property
    def null_scale(self) -> np.ndarray:
        """Standard deviations of refitted residuals."""
        return self.null.scale

    @property
    def largest(self) -> np.ndarray:
        """(R,) the largest standardised residual in all frames of each simulated set, refitted."""
        return self.whole_null.largest

    @cached_property
    def largest_as_given(self) -> np.ndarray:
        return np.abs(standardised(self.find.deviations, self.scale)).max(1)


def standardised(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0)


def drawn_to_zero(mean: np.ndarray, squared_error: np.ndarray) -> np.ndarray:
    """Means over simulations, less of each as it is no more than its standard error."""
    noise = np.divide(squared_error, mean**2, out=np.ones_like(mean), where=mean != 0)
    return mean * np.maximum(1 - noise, 0)


def p_value(largest: float, null: np.ndarray) -> float:
    """p = (1 + #{max|r*| >= max|r|}) / (R + 1)."""
    return float((1 + np.count_nonzero(null >= largest)) / (len(null) + 1))


def make_reference(
    lab: Laboratory,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    sets: int,
    report: Report,
    known: Reference | None = None,
    begun: Reference | None = None,
) -> Reference:
    """Simulates `sets` sets and the derivatives.

    Args:
        known: of a neighbouring camera; the derivatives of its coordinates are taken over, but for the full well's: what a
            flat beside it answers is another thing once an effect adds noise there.
        begun: the same with fewer sets: these and its derivatives are taken over.
    """
    label = f"simulating {sets} sets of the camera"
    done = 0 if begun is None else len(begun.sets)
    values = lab.simulated([(camera, k) for k in range(done, sets)], lambda n: report(label, done + n, sets))
    if begun is not None:
        samples = [getattr(begun, use) for use in USES]
        return replace(
            begun,
            **{
                use: replace(sample, sets=np.vstack([sample.sets, more]))
                for use, sample, more in zip(USES, samples, values, strict=True)
            },
        )
    taken = {} if known is None else {c.path: k for k, c in enumerate(known.coordinates) if c.path != WELL}
    new = [c for c in coordinates if c.path not in taken]
    slopes = derivatives(lab, camera, new, report, np.sqrt(variance(values[0])))
    if known is not None:
        old = [c for c in coordinates if c.path in taken]
        kept = [taken[c.path] for c in old]
        slopes = [
            np.hstack([getattr(known, use).slopes[:, kept], s]) for use, s in zip(USES, slopes, strict=True)
        ]
        coordinates = old + new
    least = [np.array([s.least_spread for s in f.statistics]) for f in lab.measured]
    samples = (Sample(*parts) for parts in zip(values, slopes, least, strict=True))
    return Reference(camera, tuple(coordinates), *samples)


def derivatives(
    lab: Laboratory, camera: Camera, coordinates: Sequence[Coordinate], report: Report, scale: np.ndarray
) -> list[np.ndarray]:
    """Central differences of the mean statistics, with common random numbers: (statistics, coordinates) of each use.

    Where few pairs tell little, as of an effect whose random numbers a step draws anew, there are more, and what is no more than
    their noise is drawn to 0: a statistic that answers by chance would hold the number where it is.

    Args:
        scale: (statistics,) standard deviations of the frames that find.
    """
    if not coordinates:
        return [np.zeros((len(f.values), 0)) for f in lab.measured]
    pairs = _differences(lab, camera, coordinates, range(PAIRS), report)
    answers = standardised(pairs[0].mean(1), scale)
    noise = standardised(pairs[0].std(1, ddof=1), scale) / np.sqrt(PAIRS)
    noisy = np.flatnonzero((noise**2).sum(-1) > NOISY * (answers**2).sum(-1)).tolist()
    slopes = [found.mean(1) for found in pairs]
    if noisy:
        more = _differences(lab, camera, [coordinates[k] for k in noisy], range(PAIRS, MORE_PAIRS), report)
        for slope, first, further in zip(slopes, pairs, more, strict=True):
            of = np.concatenate([first[noisy], further], axis=1)
            slope[noisy] = drawn_to_zero(of.mean(1), of.var(1, ddof=1) / MORE_PAIRS)
    return [slope.T for slope in slopes]


def _differences(
    lab: Laboratory, camera: Camera, coordinates: Sequence[Coordinate], numbers: range, report: Report
) -> list[np.ndarray]:
    """(coordinates, pairs, statistics) difference quotients of each use, one pair of simulations for each random number."""
    at = [c.read(camera) for c in coordinates]
    jobs = []
    for j, coordinate in enumerate(coordinates):
        for sign in (1, -1):
            there = [x + sign * coordinate.step * (k == j) for k, x in enumerate(at)]
            jobs += [(moved(camera, coordinates, there), number) for number in numbers]
    steps = np.array([c.step for c in coordinates])[:, None, None]
    found = []
    for values in lab.simulated(
        jobs, lambda n: report("how statistics answer the camera's numbers", n, len(jobs))
    ):
        sides = values.reshape(len(coordinates), 2, len(numbers), -1)
        found.append((sides[:, 0] - sides[:, 1]) / (2 * steps))
    return found


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
    # in units of the priors: none but equal units can be compared
    design = slopes[used] / scale[used, None] * priors
    z = residuals[:, used] / scale[used]
    ridge = np.eye(len(priors))
    steps = np.zeros((len(z), design.shape[1]))
    for _ in range(iterations):
        left = np.abs(z - steps @ design.T)
        # where most statistics are off it is the camera's numbers that are; where few are, it is something else
        limit = np.maximum(OUTLIER, OUTLIER * np.median(left, axis=1, keepdims=True))
        weights = 1 / (1 + (left / limit) ** 2)
        normal = np.stack([(design * w[:, None]).T @ design for w in weights]) + ridge
        diagonal = np.einsum("nii->ni", normal)
        diagonal *= 1 + damping + 1e-12  # the last for numbers that these frames answer alike
        pull = (weights * z) @ design - offset / priors
        steps = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
    return steps * priors


@dataclass(frozen=True)
class Fitted:
    """A camera refitted to the frames that find.

    Attributes:
        reference: the simulated sets that give the spread.
        camera: the refitted camera.
        residual, confirm_residual, whole_residual: measured less the refitted camera's mean, per statistic.
    """

    reference: Reference
    camera: Camera
    residual: np.ndarray
    confirm_residual: np.ndarray
    whole_residual: np.ndarray

    @classmethod
    def unfitted(cls, lab: Laboratory, reference: Reference) -> "Fitted":
        """A camera as it is."""
        means = (getattr(reference, use).mean for use in USES)
        left = (f.values - mean for f, mean in zip(lab.measured, means, strict=True))
        return cls(reference, reference.camera, *left)

    @cached_property
    def z(self) -> np.ndarray:
        """Residuals in standard deviations of refitted sets of the camera itself; 0 for a statistic that never varies."""
        return standardised(self.residual, self.reference.null_scale)

    @property
    def slopes(self) -> np.ndarray:
        return self.reference.slopes

    @property
    def misfit(self) -> float:
        """What the fit lowers; of cameras with the same reference the lower one fits better."""
        return _misfit(self.residual, self.reference.scale)


def refit(
    lab: Laboratory,
    reference: Reference,
    report: Report,
    begin: Camera | None = None,
    iterations: int = 12,
) -> Fitted:
    """Fits the reference's coordinates to the frames that find.

    The mean follows the camera by simulations that share their random numbers with the reference's first sets. The mean of the bias
    frames is the one statistic that tells the black level: a robust fit that takes it for an outlier never comes back by itself, so
    that where it stands out the fit begins again from there.

    Args:
        begin: a camera near the reference's at which to begin; the reference's own where left out.
    """
    fitted = _descended(lab, reference, report, begin, iterations)
    camera = _at_bias_level(lab, fitted)
    if camera is None:
        return fitted
    again = _descended(lab, reference, report, camera, iterations)
    return min(fitted, again, key=lambda f: f.misfit)


def _descended(
    lab: Laboratory, reference: Reference, report: Report, begin: Camera | None, iterations: int
) -> Fitted:
    measured = lab.measured[0].values
    coordinates, priors = list(reference.coordinates), reference.priors
    steps = np.array([c.step for c in coordinates])
    start = np.array([c.read(reference.camera) for c in coordinates])
    twins = min(STEPPED, len(reference.sets))

    def mean_at(camera: Camera) -> np.ndarray:
        there = lab.finding([(camera, k) for k in range(twins)])
        return reference.mean + there.mean(0) - reference.sets[:twins].mean(0)

    at, camera, mean = start.copy(), reference.camera, reference.mean
    if begin is not None:
        at, camera, mean = np.array([c.read(begin) for c in coordinates]), begin, mean_at(begin)
    best = (_misfit(measured - mean, reference.scale), at, camera, mean)
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
        report("refitting the camera", i, iterations)
        mean = mean_at(camera)
        misfit = _misfit(measured - mean, reference.scale)
        if misfit < best[0]:
            best = (misfit, at, camera, mean)
            damping = 0.1 * damping if damping > 0.02 else 0.0
            share = np.minimum(2 * share, 1.0)
        else:  # too far where statistics bend
            _, at, camera, mean = best
            if bends.any() and share.min() > 0.05 and np.abs(step[bends] / steps[bends]).max() > 0.1:
                share[bends] *= (
                    0.25  # a flat that was below the full well may be cut by it: no derivative tells
                )
            else:
                damping = max(10 * damping, 0.1)  # more along what the statistics tell well
        if damping > 100:
            break
    _, at, camera, _ = best
    means = _means_at(lab, reference, camera)
    # what is left of a step is small, or was tried and found worse
    last = step_from(at, means[0]) if damping == 0 else np.zeros(len(at))
    camera = moved(camera, coordinates, list(at + last)) if coordinates else camera
    left = (
        f.values - mean - getattr(reference, use).slopes @ last
        for f, mean, use in zip(lab.measured, means, USES, strict=True)
    )
    return Fitted(reference, camera, *left)


def _means_at(lab: Laboratory, reference: Reference, camera: Camera) -> list[np.ndarray]:
    """Mean statistics of each use of the frames at a camera: simulations share their random numbers with the reference's first."""
    samples = [getattr(reference, use) for use in USES]
    if camera is reference.camera:
        return [sample.mean for sample in samples]
    twins = min(TWINS, len(reference.sets))
    there = lab.simulated([(camera, k) for k in range(twins)])
    return [
        sample.mean + values.mean(0) - sample.sets[:twins].mean(0)
        for sample, values in zip(samples, there, strict=True)
    ]


def _to_bias_level(lab: Laboratory, reference: Reference, left: np.ndarray) -> np.ndarray | None:
    """The step that brings the black level to the mean of the bias frames, where it is far from there; else None.

    Bits and codes follow the black level up and down, so that no step of a robust fit leads across many DN.
    """
    told = _black_step(lab, reference, left)
    if told is None or abs(left[told.level]) < FAR_BLACK * reference.coordinates[told.black].step:
        return None
    step = np.zeros(len(reference.coordinates))
    step[told.black] = told.step
    return step


def _at_bias_level(lab: Laboratory, fitted: Fitted) -> Camera | None:
    """The camera with the black level that the mean of the bias frames tells, where that stands out; else None."""
    told = _black_step(lab, fitted.reference, fitted.residual)
    if told is None or abs(fitted.z[told.level]) < OFF_BLACK:
        return None
    coordinate = fitted.reference.coordinates[told.black]
    return moved(fitted.camera, [coordinate], [coordinate.read(fitted.camera) + told.step])


class _BlackStep(NamedTuple):
    level: int  # the statistic that is the mean of the bias frames
    black: int  # the coordinate that is the black level
    step: float  # by which the one comes to where it was measured


def _black_step(lab: Laboratory, reference: Reference, left: np.ndarray) -> _BlackStep | None:
    """What the bias frames say of the black level; None without such frames, or where the black level is not free."""
    level = bias_level(lab.statistics)
    black = next((k for k, c in enumerate(reference.coordinates) if c.path == BLACK), None)
    if level is None or black is None:
        return None
    return _BlackStep(level, black, left[level] / max(reference.slopes[level, black], 0.5))


def bias_level(statistics: Sequence[Statistic]) -> int | None:
    """Which statistic is the mean level of the bias frames; None where there are none."""
    for i, s in enumerate(statistics):
        if (s.view, s.name, s.kind) == ("level", "mean", "bias"):
            return i
    return None


def _misfit(residual: np.ndarray, scale: np.ndarray) -> float:
    """What the robust fit lowers."""
    return float(np.log1p((standardised(residual, scale) / OUTLIER) ** 2).sum())


def is_far(reference: Reference, camera: Camera, steps: float = FAR) -> bool:
    """Whether a refitted camera left the neighbourhood in which the reference's spread and derivatives hold."""
    moves = [abs(c.read(camera) - c.read(reference.camera)) / c.step for c in reference.coordinates]
    return max(moves, default=0.0) > steps
