"""What a view is: a way to look at a frame set, in numbers and in a picture."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from visaug.statistics.reduction import FrameData, GroupData
from visaug.statistics.statistic import Statistic

Span = tuple[float, float]  # from and to, in the unit of the x axis


@dataclass(frozen=True)
class Curve:
    """One line of a picture."""

    x: np.ndarray
    y: np.ndarray
    label: str = ""


@dataclass(frozen=True)
class ViewPlot:
    """What a view shows: curves in common axes, or maps (H, W) side by side.

    Attributes:
        marks: along x, where the curves show what the picture is about.
        box: the part of the maps that does so: top, bottom, left and right as shares of the height and the width.
    """

    title: str
    x_label: str = ""
    y_label: str = ""
    curves: tuple[Curve, ...] = ()
    maps: tuple[tuple[str, np.ndarray], ...] = ()
    log_x: bool = False
    log_y: bool = False
    marks: tuple[Span, ...] = ()
    box: tuple[float, float, float, float] | None = None


class View:
    """A way to look at a frame set. A subclass states `name`, `title`, `measure` and `draw`.

    Measured and simulated frames go through the same two functions; a view knows of no effect.
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""

    def measure(self, data: FrameData) -> Iterator[tuple[Statistic, float]]:
        """Statistics and values. Which ones depends only on the plan of the frames, never on their pixels."""
        raise NotImplementedError

    def picture(self, data: FrameData, worst: str = "") -> ViewPlot | None:
        """The picture of this view; None where the frames that it needs are missing.

        Args:
            worst: the statistic that it is to show, "NAME, FRAMES" as in `Place.worst`; without one a view shows what it can of
                the bias frames, or of flats below saturation.
        """
        ends = [g for g in dict.fromkeys((*data.groups, *data.darks)) if worst.endswith(f", {g.label}")]
        group = max(ends, key=lambda g: len(g.label), default=None)
        return self.draw(data, worst.removesuffix(f", {group.label}") if group else worst, group)

    def draw(self, data: FrameData, name: str, group: GroupData | None) -> ViewPlot | None:
        """The picture that shows a statistic by its name ("" for none) and the group that it is measured on."""
        raise NotImplementedError


class Unlit(View):
    """Another view, of dark frames alone: for sets whose flats tell nothing in it.

    Example:
        >>> from visaug.statistics import VIEWS
        >>> Unlit(VIEWS[0]).name == VIEWS[0].name
        True
    """

    def __init__(self, view: View):
        self.view = view
        self.name, self.title = view.name, view.title  # type: ignore[misc]

    def measure(self, data: FrameData) -> Iterator[tuple[Statistic, float]]:
        return self.view.measure(data.unlit)

    def picture(self, data: FrameData, worst: str = "") -> ViewPlot | None:
        return self.view.picture(data.unlit, worst)
