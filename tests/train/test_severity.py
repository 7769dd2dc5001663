"""Robustness curves with a network of known law: its points are off by the noise that it finds in an image."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug_train.geometry import Keypoints
from visaug_train.metrics import Detections
from visaug_train.severity import _taken, points_of, severity
from visaug_train.speed import PoseSet, read_poses

TANGO = Keypoints.load()
CAMERA = Camera.load(
    {
        "name": "measured",
        "resolution": [100, 160],
        "bit_depth": 12,
        "gain_e_per_dn": 2.0,
        "read_noise": {"sigma_e": 8.0},
        "randomize": {"gain_db": {"uniform": [0, 24]}},
    }
)


def spread(file: Path) -> float:
    """Noise in 8-bit steps: the median over blocks of 10 x 10 pixels, most of which are dark sky."""
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).astype(float)
    return float(np.median(image.reshape(10, 10, 16, 10).std(axis=(1, 3))))


class Network:
    """Finds the true points, moved by half a pixel for each step of noise in the image; counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, poses: PoseSet) -> list[Detections]:
        self.calls += 1
        targets, found = poses.targets(TANGO), []
        for file, box, points in zip(poses.files, targets.boxes, targets.points):
            found.append(
                Detections(box[None], points[None] + 0.5 * spread(file), np.ones((1, 11)), np.ones(1))
            )
        return found


def test_curves_follow_the_noise_and_resume(rendered: Path, tmp_path: Path) -> None:
    """More gain and less light are worse, less read noise is better; a second call computes nothing."""
    poses, network = read_poses(rendered, "synthetic", "test"), Network()
    axes = ["gain_db", "exposure", "read_noise"]
    found = severity(poses, TANGO, network, CAMERA, tmp_path / "s", axes)
    assert network.calls == 1 + len(found.rows)
    for axis, sign in (("gain_db", -1), ("exposure", 1), ("read_noise", -1)):
        rows = [row for row in found.rows if row["axis"] == axis]
        oks = np.array([row["oks"] for row in sorted(rows, key=lambda row: row["value"])])
        assert sign * (oks[-1] - oks[0]) > 0.05
        assert oks.max() <= found.clean["oks"] + 1e-9
    again = severity(poses, TANGO, network, CAMERA, tmp_path / "s", axes)
    assert network.calls == 1 + len(found.rows)
    assert again.rows == found.rows
    lines = (tmp_path / "s" / "severity.csv").read_text().splitlines()
    assert lines[0].startswith("axis,value,keypoint_ap")
    assert len(lines) == 2 + len(found.rows)
    assert cv2.imread(str(tmp_path / "s" / "severity.png")) is not None
    assert {file.name for file in (tmp_path / "s").iterdir()} >= {
        "severity.json",
        "severity.csv",
        "severity.png",
    }
    assert not (tmp_path / "s" / "images.partial").exists()
    with pytest.raises(InputError, match="another network"):
        severity(poses, TANGO, network, CAMERA, tmp_path / "s", axes, network="other")


def test_curves_of_a_camera_whose_map_has_changed_are_refused(rendered: Path, tmp_path: Path) -> None:
    """The name of the file is the same."""
    poses, content = read_poses(rendered, "synthetic", "test"), CAMERA.to_dict() | {"dsnu": {"map": "d.npy"}}
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(content))
    for level in (1.0, 2.0):
        np.save(tmp_path / "d.npy", np.full((100, 160), level))
        camera, network = Camera.load(tmp_path / "camera.yaml"), Network()
        if level == 2:
            with pytest.raises(InputError, match="another network, set, camera or seed"):
                severity(poses, TANGO, network, camera, tmp_path / "s", ["exposure"])
            break
        severity(poses, TANGO, network, camera, tmp_path / "s", ["exposure"])


def test_one_thing_changes_at_a_time() -> None:
    """Gain in dB keeps the electrons' law, and an effect at 0 is gone while the others stay."""
    camera = CAMERA.with_effect("row_noise", sigma_e=2.0)
    points = points_of(camera)
    assert {point.axis for point in points} == {
        "gain_db",
        "exposure",
        "temperature_c",
        "read_noise",
        "row_noise",
    }
    at = {(point.axis, point.value): point.camera.values() for point in points}
    assert at["gain_db", 18.0]["gain_e_per_dn"] == pytest.approx(2.0 * 10 ** (-18 / 20))
    assert at["row_noise", 0.0]["row_noise.sigma_e"] == 0
    assert at["row_noise", 0.0]["read_noise.sigma_e"] == 8
    assert at["row_noise", 10.0]["row_noise.sigma_e"] == pytest.approx(20.0)
    with pytest.raises(InputError, match="--curve: hot_pixels has no curve; expected one of gain_db"):
        points_of(camera, ["hot_pixels"])


def test_images_that_differ_in_suffix_alone_stay_two(rendered: Path, tmp_path: Path) -> None:
    poses = read_poses(rendered, "synthetic", "test").select(np.arange(2))
    files = (tmp_path / "a.png", tmp_path / "a.jpg")
    for level, file in enumerate(files):
        cv2.imwrite(str(file), np.full((100, 160), 100 * level + 20, np.uint8))
    (point, *_) = points_of(CAMERA, ["gain_db"])
    taken = _taken(replace(poses, files=files), point, tmp_path / "out", 0)
    means = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).mean() for file in taken.files]
    assert means == pytest.approx([20, 120], abs=3)
