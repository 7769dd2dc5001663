"""Score predictions on a test set: means, AP, pose errors; image by image and as the summary of a domain."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug_train.geometry import Keypoints, Targets, rotation_matrix
from visaug_train.metrics import (
    BOXES_PER_IMAGE,
    DEFINITIONS,
    KEYPOINT_SETS_PER_IMAGE,
    Detections,
    PrecisionTable,
    box_iou,
    keypoint_similarity,
)
from visaug_train.pose import FLOORED_DOMAINS, estimate_pose, pose_errors, spec_score
from visaug_train.poses import Pose
from visaug_train.speed import PoseSet

# A target without a pose counts as one wholly wrong, and no pose counts for more: silence is never better than an answer,
# nor worse than a wild one. Kelvins has no such limit; it is left out in the score of the answered images.
NO_POSE = (1.0, 180.0)
POSE_ERRORS = (
    "position_error",
    "position_error_m",
    "attitude_error_deg",
    "spec_score",
    "spec_score_floored",
    "spec_score_unfloored",
)
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
        """The scores of the domain; `weights` (N) are how often each image counts."""
        weights = np.ones(len(self.poses)) if weights is None else weights

        def mean(column: str) -> float | None:
            if column not in self.table:
                return None
            value = self.table[column]
            known = np.isfinite(value)
            return float((weights * np.where(known, value, 0)).sum() / max((weights * known).sum(), 1e-12))

        def precision(name: str) -> float | None:
            return self.precision[name].average(weights) if name in self.precision else None

        errors = {name: mean(name) for name in POSE_ERRORS}
        errors |= {
            f"{name}_median": weighted_median(self.table[name], weights)
            for name in POSE_ERRORS
            if "error" in name and name in self.table
        }
        return {
            "images": len(self.poses),
            "iou": mean("iou"),
            "oks": {name: mean(f"oks_{name}") for name in DEFINITIONS},
            "box_ap50_95": precision("box"),
            "keypoint_ap50_95": {name: precision(name) for name in DEFINITIONS},
            **errors,
            "poses_found": mean("pose_found"),
            "answered": {
                name: mean(f"answered_{name}") if self.found and self.table["pose_found"].any() else None
                for name in ANSWERED
            },
        }

    def __repr__(self) -> str:
        s = self.summary()
        return f"Evaluation({self.domain}, {s['images']} images, keypoint AP {s['keypoint_ap50_95']})"

    def write_csv(self, path: str | Path) -> None:
        """One line per image."""
        columns = list(self.table)
        lines = [",".join(["file", *columns])]
        for i, name in enumerate(self.poses.ids):
            lines.append(",".join([name, *(f"{self.table[c][i]:.6g}" for c in columns)]))
        write_text(path, "\n".join(lines) + "\n")

    def worst_first(self) -> np.ndarray:
        """Indices of the images from the lowest OKS (the paper's) to the highest; ties by IoU."""
        return np.lexsort([self.table["iou"], self.table["oks_paper"]])


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
    """Score poses alone."""
    if not poses.posed:
        raise InputError(f"{poses.name} has no poses, so there is nothing to score")
    targets = poses.targets(keypoints)
    rows = [_pose_row(i, pose, poses, bool(targets.seen[i])) for i, pose in enumerate(found)]
    return Evaluation(poses.domain, poses, targets, [], _columns(rows), {}, found)


def _columns(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    return {column: np.array([row[column] for row in rows]) for column in rows[0]}


def evaluate(domain: str, poses: PoseSet, keypoints: Keypoints, detections: list[Detections]) -> Evaluation:
    """Score detections, one entry per image of `poses`."""
    targets = poses.targets(keypoints)
    similarities: dict[str, list[np.ndarray]] = {name: [] for name in ("box", *DEFINITIONS)}
    rows: list[dict[str, float]] = []
    found: list[Pose | None] = []
    for i, each in enumerate(detections):
        box, points, inside = targets.boxes[i], targets.points[i], targets.inside[i]
        similarities["box"].append(box_iou(each.boxes, box))
        for name in DEFINITIONS:
            similarities[name].append(
                keypoint_similarity(each.points, points, inside, box, name, keypoints.sigmas)
            )
        latest = {name: values[-1] for name, values in similarities.items()}
        row = _row(i, each, latest, targets, poses)
        if poses.posed:
            found.append(pose_of(each, keypoints, poses))
            row |= _pose_row(i, found[-1], poses, bool(targets.seen[i]))
        rows.append(row)
    table = _columns(rows)
    if not all(np.isfinite(each.boxes).all() for each in detections):
        del similarities["box"], table["iou"]
    scores = [each.scores for each in detections]
    unseen = np.asarray(~targets.inside.any(axis=1))
    precision = {
        name: PrecisionTable(
            scores,
            values,
            targets.seen,
            np.zeros(len(poses), bool) if name == "box" else unseen,
            BOXES_PER_IMAGE if name == "box" else KEYPOINT_SETS_PER_IMAGE,
        )
        for name, values in similarities.items()
    }
    return Evaluation(domain, poses, targets, detections, table, precision, found)


def pose_of(each: Detections, keypoints: Keypoints, poses: PoseSet) -> Pose | None:
    """From the likeliest detection's keypoints."""
    if not len(each):
        return None
    best = int(np.argmax(each.scores))
    return estimate_pose(each.points[best], each.point_scores[best], keypoints.points_m, poses.camera)


def _pose_row(i: int, pose: Pose | None, poses: PoseSet, seen: bool) -> dict[str, float]:
    true = poses.quaternions[i], poses.translations[i]
    exact = NO_POSE if pose is None else pose_errors(*pose, *true)
    if not seen:
        exact = float("nan"), float("nan")
    position, attitude_deg = np.minimum(exact, NO_POSE)  # NaN stays
    floors = poses.domain in FLOORED_DOMAINS

    def spec(position: float, attitude_deg: float, floors: bool) -> float:
        return float(spec_score(np.array(position), np.array(attitude_deg), floors))

    answered = {
        "position_error": exact[0],
        "attitude_error_deg": exact[1],
        "spec_score": spec(*exact, floors),
    }
    return {
        "pose_found": float(pose is not None),
        "position_error": float(position),
        "position_error_m": float(position) * float(np.linalg.norm(true[1])),
        "attitude_error_deg": float(attitude_deg),
        "spec_score": spec(position, attitude_deg, floors),
        "spec_score_floored": spec(position, attitude_deg, True),
        "spec_score_unfloored": spec(position, attitude_deg, False),
        **{f"answered_{name}": answered[name] if pose is not None else float("nan") for name in ANSWERED},
    }


def _row(
    i: int, each: Detections, similarity: dict[str, np.ndarray], targets: Targets, poses: PoseSet
) -> dict[str, float]:
    best = int(np.argmax(each.scores)) if len(each) else None
    seen, visible = bool(targets.seen[i]), bool(targets.inside[i].any())

    def of(name: str, counts: bool) -> float:
        return float("nan") if not counts else 0.0 if best is None else float(similarity[name][best])

    return {
        "iou": of("box", seen),
        "oks_paper": of("paper", visible),
        "oks_coco": of("coco", visible),
        "score": 0.0 if best is None else float(each.scores[best]),
        "distance_m": float(np.linalg.norm(poses.translations[i])),
        "aspect_deg": _aspect_deg(poses, i),
        "brightness": _brightness(poses.files[i], targets.boxes[i]) if seen else float("nan"),
    }


def _aspect_deg(poses: PoseSet, i: int) -> float:
    """The angle between the line of sight and the body's z axis."""
    sight = poses.translations[i] / np.linalg.norm(poses.translations[i])
    axis = rotation_matrix(poses.quaternions[i])[:, 2]
    return float(np.degrees(np.arccos(np.clip(-sight @ axis, -1, 1))))


def _brightness(file: Path, box: np.ndarray) -> float:
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return float("nan")
    x0, y0, x1, y1 = (int(v) for v in box)
    part = image[y0 : y1 + 1, x0 : x1 + 1]
    return float(part.mean()) / 255 if part.size else float("nan")
