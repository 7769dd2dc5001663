"""Sensor noise in ultralytics' training: a trainer class, or a callback, that noises the batches of training
alone.

    YOLO("yolov8s-pose.yaml").train(data=..., trainer=visaug.ultralytics.vis_trainer("camera.yaml"))

Validation keeps its clean images: the validator has its own preprocessing. Both ways give the same bits. They
reach the workers of distributed training, as ultralytics (8.4.140 and newer) sends trainer class and
callbacks there by cloudpickle. ultralytics is under AGPL-3.0; only this file and the training harness know
it.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

# ultralytics asks the network and installs packages unless told otherwise, and reads this when it is
# imported.
os.environ.setdefault("YOLO_OFFLINE", "1")
os.environ.setdefault("YOLO_AUTOINSTALL", "0")
# Networks and checkpoints are read as data: neither a YAML's `activation` nor a pickle in a .pt runs code.
os.environ.setdefault("ULTRALYTICS_SAFE_LOAD", "1")

import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from ultralytics import YOLO

    from visaug.camera import Camera

PADDING = 114  # the gray that ultralytics pads images with, of 255


def vis_trainer(camera: "Camera | str | Path | nn.Module", base: type | None = None, **options: Any) -> type:
    """A trainer class for ``YOLO(...).train(trainer=...)`` that noises the training batches.

    Args:
        camera: a camera, its file or shipped name; or any module that maps images (B, C, H, W) in [0, 1] to
        such. base: the trainer to build on; ultralytics' PoseTrainer where left out (DetectionTrainer and
        others work too). options: go to `visaug.VISNoise`, for example ``p=0.5`` or ``resolution="sensor"``.
    """
    from ultralytics.models.yolo.pose import PoseTrainer

    module = noise_of(camera, **options)

    class VISTrainer(base or PoseTrainer):  # type: ignore[misc]
        """A trainer whose training batches went through a sensor."""

        noise = module

        def preprocess_batch(self, batch: dict) -> dict:
            return noised(super().preprocess_batch(batch), self.noise, self.args.hsv_v)

    return VISTrainer


def add_callback(model: "YOLO", camera: "Camera | str | Path | nn.Module", **options: Any) -> None:
    """The same for a model whose trainer one does not choose:

    ``add_callback(model, camera); model.train(...)``.
    """
    module = noise_of(camera, **options)

    def wrap(trainer: Any) -> None:
        clean = (
            trainer.preprocess_batch
        )  # callbacks never see a batch, so the method that makes it is wrapped
        trainer.preprocess_batch = lambda batch: noised(clean(batch), module, trainer.args.hsv_v)

    model.add_callback("on_train_start", wrap)


def noise_of(camera: "Camera | str | Path | nn.Module", **options: Any) -> nn.Module:
    """The noise of a camera; a module is itself."""
    if isinstance(camera, nn.Module):
        return camera
    import visaug

    return visaug.VISNoise(visaug.Camera.load(camera), **options)


@torch.no_grad()
def noised(batch: dict, noise: nn.Module, value_jitter: float = 0.0) -> dict:
    """The batch with its images ``img`` (B, C, H, W) in [0, 1] noised in float32, the padding left as it is."""
    images = batch["img"]
    with torch.autocast(images.device.type, enabled=False):
        clean = images.float()
        noisy = noise(clean)
    batch["img"] = torch.where(padding_mask(clean, value_jitter), clean, noisy).to(images.dtype)
    return batch


def padding_mask(images: Tensor, value_jitter: float = 0.0) -> Tensor:
    """Where images (B, C, H, W) in [0, 1] are padding, (B, 1, H, W): no sensor ever saw it.

    Padding is gray of one value that an image's border shows, near 114 (exactly, but for ultralytics'
    brightness jitter `hsv_v`, which scales it by up to 1 +- value_jitter), in one run from there on along a
    row or a column. For an upright or turned image and for mosaics such runs reach every padded pixel.
    """
    levels = (images * 255).round().to(torch.int16)
    gray = (levels == levels[:, :1]).all(dim=1)
    level = levels[:, 0].long()
    border = torch.cat([level[:, 0], level[:, -1], level[:, :, 0], level[:, :, -1]], dim=1)
    border_gray = torch.cat([gray[:, 0], gray[:, -1], gray[:, :, 0], gray[:, :, -1]], dim=1)
    low, high = int(PADDING * (1 - value_jitter)), -int(-PADDING * (1 + value_jitter) // 1)
    candidates = border_gray & (border >= low) & (border <= high)
    counts = torch.zeros(len(images), 256, device=images.device)
    counts.scatter_add_(1, border.clamp(0, 255), candidates.float())
    count, value = counts.max(dim=1)
    value = torch.where(count > 0, value, -1)
    alike = (gray & (level == value[:, None, None])).to(torch.uint8)
    mask = torch.zeros_like(alike)
    for dim in (1, 2):
        mask |= alike.cumprod(dim, dtype=torch.uint8)
        mask |= alike.flip(dim).cumprod(dim, dtype=torch.uint8).flip(dim)
    return mask.bool()[:, None]
