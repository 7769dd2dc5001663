"""The measured frames and a model's, through the same fingerprint."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Literal

import numpy as np

from visaug.camera import Camera
from visaug.characterization.alarms import all_warnings, found_by_checks
from visaug.core.errors import InputError
from visaug.core.sampling import as_seed
from visaug.diagnosis import store
from visaug.diagnosis.names import Names
from visaug.diagnosis.part import MeasuredFrames, parts_of
from visaug.diagnosis.spread import Job, Spread, Work, on_this_machine
from visaug.diagnosis.unknown_light import UnmeasuredLight
from visaug.frames import FrameSet
from visaug.pictures.part import PicturePart, picture_part
from visaug.statistics import Fingerprint, Statistic
from visaug.statistics.order import history_warnings
from visaug.statistics.split import CONFIRM, FIND, WHOLE
from visaug.statistics.subsample import select

READ_NOISE_E = 1.5  # of a camera for which the strengths that effects name to try are made: 0.1 to 1 times the read noise
SAVED = 32  # simulated sets that are written to the store at a time


class Laboratory:
    """Simulates sets of the same plan as the measured one and takes their fingerprints.

    Of a large set it takes a share, `selection`: see `visaug.statistics.subsample`. `parts` are what is measured and
    simulated: the frames, or a window of them and some full frames beside. `frames` and `folds` are of the first part.
    `units`: by unit, what trial values of effects are multiplied by; empty for frames.
    `calibrated`: whether the set contains the photons of all its flats.

    Args:
        frames: the measured set.
        camera: fills in what the plan leaves open (the photons of flats with an uncalibrated source).
        seed: of all simulations; simulation k of one camera shares its random numbers with simulation k of another.
        folds: False takes all frames as ones that find, for a comparison in which nothing is fitted.
        spread: does the simulations, in order; the cores of this machine, or a cluster.
        report: called with (description, done, total) while frames are read.
        transfer: of ordinary pictures, how their values follow from light.
        scenes: other pictures of such scenes as ordinary pictures show.

    Raises:
        InputError: `transfer` is another word.
    """

    def __init__(
        self,
        frames: FrameSet,
        camera: Camera,
        seed: int = 0,
        folds: bool = True,
        spread: Spread | None = None,
        report: Callable[[str, int, int], None] | None = None,
        transfer: Literal["linear", "srgb"] = "linear",
        scenes: FrameSet | None = None,
    ):
        self.seed = as_seed(seed)
        if transfer not in ("linear", "srgb"):
            raise InputError(f"{transfer!r} is not a choice", field="transfer", expected="linear or srgb")
        self.spread = spread or on_this_machine()
        self.sequences: tuple[int, ...]
        self.units: dict[str, float] = {}
        self._given: FrameSet | None = None
        self._of_reading: tuple[str, ...] = ()
        if frames.is_pictures:
            self._of_pictures(frames, camera, transfer, scenes)
            return
        self._given = frames
        frames = frames.assuming_bits(camera.bit_depth)
        self.calibrated = all(r.photons is not None for r in frames.records if r.kind == "flat")
        checks = None if self.calibrated else found_by_checks(self._given)
        lights = {} if checks is None else checks.lights
        self.selection = select(_with_photons(frames, camera, (), lights))
        lit = _with_photons(frames, camera, self.selection.frames, lights)
        unknown = frozenset(r.sequence for r in frames.records if r.kind == "flat" and r.photons is None)
        self.parts: tuple[MeasuredFrames | PicturePart, ...] = parts_of(
            lit, self.selection, folds, report, unknown
        )
        self.frames, self.folds = self.parts[0].frames, self.parts[0].folds
        self.sequences = tuple(record.sequence for record in self.frames.records)

    def _of_pictures(
        self, frames: FrameSet, camera: Camera, transfer: Literal["linear", "srgb"], scenes: FrameSet | None
    ) -> None:
        warnings = list(frames.warnings)
        part, self.selection = picture_part(frames, camera, transfer, scenes, warnings.append)
        self._of_reading = tuple(warnings)
        self.calibrated, self.parts = False, (part,)
        self.frames, self.folds = part.frames, part.folds
        self.sequences = tuple(int(record.file) for record in self.frames.records)
        noise = max(camera.spec.read_noise.sigma_e / READ_NOISE_E, 1.0)
        second = 1 / max(camera.spec.exposure_s, 1e-6)
        self.units = {"e-": noise, "e-/s": second, "e-/px/s": second}

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Of reading the frames, of the checks of the measurement model, and of what was left out."""
        if self._given is None:
            return self._of_reading
        return (
            *all_warnings(self._given),
            *self.selection.left_out,
            *history_warnings(self._given.records),
        )

    @cached_property
    def measured(self) -> tuple[Fingerprint, Fingerprint, Fingerprint]:
        """Fingerprints of the discovery frames, of the hold-out frames, and of the whole set."""
        find, confirm, whole = (
            _joined([part.measured(use) for part in self.parts]) for use in (FIND, CONFIRM, WHOLE)
        )
        return find, confirm, whole

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        return self.measured[0].statistics

    @cached_property
    def views(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Number of the view of every statistic of the discovery frames, of the hold-out frames, and of the whole set."""
        find, confirm, whole = (
            np.unique([s.view for s in f.statistics], return_inverse=True)[1] for f in self.measured
        )
        return find, confirm, whole

    def whole_of(self, finding: np.ndarray) -> np.ndarray:
        """A shape (..., statistics) of the discovery frames, as one of the whole set: 0 where these have a statistic more."""
        place = self._place_in_finding
        return np.where(place >= 0, finding[..., place], 0.0)

    @cached_property
    def _place_in_finding(self) -> np.ndarray:
        """Of every statistic of the whole set, its place among those of the discovery frames; -1 where it has none."""
        find, _, whole = (f.statistics for f in self.measured)
        places = _places(find)
        return np.array([places.get(key, -1) for key in _places(whole)])

    def simulated(
        self, cameras: Sequence[tuple[Camera, int]], report: Callable[[int], None] | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fingerprints of simulated sets.

        Args:
            cameras: pairs of a camera and the number of the simulation.
            report: called with the number of sets done.

        Returns:
            (n, statistics) of the discovery frames, of the hold-out frames, and of the whole set.
        """
        results = self._run(cameras, report, (FIND, CONFIRM, WHOLE))
        find, confirm, whole = (np.array([result[k] for result in results]) for k in range(3))
        return find, confirm, whole

    def finding(
        self, cameras: Sequence[tuple[Camera, int]], report: Callable[[int], None] | None = None
    ) -> np.ndarray:
        """The same for the discovery frames only, in half the time: (n, statistics)."""
        return np.array([a for (a,) in self._run(cameras, report, (FIND,))])

    def _run(
        self, cameras: Sequence[Job], report: Callable[[int], None] | None, uses: Sequence[str]
    ) -> list[tuple[np.ndarray, ...]]:
        names = [self._names.of(camera, number, uses) for camera, number in cameras]
        found = store.load(names)
        todo = {name: job for name, job in zip(names, cameras, strict=True) if name not in found}
        # sets with the same number share random numbers and follow one another
        todo = dict(sorted(todo.items(), key=lambda entry: entry[1][1]))
        work = Work(self.parts_to_simulate, self.seed, tuple(uses))
        new: dict[str, tuple[np.ndarray, ...]] = {}
        known = len(names) - len(todo)
        try:
            for name, result in zip(todo, self.spread(work, list(todo.values())), strict=True):
                found[name] = new[name] = result
                known += 1
                if report is not None:
                    report(known)
                if len(new) == SAVED:
                    store.keep(new)
                    new.clear()
        finally:
            store.keep(new)
        return [found[name] for name in names]

    @cached_property
    def _names(self) -> Names:
        return Names([part.identity() for part in self.parts], self.seed)

    @cached_property
    def parts_to_simulate(self) -> tuple[MeasuredFrames | PicturePart, ...]:
        """The parts without the measured pixels: all that a simulation needs."""
        return tuple(part.without_pixels() for part in self.parts)


def _joined(found: Sequence[Fingerprint]) -> Fingerprint:
    """One fingerprint of several parts."""
    if len(found) == 1:
        return found[0]
    return Fingerprint(
        tuple(s for one in found for s in one.statistics), np.concatenate([one.values for one in found])
    )


def _places(statistics: Sequence[Statistic]) -> dict[tuple[str, str, str], int]:
    """Index of each statistic by its identity."""
    return {(s.view, s.name, s.frames): i for i, s in enumerate(statistics)}


def _with_photons(
    frames: FrameSet, camera: Camera, used: Sequence[int], lights: Mapping[int, int]
) -> FrameSet:
    """The set with the photons of uncalibrated flats taken from their level and the camera's dark current, gain and efficiency.

    The level is that of the frames in use; of conditions that are not used, that of one frame.

    Args:
        lights: number of the light of each flat, by sequence number, where a lamp was changed at one setting.
    """
    blank = [i for i, r in enumerate(frames.records) if r.kind == "flat" and r.photons is None]
    if not blank:
        return frames
    allowed = set(used)
    levels: dict[int, float] = {}
    for group in frames.groups():
        if group.kind == "flat" and group.photons is None:
            alike: dict[int | None, list[int]] = {}
            for i in group.indices:
                alike.setdefault(lights.get(frames.records[i].sequence), []).append(i)
            for same in alike.values():
                read = [i for i in same if i in allowed] or same[:1]
                level = float(np.mean([frames.read(i).mean(dtype=np.float64) for i in read]))
                under = group.exposure_s or 0.0, group.temperature_c, group.gain_db
                light = UnmeasuredLight(level, tuple(read), tuple(same), *under)
                levels |= dict.fromkeys(same, light.photons(camera))
    records = [replace(r, photons=levels[i]) if i in levels else r for i, r in enumerate(frames.records)]
    return frames.with_records(records)
