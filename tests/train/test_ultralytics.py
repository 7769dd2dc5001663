"""The hook in ultralytics: training batches are noised, the same both ways; validation and padding are not."""

import pickle
import random
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from torch import nn
from torch.nn.functional import interpolate, max_pool2d

import visaug
from visaug.augment.dataset_noise import transfer_of_files, with_transfer
from visaug.ultralytics import (
    add_callback,
    noise_of,
    noised,
    track_padding,
    trainer_of,
    vis_trainer,
)
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
PAD, LEVEL = 114 / 255, 10


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
        hsv_v=0.0,
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
    changed = (by_trainer != clean).any(1)
    assert 0.2 < changed.float().mean() < 0.95  # mosaics of these renders are padded in places
    # hsv_v is 0: padding keeps its gray. Single pixels of a picture may have it too, 5 x 5 of them do not.
    gray = ((clean * 255).round() == 114).all(1, keepdim=True)
    padded = ~max_pool2d((~gray).float(), 5, 1, 2).bool()[:, 0]
    assert padded.float().mean() > 0.05
    assert not changed[padded].any()


class Darken(nn.Module):
    def forward(self, images):
        return images * 0.5


def test_noise_goes_where_the_extent_says_and_nowhere_by_pixel_values():
    images = torch.full((2, 3, 40, 64), PAD)
    images[:, :, 10:30] = 0.7
    everywhere = noised({"img": images.clone()}, Darken())
    assert torch.equal(everywhere["img"], images * 0.5)
    extent = torch.zeros(2, 40, 64, dtype=torch.bool)
    extent[0, 5:20] = True
    extent[1, :, 30:] = True
    inside = noised({"img": images.clone(), "extent": list(extent)}, Darken())
    expected = torch.where(extent[:, None], images * 0.5, images)
    assert torch.equal(inside["img"], expected)
    assert "extent" not in inside  # what follows takes the batch's other keys for labels
    small = interpolate(images, size=(20, 32))  # as multi_scale does
    halved = noised({"img": small, "extent": extent}, Darken())
    assert torch.equal(halved["img"], torch.where(extent[:, None, ::2, ::2], small * 0.5, small))


def dataset_of(folder, flat=False, **hyp):
    """A dataset of two pictures, as the trainer builds it."""
    from ultralytics.cfg import get_cfg
    from ultralytics.data.build import build_yolo_dataset

    (folder / "images").mkdir(parents=True)
    (folder / "labels").mkdir()
    rng = np.random.default_rng(2)
    for name in ("a", "b"):
        pixels = np.full((40, 90, 3), LEVEL) if flat else rng.integers(1, 100, (40, 90, 3))
        cv2.imwrite(str(folder / "images" / f"{name}.png"), pixels.astype(np.uint8))
        (folder / "labels" / f"{name}.txt").write_text("0 0.5 0.5 0.4 0.4\n")
    options = {"imgsz": 64, "hsv_h": 0.0, "hsv_s": 0.0, "hsv_v": 0.0, "task": "detect", **hyp}
    args = get_cfg(overrides=options)
    data = {"names": {0: "thing"}, "nc": 1, "channels": 3}
    return build_yolo_dataset(
        args, str(folder / "images"), 2, data, mode="train", rect=args.rect, stride=32
    ), args


GEOMETRIES = {
    "mosaic": {"mosaic": 1.0},
    "letterbox": {"mosaic": 0.0, "scale": 0.0, "translate": 0.0},
    "turned": {"mosaic": 0.0, "degrees": 30.0, "shear": 5.0, "fliplr": 1.0, "flipud": 1.0},
    "in perspective": {"mosaic": 1.0, "perspective": 0.001, "degrees": 20.0},
    "rect": {"mosaic": 0.0, "rect": True},
    "cut": {"mosaic": 1.0, "cutmix": 1.0},
}


@pytest.mark.parametrize("name", GEOMETRIES)
def test_extent_is_where_the_loader_did_not_pad(name, tmp_path):
    dataset, _ = dataset_of(tmp_path / "set", flat=True, **GEOMETRIES[name])
    assert track_padding(dataset) is True
    assert track_padding(dataset) is True  # a second call changes nothing
    dataset = pickle.loads(pickle.dumps(dataset))  # as spawned workers get it
    shares = []
    for seed in range(4):
        random.seed(seed)
        np.random.seed(seed)  # noqa: NPY002 (what ultralytics draws from)
        sample = dataset[seed % 2]
        # Along a slanted edge interpolation mixes picture and padding to values between the two.
        padded, picture = (sample["img"] == 114).all(0), (sample["img"] == LEVEL).all(0)
        assert sample["extent"].shape == padded.shape
        assert "semantic_mask" not in sample
        assert not sample["extent"][padded].any()
        assert sample["extent"][picture].all()
        assert (padded | picture).float().mean() > 0.9
        shares.append(float(padded.float().mean()))
    assert max(shares) > 0.02


def test_tracking_changes_neither_pictures_nor_labels_and_outlives_the_end_of_mosaics(tmp_path):
    options = {"mosaic": 1.0, "mixup": 0.5, "cutmix": 1.0, "degrees": 10.0, "fliplr": 0.5}
    plain, args = dataset_of(tmp_path / "plain", **options)
    tracked, _ = dataset_of(tmp_path / "tracked", **options)
    track_padding(tracked)

    def samples(dataset, count):
        random.seed(5)
        np.random.seed(5)  # noqa: NPY002
        return [dataset[i % 2] for i in range(count)]

    for before, after in zip(samples(plain, 8), samples(tracked, 8)):
        assert torch.equal(before["img"], after["img"])
        assert torch.equal(before["bboxes"], after["bboxes"])
    tracked.close_mosaic(args)
    batch = tracked.collate_fn(samples(tracked, 2))
    assert torch.stack(list(batch["extent"])).shape == (2, 64, 64)


def test_the_task_chooses_the_trainer():
    from ultralytics.models.yolo.detect import DetectionTrainer
    from ultralytics.models.yolo.obb import OBBTrainer

    assert trainer_of("obb") is OBBTrainer
    with pytest.raises(visaug.InputError, match="not a task"):
        trainer_of("guess")
    assert issubclass(vis_trainer(visaug.Camera.load(CAMERA), base=DetectionTrainer), DetectionTrainer)


def test_transfer_function_is_what_the_training_files_say(tmp_path):
    gray, colour = tmp_path / "gray.png", tmp_path / "colour.jpg"
    cv2.imwrite(str(gray), np.full((8, 8), 90, np.uint8))
    cv2.imwrite(str(colour), np.full((8, 8, 3), 90, np.uint8))
    assert transfer_of_files([str(gray)]) == ("linear", "8-bit gray, not tagged")
    assert (
        transfer_of_files([str(colour), str(tmp_path / "missing.png"), str(colour), str(gray)])[0] == "srgb"
    )
    noise = noise_of(visaug.Camera.load(CAMERA))
    resolved, said = with_transfer(noise, SimpleNamespace(im_files=[str(colour)]))
    assert resolved.sensor.transfer == "srgb"
    assert "sRGB" in said
    assert noise.sensor.transfer == "auto"  # the caller's own is left alone
    chosen = noise_of(visaug.Camera.load(CAMERA), transfer="linear")
    assert with_transfer(chosen, SimpleNamespace(im_files=[str(colour)])) == (chosen, "")


def test_noise_runs_in_float32_under_autocast():
    class Check(nn.Module):
        def forward(self, images):
            assert images.dtype == torch.float32
            return (images @ images.transpose(2, 3)).mean() + images  # a product that autocast would lower

    with torch.autocast("cpu", dtype=torch.bfloat16):
        batch = noised({"img": torch.rand(1, 3, 8, 8)}, Check())
    assert batch["img"].dtype == torch.float32


def test_trainer_and_callback_survive_the_way_to_a_worker(tmp_path):
    import cloudpickle
    from ultralytics import YOLO

    trainer = cloudpickle.loads(cloudpickle.dumps(vis_trainer(visaug.Camera.load(CAMERA))))
    model = YOLO("yolov8n-pose.yaml", verbose=False)
    add_callback(model, visaug.Camera.load(CAMERA))
    callbacks = cloudpickle.loads(cloudpickle.dumps(model.callbacks))
    stand_in = SimpleNamespace(
        preprocess_batch=lambda batch: dict(batch),
        build_dataset=lambda *_: None,
        train_loader=SimpleNamespace(dataset=SimpleNamespace(samples=[])),
        args=SimpleNamespace(augment=False),
        save_dir=tmp_path,
    )
    callbacks["on_train_start"][0](stand_in)
    assert "camera" in (tmp_path / "sensor_noise.txt").read_text()
    images = torch.full((1, 3, 64, 64), 0.3)
    torch.manual_seed(0)
    by_callback = stand_in.preprocess_batch({"img": images})["img"]
    torch.manual_seed(0)
    by_trainer = noised({"img": images}, trainer.noise)["img"]
    assert torch.equal(by_callback, by_trainer)
    assert not torch.equal(by_callback, images)


def test_a_list_gives_each_image_one_camera_at_random(tmp_path):
    from ultralytics import YOLO

    quiet = visaug.Camera.load(
        {"name": "quiet", "resolution": [64, 64], "bit_depth": 12, "gain_e_per_dn": 10}
    )
    loud = quiet.replace({"name": "loud", "read_noise.sigma_e": 4000.0})
    loud.save(tmp_path / "loud.yaml")
    cameras = [quiet, tmp_path / "loud.yaml"]
    model = YOLO("yolov8n-pose.yaml", verbose=False)
    add_callback(model, cameras)
    for noise in (vis_trainer(cameras).noise, model.callbacks["on_train_start"][0].noise):
        assert "'quiet', 'loud'" in str(noise)
        torch.manual_seed(0)
        noisy = noised({"img": torch.full((16, 3, 32, 32), 0.5)}, noise)["img"]
        is_loud = noisy.std((1, 2, 3)) > 0.03
        assert 2 <= is_loud.sum() <= 14  # outside with a probability of 5e-4; the seed is fixed


def test_tuning_trains_with_the_noise_of_the_callback(data_yaml, tmp_path):
    """ultralytics itself starts a process without callbacks for each training of a tuning."""
    from ultralytics import YOLO
    from ultralytics.engine import trainer as engine

    class Counting(nn.Module):
        seen = 0

        def forward(self, images):
            Counting.seen += len(images)
            return images

    sweep = engine.MultiTrainer
    model = YOLO("yolov8n-pose.yaml", verbose=False)
    add_callback(model, Counting())
    how = {"epochs": 1, "imgsz": 64, "batch": 8, "workers": 0, "device": "cpu", "plots": False, "val": False}
    model.tune(iterations=1, data=str(data_yaml), project=str(tmp_path), space={"lr0": (1e-4, 1e-2)}, **how)
    assert Counting.seen == 8  # the images of the one epoch
    assert engine.MultiTrainer is sweep
    with pytest.raises(visaug.core.errors.InputError, match="use_ray"):
        model.tune(use_ray=True)


def test_a_module_that_works_in_place_leaves_the_padding():
    class InPlace(nn.Module):
        def forward(self, images):
            return images.mul_(0.5)

    extent = torch.zeros(1, 8, 8, dtype=torch.bool)
    extent[:, 2:6] = True
    images = torch.full((1, 3, 8, 8), 0.5)
    noisy = noised({"img": images.clone(), "extent": list(extent)}, InPlace())["img"]
    assert (noisy[:, :, 2:6] == 0.25).all()
    assert (noisy[:, :, :2] == 0.5).all()
    assert (noisy[:, :, 6:] == 0.5).all()
