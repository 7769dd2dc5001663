"""The evaluator on a rendered domain: perfect, missed and malformed predictions."""

import json
from dataclasses import replace

import numpy as np
import pytest

from visaug.core.errors import InputError
from visaug_train import tables
from visaug_train.commands import evaluate_predictions
from visaug_train.evaluate import evaluate
from visaug_train.geometry import Keypoints, project_targets
from visaug_train.metrics import Detections
from visaug_train.predictions import load_predictions, save_predictions
from visaug_train.speed import read_poses

TANGO = Keypoints.load("tango")


def perfect(poses):
    targets = project_targets(poses.camera, TANGO, poses.quaternions, poses.translations)
    return [
        Detections(box[None], points[None], np.ones((1, 11)), np.ones(1))
        for box, points in zip(targets.boxes, targets.points)
    ]


def test_perfect_predictions_score_one(rendered, tmp_path):
    poses = read_poses(rendered, "lightbox")
    save_predictions(tmp_path / "p.json", poses, perfect(poses))
    scores = evaluate_predictions(tmp_path / "p.json", rendered, "lightbox")["lightbox"]
    assert scores["images"] == 4
    assert scores["iou"] == pytest.approx(1, abs=1e-3)
    assert scores["oks"]["paper"] == pytest.approx(1, abs=1e-4)
    assert scores["box_ap50_95"] == pytest.approx(1)
    assert scores["keypoint_ap50_95"] == pytest.approx({"paper": 1, "coco": 1})
    assert scores["position_error"] < 1e-3
    assert scores["attitude_error_deg"] < 0.1
    assert scores["spec_score"] == 0


def test_missed_target_counts_zero_and_as_a_wrong_pose(rendered):
    poses = read_poses(rendered, "lightbox")
    found = perfect(poses)
    found[1] = Detections.none(11)
    scores = evaluate("lightbox", poses, TANGO, found).summary()
    assert scores["iou"] == pytest.approx(0.75, abs=1e-3)
    assert scores["oks"]["coco"] == pytest.approx(0.75, abs=1e-3)
    assert scores["poses_found"] == 0.75
    assert scores["position_error"] == pytest.approx(0.25, abs=1e-3)
    assert scores["attitude_error_deg"] == pytest.approx(45, abs=0.1)
    # Recall ends at 3 / 4: 76 of 101 recall levels have precision 1.
    assert scores["box_ap50_95"] == pytest.approx(76 / 101)


def test_the_likeliest_detection_counts(rendered):
    poses = read_poses(rendered, "lightbox")
    good = perfect(poses)
    twice = [
        Detections(
            np.concatenate([d.boxes + 40, d.boxes]),
            np.concatenate([d.points + 40, d.points]),
            np.ones((2, 11)),
            np.array([0.2, 0.9]),
        )
        for d in good
    ]
    assert evaluate("x", poses, TANGO, twice).summary()["iou"] == pytest.approx(1, abs=1e-3)


def test_files_round_trip_and_every_image_has_a_line(rendered, tmp_path):
    poses = read_poses(rendered, "sunlamp")
    save_predictions(tmp_path / "p.json", poses, perfect(poses))
    record = json.loads((tmp_path / "p.json").read_text())[0]
    assert {"file_name", "bbox", "keypoints", "score"} <= record.keys()
    assert len(record["keypoints"]) == 33
    evaluation = evaluate("sunlamp", poses, TANGO, load_predictions(tmp_path / "p.json", poses, 11))
    evaluation.write_csv(tmp_path / "images.csv")
    lines = (tmp_path / "images.csv").read_text().splitlines()
    assert len(lines) == 5
    assert lines[0].startswith("file,iou,oks_paper,oks_coco")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"file_name": "other.png"}, "record 0.file_name"),
        ({"bbox": [1, 2, 3]}, "record 0.bbox"),
        ({"bbox": [1, 2, -3, 4]}, "record 0.bbox"),
        ({"file_name": None}, "record 0.file_name: is missing"),
        ({"keypoints": [1.0] * 51}, "record 0.keypoints: has 51 numbers; expected 33"),
        ({"keypoints": [[1, 2, 3]] * 11}, "record 0.keypoints: is malformed"),
        ({"score": "high"}, "record 0.score"),
        ({"score": float("nan")}, "NaN is not a number of JSON"),
    ],
)
def test_malformed_predictions_are_named(rendered, tmp_path, change, message):
    poses = read_poses(rendered, "sunlamp")
    record = {"file_name": poses.files[0].name, "bbox": [1, 2, 3, 4], "keypoints": [0.0] * 33, "score": 0.5}
    (tmp_path / "p.json").write_text(json.dumps([record | change]))
    with pytest.raises(InputError, match=message):
        evaluate_predictions(tmp_path / "p.json", rendered, "sunlamp")


def test_a_set_that_shows_no_target_determines_nothing(rendered, tmp_path):
    """All targets beside the image: neither AP nor errors are known, and the scores are JSON."""
    poses = read_poses(rendered, "lightbox")
    away = replace(poses, translations=np.array([[20.0, 0, 5]] * len(poses)))
    assert not away.targets(TANGO).seen.any()
    scores = evaluate("lightbox", away, TANGO, perfect(poses)).summary()
    known = {"images": 4, "poses_found": 1.0}
    for key, value in scores.items():
        values = value.values() if isinstance(value, dict) else [value]
        assert {*values} == {known.get(key)}, key
    json.dumps(scores, allow_nan=False)
    assert np.isnan(tables.value(scores, "spec_score"))
    assert tables.pose_table({"a": {"lightbox": [scores]}}).rows[0][2] == ""


@pytest.mark.parametrize("key", [[1], {"a": 1}])
def test_an_image_id_that_is_no_id_is_one_line(rendered, tmp_path, key):
    poses = read_poses(rendered, "lightbox")
    save_predictions(tmp_path / "p.json", poses, perfect(poses))
    records = json.loads((tmp_path / "p.json").read_text())
    records[0] = {name: value for name, value in records[0].items() if name != "file_name"} | {
        "image_id": key
    }
    (tmp_path / "p.json").write_text(json.dumps(records))
    (tmp_path / "i.json").write_text(json.dumps({"images": [{"id": 1, "file_name": poses.ids[0]}]}))
    with pytest.raises(InputError, match="is no image of the annotations file"):
        load_predictions(tmp_path / "p.json", poses, 11, tmp_path / "i.json")
