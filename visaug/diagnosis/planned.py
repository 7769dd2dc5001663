"""What a full plan of frames would show of effects, before any of its frames is taken."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from visaug.camera import Camera
from visaug.camera.paths import place_of
from visaug.camera.simulation import simulate, with_chart
from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean
from visaug.diagnosis.candidates.signatures import is_mostly_taken, strongest
from visaug.diagnosis.candidates.trials import Trial, leads, strength_of, trials
from visaug.diagnosis.fitting.parameters import Coordinate, base_coordinates, moved
from visaug.diagnosis.fitting.reference import Report, differences
from visaug.diagnosis.fitting.robust import adjust
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import MeasuredFrames
from visaug.diagnosis.verdict import Verdict
from visaug.frames import FrameSet
from visaug.frames.plan import default_plan
from visaug.statistics import Statistic, fingerprint

SETS = 6  # simulated sets of a camera
NULL_SETS = 24  # of the camera itself, for the scatter that a single set must exceed
POWER = 0.95  # probability with which an effect at its limit is shown
CLOSE = 1.3  # ratio of strengths that are shown and not shown at which a limit is known
SEEN = 3.0  # standard deviations of one set above which two cameras differ; the standard error of a mean of six sets is half of one
CLEAR = 2 * SEEN  # standard deviations from which an effect is shown
ALIKE = 0.9  # cosine of the differences by two effects above which these frames do not separate them
WINDOW = (128, 160)  # pixels of the sensor that are simulated
WORDS = {  # kinds of frames, the cheapest first
    "bias": "a stack of bias frames",
    "dark": "a series of dark frames over exposure and temperature",
    "flat": "flats over the whole range up to saturation, several at each level",
    "scene": "a test chart with edges and a small spot above saturation, several times, each followed by a dark frame",
}


@dataclass(frozen=True)
class Planned:
    """A camera and the statistics of a full plan of its frames.

    Args:
        camera: whose frames are planned.
        report: progress.
    """

    camera: Camera
    report: Report

    @cached_property
    def lab(self) -> Laboratory:
        return Laboratory(_plan(self.camera), self.camera, folds=False)

    @cached_property
    def example(self) -> FrameSet:
        """The frames of the plan as the camera would take them."""
        part = self.lab.parts[0]
        assert isinstance(part, MeasuredFrames)  # the plan has no pictures of unknown scenes
        return simulate(self.camera, part.plan)

    @cached_property
    def statistics(self) -> tuple[Statistic, ...]:
        return fingerprint(self.example).statistics

    @cached_property
    def kinds(self) -> np.ndarray:
        return np.array([s.kind for s in self.statistics])

    @cached_property
    def _sets(self) -> np.ndarray:
        return self.lab.finding([(self.camera, k) for k in range(SETS)])

    @cached_property
    def _free(self) -> list[Coordinate]:
        return base_coordinates(self.camera, self.lab.frames, calibrated=True)

    @cached_property
    def _slopes(self) -> np.ndarray:
        steps = {k: c.difference() for k, c in enumerate(self._free)}
        (found,) = differences(self.lab, self.camera, self._free, steps, range(2), [self._sets], self.report)
        return found.mean(1).T

    @cached_property
    def _null_spread(self) -> np.ndarray:
        more = self.lab.finding([(self.camera, k) for k in range(SETS, NULL_SETS)])
        return np.maximum(np.concatenate([self._sets, more]).std(0, ddof=1), self._least_spread)

    @cached_property
    def _least_spread(self) -> np.ndarray:
        return np.maximum([s.least_spread for s in self.statistics], 1e-9)

    def apart(self, cameras: Sequence[Camera], count: int = SETS) -> np.ndarray:
        """(cameras, statistics) differences from the camera in standard deviations of one set, after a refit of the camera.

        What the camera's parameters mostly take up is simulated again with these moved, see `is_mostly_taken`.
        """
        return self._apart(cameras, count)[0]

    def shown_by(self, cameras: Sequence[Camera]) -> list[tuple[str, ...]]:
        """The kinds of frames, the cheapest first, that show what each camera has more.

        In every simulated set some statistic of these frames differs by more than `CLEAR` standard deviations of the camera's
        own sets: single events must happen in each.
        """
        each = np.abs(self._apart(cameras, SETS)[1]) / self._null_spread
        largest = {kind: each[..., self.kinds == kind].max(-1, initial=0.0).min(-1) for kind in WORDS}
        return [tuple(kind for kind in WORDS if largest[kind][k] > CLEAR) for k in range(len(cameras))]

    def _apart(self, cameras: Sequence[Camera], count: int) -> tuple[np.ndarray, np.ndarray]:
        """The differences of `apart`, and those of each set, (cameras, sets, statistics) in the units of the statistics."""
        found, each, steps, again = self._differences(cameras, count)
        if again.any():
            places = np.flatnonzero(again).tolist()
            there = [self._without_what_is_taken(cameras[k], steps[k]) for k in places]
            found[places], each[places], *_ = self._differences(there, count)
        return found, each

    def _without_what_is_taken(self, camera: Camera, steps: np.ndarray) -> Camera:
        """A camera with its parameters moved back by the steps of a refit; those of an effect that it does not have stay out."""
        own = [(c, step) for c, step in zip(self._free, steps, strict=True) if c.path in camera.values()]
        return moved(camera, [c for c, _ in own], [c.read(camera) - step for c, step in own])

    def _differences(
        self, cameras: Sequence[Camera], count: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """See `_apart`; with the steps of the camera's parameters, and whether these take up most."""
        label, jobs = "frames that would show it", [(one, k) for one in cameras for k in range(count)]
        sets = self.lab.finding(jobs, lambda n: self.report(label, n, len(jobs)))
        own, priors = self._sets, np.array([c.prior for c in self._free])
        found, each, steps, again = [], [], [], []
        for others in sets.reshape(len(cameras), count, -1):
            spread = np.maximum(np.sqrt((own.var(0, ddof=1) + others.var(0, ddof=1)) / 2), self._least_spread)
            moves = others - own[:count]
            differ = moves.mean(0)
            step, *own_steps = adjust(np.vstack([differ, moves]), self._slopes, spread, priors)
            taken = self._slopes @ step
            found.append((differ - taken) / spread)
            each.append(moves - own_steps @ self._slopes.T)
            steps.append(step)
            again.append(is_mostly_taken(differ, differ - taken, spread))
        return np.array(found), np.array(each), np.array(steps), np.array(again)


def frames_that_show(cameras: Mapping[str, Camera], planned: Planned) -> dict[str, tuple[str, ...]]:
    """Of each camera with an effect, by name, the cheapest kind of frames in which it differs from the camera without it.

    Empty for an effect that no frames of the plan show at the strength that its camera has.
    """
    if not cameras:
        return {}
    apart = planned.apart(list(cameras.values()))
    return {name: _cheapest(planned, one) for name, one in zip(cameras, apart, strict=True)}


def _cheapest(planned: Planned, apart: np.ndarray) -> tuple[str, ...]:
    shown = {kind: np.abs(apart[planned.kinds == kind]).max(initial=0.0) > CLEAR for kind in WORDS}
    kind = next((kind for kind in WORDS if shown[kind]), None)
    return () if kind is None else (WORDS[kind],)


def before_frames(camera: Camera, names: Sequence[str], report: Report) -> list[Verdict]:
    """What a full plan of frames would show of effects: the smallest strength, the cheapest frames, and what looks alike.

    Raises:
        InputError: an effect that the camera has, or that a diagnosis does not try.
    """
    tried = trials(camera, only=frozenset(names))
    strong: dict[str, Trial] = {}
    for trial in tried:
        if trial.is_other_form or not leads(trial):
            continue
        path, strength = strength_of(camera, one := strongest(trial))
        known = strength_of(camera, strong.setdefault(trial.effect, one))
        if path == known[0] and strength > known[1]:
            strong[trial.effect] = one
    for name in names:
        if name not in strong:
            expected = f"one of {', '.join(sorted(strong))}"
            if name in camera.effect_names:
                problem = f"{camera.name} has {name} already"
            else:
                problem = f"{name} is not an effect that is tried" + did_you_mean(name, strong)
            raise InputError(problem, field="--for", expected=expected)
    planned = Planned(camera, report)
    apart = dict(zip(strong, planned.apart([t.on(camera) for t in strong.values()], 2), strict=True))
    found = []
    for name in names:
        trial, kinds = _weakest_shown(planned, [t for t in tried if t.effect == name], strong[name])
        path, _ = strength_of(camera, strong[name])
        unit = place_of(path).parameter.unit
        if trial is None:
            found.append(Verdict(name, "not testable", path, unit))
            continue
        value = dict(trial.values)[path]
        alike = tuple(
            other for other in strong if other != name and _cosine(apart[name], apart[other]) > ALIKE
        )
        word = "not separable" if alike else "absent"
        limit = value if camera.values().get(path, 0.0) else abs(value)
        limit = max(limit, least_of_events(planned.example, path, unit))
        frames = tuple(WORDS[kind] for kind in kinds[:1])
        found.append(Verdict(name, word, path, unit, limit=float(limit), others=alike, frames=frames))
    return found


def least_of_events(frames: FrameSet, path: str, unit: str) -> float:
    """The strength from which an effect that is a number of single events happens in these frames with a probability of 95 %.

    Whatever the size of an event, there is none with the probability exp(-n) where n are expected. 0 for other effects.
    """
    rows, columns = frames.shape(0)
    places = np.inf
    if unit == "share of pixels" or (unit == "fraction" and path.endswith(".density")):
        places = rows * columns
    elif unit == "1/(Mpx s)":
        places = 1e-6 * rows * columns * sum(r.exposure_s for r in frames.records)
    elif unit == "share of codes":
        places = len(set().union(*(np.unique(frames.read(i)).tolist() for i in range(len(frames)))))
    return float(-np.log(1 - POWER) / places) if places else np.inf


def _weakest_shown(
    planned: Planned, tried: Sequence[Trial], strong: Trial
) -> tuple[Trial | None, tuple[str, ...]]:
    """The weakest trial of an effect that the frames show, and the kinds of frames that do; None if they show none.

    Between a strength that is shown and one that is not the middle is tried, until they are close. An integer and a number that
    is not a strength have their trial values alone.
    """
    camera = planned.camera
    plain = [t for t in tried if not t.is_other_form]
    path, largest = strength_of(camera, strong)
    half = strong.times(0.5)
    if strong.is_fixed or not np.isclose(2 * strength_of(camera, half)[1], largest):
        steps = sorted(
            (t for t in plain if strength_of(camera, t)[0] == path), key=lambda t: strength_of(camera, t)[1]
        )
        kinds = planned.shown_by([t.on(camera) for t in steps])
        return next(((t, k) for t, k in zip(steps, kinds, strict=True) if k), (None, ()))
    high, low, trial = 1.0, 0.0, strong
    shown: tuple[Trial | None, tuple[str, ...]] = None, ()
    for _ in range(8):  # from 1 to 1e-6 in steps of 8 at most
        (kinds,) = planned.shown_by([trial.on(camera)])
        factor = strength_of(camera, trial)[1] / largest
        if kinds:
            high, shown = factor, (trial, kinds)
        else:
            low = factor
        if low == high or high < CLOSE * low:
            break
        trial = strong.times(np.sqrt(low * high) if low else high / 8)
        if not trial.fits(camera):
            break
    return shown


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return abs(float(a @ b)) / size if size else 0.0


def _plan(camera: Camera) -> FrameSet:
    """A full plan of frames in a central window of the sensor; its pixels are not used."""
    rows, columns = camera.resolution
    height, width = min(rows, WINDOW[0]), min(columns, WINDOW[1])
    r0, c0 = (rows - height) // 2, (columns - width) // 2
    full_well = camera.spec.full_well_e or camera.spec.gain_e_per_dn * 2**camera.bit_depth
    records = [
        replace(
            record,
            window=(r0, r0 + height, c0, c0 + width),
            photons=record.photons and record.photons * share,
            gain_db=camera.spec.gain_db,
        )
        for share in [full_well / camera.spec.quantum_efficiency / 20000.0]
        for record in default_plan()
        if record.kind in WORDS and record.gain_db == 0
    ]
    plan = FrameSet.from_arrays(records, [np.zeros((height, width), np.uint16)] * len(records))
    return with_chart(camera, plan)
