"""Scores of a run on all test sets, from files as far as they are there."""

import hashlib
from collections.abc import Callable

from visaug_train.convert import identity
from visaug_train.evaluate import Evaluation, evaluate
from visaug_train.predictions import load_predictions, predict, save_predictions
from visaug_train.training import Run, Study, train_run

Progress = Callable[[str, int, int], None]


def run_and_score(
    study: Study, arm: str, seed: int, progress: Progress | None = None
) -> tuple[Run, dict[str, Evaluation]]:
    """A run with its scores, from files as far as they are there."""
    run = train_run(study, arm, seed, progress)
    return run, evaluate_run(study, run, progress)


def evaluate_run(study: Study, run: Run, progress: Progress | None = None) -> dict[str, Evaluation]:
    """Score a run's network on every test set; its predictions are kept beside the weights."""
    arguments = {**study.config.training, **study.config.arm(run.arm).training}
    found = {}
    for domain, poses in study.tests.items():
        names = "\n".join([run.weights.name, str(identity(poses))])
        digest = hashlib.sha256(names.encode()).hexdigest()[:8]
        path = run.folder / "predictions" / f"{domain}-{digest}.json"
        if not path.is_file():
            detections = predict(
                run.weights,
                poses,
                arguments.get("imgsz", 640),
                study.config.output / "ultralytics-settings",
                arguments.get("device"),
                f"evaluating {run.arm} seed {run.seed} on {domain}",
                progress,
                size=study.config.data.image_size,
                reduce=study.config.data.reduction,
            )
            save_predictions(path, poses, detections)
        detections = load_predictions(path, poses, len(study.keypoints))
        found[domain] = evaluate(domain, poses, study.keypoints, detections)
    return found
