"""Training copies and what the network is shown in testing are reduced alike."""

import json

import cv2
import numpy as np
import pytest

from visaug_train.convert import convert
from visaug_train.geometry import Keypoints
from visaug_train.predictions import predict
from visaug_train.speed import read_poses

SIGMA = 20.0


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    """A SPEED+ folder of flat images, 480 x 300, with white noise."""
    root = tmp_path_factory.mktemp("noisy")
    rng = np.random.default_rng(4)
    (root / "synthetic" / "images").mkdir(parents=True)
    camera = {"Nu": 480, "Nv": 300, "cameraMatrix": [[700, 0, 240], [0, 700, 150], [0, 0, 1]]}
    (root / "camera.json").write_text(json.dumps(camera))
    records = []
    for i in range(3):
        image = np.clip(np.rint(110 + SIGMA * rng.standard_normal((300, 480))), 0, 255).astype(np.uint8)
        cv2.imwrite(
            str(root / "synthetic" / "images" / f"img{i}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, 100]
        )
        records.append(
            {"filename": f"img{i}.jpg", "q_vbs2tango_true": [1, 0, 0, 0], "r_Vo2To_vbs_true": [0, 0, 6]}
        )
    (root / "synthetic" / "test.json").write_text(json.dumps(records))
    return read_poses(root, "synthetic", "test")


@pytest.mark.parametrize(("how", "expected"), [("area", SIGMA / 3), ("linear", SIGMA)])
def test_training_and_testing_see_the_same_noise(noisy, tmp_path, monkeypatch, how, expected):
    """A third of the size: averaging nine pixels leaves a third of white noise, the centre pixel has all of it."""
    from ultralytics import YOLO
    from ultralytics.engine.predictor import BasePredictor

    convert({"train": noisy}, Keypoints.load(), tmp_path / "set", (160, 100), reduce=how)
    copies = sorted((tmp_path / "set" / "images" / "train").iterdir())
    assert [file.suffix for file in copies] == [".png"] * 3
    copy = cv2.imread(str(copies[0]), cv2.IMREAD_GRAYSCALE)
    assert copy.std() == pytest.approx(expected, rel=0.05)

    YOLO("yolov8n-pose.yaml", verbose=False).save(tmp_path / "w.pt")
    shown = []
    preprocess = BasePredictor.preprocess

    def record(self, images):
        tensor = preprocess(self, images)
        shown.append(tensor.clone())
        return tensor

    monkeypatch.setattr(BasePredictor, "preprocess", record)
    predict(tmp_path / "w.pt", noisy, 160, tmp_path / "s", "cpu", size=(160, 100), reduce=how)
    image = (shown[-1][0, 0].numpy() * 255).round().astype(np.uint8)
    top = (image.shape[0] - 100) // 2
    np.testing.assert_array_equal(image[top : top + 100, :160], copy)


def test_points_come_back_in_pixels_of_the_file(noisy, tmp_path, monkeypatch):
    """A network that always finds the reduced image's right lower corner has found the file's."""
    from types import SimpleNamespace

    import torch
    import ultralytics

    class Corner:
        def __init__(self, _):
            pass

        def predict(self, images, **_):
            found = torch.tensor([[0.0, 0.0, 160.0, 100.0]])
            boxes = SimpleNamespace(xyxy=found, conf=torch.ones(1))
            points = SimpleNamespace(data=torch.tensor([[[160.0, 100.0, 1.0]]]))
            return [SimpleNamespace(boxes=boxes, keypoints=points) for _ in images]

    monkeypatch.setattr(ultralytics, "YOLO", Corner)
    (first, *_) = predict(tmp_path / "w.pt", noisy, 160, tmp_path / "s")
    np.testing.assert_allclose(first.boxes, [[0, 0, 480, 300]])
    np.testing.assert_allclose(first.points, [[[480, 300]]])
