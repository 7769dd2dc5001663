"""Score predictions on a test set: means, AP, pose errors; image by image and as the summary of a domain."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug_train import metrics
from visaug_train.geometry import Keypoints, Targets, rotation_matrix
from visaug_train.metrics import Detections, PrecisionTable, box_iou, keypoint_similarity
from visaug_train.pose import FLOORED_DOMAINS, estimate_pose, pose_errors, spec_score
from visaug_train.predictions import Pose
from visaug_train.speed import PoseSet

# A target without a pose counts as one wholly wrong, and no pose counts for more: silence is never better than an answer,
# nor worse than a wild one. Kelvins has no such limit; it is left out in the score of the answered images.
NO_POSE = (1.0, 180.0)
ERRORS = ("position_error", "position_error_m", "attitude_error_deg")
SPEC_SCORES = ("spec_score", "spec_score_floored", "spec_score_unfloored")
ANSWERED = ("position_error", "attitude_error_deg", "spec_score")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of one network on one test set.

    `table` holds one array (N) a column: iou, oks_paper, oks_coco (the likeliest detection's; 0 where there
    is none), score, pose_found, position_error (a fraction of the distance), position_error_m, attitude_error_deg,
    spec_score (with floors where the domain has them), spec_score_floored, spec_score_unfloored, the errors without
    their limit on images with a pose alone (answered_...), and what they may hang on: distance_m, aspect_deg (angle between
    the line of sight and the body's z axis), brightness (mean of the target's box, 0 to 1). What the predictions do not hold
    has no column: boxes of records without bbox; boxes and keypoints of poses alone. `found` are the poses, None where
    there is none.
    """

    domain: str
    poses: PoseSet
    targets: Targets
    detections: list[Detections]
    table: dict[str, np.ndarray]
    precision: dict[str, PrecisionTable]
    found: list[Pose | None] = field(default_factory=list)

    def summary(self, weights: np.ndarray | None = None) -> dict[str, Any]:
        """The scores of the domain; `weights` (N) are how often each image counts.

        What nothing determines is None, as the errors of a set in which no image shows the target.
        """
        weights = np.ones(len(self.poses)) if weights is None else weights

        def mean(column: str) -> float | None:
            if column not in self.table:
                return None
            value = self.table[column]
            known = np.isfinite(value)
            total = float((weights * known).sum())
            return float((weights * np.where(known, value, 0)).sum() / total) if total > 0 else None

        def precision(name: str) -> float | None:
            return _known(self.precision[name].average(weights)) if name in self.precision else None

        errors = {name: mean(name) for name in (*ERRORS, *SPEC_SCORES)}
        known = [name for name in ERRORS if name in self.table]
        errors |= {f"{name}_median": _known(weighted_median(self.table[name], weights)) for name in known}
        answered = self.found and self.table["pose_found"].any()
        return {
            "images": len(self.poses),
            "iou": mean("iou"),
            "oks": {name: mean(f"oks_{name}") for name in metrics.DEFINITIONS},
            "box_ap50_95": precision("box"),
            "keypoint_ap50_95": {name: precision(name) for name in metrics.DEFINITIONS},
            **errors,
            "poses_found": mean("pose_found"),
            "answered": {name: mean(f"answered_{name}") if answered else None for name in ANSWERED},
        }

    def write_csv(self, path: str | Path) -> None:
        """One line per image."""
        rows = zip(self.poses.ids, *self.table.values())
        lines = [["file", *self.table], *([name, *(f"{v:.6g}" for v in values)] for name, *values in rows)]
        write_text(path, "".join(",".join(line) + "\n" for line in lines))

    def worst_first(self) -> np.ndarray:
        """Indices of the images from the lowest OKS (the paper's) to the highest; ties by IoU."""
        return np.lexsort([self.table["iou"], self.table["oks_paper"]])


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """The value that half of the weight does not exceed, the mean of two where they share it; NaN are left out."""
    counted = np.isfinite(values) & (weights > 0)
    if not counted.any():
        return float("nan")
    order = np.argsort(values[counted])
    sorted_values, total = values[counted][order], np.cumsum(weights[counted][order])
    half = total[-1] / 2
    low, high = np.searchsorted(total, half, side="left"), np.searchsorted(total, half, side="right")
    return float((sorted_values[low] + sorted_values[min(high, len(order) - 1)]) / 2)


def evaluate_poses(poses: PoseSet, keypoints: Keypoints, found: list[Pose | None]) -> Evaluation:
    if not poses.posed:
        raise InputError(f"{poses.name} has no poses, so there is nothing to score")
    targets = poses.targets(keypoints)
    return Evaluation(poses.domain, poses, targets, [], _of_poses(found, poses, targets.seen), {}, found)


def evaluate(domain: str, poses: PoseSet, keypoints: Keypoints, detections: list[Detections]) -> Evaluation:
    """Score detections, one entry per image of `poses`."""
    targets = poses.targets(keypoints)
    shown = list(zip(detections, targets.boxes, targets.points, targets.inside))
    similarities = {"box": [box_iou(each.boxes, box) for each, box, *_ in shown]}
    for name in metrics.DEFINITIONS:
        of = partial(keypoint_similarity, definition=name, sigmas=keypoints.sigmas)
        similarities[name] = [of(each.points, points, inside, box) for each, box, points, inside in shown]
    scores = [each.scores for each in detections]
    visible = np.asarray(targets.inside.any(axis=1))

    def likeliest(values: list[np.ndarray]) -> np.ndarray:
        """Of each image, that of the likeliest detection; 0 where there is none."""
        return np.array([v[np.argmax(score)] if len(score) else 0.0 for v, score in zip(values, scores)])

    table = {
        "iou": np.where(targets.seen, likeliest(similarities["box"]), np.nan),
        "oks_paper": np.where(visible, likeliest(similarities["paper"]), np.nan),
        "oks_coco": np.where(visible, likeliest(similarities["coco"]), np.nan),
        "score": likeliest(scores),
        "distance_m": np.linalg.norm(poses.translations, axis=1),
        "aspect_deg": _aspect_deg(poses),
        "brightness": np.array(list(map(_brightness, poses.files, targets.boxes, targets.seen))),
    }
    found = [pose_of(each, keypoints, poses) for each in detections] if poses.posed else []
    if poses.posed:
        table |= _of_poses(found, poses, targets.seen)
    if not all(np.isfinite(each.boxes).all() for each in detections):
        del similarities["box"], table["iou"]
    counting = dict.fromkeys(metrics.DEFINITIONS, (~visible, metrics.KEYPOINT_SETS_PER_IMAGE))
    counting["box"] = np.zeros(len(poses), bool), metrics.BOXES_PER_IMAGE
    precision = {n: PrecisionTable(scores, v, targets.seen, *counting[n]) for n, v in similarities.items()}
    return Evaluation(domain, poses, targets, detections, table, precision, found)


def pose_of(each: Detections, keypoints: Keypoints, poses: PoseSet) -> Pose | None:
    """From the likeliest detection's keypoints."""
    if not len(each):
        return None
    best = int(np.argmax(each.scores))
    return estimate_pose(each.points[best], each.point_scores[best], keypoints.points_m, poses.camera)


def _of_poses(found: list[Pose | None], poses: PoseSet, seen: np.ndarray) -> dict[str, np.ndarray]:
    answered = np.array([pose is not None for pose in found])
    given = np.array([np.full(7, np.nan) if pose is None else np.concatenate(pose) for pose in found])
    exact = pose_errors(given[:, :4], given[:, 4:], poses.quaternions, poses.translations)
    off, turned_deg = found_errors = [np.where(seen, errors, np.nan) for errors in exact]
    # fmin passes over the NaN of an image without an answer
    position, attitude_deg = (np.where(seen, np.fmin(*each), np.nan) for each in zip(found_errors, NO_POSE))
    floors = poses.domain in FLOORED_DOMAINS
    without_limit = (off, turned_deg, spec_score(off, turned_deg, floors))
    return {
        "pose_found": answered.astype(float),
        "position_error": position,
        "position_error_m": position * np.linalg.norm(poses.translations, axis=1),
        "attitude_error_deg": attitude_deg,
        "spec_score": spec_score(position, attitude_deg, floors),
        "spec_score_floored": spec_score(position, attitude_deg, True),
        "spec_score_unfloored": spec_score(position, attitude_deg, False),
        **{f"answered_{name}": values for name, values in zip(ANSWERED, without_limit)},
    }


def _aspect_deg(poses: PoseSet) -> np.ndarray:
    """The angle between the line of sight and the body's z axis."""
    sight = poses.translations / np.linalg.norm(poses.translations, axis=1, keepdims=True)
    cosine = -(sight * rotation_matrix(poses.quaternions)[:, :, 2]).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def _brightness(file: Path, box: np.ndarray, seen: bool) -> float:
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) if seen else None
    if image is None:
        return float("nan")
    x0, y0, x1, y1 = (int(v) for v in box)
    part = image[y0 : y1 + 1, x0 : x1 + 1]
    return float(part.mean()) / 255 if part.size else float("nan")
