"""Fingerprint of a frame set: a few hundred named statistics, each in a view that a person can look at."""

from collections.abc import Iterable, Sequence

import numpy as np

from visaug.core.recurrent import Recurrent
from visaug.frames import FrameSet
from visaug.statistics.reduction import FrameData, GroupData, Stacks
from visaug.statistics.statistic import AXES, Fingerprint, Statistic, finite
from visaug.statistics.view import Curve, View, ViewPlot
from visaug.statistics.views import IN_A_WINDOW, OF_FULL_FRAMES, OF_PICTURES, VIEWS

__all__ = [
    "AXES",
    "IN_A_WINDOW",
    "OF_FULL_FRAMES",
    "OF_PICTURES",
    "VIEWS",
    "Curve",
    "Fingerprint",
    "FrameData",
    "GroupData",
    "Stacks",
    "Statistic",
    "View",
    "ViewPlot",
    "fingerprint",
    "fingerprint_values",
]


def fingerprint(
    frames: FrameSet, use: Iterable[int] | None = None, views: Sequence[View] = VIEWS, place: str = ""
) -> Fingerprint:
    """The statistics of the frames at positions `use` (all by default).

    Two sets of the same plan have the same statistics in the same order. `place` names the part of the sensor that they show.
    """
    data = FrameData(frames, use, place=place)
    return Fingerprint.of(pair for view in views for pair in view.measure(data))


def fingerprint_values(
    frames: FrameSet,
    uses: Iterable[Iterable[int] | None] = (None,),
    views: Sequence[View] = VIEWS,
    shared: Recurrent | None = None,
) -> list[np.ndarray]:
    """The values of `fingerprint` alone, (n,) float64, for each use of the frames: positions, or None for all.

    Where the frames of one use are those of two before it, no pixel is gone through again for sums; nor where frames of equal
    conditions came out as those of other sets with the same `shared`, bit for bit.
    """
    stacks = Stacks(frames, shared)
    found: dict[frozenset[int], np.ndarray] = {}
    asked = []
    for use in uses:
        data = FrameData(frames, use, named=False, stacks=stacks)
        if data.use not in found:
            found[data.use] = finite([value for view in views for _, value in view.measure(data)])
        asked.append(found[data.use])
    return asked
