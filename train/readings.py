"""Conventions in which predictions may be written, told by how well each fits the true poses.

A reading other than the expected one is taken only where it is beyond doubt: its median error is less than a quarter of
that of the file as it stands. It is always said.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import binomtest

from visaug_train.geometry import Targets
from visaug_train.metrics import Detections
from visaug_train.pose import pose_errors
from visaug_train.speed import PoseSet

Say = Callable[[str], None]
LEAST_IMAGES = 3  # below these a wrong prediction may fit another reading by chance
UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001}


def clearly(errors: Sequence[np.ndarray]) -> int:
    """Which reading is meant, by the errors (N) of each: the first, which is the expected one, unless another is far nearer to
    the truth.
    """
    medians = [float(np.nanmedian(each)) for each in errors]
    best = int(np.argmin(medians))
    beyond_doubt = 0.25  # of the median error as given
    return best if medians[best] < beyond_doubt * medians[0] else 0


def pose_readings(
    quaternions: np.ndarray, translations: np.ndarray, poses: PoseSet, say: Say
) -> tuple[np.ndarray, np.ndarray]:
    """Quaternions (N, 4) scalar first and translations (N, 3) in metres; NaN where an image has no answer."""
    answered = np.isfinite(quaternions).all(axis=1)
    if not poses.posed or answered.sum() < LEAST_IMAGES:
        return quaternions, translations
    true = poses.quaternions, poses.translations
    orders = [quaternions, np.roll(quaternions, 1, axis=1)]
    if order := clearly([pose_errors(each, translations, *true)[1] for each in orders]):
        say("the quaternions are scalar last (x, y, z, w), and were read so")
    scaled = [translations * factor for factor in UNITS.values()]
    if unit := clearly([pose_errors(quaternions, each, *true)[0] for each in scaled]):
        say(f"the positions are in {list(UNITS)[unit]}, and were read so")
    return orders[order], scaled[unit]


def which_block(blocks: Sequence[np.ndarray], foreign: Sequence[int], poses: PoseSet) -> int | None:
    """Which of several answers (N, 7: quaternion, translation; NaN for none) to the same names is this domain's.

    It is the only one that answers every image, and none of another domain (`foreign` counts these); otherwise the one that
    is nearest to the truth on more images than chance would have it in 1 of 100 cases. None where neither tells.
    """
    complete = [i for i, block in enumerate(blocks) if np.isfinite(block).all() and not foreign[i]]
    if len(complete) == 1 or not poses.posed:
        return complete[0] if len(complete) == 1 else None
    errors = []
    for block in blocks:
        read = pose_readings(block[:, :4], block[:, 4:], poses, lambda _: None)
        off, turned_deg = pose_errors(*read, poses.quaternions, poses.translations)
        errors.append(np.radians(turned_deg) + off)
    known = np.array(errors)[:, np.isfinite(errors).any(axis=0)]
    known = np.where(np.isfinite(known), known, np.inf)
    alone = (known == known.min(axis=0)).sum(axis=0) == 1  # equal answers tell nothing
    nearest = known.argmin(axis=0)[alone]
    won = np.bincount(nearest, minlength=len(blocks))
    best = int(np.argmax(won))
    by_chance = binomtest(int(won[best]), known.shape[1], 1 / len(blocks), alternative="greater").pvalue
    return best if by_chance < 0.01 else None


def starts_over(images: Sequence[int], others: int) -> int | None:
    """Where a list of detections begins to go through the images once more, as a list of several domains does.

    Several detections of one image are listed together, or in the order of their scores. A list of several domains instead goes
    through the images in order once per domain, and at least some images occur again.

    Args:
        images: the image's number, record by record.
        others: the number of domains that may be in the list as well.
    """
    again = 5  # images that come again: fewer may rise by chance
    visits = [i for i in range(len(images)) if i == 0 or images[i] != images[i - 1]]
    starts = [b for a, b in pairwise(visits) if images[b] < images[a]]
    repeated = len(visits) - len(set(images))
    return starts[0] if 0 < len(starts) <= others and repeated >= again else None


def point_readings(
    detections: list[Detections], targets: Targets, size: tuple[int, int], say: Say
) -> list[Detections]:
    """Detections in pixels of the images (`size`: width, height), where they were written for reduced or enlarged copies,
    or as shares of the image.
    """
    found, true, extent = [], [], []
    for i, each in enumerate(detections):
        if len(each):
            best = int(np.argmax(each.scores))
            used = targets.inside[i] & (each.point_scores[best] > 0)
            found.append(each.points[best][used])
            true.append(targets.points[i][used])
            extent.append(np.full(used.sum(), np.sqrt(np.prod(targets.boxes[i][2:] - targets.boxes[i][:2]))))
    if len(found) < LEAST_IMAGES or not sum(map(len, found)):
        return detections
    points, truth, sizes = np.concatenate(found), np.concatenate(true), np.concatenate(extent)
    whole = np.array(size, float)
    far = (truth > 0.1 * whole).all(axis=1)  # nearer to an edge a ratio says little
    if not far.any():
        return detections
    copies = _copies(np.median(points[far] / truth[far], axis=0), size)
    factor = whole / copies
    off = [np.linalg.norm(points * f - truth, axis=1) / sizes for f in (np.ones(2), factor)]
    if not clearly(off):
        return detections
    what = "shares of the image" if copies == [1, 1] else f"pixels of {copies[0]} x {copies[1]} images"
    say(f"boxes and keypoints are in {what}, and were brought to {size[0]} x {size[1]}")
    both = np.tile(factor, 2)
    return [Detections(d.boxes * both, d.points * factor, d.point_scores, d.scores) for d in detections]


def _copies(ratio: np.ndarray, size: tuple[int, int]) -> list[int]:
    """Width and height of copies by the ratio of their points to those of the images, (2).

    Where one of the same proportions is within 1 %, it is that.
    """
    step = np.array(size) // math.gcd(*size)
    same = max(1, round(float(np.mean(ratio * size / step)))) * step
    if np.abs(same / (ratio * size) - 1).max() < 0.01:
        return same.tolist()
    return [max(1, round(float(each))) for each in ratio * size]
