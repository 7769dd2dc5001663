"""Figures of an ablation: scores against the conditions of the images, good and bad predictions."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from visaug.report.plots.learning import ARM_COLOURS, plot_predictions
from visaug.report.plots.style import blank, styled
from visaug_train.evaluate import Evaluation
from visaug_train.reduction import read_pixels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_dependence(evaluations: Mapping[str, Sequence[Evaluation]]) -> "Figure":
    """Mean score of arms, each with the evaluations of its seeds on one domain, against distance, attitude and brightness, in
    bins of equally many images.
    """
    causes = {
        "distance_m": "distance, m",
        "aspect_deg": "line of sight to body axis, deg",
        "brightness": "brightness of the target's box",
    }
    with styled():
        figure = blank(8.0, 2.7)
        panels = figure.subplots(1, len(causes), sharey=True)
        for axes, (cause, label) in zip(panels, causes.items()):
            for (arm, several), colour in zip(evaluations.items(), ARM_COLOURS * 4):
                score = np.mean([e.table["oks_paper"] for e in several], axis=0)
                value = several[0].table[cause]
                known = np.isfinite(score) & np.isfinite(value)
                order = np.argsort(value[known])
                parts = [part for part in np.array_split(order, 6) if len(part)]
                x = [value[known][part].mean() for part in parts]
                y = [score[known][part].mean() for part in parts]
                error = [score[known][part].std() / max(1, len(part)) ** 0.5 for part in parts]
                axes.errorbar(x, y, error, color=colour, label=arm, marker="o", markersize=3)
            axes.set(xlabel=label, ylim=(0, 1))
        panels[0].set_ylabel("OKS (paper), mean")
        panels[0].legend()
    return figure


def plot_gallery(evaluation: Evaluation, indices: Sequence[int] | np.ndarray) -> "Figure":
    """Truth and the likeliest prediction on some images."""
    targets, shown = evaluation.targets, []
    for i in indices:
        each, inside = evaluation.detections[i], targets.inside[i]
        best = int(np.argmax(each.scores)) if len(each) else None
        found = (None, None) if best is None else (each.points[best][inside], each.boxes[best])
        title = f"{evaluation.domain} {i + 1}: OKS {evaluation.table['oks_paper'][i]:.2f}"
        image, truth = read_pixels(evaluation.poses.files[i]), targets.points[i][inside]
        shown.append((image, truth, found[0], targets.boxes[i], found[1], title))
    return plot_predictions(*zip(*shown))


def plot_scores(
    points: Mapping[str, Mapping[str, Sequence[float]]], score: str = "keypoint AP50-95 (COCO)"
) -> "Figure":
    """A score from 0 to 1 as bars of the mean with a dot for each seed: group of bars -> bar -> scores of the seeds."""
    trainings = list(dict.fromkeys(name for bars in points.values() for name in bars))
    width = 0.8 / len(trainings)
    with styled():
        figure = blank(8.0, 3.4)
        axes = figure.subplots()
        for j, (training, colour) in enumerate(zip(trainings, ARM_COLOURS * 4)):
            place = (j - (len(trainings) - 1) / 2) * width
            groups = enumerate(points.values())
            trained = [(i + place, bars[training]) for i, bars in groups if bars.get(training)]
            means = [float(np.mean(values)) for _, values in trained]
            axes.bar([x for x, _ in trained], means, width * 0.92, color=colour, alpha=0.8, label=training)
            for x, values in trained:
                axes.plot([x] * len(values), values, "o", color="#1c2430", markersize=3.5)
        axes.set_xticks(range(len(points)), [name.replace("_", " ") for name in points])
        axes.set(ylabel=score, ylim=(0, 1))
        axes.grid(axis="x", visible=False)
        figure.legend(ncols=3, loc="outside upper center")
    return figure
