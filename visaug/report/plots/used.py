"""Which part of the sensor a comparison looked at."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from visaug.report.plots.style import MEASURED, MODELLED, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_used(used: Mapping[str, Any]) -> "Figure":
    """The sensor with the windows in which temporal statistics were measured.

    Args:
        used: as `compare --json` and `diagnose --json` hold it; windows are rows and columns r0, r1, c0, c1.
    """
    with styled():
        figure = blank(4.7, 3.8)
        axes = figure.subplots()
        top, bottom, left, right = used["frame"]
        size = {"width": right - left, "height": bottom - top}
        axes.add_patch(_box(left, top, **size, color=MODELLED, label=f"{used['full_frames']} full frames"))
        for k, (r0, r1, c0, c1) in enumerate(w for w in used["windows"] if w != used["frame"]):
            label = "window of all frames used" if k == 0 else None
            axes.add_patch(_box(c0, r0, c1 - c0, r1 - r0, MEASURED, label))
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        axes.set_aspect("equal")
        axes.set_xlabel("column, px")
        axes.set_ylabel("row, px")
        axes.grid(False)
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _box(x: float, y: float, width: float, height: float, color: str, label: str | None):
    from matplotlib.patches import Rectangle

    return Rectangle((x, y), width, height, facecolor=color, alpha=0.25, edgecolor=color, label=label)
