"""Score predictions on a test set: means, AP, pose errors; image by image and as the summary of a domain."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visaug.files import write_text
from visaug_train.geometry import Keypoints, Targets, project_targets, rotation_matrix
from visaug_train.metrics import (
    BOXES_PER_IMAGE,
    DEFINITIONS,
    KEYPOINT_SETS_PER_IMAGE,
    Detections,
    PrecisionTable,
    box_iou,
    keypoint_similarity,
)
from visaug_train.pose import estimate_pose, pose_errors, spec_score
from visaug_train.predictions import load_predictions
from visaug_train.speed import PoseSet, read_poses

# A target without a pose counts as one wholly wrong, so a network cannot better its score by silence.
NO_POSE = (1.0, 180.0)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of one network on one test set.

    `table` holds one array (N) a column: iou, oks_paper, oks_coco (the likeliest detection's; 0 where there
    is none), score, pose_found, position_error, attitude_error_deg, spec_score, and what they may hang on:
    distance_m, aspect_deg (angle between the line of sight and the body's z axis), brightness (mean of the
    target's box, 0 to 1).
    """

    domain: str
    poses: PoseSet
    targets: Targets
    detections: list[Detections]
    table: dict[str, np.ndarray]
    precision: dict[str, PrecisionTable]

    def summary(self, weights: np.ndarray | None = None) -> dict[str, Any]:
        """The scores of the domain; `weights` (N) are how often each image counts."""
        weights = np.ones(len(self.poses)) if weights is None else weights

        def mean(column: str) -> float:
            value = self.table[column]
            known = np.isfinite(value)
            return float((weights * np.where(known, value, 0)).sum() / max((weights * known).sum(), 1e-12))

        return {
            "images": len(self.poses),
            "iou": mean("iou"),
            "oks": {name: mean(f"oks_{name}") for name in DEFINITIONS},
            "box_ap50_95": self.precision["box"].average(weights),
            "keypoint_ap50_95": {name: self.precision[name].average(weights) for name in DEFINITIONS},
            "position_error": mean("position_error"),
            "attitude_error_deg": mean("attitude_error_deg"),
            "spec_score": mean("spec_score"),
            "poses_found": mean("pose_found"),
        }

    def __repr__(self) -> str:
        s = self.summary()
        return (
            f"Evaluation({self.domain}, {s['images']} images, box AP {s['box_ap50_95']:.3f}, "
            f"keypoint AP {s['keypoint_ap50_95']['paper']:.3f} (paper) {s['keypoint_ap50_95']['coco']:.3f} (COCO))"
        )

    def to_json(self) -> dict[str, Any]:
        """The summary under the domain's name."""
        return {self.domain: self.summary()}

    def write_csv(self, path: str | Path) -> None:
        """One line per image."""
        columns = list(self.table)
        lines = [",".join(["file", *columns])]
        for i, file in enumerate(self.poses.files):
            lines.append(",".join([file.name, *(f"{self.table[c][i]:.6g}" for c in columns)]))
        write_text(path, "\n".join(lines) + "\n")

    def worst(self, count: int = 8) -> np.ndarray:
        """Indices of the images with the lowest OKS (the paper's), worst first; ties by IoU."""
        return np.lexsort([self.table["iou"], self.table["oks_paper"]])[:count]

    def best(self, count: int = 8) -> np.ndarray:
        """Indices of the images with the highest OKS."""
        return np.lexsort([self.table["iou"], self.table["oks_paper"]])[::-1][:count]


def evaluate_predictions(
    predictions: str | Path,
    data: str | Path,
    domain: str,
    keypoints: str | Path = "tango",
    split: str | None = None,
) -> dict[str, Any]:
    """Scores of any network's predictions on a domain of a SPEED or SPEED+ folder: {domain: summary}."""
    poses = read_poses(data, domain, split)
    points = Keypoints.load(keypoints)
    return evaluate(domain, poses, points, load_predictions(predictions, poses, len(points))).to_json()


def evaluate(domain: str, poses: PoseSet, keypoints: Keypoints, detections: list[Detections]) -> Evaluation:
    """Score detections, one entry per image of `poses`."""
    targets = project_targets(poses.camera, keypoints, poses.quaternions, poses.translations)
    similarities: dict[str, list[np.ndarray]] = {name: [] for name in ("box", *DEFINITIONS)}
    rows: list[dict[str, float]] = []
    for i, each in enumerate(detections):
        box, points, inside = targets.boxes[i], targets.points[i], targets.inside[i]
        similarities["box"].append(box_iou(each.boxes, box))
        for name in DEFINITIONS:
            similarities[name].append(keypoint_similarity(each.points, points, inside, box, name))
        rows.append(
            _row(
                i,
                each,
                {name: values[-1] for name, values in similarities.items()},
                targets,
                poses,
                keypoints,
            )
        )
    table = {column: np.array([row[column] for row in rows]) for column in rows[0]}
    scores = [each.scores for each in detections]
    unseen = ~targets.inside.any(axis=1)
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
    return Evaluation(domain, poses, targets, detections, table, precision)


def _row(
    i: int,
    each: Detections,
    similarity: dict[str, np.ndarray],
    targets: Targets,
    poses: PoseSet,
    keypoints: Keypoints,
) -> dict[str, float]:
    best = int(np.argmax(each.scores)) if len(each) else None
    seen, visible = bool(targets.seen[i]), bool(targets.inside[i].any())

    def of(name: str, counts: bool) -> float:
        return float("nan") if not counts else 0.0 if best is None else float(similarity[name][best])

    pose = None
    if best is not None:
        pose = estimate_pose(each.points[best], each.point_scores[best], keypoints.points_m, poses.camera)
    errors = NO_POSE if pose is None else pose_errors(*pose, poses.quaternions[i], poses.translations[i])
    if not seen:
        errors = (float("nan"), float("nan"))
    sight = poses.translations[i] / np.linalg.norm(poses.translations[i])
    axis = rotation_matrix(poses.quaternions[i])[:, 2]
    return {
        "iou": of("box", seen),
        "oks_paper": of("paper", visible),
        "oks_coco": of("coco", visible),
        "score": 0.0 if best is None else float(each.scores[best]),
        "pose_found": float(pose is not None),
        "position_error": errors[0],
        "attitude_error_deg": errors[1],
        "spec_score": float(spec_score(np.array(errors[0]), np.array(errors[1]))),
        "distance_m": float(np.linalg.norm(poses.translations[i])),
        "aspect_deg": float(np.degrees(np.arccos(np.clip(-sight @ axis, -1, 1)))),
        "brightness": _brightness(poses.files[i], targets.boxes[i]) if seen else float("nan"),
    }


def _brightness(file: Path, box: np.ndarray) -> float:
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return float("nan")
    x0, y0, x1, y1 = (int(v) for v in box)
    part = image[y0 : y1 + 1, x0 : x1 + 1]
    return float(part.mean()) / 255 if part.size else float("nan")
