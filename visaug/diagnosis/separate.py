"""Which frames would distinguish two effects."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from visaug.camera import Camera
from visaug.camera.simulation import simulate, with_chart
from visaug.diagnosis.candidates.trials import exchanged
from visaug.diagnosis.fitting.parameters import base_coordinates
from visaug.diagnosis.fitting.reference import Report, differences
from visaug.diagnosis.fitting.robust import adjust
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import Part
from visaug.effects import catalogue
from visaug.frames import FrameSet
from visaug.frames.plan import default_plan
from visaug.statistics import Statistic, fingerprint

SETS = 6
SEEN = 3.0  # standard deviations of one set above which two cameras differ; the standard error of a mean of six sets is half of one
WINDOW = (128, 160)
TAKEN = 0.5  # fraction of a plan's settings of one kind of frame that must be available,
BRIGHT = 0.8  # and of its brightest level, for more such frames to add little information
WORDS = {
    "bias": "a stack of bias frames",
    "dark": "a series of dark frames over exposure and temperature",
    "flat": "flats over the whole range up to saturation, several at each level",
    "scene": "a test chart with edges and a small spot above saturation, several times, each followed by a dark frame",
}


def measurement(cameras: Mapping[str, Camera], at_hand: Sequence[Statistic], report: Report) -> str:
    """Describes the frames in which two cameras differ most, from simulations of a full plan of frames.

    Differences that a refit of the first camera could absorb do not count. Available kinds of frames are named only if no other
    kind would be more informative.

    Args:
        at_hand: statistics of the frames that could not distinguish the two.
    """
    pair = _on_one_base(cameras)
    lab = Laboratory(_plan(pair[0]), pair[0], folds=False)
    part = lab.parts[0]
    assert isinstance(part, Part)  # the plan has no pictures of unknown scenes
    statistics = fingerprint(simulate(pair[0], part.plan)).statistics
    apart = np.abs(_apart(lab, pair, statistics, report))
    kinds = np.array([s.kind for s in statistics])
    known = taken(at_hand, statistics)
    squares = {kind: float((apart[(kinds == kind) & (apart > SEEN)] ** 2).sum()) for kind in WORDS}
    tell = [kind for kind in WORDS if squares[kind] > 0]
    if not tell:
        return "many more frames of every kind: the differences are small in each"
    kind = max([k for k in tell if k not in known] or tell, key=lambda k: squares[k])
    best = statistics[int(np.where(kinds == kind, apart, 0.0).argmax())]
    more = "many more frames of the kinds already taken, above all " if kind in known else ""
    view = best.view.replace("_", " ")
    return f"{more}{WORDS[kind]}: the largest difference is in {best.name} of {best.frames} ({view})"


def _on_one_base(cameras: Mapping[str, Camera]) -> tuple[Camera, Camera]:
    """The first camera, and the first camera with the effect of the second in place of its own.

    Nuisance parameters that few frames do not determine may differ between the two fits; that is not a difference of the effects.
    """
    (own, first), (rival, second) = list(cameras.items())[:2]
    if any(catalogue()[name].base for name in (own, rival)):
        return first, second
    return first, exchanged(first, own, second, rival)


def taken(at_hand: Sequence[Statistic], plan: Sequence[Statistic]) -> frozenset[str]:
    """Kinds of frames that are available in about as many settings, and as bright, as in a plan."""

    def settings(statistics: Sequence[Statistic], kind: str) -> int:
        return len({s.frames for s in statistics if s.kind == kind})

    def brightest(statistics: Sequence[Statistic]) -> float:
        return max((s.signal for s in statistics if s.kind == "flat"), default=0.0)

    there = {k for k in WORDS if settings(at_hand, k) >= max(TAKEN * settings(plan, k), 1)}
    dim = brightest(at_hand) < BRIGHT * brightest(plan)
    return frozenset(there - {"flat"} if dim else there)


def _apart(
    lab: Laboratory, pair: Sequence[Camera], statistics: Sequence[Statistic], report: Report
) -> np.ndarray:
    """(statistics,) difference of two cameras in standard deviations of one set, after a refit of the first."""
    label, jobs = "frames that would distinguish them", [(camera, k) for camera in pair for k in range(SETS)]
    sets = lab.finding(jobs, lambda n: report(label, n, len(jobs))).reshape(2, SETS, -1)
    least = np.maximum([s.least_spread for s in statistics], 1e-9)
    spread = np.maximum(np.sqrt(sets.var(1, ddof=1).mean(0)), least)
    free = base_coordinates(pair[0], lab.frames, calibrated=True)
    base = lab.simulated([(pair[0], k) for k in range(2)])
    slopes = differences(lab, pair[0], free, range(2), base, report)[0].mean(1).T
    differ = sets[0].mean(0) - sets[1].mean(0)
    (steps,) = adjust(differ[None], slopes, spread, np.array([c.prior for c in free]))
    return (differ - slopes @ steps) / spread


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
        )
        for share in [full_well / camera.spec.quantum_efficiency / 20000.0]
        for record in default_plan()
        if record.kind in WORDS and record.gain_db == 0
    ]
    plan = FrameSet.from_arrays(records, [np.zeros((height, width), np.uint16)] * len(records))
    return with_chart(camera, plan)
