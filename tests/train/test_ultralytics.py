"""The hook in ultralytics: training batches are noised, the same both ways; validation and padding are not."""

from types import SimpleNamespace

import pytest
import torch
from torch import nn

import visaug
from visaug.ultralytics import add_callback, noised, padding_mask, vis_trainer
from visaug_train.convert import convert
from visaug_train.geometry import Keypoints
from visaug_train.speed import read_poses

CAMERA = {
    "resolution": [64, 64],
    "bit_depth": 12,
    "gain_e_per_dn": 0.1,
    "read_noise": {"sigma_e": 8.0},
    "dsnu": {"column_e": 4.0},
    "randomize": {"gain_db": {"std": 2.0}},
}
PAD = 114 / 255


@pytest.fixture(scope="module")
def data_yaml(rendered, tmp_path_factory):
    parts = {
        "train": read_poses(rendered, "synthetic", "train"),
        "val": read_poses(rendered, "synthetic", "validation"),
    }
    return convert(parts, Keypoints.load(), tmp_path_factory.mktemp("data") / "set")


def seen_by_the_network(data_yaml, folder, trainer=None, callback=None):
    """Images that the network got in one epoch of training, and in validation."""
    from ultralytics import YOLO

    training, validation = [], []
    model = YOLO("yolov8n-pose.yaml", verbose=False)

    def listen(t):
        t.model.register_forward_pre_hook(
            lambda _, args: training.append(args[0]["img"].clone()) if isinstance(args[0], dict) else None
        )
        preprocess = t.validator.preprocess

        def record(batch):
            batch = preprocess(batch)
            validation.append(batch["img"].clone())
            return batch

        t.validator.preprocess = record

    if callback is not None:
        add_callback(model, callback)
    model.add_callback("on_train_start", listen)
    model.train(
        trainer=trainer,
        data=str(data_yaml),
        epochs=1,
        imgsz=64,
        batch=4,
        device="cpu",
        plots=False,
        amp=False,
        pretrained=False,
        verbose=False,
        project=str(folder),
        seed=3,
    )
    assert training
    assert validation
    return torch.cat(training), torch.cat(validation)


@pytest.mark.slow
def test_both_ways_noise_training_alone_and_alike(data_yaml, tmp_path):
    clean, clean_val = seen_by_the_network(data_yaml, tmp_path / "clean")
    camera = visaug.Camera.load(CAMERA)
    by_trainer, trainer_val = seen_by_the_network(data_yaml, tmp_path / "a", trainer=vis_trainer(camera))
    by_callback, callback_val = seen_by_the_network(data_yaml, tmp_path / "b", callback=camera)
    assert torch.equal(by_trainer, by_callback)
    assert torch.equal(clean_val, trainer_val)
    assert torch.equal(clean_val, callback_val)
    padding = padding_mask(clean, value_jitter=0.4).expand_as(clean)
    assert 0.2 < padding.float().mean() < 0.8
    assert torch.equal(by_trainer[padding], clean[padding])
    assert (by_trainer[~padding] != clean[~padding]).float().mean() > 0.5


class Darken(nn.Module):
    def forward(self, images):
        return images * 0.5


def test_letterbox_is_left_alone():
    images = torch.rand(2, 3, 40, 64) * 0.9 + 0.05
    images[:, :, :10] = PAD
    images[:, :, 30:] = PAD
    batch = noised({"img": images.clone()}, Darken())
    assert torch.equal(batch["img"][:, :, :10], images[:, :, :10])
    assert torch.equal(batch["img"][:, :, 30:], images[:, :, 30:])
    assert torch.equal(batch["img"][:, :, 10:30], images[:, :, 10:30] * 0.5)


def test_padding_of_a_turned_image_and_of_other_brightness_is_found():
    y, x = torch.meshgrid(torch.arange(60.0), torch.arange(60.0), indexing="ij")
    inside = ((x - 30 + 0.5 * (y - 30)).abs() < 18) & ((y - 30 - 0.5 * (x - 30)).abs() < 18)
    image = torch.where(inside, torch.rand(60, 60) * 0.3, torch.tensor(round(114 * 1.3) / 255))
    mask = padding_mask(image.expand(1, 3, 60, 60), value_jitter=0.4)
    assert torch.equal(mask[0, 0], ~inside)
    assert not padding_mask(image.expand(1, 3, 60, 60), value_jitter=0.0).any()


def test_gray_like_padding_inside_the_image_is_no_padding():
    image = torch.rand(1, 3, 30, 30) * 0.3
    image[:, :, 10:20, 10:20] = PAD
    assert not padding_mask(image).any()


def test_black_sky_is_no_padding():
    assert not padding_mask(torch.zeros(1, 3, 20, 20), value_jitter=0.4).any()


def test_noise_runs_in_float32_under_autocast():
    class Check(nn.Module):
        def forward(self, images):
            assert images.dtype == torch.float32
            return (images @ images.transpose(2, 3)).mean() + images  # a product that autocast would lower

    with torch.autocast("cpu", dtype=torch.bfloat16):
        batch = noised({"img": torch.rand(1, 3, 8, 8)}, Check())
    assert batch["img"].dtype == torch.float32


def test_trainer_and_callback_survive_the_way_to_a_worker():
    import cloudpickle
    from ultralytics import YOLO

    trainer = cloudpickle.loads(cloudpickle.dumps(vis_trainer(visaug.Camera.load(CAMERA))))
    model = YOLO("yolov8n-pose.yaml", verbose=False)
    add_callback(model, visaug.Camera.load(CAMERA))
    callbacks = cloudpickle.loads(cloudpickle.dumps(model.callbacks))
    stand_in = SimpleNamespace(preprocess_batch=lambda batch: dict(batch), args=SimpleNamespace(hsv_v=0.0))
    callbacks["on_train_start"][-1](stand_in)
    images = torch.full((1, 3, 64, 64), 0.3)
    torch.manual_seed(0)
    by_callback = stand_in.preprocess_batch({"img": images})["img"]
    torch.manual_seed(0)
    by_trainer = noised({"img": images}, trainer.noise)["img"]
    assert torch.equal(by_callback, by_trainer)
    assert not torch.equal(by_callback, images)
