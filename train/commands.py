"""What the program's commands of the harness call."""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from visaug.camera import Camera
from visaug.core.errors import InputError, PartlyFailed
from visaug.core.files import folder_lock
from visaug.core.progress import Progress
from visaug_train import predictions as files
from visaug_train import training
from visaug_train.checks import check_arms, check_target
from visaug_train.config import Config, load_config
from visaug_train.convert import identity
from visaug_train.datasets import keypoints_of, read_poses
from visaug_train.evaluate import evaluate as score
from visaug_train.evaluate import evaluate_poses, pose_of
from visaug_train.geometry import Keypoints
from visaug_train.metrics import Detections
from visaug_train.readings import point_readings
from visaug_train.results import ablate as run_ablation
from visaug_train.severity import severity
from visaug_train.speed import PoseSet
from visaug_train.strength import strengths
from visaug_train.training import Run, Study, prepare, train_run


def train(config_path: Path, seed: int = 0, progress: Progress | None = None, arm: str | None = None) -> str:
    """Train an arm of a config, the last one where none is named, with its first seed; what to print."""
    config = _seeded(config_path, seed, partial(print, flush=True))
    arm = _arm(config, arm)
    with folder_lock(config.output):
        study = prepare(config, progress, partial(print, flush=True), [arm])
        print(strengths(study).text(), flush=True)
        run = train_run(study, arm, study.config.seeds[0], progress)
    return f"{arm}, seed {run.seed}: {run.weights} ({run.seconds:.0f} s)"


def ablate(config_path: Path, seed: int = 0, progress: Progress | None = None) -> str:
    """Train and score all arms, and write tables and report; what to print, raised as PartlyFailed where a run failed."""
    from visaug_train.report import write_report

    config = _seeded(config_path, seed)
    with folder_lock(config.output):
        ablation = run_ablation(config, progress, partial(print, flush=True))
        written = ablation.write(ablation.config.output)
        report = write_report(ablation)
    lines = [table.to_markdown() for table in ablation.tables().values()]
    lines += [f"failed: {f.arm}, seed {f.seed}: {f.error}" for f in ablation.failures]
    text = "\n".join([*lines, ablation.interval_covers, f"tables: {written}", f"report: {report}"])
    if ablation.failures:
        raise PartlyFailed(text)
    return text


def evaluate(
    config_path: Path,
    seed: int = 0,
    progress: Progress | None = None,
    arm: str | None = None,
    elsewhere: tuple[Path, str, str | None] | None = None,
    poses_csv: Path | None = None,
) -> dict[str, dict[str, Any]]:
    """Scores by domain of an arm of a config, the last one where none is named, whose network must be trained: if not, nothing
    is rendered or written.

    Args:
        elsewhere: folder, domain and split of another set than the config's test sets; the config's `split_seed` splits
            it too.
        poses_csv: where to write the poses of that set.
    """
    study, run = _trained(config_path, seed, progress, arm)
    own = study.tests
    if elsewhere is not None:
        poses = read_poses(*elsewhere, seed=study.config.data.split_seed, labels=False)
        check_target(study.config.data.keypoints, study.keypoints, study.training_images, poses)
        if not poses.labelled:
            detections = training.predictions_of(study, run, poses.domain, poses, progress)
            return {poses.domain: submission(poses, study.keypoints, detections, poses_csv)}
        study = replace(study, tests={poses.domain: poses})
    evaluations, folder = training.evaluate_run(study, run, progress), run.folder
    for domain, evaluation in evaluations.items():
        name = domain
        if domain in own and (found := identity(evaluation.poses)) != identity(own[domain]):
            # the name is that of a test set of the config, whose files stay
            name += "-" + hashlib.sha256(str(found).encode()).hexdigest()[:8]
        evaluation.write_csv(folder / f"{name}.csv")
        files.save_poses(folder / f"{name}-poses.csv", evaluation.poses, evaluation.found)
        if poses_csv is not None:
            files.save_poses(poses_csv, evaluation.poses, evaluation.found)
    weights = study.config.weights
    others = training.other_summaries(study, run, progress)
    return {
        domain: {**evaluation.summary(), "weights": weights}
        | ({training.other_weights(weights): others[domain]} if domain in others else {})
        for domain, evaluation in evaluations.items()
    }


def evaluate_predictions(
    predictions: str | Path,
    data: str | Path,
    domain: str,
    keypoints: str | Path = "tango",
    split: str | None = None,
    images: str | Path | None = None,
    poses_csv: str | Path | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Scores of any network's predictions on a domain of a data set: {domain: summary}.

    Args:
        predictions: COCO's results of keypoints, or poses as Kelvins takes them (NAME.csv). What they do not hold has no
            score (None): boxes where records have no `bbox`, boxes and keypoints of poses.
        images: COCO's annotations file, for records with `image_id`.
        poses_csv: where to write the poses that the keypoints give. Of images without labels that is all there is to do:
            every image gets a line, as a submission to Kelvins needs it.
        seed: that by which SPEED's one list was split, as a config's `split_seed`.

    Returns:
        The summary, with `notes`: what was recognised in the predictions, and what their score leaves out.
    """
    poses = read_poses(data, domain, split, seed, labels=False)
    points = keypoints_of(keypoints, poses)
    names = files.ImageNames(poses, files.names_elsewhere(data, poses), data)
    notes: list[str] = []
    if Path(predictions).suffix.lower() == ".csv":
        evaluation = evaluate_poses(poses, points, files.load_poses(predictions, poses, names, notes.append))
        names.note(notes.append)
    else:
        detections = files.load_predictions(predictions, poses, len(points), images, names, notes.append)
        names.note(notes.append)
        if not poses.labelled:
            said = submission(poses, points, detections, poses_csv)
            return {domain: said | {"notes": [*notes, *said["notes"]]}}
        detections = point_readings(detections, poses.targets(points), poses.camera.size, notes.append)
        evaluation = score(domain, poses, points, detections)
        if "iou" not in evaluation.table:
            notes.append("boxes are not scored, for not every record has a bbox")
    if poses_csv is not None and poses.posed:
        files.save_poses(poses_csv, poses, evaluation.found)
    return {domain: evaluation.summary() | {"notes": notes}}


def submission(
    poses: PoseSet, keypoints: Keypoints, detections: list[Detections], path: str | Path | None
) -> dict[str, Any]:
    """Write the poses of images without labels as Kelvins wants them; what to say in place of scores."""
    if path is None:
        problem = f"{poses.name} has no labels, so there is nothing to score"
        raise InputError(problem, field="--poses", expected="the CSV to write for a submission")
    if not np.isfinite(keypoints.points_m).all():
        problem = f"{poses.name} does not say where on the spacecraft its points are"
        problem += ", so no pose follows from them"
        raise InputError(problem, field="keypoints", expected="a YAML file with points_m in metres")
    count = len(poses)
    missing = files.save_submission(path, poses, [pose_of(each, keypoints, poses) for each in detections])
    note = f"{missing} of {count} images have no pose of their own; they got the median position, unrotated"
    return {"images": count, "poses_found": 1 - missing / count, "notes": [note] if missing else []}


def severity_curves(
    config_path: Path,
    camera: str,
    output: Path,
    axes: list[str],
    seed: int = 0,
    progress: Progress | None = None,
    arm: str | None = None,
    elsewhere: tuple[Path, str, str | None] | None = None,
) -> str:
    """Robustness curves of an arm of a config on a set, `elsewhere` or else the config's first test set; what to print."""
    study, run = _trained(config_path, seed, progress, arm)
    poses = next(iter(study.tests.values()))
    if elsewhere is not None:
        poses = read_poses(*elsewhere, seed=study.config.data.split_seed)
        check_target(study.config.data.keypoints, study.keypoints, study.training_images, poses)
    network = hashlib.sha256(run.weights.read_bytes()).hexdigest()
    predict, measured = training.predictor(study, run, run.weights), Camera.load(camera)
    severity(poses, study.keypoints, predict, measured, output, axes or None, network, seed, progress)
    return f"curves: {output / 'severity.csv'}, {output / 'severity.png'}"


def _trained(config_path: Path, seed: int, progress: Progress | None, arm: str | None) -> tuple[Study, Run]:
    """The study and the run of an arm; an InputError where it is not trained, before anything is rendered or written."""
    config = load_config(config_path)
    arm, first = _arm(config, arm), config.seeds[0] + seed
    expected = f"visaug train {config_path} --arm {arm}, or visaug ablate {config_path}, first"
    missing = InputError(f"arm {arm}, seed {first} is not trained", file=config_path, expected=expected)
    if not any((config.output / "runs").glob(f"{arm}-seed{first}-*/run.json")):
        raise missing
    study = prepare(_seeded(config_path, seed), progress)
    folder = training.run_folder(study, arm, first)
    if not (folder / "run.json").is_file():  # trained, but with other settings
        raise missing
    return study, train_run(study, arm, first, progress)


def _arm(config: Config, name: str | None) -> str:
    """An arm's name; the last one's, which a config is about, where none is given."""
    name = name or list(config.arms)[-1]
    config.arm(name)
    return name


def _seeded(path: Path, seed: int, announce: Callable[[str], None] | None = None) -> Config:
    """The config with `seed` added to its seeds, so that --seed 0 is the config as it stands."""
    config = load_config(path)
    check_arms(config, announce)
    return config.model_copy(update={"seeds": [s + seed for s in config.seeds]})
