"""Scores of a run on all test sets, from files as far as they are there."""

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from visaug.core.progress import Progress
from visaug_train.convert import identity
from visaug_train.evaluate import Evaluation, evaluate
from visaug_train.metrics import Detections
from visaug_train.predictions import load_predictions, predict, save_predictions
from visaug_train.speed import PoseSet
from visaug_train.training import Run, Study, train_run


def other_weights(weights: str) -> str:
    """The weights of a run that are not its headline."""
    return "best" if weights == "last" else "last"


def run_and_score(
    study: Study, arm: str, seed: int, progress: Progress | None = None
) -> tuple[Run, dict[str, Evaluation], dict[str, dict[str, Any]]]:
    """A run, its evaluations, and the summaries of its other weights by domain; from files as far as they are there."""
    run = train_run(study, arm, seed, progress)
    return run, evaluate_run(study, run, progress), other_summaries(study, run, progress)


def other_summaries(study: Study, run: Run, progress: Progress | None = None) -> dict[str, dict[str, Any]]:
    """Scores by domain of a run's other weights; empty where it kept none, or where no validation told best from last."""
    other, arguments = other_weights(study.config.weights), study.config.arguments(run.arm)
    if not arguments.get("val", True) or not run.weights.with_stem(other).is_file():
        return {}
    return {name: each.summary() for name, each in evaluate_run(study, run, progress, other).items()}


def evaluate_run(
    study: Study, run: Run, progress: Progress | None = None, weights: str = ""
) -> dict[str, Evaluation]:
    """Score a run's network on every test set: that of its `weights` (last or best), the config's where left out."""
    found = {n: predictions_of(study, run, n, p, progress, weights) for n, p in study.tests.items()}
    return {name: evaluate(name, study.tests[name], study.keypoints, each) for name, each in found.items()}


def predictions_of(
    study: Study, run: Run, domain: str, poses: PoseSet, progress: Progress | None = None, weights: str = ""
) -> list[Detections]:
    """What a run's network finds in a set; kept beside the weights."""
    file = run.weights.with_stem(weights) if weights else run.weights
    digest = hashlib.sha256(f"{file.name}\n{identity(poses)}".encode()).hexdigest()[:8]
    path = run.folder / "predictions" / f"{domain}-{digest}.json"
    if not path.is_file():
        title = f"evaluating {run.arm} seed {run.seed} on {domain}"
        save_predictions(path, poses, predictor(study, run, file)(poses, title=title, progress=progress))
    return load_predictions(path, poses, len(study.keypoints))


def predictor(study: Study, run: Run, weights: Path) -> Callable[..., list[Detections]]:
    """What a file of a run's weights finds in a set, a function of the set: images are reduced as in training."""
    config, arguments = study.config, study.config.arguments(run.arm)
    return partial(
        predict,
        weights,
        image_size=arguments.get("imgsz", 640),
        settings_folder=config.output / "ultralytics-settings",
        device=arguments.get("device"),
        size=config.data.image_size,
        reduce=config.data.reduction,
    )
