"""The error falling, effect by effect."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from visaug.core.wording import probability_text
from visaug.report.plots.style import MEASURED, MODELLED, SOFT, blank, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_error_steps(
    steps: Sequence[Mapping[str, Any]], before: float | None, floor: float | None
) -> "Figure":
    """Error against the steps that a diagnosis took, with 95 % intervals and the floor.
    `steps`: each with `action`, `error` and perhaps `interval`, in the order taken; those without a known
    error are left out.
    `before`: the error of the camera as given; None leaves it out.
    `floor`: as close as another set of the accepted camera would come.
    """
    points: list[Mapping[str, Any]] = [step for step in steps if step["error"] is not None]
    if before is not None:
        points = [{"action": "camera as given", "error": before}, *points]
    with styled():
        figure = blank(8.0, 3.4)
        axes = figure.subplots()
        x = range(len(points))
        y = [point["error"] for point in points]
        for i, point in enumerate(points):
            if point.get("interval"):
                axes.plot([i, i], point["interval"], color=MEASURED, linewidth=7, alpha=0.3)
        axes.plot(x, y, "o-", color=MEASURED, label="error on hold-out frames, 95 % interval")
        for i, value in enumerate(y):
            axes.annotate(f"{value:.2f}", (i, value), textcoords="offset points", xytext=(9, 5), fontsize=9)
        if floor is not None:
            label = "floor: a second camera of the same type"
            axes.axhline(floor, color=MODELLED, linestyle="--", linewidth=1.2, label=label)
        axes.axhline(0, color=SOFT, linewidth=0.8)
        axes.set_xticks(list(x), [wrapped(point["action"]) for point in points])
        axes.set_xlim(-0.35, len(points) - 0.5)
        lows = [point["interval"][0] for point in points if point.get("interval")]
        axes.set_ylim(min(-0.08, *lows, 0) - 0.02, max([1.0, *y]) * 1.15)
        axes.set_ylabel("error (1: camera as given, 0: floor)")
        axes.grid(axis="x", visible=False)
        figure.legend(loc="outside upper left", ncols=2, fontsize=8.5)
    return figure


def plot_ranking(ranking: Sequence[Mapping[str, Any]]) -> "Figure":
    """Share of the misfit that each effect explains, the likeliest first, with its probability: the longest bar is the best."""
    shown = [entry for entry in ranking if entry["error_after"] is not None][:12][::-1]
    with styled():
        figure = blank(8.0, 0.9 + 0.27 * max(len(shown), 1))
        axes = figure.subplots()
        values = [1 - entry["error_after"] for entry in shown]
        colours = [MODELLED if entry.get("probability", 0) >= 0.5 else "#b9c6d6" for entry in shown]
        axes.barh(range(len(shown)), values, color=colours, height=0.66)
        axes.set_yticks(range(len(shown)), [entry["effect"] for entry in shown])
        beside = {"textcoords": "offset points", "xytext": (5, -3), "fontsize": 8.5, "color": SOFT}
        for i, entry in enumerate(shown):
            said = f"probability {probability_text(entry['probability'])}"
            axes.annotate(said, (max(values[i], 0), i), **beside)
        axes.set_xlim(min(0, *values) if values else 0, max([1.0, *values]) * 1.12)
        axes.set_xlabel("misfit explained by adding the effect and refitting (1: as good as a second camera)")
        axes.grid(axis="y", visible=False)
    return figure


def wrapped(action: str) -> str:
    lines = textwrap.wrap(action.replace("_", "_ "), 16)
    return "\n".join(line.replace("_ ", "_") for line in lines) or action
