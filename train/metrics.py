"""IoU, OKS and average precision of boxes and keypoints, one target an image, by COCO's procedure.

Independent of ultralytics and of pycocotools (which the tests compare it with). Two definitions of OKS stand
side by side: the paper's, exp(-d^2 / (2 s^2 A)) with s = 1 / K for K keypoints and A the area of the box; and
COCO's as ultralytics has it, with 2 s in the place of s and 0.53 A in the place of A. On the same predictions
the paper's is far stricter.
"""

from dataclasses import dataclass

import numpy as np

THRESHOLDS = np.linspace(0.5, 0.95, 10)
DEFINITIONS = ("paper", "coco")
BOXES_PER_IMAGE, KEYPOINT_SETS_PER_IMAGE = 100, 20  # COCO's maxDets


@dataclass(frozen=True, eq=False)
class Detections:
    """Detections of a network in one image.

    Boxes (D, 4) x0 y0 x1 y1, points (D, K, 2), point scores (D, K), scores (D).
    """

    boxes: np.ndarray
    points: np.ndarray
    point_scores: np.ndarray
    scores: np.ndarray

    def __len__(self) -> int:
        return len(self.scores)

    @classmethod
    def none(cls, keypoints: int) -> "Detections":
        return cls(np.zeros((0, 4)), np.zeros((0, keypoints, 2)), np.zeros((0, keypoints)), np.zeros(0))


def box_iou(boxes: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Intersection over union of boxes (D, 4) with one box (4), x0 y0 x1 y1."""
    low, high = np.maximum(boxes[:, :2], target[:2]), np.minimum(boxes[:, 2:], target[2:])
    shared = np.prod(np.clip(high - low, 0, None), axis=1)
    both = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) + np.prod(target[2:] - target[:2]) - shared
    return np.where(both > 0, shared / np.where(both > 0, both, 1), 0.0)


def keypoint_similarity(
    points: np.ndarray,
    target: np.ndarray,
    visible: np.ndarray,
    box: np.ndarray,
    definition: str,
    sigmas: np.ndarray | None = None,
) -> np.ndarray:
    """OKS (D) of points (D, K, 2) with a target's (K, 2), over those visible (K); `definition` is paper or
    coco. The latter takes the points' own `sigmas` (K) where they are given.

    Where no keypoint is visible, COCO measures how far the points lie from the box enlarged threefold.
    """
    span = box[2:] - box[:2]
    area = span[0] * span[1] * (1.0 if definition == "paper" else 0.53)
    sigma = np.full(len(target), 1 / len(target))
    if definition == "coco":
        sigma = 2 * (sigma if sigmas is None else sigmas)
    if visible.any():
        offset, sigma = (points - target)[:, visible], sigma[visible]
    else:
        low, high = box[:2] - span, box[:2] + 2 * span
        offset = np.clip(low - points, 0, None) + np.clip(points - high, 0, None)
    return np.exp(-(offset**2).sum(axis=2) / (2 * sigma**2 * (area + np.spacing(1)))).mean(axis=1)


class PrecisionTable:
    """Average precision over IoU (or OKS) thresholds 0.5 ... 0.95 of images with at most one target each.

    Matching and sorting are done once; `average(weights)` then gives the AP of any weighting of the images, such as how often a
    bootstrap resample holds each.

    Args:
        scores, similarities: of each image, (D) both: the detections' scores and their similarity to the target.
        present: (N) whether the image has a target.
        ignored: (N) whether the target, and the detection that matches it, count neither way.
    """

    def __init__(
        self,
        scores: list[np.ndarray],
        similarities: list[np.ndarray],
        present: np.ndarray,
        ignored: np.ndarray,
        most: int,
    ) -> None:
        self.counted = (present & ~ignored).astype(float)
        hits, skips, images, all_scores = [], [], [], []
        for i, (score, similarity) in enumerate(zip(scores, similarities)):
            order = np.argsort(-score, kind="mergesort")[:most]
            enough = similarity[order] >= np.minimum(THRESHOLDS, 1 - 1e-10)[:, None]
            if not present[i]:
                enough[:] = False
            first = enough & (np.cumsum(enough, axis=1) == 1)  # the best-scored match takes the target
            hits.append(first & ~ignored[i])
            skips.append(first & ignored[i])
            images.append(np.full(len(order), i))
            all_scores.append(score[order])
        order = np.argsort(-np.concatenate([*all_scores, np.zeros(0)]), kind="mergesort")
        self.image = np.concatenate([*images, np.zeros(0, int)])[order].astype(int)
        self.hit = np.concatenate([*hits, np.zeros((len(THRESHOLDS), 0), bool)], axis=1)[:, order]
        skip = np.concatenate([*skips, np.zeros((len(THRESHOLDS), 0), bool)], axis=1)[:, order]
        self.miss = ~self.hit & ~skip

    def average(self, weights: np.ndarray | None = None) -> float:
        """AP50-95 with the images weighted; NaN where none has a target that counts."""
        weights = np.ones(len(self.counted)) if weights is None else weights
        targets = float((weights * self.counted).sum())
        if targets == 0:
            return float("nan")
        each = weights[self.image]
        hits, misses = np.cumsum(self.hit * each, axis=1), np.cumsum(self.miss * each, axis=1)
        recall = hits / targets
        precision = hits / (hits + misses + np.spacing(1))
        envelope = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
        total, recalls = 0.0, np.linspace(0.0, 1.0, 101)
        for found, best in zip(recall, envelope):
            at = np.searchsorted(found, recalls, side="left")
            total += best[at[at < len(best)]].sum()
        return float(total) / (len(THRESHOLDS) * len(recalls))
