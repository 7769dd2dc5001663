"""Fingerprint of a frame set: a few hundred named statistics, each in a view that a person can look at."""

from collections.abc import Iterable, Sequence

from visaug.fingerprint.reduction import FrameData, GroupData
from visaug.fingerprint.statistic import AXES, Fingerprint, Statistic
from visaug.fingerprint.view import Curve, Picture, View
from visaug.fingerprint.views import VIEWS
from visaug.frames import FrameSet

__all__ = [
    "AXES",
    "VIEWS",
    "Curve",
    "Fingerprint",
    "FrameData",
    "GroupData",
    "Picture",
    "Statistic",
    "View",
    "fingerprint",
]


def fingerprint(
    frames: FrameSet, use: Iterable[int] | None = None, views: Sequence[View] = VIEWS
) -> Fingerprint:
    """The statistics of the frames at positions `use` (all by default).

    Two sets of the same plan have the same statistics in the same order.
    """
    data = FrameData(frames, use)
    return Fingerprint.of(pair for view in views for pair in view.measure(data))
