"""Which frames would distinguish two effects."""

from collections.abc import Mapping, Sequence

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.trials import exchanged
from visaug.diagnosis.fitting.reference import Report
from visaug.diagnosis.planned import SEEN, WORDS, Planned
from visaug.effects import catalogue
from visaug.statistics import Statistic

TAKEN = 0.5  # fraction of a plan's settings of one kind of frame that must be available,
BRIGHT = 0.8  # and of its brightest level, for more such frames to add little information


def measurement(cameras: Mapping[str, Camera], at_hand: Sequence[Statistic], report: Report) -> str:
    """Describes the frames in which two cameras differ most, from simulations of a full plan of frames.

    Differences that a refit of the first camera could absorb do not count. Available kinds of frames are named only if no other
    kind would be more informative.

    Args:
        at_hand: statistics of the frames that could not distinguish the two.
    """
    first, second = _on_one_base(cameras)
    planned = Planned(first, report)
    statistics, kinds = planned.statistics, planned.kinds
    (apart,) = np.abs(planned.apart([second]))
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
