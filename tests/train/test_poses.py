"""Poses in and out, and which domains have SPEC's floors."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from visaug.core.errors import InputError
from visaug_train.commands import evaluate_predictions
from visaug_train.evaluate import weighted_median
from visaug_train.geometry import Keypoints, project_targets
from visaug_train.metrics import Detections
from visaug_train.predictions import load_poses, save_poses, save_predictions
from visaug_train.speed import read_poses

TURN_DEG, STEP = 0.12, 0.0015  # below SPEC's floors of 0.169 deg and 2.173 mm/m


def slightly_off(poses):
    found = []
    for q, r in zip(poses.quaternions, poses.translations):
        turned = Rotation.from_quat(np.roll(q, -1)) * Rotation.from_rotvec([np.radians(TURN_DEG), 0, 0])
        found.append((np.roll(turned.as_quat(), 1), r * (1 + STEP)))
    return found


@pytest.mark.parametrize(("domain", "floors"), [("lightbox", True), ("sunlamp", True), ("synthetic", False)])
def test_floors_are_those_of_the_laboratorys_images(rendered, tmp_path, domain, floors):
    poses = read_poses(rendered, domain, "test")
    save_poses(tmp_path / "sub.csv", poses, slightly_off(poses))
    scores = evaluate_predictions(tmp_path / "sub.csv", rendered, domain)[domain]
    exact = STEP + np.radians(TURN_DEG)
    assert scores["spec_score_unfloored"] == pytest.approx(exact, rel=1e-4)
    assert scores["spec_score_floored"] == 0
    assert scores["spec_score"] == (0 if floors else pytest.approx(exact, rel=1e-4))
    distances = np.linalg.norm(poses.translations, axis=1)
    assert scores["position_error_m"] == pytest.approx(STEP * distances.mean(), rel=1e-4)
    assert scores["position_error_m_median"] == pytest.approx(STEP * np.median(distances), rel=1e-4)
    assert scores["attitude_error_deg_median"] == pytest.approx(TURN_DEG, rel=1e-4)
    assert scores["iou"] is None
    assert scores["poses_found"] == 1


def test_a_head_is_passed_over_and_a_missing_image_is_a_missed_one(rendered, tmp_path):
    poses = read_poses(rendered, "lightbox")
    found = slightly_off(poses)
    found[1] = None
    save_poses(tmp_path / "sub.csv", poses, found)
    text = "filename,q1,q2,q3,q4,r1,r2,r3\n" + (tmp_path / "sub.csv").read_text()
    (tmp_path / "head.csv").write_text(text)
    again = load_poses(tmp_path / "head.csv", poses)
    assert [pose is None for pose in again] == [False, True, False, False]
    np.testing.assert_allclose(again[2][1], found[2][1], rtol=1e-8)
    scores = evaluate_predictions(tmp_path / "head.csv", rendered, "lightbox")["lightbox"]
    assert scores["poses_found"] == 0.75
    assert scores["attitude_error_deg"] == pytest.approx((180 + 3 * TURN_DEG) / 4)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{name},1,0,0,0,0,0", "pose 0: holds"),
        ("{name},1,0,0,0,0,0,nan\n{name},1,0,0,0,0,0,5", "holds"),
        ("{name},2,0,0,0,0,0,5", "length 2"),
        ("none.png,1,0,0,0,0,0,5", "no image of lightbox/test"),
        ("{name},1,0,0,0,0,0,5\n{name},1,0,0,0,0,0,5", "pose 1: .* comes twice"),
        ("", "holds no poses"),
    ],
)
def test_malformed_poses_are_named(rendered, tmp_path, line, message):
    poses = read_poses(rendered, "lightbox")
    name = poses.files[0].name
    first = f"{name},1,0,0,0,0,0,5\n" if "nan" in line else ""
    (tmp_path / "sub.csv").write_text(first + line.format(name=name))
    with pytest.raises(InputError, match=message):
        load_poses(tmp_path / "sub.csv", poses)


def test_image_ids_are_read_with_their_annotations(rendered, tmp_path):
    """As pycocotools and mmpose write results; and poses come out of them."""
    poses = read_poses(rendered, "sunlamp")
    tango = Keypoints.load()
    targets = project_targets(poses.camera, tango, poses.quaternions, poses.translations)
    perfect = [
        Detections(box[None], points[None], np.ones((1, 11)), np.ones(1))
        for box, points in zip(targets.boxes, targets.points)
    ]
    save_predictions(tmp_path / "p.json", poses, perfect)
    images = [{"id": 70 + i, "file_name": f"sunlamp/images/{f.name}"} for i, f in enumerate(poses.files)]
    ids = {image["file_name"].split("/")[-1]: image["id"] for image in images}
    records = json.loads((tmp_path / "p.json").read_text())
    for record in records:
        record["image_id"] = ids[record.pop("file_name")]
    (tmp_path / "ids.json").write_text(json.dumps(records))
    (tmp_path / "annotations.json").write_text(json.dumps({"images": images, "annotations": []}))
    with pytest.raises(InputError, match=r"record 0\.file_name: is missing.*--images"):
        evaluate_predictions(tmp_path / "ids.json", rendered, "sunlamp")
    scores = evaluate_predictions(
        tmp_path / "ids.json",
        rendered,
        "sunlamp",
        images=tmp_path / "annotations.json",
        poses_csv=tmp_path / "poses.csv",
    )
    assert scores["sunlamp"]["iou"] == pytest.approx(1, abs=1e-3)
    again = evaluate_predictions(tmp_path / "poses.csv", rendered, "sunlamp")["sunlamp"]
    assert again["position_error_m"] == pytest.approx(scores["sunlamp"]["position_error_m"], abs=1e-6)
    records[0]["image_id"] = 5
    (tmp_path / "ids.json").write_text(json.dumps(records))
    with pytest.raises(InputError, match=r"record 0\.image_id: 5 is no image"):
        evaluate_predictions(tmp_path / "ids.json", rendered, "sunlamp", images=tmp_path / "annotations.json")


def test_a_weighted_median_is_that_of_repeated_values():
    rng = np.random.default_rng(6)
    for _ in range(20):
        values, weights = rng.normal(size=9), rng.integers(0, 4, 9)
        if weights.sum():
            repeated = np.repeat(values, weights)
            assert weighted_median(values, weights.astype(float)) == pytest.approx(np.median(repeated))
