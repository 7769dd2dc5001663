"""A camera's own simulated sets: their mean, their spread, how the mean answers each number, and what a refit of them leaves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from visaug.camera import Camera
from visaug.comparison.distance import variance
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.parameters import WELL, Coordinate, moved
from visaug.diagnosis.robust import adjust, drawn_to_zero, standardised

PAIRS, MORE_PAIRS = (
    3,
    8,
)  # simulations with common random numbers for each side of a derivative, and of one that noise is much of:
NOISY = 0.05  # from this share of it on
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
    all frames together, `whole`. Without a word it is the discovery frames.
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
        """Of the discovery frames."""
        return self._null_of(self.find)

    @cached_property
    def confirm_null(self) -> Null:
        """Of the hold-out frames."""
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
        scale: (statistics,) standard deviations of the discovery frames.
    """
    if not coordinates:
        return [np.zeros((len(f.values), 0)) for f in lab.measured]
    pairs = differences(lab, camera, coordinates, range(PAIRS), report)
    answers = standardised(pairs[0].mean(1), scale)
    noise = standardised(pairs[0].std(1, ddof=1), scale) / np.sqrt(PAIRS)
    noisy = np.flatnonzero((noise**2).sum(-1) > NOISY * (answers**2).sum(-1)).tolist()
    slopes = [found.mean(1) for found in pairs]
    if noisy:
        more = differences(lab, camera, [coordinates[k] for k in noisy], range(PAIRS, MORE_PAIRS), report)
        for slope, first, further in zip(slopes, pairs, more, strict=True):
            of = np.concatenate([first[noisy], further], axis=1)
            slope[noisy] = drawn_to_zero(of.mean(1), of.var(1, ddof=1) / MORE_PAIRS)
    return [slope.T for slope in slopes]


def differences(
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


def is_far(reference: Reference, camera: Camera, steps: float = FAR) -> bool:
    """Whether a refitted camera left the neighbourhood in which the reference's spread and derivatives hold."""
    moves = [abs(c.read(camera) - c.read(reference.camera)) / c.step for c in reference.coordinates]
    return max(moves, default=0.0) > steps
