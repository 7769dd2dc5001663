"""Sensor noise in ultralytics' training: a trainer class, or a callback, that noises the batches of training alone.

    YOLO("yolov8s-pose.yaml").train(data=..., trainer=visaug.ultralytics.vis_trainer("camera.yaml"))

Validation keeps its clean images: the validator has its own preprocessing. Both ways give the same bits. They reach the
workers of distributed training, as ultralytics (8.4.140 and newer) sends trainer class and callbacks there by cloudpickle.
ultralytics is under AGPL-3.0; only this file and the training harness know it.

Padding gets no noise, for no sensor saw it. Where it is, is known from the loader's geometry and never guessed from
pixel values: each image takes along a mask that ultralytics' own transforms move, crop and pad with it.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

# ultralytics asks the network and installs packages unless told otherwise, and reads this when it is imported.
os.environ.setdefault("YOLO_OFFLINE", "1")
os.environ.setdefault("YOLO_AUTOINSTALL", "0")
# Networks and checkpoints are read as data: neither a YAML's `activation` nor a pickle in a .pt runs code.
os.environ.setdefault("ULTRALYTICS_SAFE_LOAD", "1")

import torch
from torch import nn
from torch.nn.functional import interpolate

from visaug.augment.dataset_noise import with_bands, with_transfer
from visaug.augment.under_ultralytics import hook, record
from visaug.core.errors import InputError

if TYPE_CHECKING:
    from ultralytics import YOLO

    from visaug.augment.sensor_noise import Source

EXTENT = (
    "extent"  # of a sample: (H, W) bool, True where a pixel holds a picture and False where it is padding
)
# ultralytics' transforms move this key along with the image and fill it with 255 where they pad.
MASK, PICTURE = "semantic_mask", 1
TRAINERS = {
    "detect": "DetectionTrainer",
    "segment": "SegmentationTrainer",
    "pose": "PoseTrainer",
    "obb": "OBBTrainer",
    "classify": "ClassificationTrainer",
    "semantic": "SemanticSegmentationTrainer",
    "depth": "DepthTrainer",
}

# Heads of models whose trainer is not that of their task, and this trainer. Source: ultralytics' `task_map`s.
OWN_TRAINERS = {
    "RTDETRDecoder": "ultralytics.models.rtdetr.train.RTDETRTrainer",
    "WorldDetect": "ultralytics.models.yolo.world.WorldTrainer",
    "YOLOEDetect": "ultralytics.models.yolo.yoloe.YOLOETrainer",
    "YOLOESegment": "ultralytics.models.yolo.yoloe.YOLOESegTrainer",
    "YOLOESegment26": "ultralytics.models.yolo.yoloe.YOLOESegTrainer",
}


def vis_trainer(
    camera: "Source | Sequence[Source] | nn.Module", base: type | None = None, **options: Any
) -> type:
    """A trainer class for ``YOLO(...).train(trainer=...)`` that noises the training batches.

    Args:
        camera: a camera, its file or shipped name, or a list of these, of which each image gets one at random; or any
            module that maps images (B, C, H, W) in [0, 1] to such.
        base: the trainer to build on; where left out, the one of the model's task.
        options: go to `visaug.VISNoise`, for example ``p=0.5`` or ``gain_db=(0, 24)``. With transfer="auto" the
            training images' files decide, as in `visaug augment`.

    A resumed training needs the trainer again: ``YOLO("last.pt").train(resume=True, trainer=vis_trainer(camera))``.

    Raises:
        InputError: when the training starts: a model whose trainer is not that of its task, such as RT-DETR, without
            `base`; noise from another source too; a training that was begun with noise and is resumed without.
    """
    return _trainer(noise_of(camera, **options), base, of_task=base is None)


def _trainer(module: nn.Module, base: type | None, of_task: bool) -> type:
    """The class; `of_task` where the task chooses, or chose, the base."""
    from ultralytics.models.yolo.pose import PoseTrainer

    class VISTrainer(base or PoseTrainer):  # type: ignore[misc]
        """A trainer whose training batches went through a sensor."""

        noise = module
        noise_of_trainer = True  # by which `sources` knows it

        def __new__(cls, *args: Any, **kwargs: Any) -> Any:
            overrides = kwargs.get("overrides") or (args[1] if len(args) > 1 else None) or {}
            task = overrides.get("task", "pose")
            if base is None and task != "pose":
                return _trainer(module, trainer_of(task), of_task)(*args, **kwargs)
            return super().__new__(cls)

        def run_callbacks(self, event: str) -> None:
            if event == "on_train_start":
                self.noise = begin(self, self.noise)
            super().run_callbacks(event)

        def get_model(self, cfg: Any = None, weights: Any = None, *more: Any, **named: Any) -> Any:
            if of_task:
                check_head(cfg)
            return super().get_model(cfg, weights, *more, **named)

        def preprocess_batch(self, batch: dict) -> dict:
            return noised(super().preprocess_batch(batch), self.noise)

    return VISTrainer


def add_callback(model: "YOLO", camera: "Source | Sequence[Source] | nn.Module", **options: Any) -> None:
    """Adds the noise to the training of a model whose trainer cannot be chosen.

    Use: `add_callback(model, camera); model.train(...)`. Arguments as for `vis_trainer`.
    """
    model.callbacks["on_train_start"].insert(0, NoiseCallback(noise_of(camera, **options)))
    model.tune = partial(_tune, model)


class NoiseCallback:
    """ultralytics' callback `on_train_start` that adds noise to the batches of a trainer."""

    noise_of_callback = True  # by which `sources` knows it

    def __init__(self, noise: nn.Module) -> None:
        self.noise = noise

    def __call__(self, trainer: Any) -> None:
        noise = begin(trainer, self.noise)
        clean = (
            trainer.preprocess_batch
        )  # callbacks never see a batch, so the method that makes it is wrapped
        trainer.preprocess_batch = lambda batch: noised(clean(batch), noise)


def _tune(model: "YOLO", use_ray: bool = False, *args: Any, **kwargs: Any) -> Any:
    """``model.tune`` with the model's callbacks: ultralytics starts each training in a process of its own, or lets Ray
    do so, without them. Here the trainings run in this process.
    """
    from ultralytics.engine import trainer as engine

    if use_ray:
        raise InputError("loses the noise", field="use_ray", expected="False")
    sweep = engine.MultiTrainer

    def with_callbacks(_: None, arguments: dict, network: nn.Module) -> Any:
        return sweep(trainer_of(str(model.task)), arguments, network, model.callbacks)

    engine.MultiTrainer = with_callbacks  # pyrefly: ignore[bad-assignment]
    try:
        return type(model).tune(model, False, *args, **kwargs)
    finally:
        engine.MultiTrainer = sweep


def trainer_of(task: str) -> type:
    """ultralytics' trainer for a task."""
    from importlib import import_module

    if task not in TRAINERS:
        raise InputError(
            f"{task!r} is not a task", field="task", expected="base=TRAINER, or " + ", ".join(TRAINERS)
        )
    return getattr(import_module(f"ultralytics.models.yolo.{task}"), TRAINERS[task])


def check_head(network: Any) -> None:
    """Refuses, by the last layer of a network's YAML, or of the dict in it, what the trainer of its task does not train."""
    from ultralytics.nn.tasks import yaml_model_load

    known = yaml_model_load(network) if isinstance(network, str | Path) else network
    head = known.get("head") if isinstance(known, dict) else None
    layer = str(head[-1][2]) if head else ""
    if layer in OWN_TRAINERS:
        raise InputError(
            f"a network with the head {layer} is not trained by the trainer of its task",
            field="trainer",
            expected=f"vis_trainer(CAMERA, base={OWN_TRAINERS[layer]}), or visaug.ultralytics.add_callback(model, CAMERA)",
        )


def noise_of(camera: "Source | Sequence[Source] | nn.Module", **options: Any) -> nn.Module:
    """The noise of a camera, or of several; a module is itself."""
    if isinstance(camera, nn.Module):
        return camera
    from visaug.augment import VISNoise

    return VISNoise(camera, **options)


@torch.no_grad()
def noised(batch: dict, noise: nn.Module, value_jitter: float | None = None) -> dict:
    """The batch with its images ``img`` (B, C, H, W) in [0, 1] noised in float32, the padding left as it is.

    Args:
        batch: where it has `extent`, (B, H, W) bool or one (H, W) for each image, noise goes where that is True;
            else everywhere.
        noise: maps images to noisy ones.
        value_jitter: has no effect: padding is not looked for among pixel values.
    """
    images = batch["img"]
    with torch.autocast(images.device.type, enabled=False):
        clean = images.float()
        noisy = noise(clean.clone())  # a module may work in place
    extent = batch.pop(EXTENT, None)
    if extent is not None:
        held = torch.stack(list(extent))[:, None].to(images.device)
        if held.shape[2:] != images.shape[2:]:  # multi_scale stretched the images
            held = interpolate(held.float(), size=images.shape[2:], mode="nearest").bool()
        noisy = torch.where(held, noisy, clean)
    batch["img"] = noisy.to(images.dtype)
    return batch


def begin(trainer: Any, noise: nn.Module) -> nn.Module:
    """At the start of a training: padding is tracked, transfer function and channels decided, all said in one line.

    Returns:
        The noise to use: a copy whose transfer function is decided where it was "auto".

    Raises:
        InputError: this trainer adds noise already, or the noise does not suit the number of channels.
    """
    if hasattr(trainer, "sensor_noise"):
        raise InputError(
            f"is added already ({trainer.sensor_noise})", field="sensor noise", expected="one source of noise"
        )
    dataset = trainer.train_loader.dataset
    known = track_padding(dataset)
    if getattr(trainer.train_loader, "iterator", None) is not None:  # workers have copies of the dataset
        trainer.train_loader.reset()
    build = trainer.build_dataset  # after running out of memory, ultralytics builds anew

    def build_tracked(img_path: Any, mode: str = "train", batch: int | None = None) -> Any:
        built = build(img_path, mode, batch)
        if mode == "train":
            track_padding(built)
        return built

    trainer.build_dataset = build_tracked
    noise, transfer = with_transfer(noise, dataset)
    noise, bands = with_bands(noise, (getattr(trainer, "data", None) or {}).get("channels", 3))
    unknown = "padding not known for this task: noise goes everywhere"
    padding = {None: "", True: "padding left as it is", False: unknown}[known]
    parts = (" ".join(str(noise).split()), transfer, bands, padding)
    record(trainer, ", ".join(part for part in parts if part))
    return noise


def track_padding(dataset: Any) -> bool | None:
    """Lets the samples of a dataset carry `extent`.

    Returns:
        True where padding is known; False where it is not: semantic segmentation and depth use the mask themselves;
        None where there is none, as in classification.
    """
    from ultralytics.data.dataset import DepthDataset, SemanticDataset

    if hasattr(dataset, "datasets"):  # several as one
        known = [track_padding(part) for part in dataset.datasets]
        return all(known)
    if not hasattr(dataset, "update_labels_info"):
        return None
    if isinstance(dataset, SemanticDataset | DepthDataset):
        return False
    if not isinstance(dataset.update_labels_info, _Marked):
        dataset.update_labels_info = _Marked(dataset)
        dataset.build_transforms = _Tracked(dataset)
        _track(dataset.transforms)
    return True


class _Marked:
    """In place of a dataset's `update_labels_info`: every pixel of an image as it is read holds a picture."""

    def __init__(self, dataset: Any) -> None:
        self.dataset = dataset

    def __call__(self, label: dict) -> dict:
        import numpy as np

        label = type(self.dataset).update_labels_info(self.dataset, label)
        label[MASK] = np.full(label["img"].shape[:2], PICTURE, np.uint8)
        return label


class _Tracked:
    """In place of a dataset's `build_transforms`, which is called again when mosaics end."""

    def __init__(self, dataset: Any) -> None:
        self.dataset = dataset

    def __call__(self, hyp: Any = None) -> Any:
        return _track(type(self.dataset).build_transforms(self.dataset, hyp))


class _ToExtent:
    """The last transform: the mask as `extent`."""

    def __call__(self, labels: dict) -> dict:
        mask = labels.pop(MASK, None)
        if mask is not None:
            labels[EXTENT] = torch.from_numpy(mask == PICTURE)
        return labels


class _SameCut:
    """In place of CutMix's `get_params`, which cuts more often where there is a mask: the cuts of a run without."""

    def __init__(self, cutmix: Any) -> None:
        self.cutmix = cutmix

    def __call__(self, labels: dict) -> dict:
        mask = labels.pop(MASK, None)
        params = type(self.cutmix).get_params(self.cutmix, labels)
        if mask is not None:
            labels[MASK] = mask
        return params


def _track(transforms: Any) -> Any:
    from ultralytics.data.augment import CutMix

    for transform in transforms.transforms:
        if isinstance(transform, CutMix):
            transform.get_params = _SameCut(transform)
    transforms.append(_ToExtent())
    return transforms


def _load_transform() -> None:
    """Makes albumentations know `AlbumentationsNoise`."""
    try:
        import visaug.augment.albumentations_noise  # noqa: F401
    except ImportError:
        raise InputError(
            "the package albumentations is not installed", expected="`pip install albumentations`"
        ) from None


with suppress(ImportError):  # `noised` works without ultralytics
    import ultralytics.engine.trainer  # noqa: F401

    hook(loader=_load_transform)
