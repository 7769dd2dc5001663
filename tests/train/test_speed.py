"""Reading SPEED and SPEED+ folders, and refusing wrong ones."""

import json
import shutil

import cv2
import numpy as np
import pytest

from visaug.core.errors import InputError
from visaug_train.speed import domains, read_poses, split_indices


def test_rendered_folder_reads_as_speedplus(rendered):
    assert domains(rendered)["synthetic"] == ("train", "validation", "test")
    assert len(read_poses(rendered, "synthetic", "train")) == 8
    assert read_poses(rendered, "lightbox").name == "lightbox/test"


def test_paper_split_of_speed():
    split = split_indices(12000, seed=3)
    assert [len(part) for part in split.values()] == [7680, 1920, 2400]
    assert np.array_equal(np.sort(np.concatenate(list(split.values()))), np.arange(12000))
    assert not np.array_equal(split["train"], split_indices(12000, seed=4)["train"])


def as_speed(rendered, root):
    """The rendered synthetic images in SPEED's layout, which has another key and other folders."""
    (root / "images").mkdir(parents=True)
    shutil.copytree(rendered / "synthetic" / "images", root / "images" / "train")
    shutil.copy(rendered / "camera.json", root)
    records = json.loads((rendered / "synthetic" / "train.json").read_text())
    for record in records:
        record["q_vbs2tango"] = record.pop("q_vbs2tango_true")
    (root / "train.json").write_text(json.dumps(records))
    return root


def test_speed_layout_is_read_and_split(rendered, tmp_path):
    root = as_speed(rendered, tmp_path / "speed")
    parts = [read_poses(root, "speed", split) for split in ("train", "validation", "test")]
    assert [len(part) for part in parts] == [5, 1, 2]
    assert len({file for part in parts for file in part.files}) == 8


def broken(rendered, root, change):
    shutil.copytree(rendered, root)
    listing = root / "lightbox" / "test.json"
    records = json.loads(listing.read_text())
    change(root, records)
    listing.write_text(json.dumps(records))
    return root


def no_image(root, records):
    (root / "lightbox" / "images" / records[1]["filename"]).unlink()


def long_quaternion(root, records):
    records[2]["q_vbs2tango_true"] = [1.0, 1.0, 0.0, 0.0]


def short_quaternion(root, records):
    records[0]["q_vbs2tango_true"] = [1.0, 0.0, 0.0]


def behind(root, records):
    records[0]["r_Vo2To_vbs_true"][2] = -4.0


def other_size(root, records):
    cv2.imwrite(str(root / "lightbox" / "images" / records[0]["filename"]), np.zeros((10, 10), np.uint8))


def other_camera(root, records):
    camera = json.loads((root / "camera.json").read_text())
    camera["cameraMatrix"][0][0] *= 30
    camera["cameraMatrix"][1][1] *= 30
    (root / "camera.json").write_text(json.dumps(camera))


def no_camera(root, records):
    (root / "camera.json").unlink()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (no_image, "1 of 4 images are missing"),
        (long_quaternion, "record 2: q_vbs2tango_true: expected a unit quaternion"),
        (short_quaternion, "record 0: q_vbs2tango_true: expected 4"),
        (behind, "record 0: r_Vo2To_vbs_true"),
        (other_size, "wrong camera"),
        (other_camera, "wrong camera"),
        (no_camera, "camera.json: no such file"),
    ],
)
def test_what_is_wrong_is_named(rendered, tmp_path, change, message):
    root = broken(rendered, tmp_path / "data", change)
    with pytest.raises(InputError, match=message) as caught:
        read_poses(root, "lightbox")
    assert "\n" not in str(caught.value)


def test_unknown_domain_is_refused(rendered):
    with pytest.raises(InputError, match="lightbox, sunlamp, synthetic"):
        read_poses(rendered, "moon")
