"""Noise in ultralytics' trainings: it arrives once, or the training stops with one line that says why.

ultralytics restores `augmentations=[...]` by name in every worker of a distributed training and after a resume. Where
the class of a transform is not known there, it logs one line and trains without any of the list. It also starts trainings
of a tuning in processes of their own, and `yolo train resume` never imports visaug. `hook` covers these cases:

- a callback that travels to the workers brings the class with it;
- a training is checked before it starts: noise from two sources, or a source that is lost, is an error;
- a checkpoint of a training with noise carries a sentence in place of the unused argument `augment`. A process without
  visaug refuses that value, and prints the sentence, when it resumes. A process with visaug puts the value right.

This module uses ultralytics where it is loaded already, and never loads it.
"""

import json
import sys
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug.core.files import write_text

NAME = "AlbumentationsNoise"
RECORD = "sensor_noise.txt"  # beside ultralytics' args.yaml
KEY = "sensor_noise"  # in args.yaml; ultralytics refuses it if that file is used as cfg=
GUARDED = "augment"  # test-time augmentation: has no meaning in a training, and ultralytics checks its type
GUARD = "visaug: this training has sensor noise"
ALTERNATIVES = ("OneOf", "OneOrOther")  # of whose transforms one acts
BY_LIST = f"augmentations=[{NAME}(...)]"
OTHER_WAYS = (
    "trainer=visaug.ultralytics.vis_trainer(CAMERA), or visaug.ultralytics.add_callback(model, CAMERA)"
)


def hook(traveller: Callable[[Any], None] | None = None, loader: Callable[[], None] | None = None) -> None:
    """Prepares ultralytics for noise; without effect where it is not loaded, or prepared already.

    Args:
        traveller: a callback `on_train_start` of every training: a worker that unpickles it imports its module.
        loader: called before transforms are restored, to make albumentations know `AlbumentationsNoise`.
    """
    TRAVELLERS.extend(one for one in [traveller] if one is not None and one not in TRAVELLERS)
    LOADERS.extend(one for one in [loader] if one is not None and one not in LOADERS)
    engine: Any = sys.modules.get("ultralytics.engine.trainer")
    transforms: Any = sys.modules.get("ultralytics.data.augment")
    callbacks: Any = sys.modules.get("ultralytics.utils.callbacks.base")
    if engine is None or transforms is None or callbacks is None:
        return
    starts = callbacks.default_callbacks["on_train_start"]
    starts.extend(one for one in TRAVELLERS if one not in starts)
    if hasattr(engine.BaseTrainer, "visaug"):
        return
    engine.BaseTrainer.visaug = True
    engine.BaseTrainer.train = _checked(engine.BaseTrainer.train)
    engine.get_cfg = _unguarded(engine.get_cfg)
    engine.MultiTrainer.__init__ = _in_this_process(engine.MultiTrainer.__init__)
    transforms.Albumentations.__init__ = _with_noise(transforms.Albumentations.__init__)


def number_of_noises(transforms: Any) -> int:
    """Number of `AlbumentationsNoise` that act on one image, in transforms or in their serialized form."""
    if isinstance(transforms, list | tuple):
        return sum(number_of_noises(one) for one in transforms)
    if isinstance(transforms, dict):
        inner = transforms.get("transform", transforms)
        name = str(inner.get("__class_fullname__", "")).rpartition(".")[2]
        parts = inner.get("transforms", ())
    else:
        name, parts = type(transforms).__name__, getattr(transforms, "transforms", ())
    if name == NAME:
        return 1
    counts = [number_of_noises(part) for part in parts] if isinstance(parts, list | tuple) else []
    return max(counts, default=0) if name in ALTERNATIVES else sum(counts)


def sources(trainer: Any) -> list[str]:
    """Everything that would add noise to the training batches, in words; the same word twice where it acts twice."""
    classes = sum("noise_of_trainer" in vars(kind) for kind in type(trainer).__mro__)
    starts = getattr(trainer, "callbacks", {}).get("on_train_start", ())
    added = sum(hasattr(callback, "noise_of_callback") for callback in starts)
    listed = number_of_noises(getattr(trainer.args, "augmentations", None))
    return ["trainer=vis_trainer(...)"] * classes + ["add_callback(...)"] * added + [BY_LIST] * listed


def check_sources(trainer: Any) -> None:
    """Before a training starts: refuses noise that would be added twice, that a training had and loses, or that is in
    `augmentations=`, which ultralytics passes over for this task or number of channels.
    """
    found = sources(trainer)
    if len(found) > 1:
        problem = f"would be added {len(found)} times to each image, by {' and by '.join(found)}"
        expected = "one of these, once; a model keeps its callbacks, so begin with a new YOLO(...)"
        raise InputError(problem, field="sensor noise", expected=expected)
    record = Path(trainer.save_dir) / RECORD
    if not found and trainer.args.resume and record.is_file():
        began = record.read_text(encoding="utf-8").strip()
        problem = f"this training began with sensor noise ({began}) and would go on without"
        raise InputError(problem, expected=f"{OTHER_WAYS}; to go on without noise, delete {record}")
    if found == [BY_LIST]:
        channels = (getattr(trainer, "data", None) or {}).get("channels", 3)
        if trainer.args.task == "classify" or channels not in (1, 3):
            what = "classification" if trainer.args.task == "classify" else f"images of {channels} channels"
            raise _passed_over(f"ultralytics does not apply it to {what}")


def announce(trainer: Any) -> None:
    """ultralytics' callback `on_train_start`: noise in `augmentations=` is in the built transforms, and is recorded."""
    if not number_of_noises(getattr(trainer.args, "augmentations", None)):
        return
    acting = [noise for built in _built(trainer.train_loader.dataset) for noise in _noises(built.transform)]
    if not acting:
        raise _passed_over("ultralytics did not build it for this training")
    how = "by augmentations= on the CPU, padding included"
    record(trainer, "; ".join(dict.fromkeys(f"{noise.described()}, {how}" for noise in acting)))


def record(trainer: Any, said: str) -> None:
    """Writes what acts to `sensor_noise.txt`, to args.yaml, to the log and to each checkpoint."""
    utils = sys.modules["ultralytics.utils"]
    trainer.sensor_noise = said
    if utils.RANK not in (-1, 0):
        return
    folder = Path(trainer.save_dir)
    write_text(folder / RECORD, said + "\n")
    arguments = folder / "args.yaml"
    if arguments.is_file():
        lines = arguments.read_text(encoding="utf-8").splitlines()
        lines = [line for line in lines if not line.startswith(f"{KEY}:")]
        write_text(arguments, "\n".join([*lines, f"{KEY}: {json.dumps(said)}"]) + "\n")
    utils.LOGGER.info(f"sensor noise: {said}")
    if hasattr(trainer, "save_model"):
        trainer.save_model = _guarded(trainer, trainer.save_model, said)


def _guarded(trainer: Any, save: Callable[[], Any], said: str) -> Callable[[], Any]:
    """ultralytics' `save_model`, whose checkpoints cannot be resumed without visaug."""
    again = "" if sources(trainer) == [BY_LIST] else f" and with {OTHER_WAYS}"
    sentence = f"{GUARD} ({said}), which would be lost here: resume it in Python after `import visaug.ultralytics`{again}"

    def save_guarded() -> Any:
        args = trainer.args
        kept = getattr(args, GUARDED)
        setattr(args, GUARDED, sentence)
        try:
            return save()
        finally:
            setattr(args, GUARDED, kept)

    return save_guarded


def _unguarded(get_cfg: Callable[..., Any]) -> Callable[..., Any]:
    """ultralytics' `get_cfg`, which takes the arguments of a checkpoint of a training with noise."""

    @wraps(get_cfg)
    def unguarded(cfg: Any = None, overrides: Any = None) -> Any:
        if isinstance(cfg, dict) and str(cfg.get(GUARDED, "")).startswith(GUARD):
            cfg = cfg | {GUARDED: False}
        return get_cfg(overrides=overrides) if cfg is None else get_cfg(cfg, overrides)

    return unguarded


def _checked(train: Callable[[Any], Any]) -> Callable[[Any], Any]:
    @wraps(train)
    def checked(trainer: Any) -> Any:
        check_sources(trainer)
        starts = trainer.callbacks.setdefault("on_train_start", [])
        # of a model that is older than the hook
        starts.extend(one for one in TRAVELLERS if one not in starts)
        return train(trainer)

    return checked


def _in_this_process(init: Callable[..., None]) -> Callable[..., None]:
    """Of ultralytics' MultiTrainer, which without a trainer starts `yolo train` for each training."""

    @wraps(init)
    def checked(sweep: Any, trainer: Any, args: dict, *more: Any, **named: Any) -> None:
        if trainer is None and number_of_noises(args.get("augmentations")):
            raise _passed_over("ultralytics starts these trainings in processes that lose it")
        init(sweep, trainer, args, *more, **named)

    return checked


def _with_noise(init: Callable[..., None]) -> Callable[..., None]:
    """Of ultralytics' Albumentations, which otherwise drops a list that it cannot restore; its arrays are BGR."""

    @wraps(init)
    def restored(
        albumentations: Any, p: float = 1.0, transforms: Any = None, *more: Any, **named: Any
    ) -> None:
        if wanted := number_of_noises(transforms):
            for load in LOADERS:
                load()
        init(albumentations, p, transforms, *more, **named)
        found = list(_noises(albumentations.transform))
        if wanted and not found:
            raise _passed_over("ultralytics could not restore it")
        for noise in found:
            noise.default_order = "BGR"

    return restored


def _noises(transform: Any) -> Iterator[Any]:
    """Every `AlbumentationsNoise` in a transform."""
    if type(transform).__name__ == NAME:
        yield transform
    for part in getattr(transform, "transforms", ()) if transform is not None else ():
        yield from _noises(part)


def _built(dataset: Any) -> Iterator[Any]:
    """Every Albumentations among the transforms of a dataset, or of several as one."""
    parts = getattr(dataset, "datasets", [dataset])
    waiting = [part.transforms for part in parts if hasattr(part, "transforms")]
    while waiting:
        one = waiting.pop()
        if type(one).__name__ == "Albumentations":
            yield one
        parts = getattr(one, "transforms", None)
        waiting += parts if isinstance(parts, list | tuple) else []
        before = getattr(one, "pre_transform", None)
        waiting += [before] if before is not None else []


def _passed_over(problem: str) -> InputError:
    return InputError(problem, field=BY_LIST, expected=OTHER_WAYS)


TRAVELLERS: list[Callable[[Any], None]] = [announce]
LOADERS: list[Callable[[], None]] = []
hook()
