"""The measured frames and a model's, through the same fingerprint."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import torch

from visaug.camera import Camera
from visaug.comparison.selection import manageable
from visaug.errors import InputError
from visaug.fingerprint import Fingerprint, Statistic, fingerprint, fingerprint_values
from visaug.frames import FrameSet
from visaug.simulation import simulate

Job = tuple[Camera, int]
Work = Callable[[Job], tuple[np.ndarray, ...]]
Spread = Callable[[Work, Sequence[Job]], Iterable[tuple[np.ndarray, ...]]]


@dataclass(frozen=True)
class Folds:
    """Which frames do what, as positions in the set. Every group of equal conditions is shared out, never single pixels."""

    fit: tuple[int, ...]
    select: tuple[int, ...]
    confirm: tuple[int, ...]

    @property
    def find(self) -> tuple[int, ...]:
        """Frames that an effect is found on; the others only confirm it."""
        return tuple(sorted(self.fit + self.select))


def share_out(frames: FrameSet) -> Folds:
    """Of each group two frames in three find (one fits, one selects), the third confirms.

    Groups of one or two frames stay whole, or their temporal noise could not be seen: of a ladder of them every third confirms.
    A scene taken twice is found once and confirmed once.
    """
    fit: list[int] = []
    select: list[int] = []
    confirm: list[int] = []
    small: dict[str, int] = {}
    groups = frames.groups()
    ladder = {kind: sum(g.kind == kind and len(g.indices) < 3 for g in groups) for kind in ("dark", "flat")}
    for group in groups:
        members = sorted(group.indices)
        if len(members) >= 3:
            fit += members[::3]
            select += members[1::3]
            confirm += members[2::3]
        elif group.kind == "scene" and len(members) == 2:
            fit.append(members[0])
            confirm.append(members[1])
        else:
            place = small.setdefault(group.kind, 0)
            small[group.kind] += 1
            middle = 0 < place < ladder.get(group.kind, 0) - 1
            if middle and place % 3 == 1:
                confirm += members
            else:
                fit.append(members[0])
                select += members[1:]
    return Folds(tuple(sorted(fit)), tuple(sorted(select)), tuple(sorted(confirm)))


class Laboratory:
    """Simulates sets of the same plan as the measured one and takes their fingerprints.

    Of a large set it takes a share, see `manageable`; `selection` says which, None where it takes all.

    Args:
        frames: the measured set.
        camera: fills in what the plan leaves open (the photons of flats with an uncalibrated source).
        seed: of all simulations; simulation k of one camera shares its random numbers with simulation k of another.
        folds: False takes all frames as ones that find, for a comparison in which nothing is fitted.
        spread: does the simulations, in order; the threads of this machine, or a cluster.
    """

    def __init__(
        self,
        frames: FrameSet,
        camera: Camera,
        seed: int = 0,
        folds: bool = True,
        spread: Spread | None = None,
    ):
        if not any(record.kind != "image" for record in frames.records):
            raise InputError(
                "only pictures of which nothing is known",
                field="kind",
                expected="bias, dark, flat or scene frames to compare a camera with",
            )
        small, self.selection = manageable(frames)
        self.frames = _with_photons(small, camera)
        self.folds = share_out(self.frames) if folds else Folds(tuple(range(len(self.frames))), (), ())
        self.seed = seed
        self.spread = spread or by_threads

    @cached_property
    def measured(self) -> tuple[Fingerprint, Fingerprint, Fingerprint]:
        """Fingerprints of the measured frames that find, of those that confirm, and of the whole set."""
        find, confirm, whole = (fingerprint(self.frames, use) for use in self._uses)
        return find, confirm, whole

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        return self.measured[0].statistics

    def whole_of(self, finding: np.ndarray) -> np.ndarray:
        """A shape (..., statistics) of the frames that find, as one of the whole set: 0 where these have a statistic more."""
        place = self._place_in_finding
        return np.where(place >= 0, finding[..., place], 0.0)

    @cached_property
    def _place_in_finding(self) -> np.ndarray:
        """Of every statistic of the whole set, its place among those of the frames that find; -1 where it has none."""
        find, _, whole = (f.statistics for f in self.measured)
        places = _places(find)
        return np.array([places.get(key, -1) for key in _places(whole)])

    @cached_property
    def confirming(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the statistics that the frames that find and those that confirm both have: places among the one's and the other's."""
        find, confirm, _ = (_places(f.statistics) for f in self.measured)
        both = np.array([(find[key], i) for key, i in confirm.items() if key in find], int).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def simulated(
        self, cameras: Sequence[tuple[Camera, int]], report: Callable[[int], None] | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fingerprints of simulated sets.

        Args:
            cameras: pairs of a camera and the number of the simulation.
            report: called with the number of sets done.

        Returns:
            (n, statistics) of the frames that find, of those that confirm, and of the whole set.
        """
        results = self._run(cameras, report, self._uses)
        find, confirm, whole = (np.array([result[k] for result in results]) for k in range(3))
        return find, confirm, whole

    def finding(
        self, cameras: Sequence[tuple[Camera, int]], report: Callable[[int], None] | None = None
    ) -> np.ndarray:
        """The same for the frames that find alone, in half the time: (n, statistics)."""
        return np.array([a for (a,) in self._run(cameras, report, (self.folds.find,))])

    def _run(self, cameras, report, uses) -> list[tuple[np.ndarray, ...]]:
        results = []
        for result in self.spread(partial(fingerprints, self.plan, self.seed, uses), cameras):
            results.append(result)
            if report is not None:
                report(len(results))
        return results

    @cached_property
    def plan(self) -> FrameSet:
        """What was taken, without the pixels: all that a simulation needs."""
        records = self.frames.records
        cleans = {
            r.clean: self.frames.clean(i) for i, r in enumerate(records) if r.kind == "scene" and r.clean
        }
        unread = [np.zeros((1, 1), np.uint16)] * len(records)
        return FrameSet.from_arrays(records, unread, cleans, bit_depth=self.frames.bit_depth)

    @property
    def _uses(self) -> tuple[tuple[int, ...], ...]:
        return self.folds.find, self.folds.confirm, tuple(range(len(self.frames)))


def _places(statistics: Sequence[Statistic]) -> dict[tuple[str, str, str], int]:
    """Where each statistic stands, by its identity, in their order."""
    return {(s.view, s.name, s.frames): i for i, s in enumerate(statistics)}


def fingerprints(
    plan: FrameSet, seed: int, uses: Sequence[Sequence[int]], job: tuple[Camera, int]
) -> tuple[np.ndarray, ...]:
    """Of one simulated set: one array of values for each use of its frames."""
    camera, number = job
    frames = simulate(camera, plan, seed=seed * 1_000_003 + number)
    return tuple(fingerprint_values(frames, use) for use in uses)


def by_threads(work: Work, jobs: Sequence[Job]) -> Iterator[tuple[np.ndarray, ...]]:
    """The results in the order of the jobs, from the cores of this machine."""
    with _single_threads(), ThreadPoolExecutor(workers()) as pool:
        yield from pool.map(work, jobs)


def workers() -> int:
    """Sets that are simulated at a time."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _single_threads:
    """One torch thread a set: whole sets are what runs side by side."""

    def __enter__(self) -> None:
        self.before = torch.get_num_threads()
        torch.set_num_threads(1)

    def __exit__(self, *_: object) -> None:
        torch.set_num_threads(self.before)


def _with_photons(frames: FrameSet, camera: Camera) -> FrameSet:
    """The set with the photons of uncalibrated flats taken from their level and the camera's gain and efficiency."""
    blank = [i for i, r in enumerate(frames.records) if r.kind == "flat" and r.photons is None]
    if not blank:
        return frames
    levels: dict[int, float] = {}
    for group in frames.groups():
        if group.kind == "flat" and group.photons is None:
            level = float(np.mean([frames.read(i).mean(dtype=np.float64) for i in group.indices]))
            electrons = max(level - camera.spec.black_level_dn, 0.0) * camera.gain_at(group.gain_db)
            levels |= dict.fromkeys(group.indices, electrons / camera.spec.quantum_efficiency)
    records = [replace(r, photons=levels[i]) if i in levels else r for i, r in enumerate(frames.records)]
    return frames.with_records(records)
