"""Train the arms of a config with ultralytics, and score them: one run is one arm with one seed in a folder of its own.

A run's folder carries a hash of all that decides its outcome. A finished run (``run.json``) is never run
again, an interrupted one resumes from its last epoch, and a changed config trains new runs.
"""

import csv
import hashlib
import json
import shutil
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from torch import nn

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import whole_file, write_json, write_text
from visaug.core.progress import Progress
from visaug_train import callbacks
from visaug_train.arms import Arm
from visaug_train.checks import Say, check_apart, check_target, cost, followed, start_weights
from visaug_train.config import Config, Source
from visaug_train.convert import convert, identity
from visaug_train.datasets import keypoints_of, read_poses
from visaug_train.evaluate import Evaluation, evaluate
from visaug_train.geometry import Keypoints
from visaug_train.metrics import Detections
from visaug_train.noise import batch_noise
from visaug_train.predictions import load_predictions, predict, save_predictions
from visaug_train.quiet import quiet_ultralytics, set_tracking
from visaug_train.record import decides, surroundings
from visaug_train.render.dataset import read_back, render_dataset
from visaug_train.speed import PoseSet, part_of
from visaug_train.studies.hidden import HiddenEffect, hide_effects
from visaug_train.studies.target import TargetCamera, make_cameras


@dataclass(frozen=True)
class Study:
    """A config whose data are ready: ultralytics' data.yaml, the images it was made of, the test sets by domain."""

    config: Config
    data_yaml: Path
    keypoints: Keypoints
    tests: dict[str, PoseSet]
    training_images: PoseSet
    data_seconds: float = 0.0
    hidden: tuple[HiddenEffect, ...] = ()
    cameras: tuple[TargetCamera, ...] = ()


@dataclass(frozen=True)
class Run:
    """A finished run: its weights, the seconds it took, its curves (column -> values by epoch)."""

    arm: str
    seed: int
    folder: Path
    weights: Path
    seconds: float
    curves: dict[str, list[float]]
    surroundings: dict[str, Any] = field(default_factory=dict)


def prepare(
    config: Config, progress: Progress | None = None, announce: Say | None = None, arms: Sequence[str] = ()
) -> Study:
    """Renders (if configured), checks and converts the data; simulates and diagnoses hidden effects.

    `announce` gets the hours that the training costs (of all runs, or of `arms` with one seed), before anything is converted.
    """
    began, data, root = time.monotonic(), config.data, config.data.root
    if data.rendered is not None:
        root = config.output / f"data-{_digest(read_back(data.rendered))}"
        render_dataset(root, data.rendered, progress)
    assert root is not None  # check_config saw to it

    def read(source: Source) -> PoseSet:
        poses = read_poses(source.root or root, source.domain, source.split, data.split_seed)
        return part_of(poses, source.share, data.split_seed) if source.share else poses

    parts = {"train": read(data.train), "val": read(data.validation)}
    keypoints = keypoints_of(data.keypoints, parts["train"])
    tests = {name: read(source) for name, source in data.test.items()}
    check_apart(parts, tests)
    for poses in (parts["val"], *tests.values()):
        check_target(data.keypoints, keypoints, parts["train"], poses)
    if announce is not None and not (config.cluster and config.cluster.address):
        announce(cost(config, len(parts["train"]), arms))
    name = "-".join(["ultralytics", *data.copies])
    place = root.resolve() / name if data.rendered else config.output / f"{root.name}-{name}"
    size, how, channels = data.image_size, data.reduction, data.channels
    data_yaml = convert(parts, keypoints, place, size, progress, reduce=how, channels=channels)
    hidden: list[HiddenEffect] = []
    if config.hidden is not None:
        config, tests, hidden = hide_effects(config, tests, progress)
    config, cameras = make_cameras(config, read, progress)
    seconds = time.monotonic() - began
    return Study(config, data_yaml, keypoints, tests, parts["train"], seconds, tuple(hidden), cameras)


def train_run(study: Study, arm_name: str, seed: int, progress: Progress | None = None) -> Run:
    """Trains one arm with one seed, or the rest of it; a finished run is only read."""
    config, arm = study.config, study.config.arm(arm_name)
    folder = run_folder(study, arm_name, seed)
    if not (folder / "run.json").is_file():
        start = start_network(study, progress) or config.model
        named = {"arm": arm_name, "seed": seed, "hash": folder.name.rsplit("-", 1)[-1]}
        record = {**named, **decides(config, arm, study.data_yaml)}
        arguments, title = config.arguments(arm_name), f"training {arm_name} seed {seed}"
        config = config.model_copy(update={"model": start})
        what = (config, batch_noise(arm), arguments, study.data_yaml, folder, seed)
        _finish(folder, record, arguments, _train(*what, title, progress, arm.clean_epochs))
        _failure_file(study, arm_name, seed).unlink(missing_ok=True)  # of an earlier try
    record = read_json(folder / "run.json")
    weights = folder / "weights" / f"{config.weights}.pt"
    curves = read_curves(folder / "results.csv")
    return Run(arm_name, seed, folder, weights, record["seconds"], curves, record.get("surroundings", {}))


def start_network(study: Study, progress: Progress | None = None) -> str | None:
    """The file of the network that all runs start from, made now where it is not yet; None where there is none."""
    config, start = study.config, study.config.start
    if start is None:
        return None
    if start.weights:
        return str(_from_weights(config, Path(start.weights)))
    arm = config.arm(start.like) if start.like else Arm()
    arguments = {**config.training, **arm.training, **start.training, "epochs": start.epochs}
    decided = {**decides(config, arm, study.data_yaml), "training": arguments}
    folder = config.output / "runs" / f"start-seed{start.seed}-{_digest(decided)}"
    if not (folder / "run.json").is_file():
        title = f"training the network that all arms start from, seed {start.seed}"
        what = (config, batch_noise(arm), arguments, study.data_yaml, folder, start.seed)
        _finish(folder, decided, arguments, _train(*what, title, progress))
    return str(folder / "weights" / "last.pt")


def _finish(folder: Path, record: dict[str, Any], arguments: dict[str, Any], seconds: float) -> None:
    around = surroundings(arguments.get("device"), followed(arguments).get("amp"))
    write_json(folder / "run.json", {**record, "surroundings": around, "seconds": seconds})
    callbacks.forget(folder)


def _from_weights(config: Config, weights: Path) -> Path:
    """A checkpoint of ultralytics with the state that a safetensors file holds; refused if it is another network's."""
    assert config.start is not None
    content = start_weights(config.start)
    made = config.output / "runs" / f"start-{str(config.start.sha256)[:8]}.pt"
    if not made.is_file():
        quiet_ultralytics(config.output / "ultralytics-settings")
        from safetensors.torch import load
        from ultralytics import YOLO

        model = YOLO(config.model, task="pose", verbose=False)
        network: Any = model.model
        try:
            network.load_state_dict(load(content))
        except RuntimeError:
            problem = "is the state of another network"
            raise InputError(problem, file=weights, expected=f"that of {config.model}") from None
        with whole_file(made) as partial_file:
            model.save(partial_file)
    return made


def note_failure(study: Study, arm: str, seed: int, error: Exception) -> str:
    """Keep how a run failed beside the runs; the error in one line."""
    write_text(_failure_file(study, arm, seed), "".join(traceback.format_exception(error)))
    return " ".join(f"{type(error).__name__}: {error}".split())


def _failure_file(study: Study, arm: str, seed: int) -> Path:
    return study.config.output / "failures" / f"{arm}-seed{seed}.txt"


def run_folder(study: Study, arm_name: str, seed: int) -> Path:
    """Where a run lies: arm, seed and a hash of all that decides its outcome."""
    digest = _digest(decides(study.config, study.config.arm(arm_name), study.data_yaml))
    return study.config.output / "runs" / f"{arm_name}-seed{seed}-{digest}"


def read_curves(path: Path) -> dict[str, list[float]]:
    """Columns of ultralytics' results.csv: losses and validation scores by epoch."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    return {key.strip(): [float(row[key]) for row in rows] for key in rows[0]} if rows else {}


def _train(
    config: Config,
    noise: nn.Module,
    arguments: dict[str, Any],
    data_yaml: Path,
    folder: Path,
    seed: int,
    title: str,
    progress: Progress | None,
    clean_epochs: int = 0,
) -> float:
    """Trains the rest of a run, the last epochs without noise; returns the total seconds."""
    quiet_ultralytics(config.output / "ultralytics-settings")
    from ultralytics import YOLO

    from visaug.ultralytics import vis_trainer

    set_tracking(config.tracking)
    trainer = vis_trainer(noise)
    state = callbacks.load_state(folder)
    if state is not None and state["exact"]["over"]:
        callbacks.finish(folder, state)
        return state["exact"]["seconds"]
    kept = callbacks.Checkpoints(seed, state, partial(progress, title) if progress else None)
    if state is None:
        shutil.rmtree(folder, ignore_errors=True)
        model = YOLO(config.model, task="pose", verbose=False)
        place = {"project": str(folder.parent.resolve()), "name": folder.name, "exist_ok": True}
        how = {"pretrained": config.model.endswith(".pt"), "plots": False, "verbose": False, "seed": seed}
        how |= place | followed(arguments)
    else:
        model = YOLO(str(callbacks.restore(folder, state)), task="pose")
        how = {"resume": True, "save_dir": str(folder.resolve())}
    kept.attach(model)
    model.add_callback("on_train_epoch_start", partial(callbacks.close_noise, clean_epochs))
    model.add_callback("on_train_batch_start", partial(callbacks.keep_batch, arguments.get("batch", 16)))
    model.train(trainer=trainer, data=str(data_yaml), **how)
    return kept.seconds_before + time.monotonic() - kept.began


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


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:8]
