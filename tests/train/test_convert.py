"""ultralytics' labels: values, visibility, whole or not at all, going on."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from visaug.core.errors import InputError
from visaug_train.config import check_config
from visaug_train.convert import convert, identity, label_lines
from visaug_train.geometry import Keypoints
from visaug_train.record import decides
from visaug_train.render.dataset import SPEED_PLUS_CAMERA
from visaug_train.speed import PoseSet, read_poses

TANGO = Keypoints.load("tango")


def test_label_holds_box_and_points_as_shares_and_hides_what_is_outside(tmp_path):
    q = np.array([[1.0, 0, 0, 0]] * 3)
    r = np.array([[0, 0, 4.0], [-1.3, 0, 4.0], [-6.0, 0, 4.0]])
    poses = PoseSet("p", SPEED_PLUS_CAMERA, tuple(tmp_path / f"{i}.png" for i in range(3)), q, r)
    whole, cut, gone = label_lines(poses, TANGO)
    assert gone == ""
    numbers = np.array(whole.split(), float)
    assert numbers[0] == 0
    assert len(numbers) == 5 + 33
    points = SPEED_PLUS_CAMERA.project(TANGO.points_m + r[0]) / [1920, 1200]
    np.testing.assert_allclose(numbers[5:].reshape(11, 3)[:, :2], points, atol=1e-6)
    np.testing.assert_allclose(numbers[1:3], (points.min(0) + points.max(0)) / 2, atol=1e-6)
    hidden = np.array(cut.split(), float)[5:].reshape(11, 3)
    assert set(hidden[:, 2]) == {0.0, 2.0}
    assert (hidden[hidden[:, 2] == 0, :2] == 0).all()


def parts(rendered):
    return {
        "train": read_poses(rendered, "synthetic", "train"),
        "val": read_poses(rendered, "synthetic", "test"),
    }


def test_converted_dataset_is_complete_and_resized(rendered, tmp_path):
    data_yaml = convert(parts(rendered), TANGO, tmp_path / "out", size=(80, 50))
    content = yaml.safe_load(data_yaml.read_text())
    assert content["kpt_shape"] == [11, 3]
    images = sorted((tmp_path / "out" / "images" / "train").iterdir())
    assert len(images) == 8
    assert cv2.imread(str(images[0]), cv2.IMREAD_UNCHANGED).shape == (50, 80)
    assert {f.stem for f in images} == {f.stem for f in (tmp_path / "out" / "labels" / "train").iterdir()}
    assert not (tmp_path / "out.partial").exists()


def test_interrupted_conversion_goes_on(rendered, tmp_path):
    def stop(_title, done, _total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        convert(parts(rendered), TANGO, tmp_path / "out", size=(80, 50), progress=stop)
    assert not (tmp_path / "out").exists()
    kept = tmp_path / "out.partial" / "images" / "train" / "img000001.png"
    made = kept.stat().st_mtime_ns
    convert(parts(rendered), TANGO, tmp_path / "out", size=(80, 50))
    assert (tmp_path / "out" / "images" / "train" / kept.name).stat().st_mtime_ns == made


def test_other_settings_do_not_mix(rendered, tmp_path):
    convert(parts(rendered), TANGO, tmp_path / "out", size=(80, 50))
    with pytest.raises(InputError, match="other settings"):
        convert(parts(rendered), TANGO, tmp_path / "out", size=(40, 25))


@pytest.mark.parametrize("size", [(80, 50), None], ids=["copied", "linked"])
def test_a_moved_dataset_is_found_again_with_the_same_hash(rendered, tmp_path, size):
    shutil.copytree(rendered, tmp_path / "here")
    first = convert(parts(tmp_path / "here"), TANGO, tmp_path / "here" / "out", size=size)
    study = check_config({"name": "n", "output": "o", "data": {"rendered": {}}, "arms": {"baseline": {}}})
    before = decides(study, study.arm("baseline"), first)
    (tmp_path / "here").rename(tmp_path / "there")
    moved = convert(parts(tmp_path / "there"), TANGO, tmp_path / "there" / "out", size=size)
    assert yaml.safe_load(moved.read_text())["path"] == str(tmp_path / "there" / "out")
    assert decides(study, study.arm("baseline"), moved) == before
    assert all(image.stat().st_size for image in (tmp_path / "there" / "out" / "images" / "train").iterdir())


@pytest.mark.parametrize("size", [None, (8, 5)])
@pytest.mark.parametrize("names", [("a.jpg", "a.png"), ("a/b-c.png", "a-b/c.png", "z/c.png")])
def test_images_that_would_share_a_label_are_refused(tmp_path, names, size):
    q, r = np.array([[1.0, 0, 0, 0]] * len(names)), np.array([[0, 0, 4.0]] * len(names))
    files = tuple(tmp_path / "in" / name for name in names)
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(file), np.zeros((SPEED_PLUS_CAMERA.height, SPEED_PLUS_CAMERA.width), np.uint8))
    poses = PoseSet("p/train", SPEED_PLUS_CAMERA, files, q, r)
    with pytest.raises(InputError, match="would have the label of"):
        convert({"train": poses}, TANGO, tmp_path / "out", size)
    assert not (tmp_path / "out").exists()


def test_other_images_of_the_same_size_in_bytes_are_other_images(rendered, tmp_path):
    """Uncompressed ones all have one size: a prediction of the old ones is not that of the new."""
    poses = read_poses(rendered, "synthetic", "test")
    files = tuple(tmp_path / f"{number}.bmp" for number in range(len(poses)))
    found = []
    for level in (10, 10, 20):
        for file in files:
            cv2.imwrite(str(file), np.full(poses.camera.size[::-1], level, np.uint8))
        found.append(identity(replace(poses, files=files)))
    assert found[0] == found[1] != found[2]
    assert "sha256" not in identity(poses)  # compressed ones differ in size
