"""Draw a count of the benchmark: python -m scripts.result_picture docs/pictures/results.svg FOLDER [FOLDER ...]

Each FOLDER has sets of `python -m benchmark`, its results beside it. Left: whether stated probabilities hold. Right: what was
named in each kind of set.
"""

import sys
from pathlib import Path

import numpy as np

from benchmark.calibration import binned, told
from benchmark.judge import answered, verdict, wilson
from visaug.report.plots.style import MEASURED, MODELLED, blank, styled

KINDS = {
    "single": "one effect",
    "pairs": "two effects",
    "clean": "nothing",
    "wrong_file": "a mistake in the file",
    "leave_out": "left out of the catalogue",
    "foreign": "outside any catalogue",
}


def reliability(axes, pairs: list[tuple[float, bool]]) -> None:
    """Share of right names in ten bins of the stated probability, with 95 % intervals (Wilson)."""
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1, label="as stated")
    for k, one in enumerate(binned(pairs)):
        right = one.right / one.count
        low, high = wilson(one.right, one.count)
        error = [[max(right - low, 0)], [max(high - right, 0)]]
        label = None if k else "counted, 95 %"
        axes.errorbar(one.mean, right, yerr=error, fmt="o", color=MEASURED, label=label)
        axes.annotate(
            str(one.count), (one.mean, right), (-6, 0), textcoords="offset points", ha="right", va="center"
        )
    axes.set(
        xlabel="stated probability", ylabel="share of right names", xlim=(0, 1.05), ylim=(0, 1.05),
        title="Probability of a name; numbers are counts",
    )  # fmt: skip
    axes.legend(loc="upper left")


def kinds(axes, sets: list[tuple[dict, dict]]) -> None:
    """Stacked bars of right, incomplete and wrong answers."""
    shown = [kind for kind in KINDS if any(answer["kind"] == kind for answer, _ in sets)]
    counts = np.zeros((len(shown), 3), int)
    for answer, result in sets:
        if answer["kind"] in shown:
            judged = verdict(answer, result)
            is_outside = answer["kind"] in ("leave_out", "foreign")
            named = bool((result["diagnosis"] or {}).get("accepted"))
            right = not (named or judged["failed"]) if is_outside else judged["right"]
            wrong = named if is_outside else judged["wrong"]
            counts[shown.index(answer["kind"]), 2 if wrong else 0 if right else 1] += 1
    left = np.zeros(len(shown))
    for column, (label, colour) in enumerate(
        (("right", MODELLED), ("not named, or in part", "0.75"), ("a wrong name", MEASURED))
    ):
        axes.barh(range(len(shown)), counts[:, column], left=left, color=colour, label=label)
        for row, (start, size) in enumerate(zip(left, counts[:, column], strict=True)):
            if size:
                ink = "black" if column == 1 else "white"
                axes.text(start + size / 2, row, str(size), ha="center", va="center", color=ink)
        left += counts[:, column]
    axes.set_yticks(range(len(shown)), [KINDS[kind] for kind in shown])
    axes.invert_yaxis()
    axes.set(xlabel="sets", title="What was hidden, and what was named")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.17), ncols=3)


def main(output: Path, folders: list[Path]) -> None:
    sets = [(answer, result) for _, answer, result in answered(folders)]
    with styled():
        figure = blank(10.0, 4.2)
        first, second = figure.subplots(1, 2)
        reliability(first, [pair for one in sets for pair in told(*one)])
        kinds(second, sets)
        figure.savefig(output)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), [Path(folder) for folder in sys.argv[2:]])
