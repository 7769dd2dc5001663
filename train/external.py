"""Scores of predictions that any network wrote into a file, and a submission where there are no labels."""

from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug_train.datasets import keypoints_of, read_poses
from visaug_train.evaluate import evaluate, evaluate_poses, pose_of
from visaug_train.geometry import Keypoints
from visaug_train.image_names import ImageNames, names_elsewhere
from visaug_train.metrics import Detections
from visaug_train.poses import load_poses, save_poses, save_submission
from visaug_train.predictions import load_predictions
from visaug_train.readings import point_readings
from visaug_train.speed import PoseSet


def evaluate_predictions(
    predictions: str | Path,
    data: str | Path,
    domain: str,
    keypoints: str | Path = "tango",
    split: str | None = None,
    images: str | Path | None = None,
    poses_csv: str | Path | None = None,
) -> dict[str, Any]:
    """Scores of any network's predictions on a domain of a data set: {domain: summary}.

    Args:
        predictions: COCO's results of keypoints, or poses as Kelvins takes them (NAME.csv). What they do not hold has no
            score (None): boxes where records have no `bbox`, boxes and keypoints of poses.
        data: the folder.
        domain: which of its test sets.
        keypoints: the model that the keypoints belong to.
        split: of the domain, where it has several.
        images: COCO's annotations file, for records with `image_id`.
        poses_csv: where to write the poses that the keypoints give. Of images without labels that is all there is to do:
            every image gets a line, as a submission to Kelvins needs it.

    Returns:
        The summary, with `notes`: what was recognised in the predictions, and what their score leaves out.
    """
    poses = read_poses(data, domain, split, labels=False)
    points = keypoints_of(keypoints, poses)
    names = ImageNames(poses, names_elsewhere(data, poses))
    notes: list[str] = []
    if Path(predictions).suffix.lower() == ".csv":
        evaluation = evaluate_poses(poses, points, load_poses(predictions, poses, names, notes.append))
    else:
        detections = load_predictions(predictions, poses, len(points), images, names)
        if not poses.labelled:
            return {domain: submission(poses, points, detections, poses_csv)}
        targets = poses.targets(points)
        size = (poses.camera.width, poses.camera.height)
        detections = point_readings(detections, targets, size, notes.append)
        evaluation = evaluate(domain, poses, points, detections)
        if "iou" not in evaluation.table:
            notes.append("boxes are not scored, for not every record has a bbox")
    if poses_csv is not None and poses.posed:
        save_poses(poses_csv, poses, evaluation.found)
    return {domain: evaluation.summary() | {"notes": notes}}


def submission(
    poses: PoseSet, keypoints: Keypoints, detections: list[Detections], path: str | Path | None
) -> dict[str, Any]:
    """Write the poses of images without labels as Kelvins wants them; what to say in place of scores."""
    if path is None:
        raise InputError(
            f"{poses.name} has no labels, so there is nothing to score",
            field="--poses",
            expected="the CSV to write for a submission",
        )
    missing = save_submission(path, poses, [pose_of(each, keypoints, poses) for each in detections])
    note = (
        f"{missing} of {len(poses)} images have no pose of their own; they got the median position, unrotated"
    )
    return {"images": len(poses), "poses_found": 1 - missing / len(poses), "notes": [note] if missing else []}
