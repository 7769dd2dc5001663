"""Draw a count of the benchmark: python -m scripts.result_picture docs/pictures/results.svg FOLDER [FOLDER ...]

Each FOLDER has sets of `python -m benchmark`, its results beside it. results.svg shows whether stated probabilities hold, and what
was named in each kind of set; results_effects.svg beside it what was named for each hidden effect, and how often the interval of
its strength holds the hidden value.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

from benchmark.calibration import binned, covered, told
from benchmark.judge import answered, verdict, wilson
from visaug.report.plots.style import MEASURED, MODELLED, blank, styled

NOTHING = "nothing"
KINDS = {
    "single": "one effect",
    "other_form": "in another form",
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
            str(one.count), (one.mean, right), (6, 0), textcoords="offset points", ha="left", va="center"
        )
    axes.set(
        xlabel="stated probability", ylabel="share of right names", xlim=(0, 1.05), ylim=(0, 1.05),
        title="Probability of a name; numbers are counts",
    )  # fmt: skip
    axes.legend(loc="lower right")


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
            if size > 0.03 * counts.sum(1).max():  # the width of a number
                ink = "black" if column == 1 else "white"
                axes.text(start + size / 2, row, str(size), ha="center", va="center", color=ink)
        left += counts[:, column]
    axes.set_yticks(range(len(shown)), [KINDS[kind] for kind in shown])
    axes.invert_yaxis()
    axes.set(xlabel="sets", title="What was hidden, and what was named")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.17), ncols=3)


def named(axes, sets: list[tuple[dict, dict]]) -> None:
    """Number of sets by hidden effect and by what was named in them: the diagonal is right, a wrong name beside it is shown too."""
    cells: Counter[tuple[str, str]] = Counter()
    for answer, result in sets:
        accepted = (result["diagnosis"] or {}).get("accepted", [])
        for own in answer["expect"] if answer["kind"] in ("single", "other_form", "pairs") else ():
            others = [name for name in accepted if name not in answer["expect"]]
            right = [own] if own in accepted else []
            cells.update((own, name) for name in [*right, *others] or [NOTHING])
    rows = sorted({own for own, _ in cells})
    columns = [*rows, *sorted({name for _, name in cells} - {*rows, NOTHING}), NOTHING]
    for (own, name), count in cells.items():
        ink = MODELLED if own == name else "0.45" if name == NOTHING else MEASURED
        axes.text(
            columns.index(name), rows.index(own), str(count), ha="center", va="center", color=ink, fontsize=8
        )
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set(
        xlim=(-0.7, len(columns) - 0.3), ylim=(len(rows) - 0.3, -0.7), xlabel="named", ylabel="hidden",
        title="Sets by hidden effect and name: right (blue), wrong (red), none (grey)",
    )  # fmt: skip


def coverage(axes, sets: list[tuple[dict, dict]]) -> None:
    """Share of 95 % intervals of strengths that hold the hidden value, by effect, with intervals of 95 % (Wilson)."""
    held: dict[str, list[bool]] = {}
    for one in sets:
        for name, is_inside in covered(*one):
            held.setdefault(name, []).append(is_inside)
    names = sorted(held)
    for row, name in enumerate(names):
        inside, count = sum(held[name]), len(held[name])
        low, high = wilson(inside, count)
        axes.plot([low, high], [row, row], color=MODELLED)
        axes.plot(inside / count, row, "o", color=MODELLED, clip_on=False)
        axes.annotate(
            f"{inside} of {count}", (1.04, row), xycoords=("axes fraction", "data"), va="center", fontsize=8
        )
    axes.axvline(0.95, color="0.6", linewidth=1)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.invert_yaxis()
    axes.set(xlim=(0, 1), xlabel="share of intervals that hold the strength", title="Coverage; line: 95 %")


def main(output: Path, folders: list[Path]) -> None:
    sets = [(answer, result) for _, answer, result in answered(folders)]
    with styled():
        figure = blank(10.0, 6.2)
        first, second = figure.subplots(1, 2, width_ratios=(1.9, 1))
        named(first, sets)
        coverage(second, sets)
        figure.savefig(output.with_stem(f"{output.stem}_effects"))
        figure = blank(10.0, 4.2)
        first, second = figure.subplots(1, 2)
        reliability(first, [pair for one in sets for pair in told(*one)])
        kinds(second, sets)
        figure.savefig(output)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), [Path(folder) for folder in sys.argv[2:]])
