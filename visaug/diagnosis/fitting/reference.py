"""Simulated sets of a camera: mean, variance, derivatives of the mean, and the residuals of their refits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.fitting.parameters import BLACK, WELL, Coordinate, is_stopped, linear_dn, moved
from visaug.diagnosis.fitting.robust import adjust, shrunk, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.statistics.distance import largest_of_each, least_spread, variance

PAIRS = 2  # simulated steps of a derivative, on alternate sides and with the random numbers of a simulated set each
MORE_PAIRS = 4  # of a derivative of which noise is much even with a step so many times as wide,
WIDER = 4.0
MOST_PAIRS = 16  # and at most, where other coordinates change nearly the same statistics
# Standard errors by which a derivative that is mostly noise, or a correlation, must differ from 0, and two standard deviations
# from each other, to count as two.
CERTAIN = 3.0
NOISY = 0.1  # share of noise in what tells a coordinate from which its derivative is simulated further
DARK = ("bias", "dark")  # frames whose bits show a shift of their level
FAR = 6.0  # steps of a coordinate beyond which the reference is simulated anew
FIRST = 60  # simulated sets whose spread tells the noise of a derivative
STAGES = (FIRST, 120, 200)  # simulated sets after each of which a test is asked whether it is decided

Report = Callable[[str, int, int], None]


@dataclass(frozen=True)
class SimulatedStatistics:
    """Simulated statistics of one use of the frames (discovery, hold-out, all).

    Attributes:
        sets: (R, statistics) fingerprints of simulated sets.
        slopes: (statistics, coordinates), derivatives of their means.
        least: (statistics,) lower limit of the standard deviation.
    """

    sets: np.ndarray
    slopes: np.ndarray
    least: np.ndarray

    @cached_property
    def mean(self) -> np.ndarray:
        return self.sets.mean(0)

    @cached_property
    def scale(self) -> np.ndarray:
        """(statistics,) standard deviations, at least `least`; 0 for a statistic that is constant."""
        return np.maximum(np.sqrt(variance(self.sets)), self.least)

    @cached_property
    def deviations(self) -> np.ndarray:
        """(R, statistics) each set minus the mean of the others."""
        count = len(self.sets)
        return (self.sets - self.mean) * (count / (count - 1))


@dataclass(frozen=True)
class Null:
    """Null distribution: residuals of a complete camera after a refit, for one use of the frames.

    Attributes:
        residuals: (R, statistics) of the simulated sets.
        floor: (statistics,) lower limit of the standard deviation; 0 for a statistic that is constant.
        slopes: (statistics, coordinates), derivatives of the means.
        priors: (coordinates,) standard deviations of the priors.
    """

    residuals: np.ndarray
    floor: np.ndarray
    slopes: np.ndarray
    priors: np.ndarray

    @cached_property
    def halves(self) -> dict[bytes, Any]:
        """Covariances of halves of the sets by the tolerance that they allow, see `each_half`."""
        return {}

    @cached_property
    def scale(self) -> np.ndarray:
        """(statistics,) standard deviations; 0 for a statistic that is constant."""
        return self.scale_of(len(self.residuals))

    def scale_of(self, count: int) -> np.ndarray:
        """The same of the first sets alone."""
        return np.where(self.floor > 0, np.maximum(self.residuals[:count].std(0, ddof=1), self.floor), 0.0)

    @cached_property
    def correlation(self) -> np.ndarray:
        """Correlation matrix of the statistics that vary, see `shrunk`."""
        used = self.scale > 0
        return shrunk(self.residuals[:, used] / self.scale[used])

    @cached_property
    def largest(self) -> np.ndarray:
        """(R,) largest residual of each set, in standard deviations of the other sets."""
        return largest_of_each(self.residuals, self.floor)

    def beyond(self, moves: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
        """(statistics,) the part of a shift that the camera's parameters cannot reproduce, in standard deviations.

        A least-squares projection with the priors of the parameters.

        Args:
            moves: (statistics,) a shift.
            scale: standard deviations to use; this camera's if omitted.
        """
        scale = self.scale if scale is None else scale
        along, design = standardised(moves, scale), standardised(self.slopes.T, scale)
        normal = design @ design.T + np.diag(1 / self.priors**2)
        return along - design.T @ np.linalg.solve(normal, design @ along)


USES = ("find", "confirm", "whole")


@dataclass(frozen=True)
class Reference:
    """A camera with its simulated sets: mean, variance and derivatives with respect to each free parameter.

    Effects are selected on the discovery frames (`find`), their errors are reported on the hold-out frames (`confirm`), and
    the test whether anything is missing uses all frames (`whole`). Attributes without a prefix refer to the discovery frames.
    `is_erratic`: whether statistics were seen to answer a small step of a parameter by chance.
    `noise`: (coordinates,) squared standard error of each derivative in standard deviations, summed over the discovery
    statistics.
    """

    camera: Camera
    coordinates: tuple[Coordinate, ...]
    find: SimulatedStatistics
    confirm: SimulatedStatistics
    whole: SimulatedStatistics
    is_erratic: bool = field(default=False, kw_only=True)
    noise: np.ndarray | None = field(default=None, kw_only=True)

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
        """(R, coordinates) steps of the coordinates in refits of the simulated sets: their sampling distribution."""
        return adjust(self.find.deviations, self.slopes, self.scale, self.priors)

    def refitted(self, residuals: np.ndarray) -> np.ndarray:
        """(n, coordinates) steps in linear refits to residuals (n, statistics), as far as repeated steps of a fit would go."""
        return adjust(residuals, self.slopes, self.scale, self.priors, noise=self.noise)

    @cached_property
    def spread_steps(self) -> np.ndarray:
        """(R, coordinates) the same of the simulated sets, from which intervals are computed.

        `null_steps` are a least-squares fit by the derivatives as they are, noise included, and belong to the residuals.
        """
        return self.refitted(self.find.deviations)

    @cached_property
    def undetermined(self) -> np.ndarray:
        """(coordinates,) standard deviation that comes from the priors because the frames do not determine it."""
        return self.priors * np.sqrt((self._posterior**2).sum(1))

    @property
    def determined(self) -> np.ndarray:
        """(coordinates,) share of each that the frames determine and not its prior (D. MacKay, Neural Comput. 4 (1992) 415)."""
        return 1 - np.diag(self._posterior)

    @cached_property
    def _posterior(self) -> np.ndarray:
        """(coordinates, coordinates) posterior covariance, in units of the priors."""
        if not self.coordinates:
            return np.zeros((0, 0))
        design = standardised(self.slopes.T, self.scale) * self.priors[:, None]
        return np.linalg.inv(design @ design.T + np.eye(len(self.priors)))

    def _null_of(self, sample: SimulatedStatistics) -> Null:
        residuals = sample.deviations - self.null_steps @ sample.slopes.T
        return Null(residuals, least_spread(sample.scale, sample.least), sample.slopes, self.priors)

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
        """(statistics,) standard deviations of refitted residuals."""
        return self.null.scale

    @property
    def largest(self) -> np.ndarray:
        """(R,) largest standardised residual in all frames of each simulated set, after its refit."""
        return self.whole_null.largest

    @cached_property
    def largest_as_given(self) -> np.ndarray:
        return largest_of_each(self.find.deviations, least_spread(self.scale, self.find.least))


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
        known: reference of a similar camera, whose derivatives are reused except those of the full well, which changes where
            an effect adds noise, and of the black level, which bits answer otherwise at another level.
        begun: the same reference with fewer sets; these and its derivatives are reused.
    """
    if begun is None and sets > FIRST:
        begun = make_reference(lab, camera, coordinates, FIRST, report, known)
    label = f"simulating {sets} sets of the camera"
    done = 0 if begun is None else len(begun.sets)
    values = lab.simulated([(camera, k) for k in range(done, sets)], lambda n: report(label, done + n, sets))
    if begun is not None:
        find, confirm, whole = (
            replace(getattr(begun, use), sets=np.vstack([getattr(begun, use).sets, more]))
            for use, more in zip(USES, values, strict=True)
        )
        return replace(begun, find=find, confirm=confirm, whole=whole)
    taken = (
        {}
        if known is None
        else {c.path: k for k, c in enumerate(known.coordinates) if c.path not in (WELL, BLACK)}
    )
    old = [c for c in coordinates if c.path in taken]
    coordinates = old + [c for c in coordinates if c.path not in taken]
    slopes, noise = derivatives(
        lab, camera, coordinates, values, report, _of(known, [taken[c.path] for c in old])
    )
    least = [np.array([s.least_spread for s in f.statistics]) for f in lab.measured]
    samples = (SimulatedStatistics(*parts) for parts in zip(values, slopes, least, strict=True))
    is_erratic = known is not None and known.is_erratic
    return Reference(camera, tuple(coordinates), *samples, is_erratic=is_erratic, noise=noise)


Derivatives = tuple[
    list[np.ndarray], np.ndarray
]  # (statistics, coordinates) of each use, and their noise, see `Reference`


def _of(known: Reference | None, places: Sequence[int]) -> Derivatives | None:
    """Derivatives of some coordinates of a reference; None without one."""
    if known is None:
        return None
    noise = np.zeros(len(known.coordinates)) if known.noise is None else known.noise
    return [getattr(known, use).slopes[:, places] for use in USES], noise[places]


def derivatives(
    lab: Laboratory,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    sets: Sequence[np.ndarray],
    report: Report,
    known: Derivatives | None = None,
) -> Derivatives:
    """Derivatives of the mean statistics with common random numbers, and their noise.

    Noise in derivatives makes refits of simulated sets, and so the intervals, too narrow (regression dilution: W. A. Fuller,
    Measurement Error Models, 1987), by the more the less the statistics distinguish a coordinate from the others. Where noise is
    more than the share `NOISY` of this information, the derivative is simulated with a wider step, and then more often. One that
    stays mostly noise, since the random numbers of an effect change with the step, is 0 where it is within its noise.

    Args:
        sets: (R, statistics) of each use, simulated sets of the camera.
        known: derivatives of the first coordinates, of a similar camera; those that are too noisy here are simulated again.
    """
    slopes = [np.zeros((values.shape[1], len(coordinates))) for values in sets]
    noise = np.zeros(len(coordinates))
    if not coordinates:
        return slopes, noise
    given = 0 if known is None else len(known[1])
    if known is not None:
        noise[:given] = known[1]
        for own, there in zip(slopes, known[0], strict=True):
            own[:, :given] = there
    scale, priors = np.sqrt(variance(sets[0])), np.array([c.prior for c in coordinates])
    taken: dict[int, list[np.ndarray]] = {}  # (simulations, statistics) difference quotients of each use

    dark_levels = [
        i for i, s in enumerate(lab.statistics) if s.name == "mean" and s.view == "level" and s.kind in DARK
    ]
    reach_dn = linear_dn(camera)

    def wider(k: int) -> float:
        """A step so many times as wide, as far as it moves no dark level by more than bits are linear over."""
        most_dn = np.abs(slopes[0][dark_levels, k]).max(initial=0.0)
        narrow, wide = (coordinates[k].difference(width) for width in (1.0, WIDER))
        is_limited = coordinates[k].path != BLACK and most_dn > 0  # that of the black level is so by itself
        return min(wide, max(narrow, reach_dn / most_dn)) if is_limited else wide

    def take(steps: Mapping[int, float], numbers: range) -> None:
        found = differences(lab, camera, coordinates, steps, numbers, sets, report)
        for j, k in enumerate(steps):
            new = [quotients[j] for quotients in found]
            taken[k] = [np.vstack(both) for both in zip(taken[k], new, strict=True)] if numbers.start else new
            for own, quotients in zip(slopes, taken[k], strict=True):
                own[:, k] = quotients.mean(0)
            noise[k] = (standardised(_error(taken[k][0]), scale) ** 2).sum()

    def noisy() -> list[int]:
        design = standardised(slopes[0].T, scale)
        told = 1 / np.diag(np.linalg.inv(design @ design.T + np.diag(1 / priors**2)))
        return np.flatnonzero(noise > NOISY * told).tolist()

    if given < len(coordinates):
        take({k: coordinates[k].difference() for k in range(given, len(coordinates))}, range(PAIRS))
    most = min(MOST_PAIRS, len(sets[0]) // 2 * 2)
    wide = np.zeros(len(coordinates), int)  # simulations of each with the wider step
    while todo := [k for k in noisy() if wide[k] < most]:
        groups = {int(count): [k for k in todo if wide[k] == count] for count in np.unique(wide[todo])}
        for count, which in groups.items():
            further = range(count, min(max(2 * count, PAIRS), most))
            take({k: wider(k) for k in which}, further)
            wide[which] = further.stop
        answers = (standardised(slopes[0].T, scale) ** 2).sum(1)
        for k in todo:
            if wide[k] >= MORE_PAIRS and noise[k] > NOISY * answers[k]:
                for own, quotients, values in zip(slopes, taken[k], sets, strict=True):
                    own[:, k] = _certain(quotients, variance(values))
                noise[k] = 0.0
    return slopes, noise


def _error(quotients: np.ndarray) -> np.ndarray:
    """(statistics,) standard errors of the means of difference quotients (simulations, statistics).

    From means of a step upwards and one downwards, in which a curvature cancels; of two simulations from the two themselves.
    """
    each = quotients.reshape(-1, 2, quotients.shape[1]).mean(1) if len(quotients) > 2 else quotients
    return each.std(0, ddof=1) / np.sqrt(len(each))


def _certain(quotients: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Means of difference quotients (simulations, statistics), 0 where they are within `CERTAIN` standard errors.

    The noise of a thousand statistics would outweigh the few that answer. Few simulations do not tell the noise of one
    statistic; all together do.

    Args:
        spread: (statistics,) variances of simulated sets.
    """
    mean, noise = quotients.mean(0), _error(quotients) ** 2
    share = np.divide(noise, spread, out=np.zeros_like(noise), where=spread > 0).mean()
    return np.where(mean**2 > CERTAIN**2 * np.maximum(noise, share * spread), mean, 0.0)


def differences(
    lab: Laboratory,
    camera: Camera,
    coordinates: Sequence[Coordinate],
    steps: Mapping[int, float],
    numbers: range,
    sets: Sequence[np.ndarray],
    report: Report,
) -> list[np.ndarray]:
    """(steps, simulations, statistics) difference quotients of each use of the frames, or of the discovery frames alone.

    Each is between a simulated set and the same with a step of one coordinate, upwards for even numbers and downwards for odd
    ones, so that a curvature cancels in their mean; at a bound of a parameter all steps are away from it.

    Args:
        coordinates: all that are free; the others are held at their values, which for those in DN depend on the gain.
        steps: of the coordinates that are stepped, by index.
        sets: simulated sets of the camera, of each use or of the first alone.
    """
    at = np.array([c.read(camera) for c in coordinates])

    def stepped(j: int, size: float) -> Camera:
        there = at.copy()
        there[j] += size
        return moved(camera, coordinates, there.tolist())

    signed = np.array([[step * (1 - 2 * (k % 2)) for k in numbers] for step in steps.values()])
    jobs = []
    for row, j in enumerate(steps):
        for column, number in enumerate(numbers):
            there = stepped(j, signed[row, column])
            if is_stopped(coordinates[j], there, at[j] + signed[row, column]):  # by a bound
                signed[row, column] *= -1
                there = stepped(j, signed[row, column])
                signed[row, column] = (
                    coordinates[j].read(there) - at[j] or signed[row, column]
                )  # by both bounds
            jobs.append((there, number))
    word = "computing sensitivities"

    def tick(done: int) -> None:
        report(word, done, len(jobs))

    found = lab.simulated(jobs, tick) if len(sets) > 1 else [lab.finding(jobs, tick)]
    return [
        (values.reshape(*signed.shape, -1) - own[numbers.start : numbers.stop]) / signed[..., None]
        for values, own in zip(found, sets, strict=True)
    ]


def is_far(reference: Reference, camera: Camera, steps: float = FAR) -> bool:
    """Whether a refitted camera is outside the region in which the variance and derivatives of its reference are valid."""
    return bool(far_coordinates(reference, camera, steps))


def far_coordinates(reference: Reference, camera: Camera, steps: float = FAR) -> set[str]:
    """Paths of the coordinates in which a refitted camera is more than so many steps from its reference."""
    return {
        c.path
        for c in reference.coordinates
        if abs(c.read(camera) - c.read(reference.camera)) / c.step > steps
    }
