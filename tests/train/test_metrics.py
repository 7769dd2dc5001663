"""IoU, OKS and AP against pycocotools, and cases done by hand."""

import contextlib
import io

import numpy as np
import pytest

from visaug_train.metrics import (
    BOXES_PER_IMAGE,
    KEYPOINT_SETS_PER_IMAGE,
    PrecisionTable,
    box_iou,
    keypoint_similarity,
)

K = 11


def random_case(seed: int, images: int = 60):
    """Targets with hidden points and detections of all qualities: several an image, some images empty."""
    rng = np.random.default_rng(seed)
    corner = rng.uniform(0, 100, (images, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(20, 120, (images, 2))], axis=1)
    points = corner[:, None] + rng.uniform(0, 1, (images, K, 2)) * (boxes[:, None, 2:] - boxes[:, None, :2])
    inside = rng.random((images, K)) < 0.8
    found = []
    for i in range(images):
        count = int(rng.integers(0, 6))
        spread = rng.choice([0.5, 3.0, 15.0], count)
        corners = boxes[i] + rng.normal(size=(count, 4)) * spread[:, None]
        corners[:, 2:] = np.maximum(corners[:, 2:], corners[:, :2] + 1)
        found.append(
            (
                corners,
                points[i] + rng.normal(size=(count, K, 2)) * spread[:, None, None],
                np.round(rng.random(count), 2),  # ties do happen
            )
        )
    return boxes, points, inside, found


def coco_ap(boxes, points, inside, found, kind, sigma=None, area_factor=1.0):
    coco = pytest.importorskip("pycocotools.coco")
    from pycocotools.cocoeval import COCOeval

    truth, results = [], []
    for i, (box, point, seen) in enumerate(zip(boxes, points, inside)):
        width, height = box[2:] - box[:2]
        triples = np.concatenate([point, 2.0 * seen[:, None]], axis=1)
        truth.append(
            {
                "id": i + 1,
                "image_id": i,
                "category_id": 1,
                "iscrowd": 0,
                "bbox": [*box[:2].tolist(), float(width), float(height)],
                "area": float(width * height * area_factor),
                "keypoints": triples.ravel().tolist(),
                "num_keypoints": int(seen.sum()),
            }
        )
        for b, p, s in zip(*found[i]):
            result = {"image_id": i, "category_id": 1, "score": float(s)}
            if kind == "bbox":
                result["bbox"] = [*b[:2].tolist(), *(b[2:] - b[:2]).tolist()]
            else:
                result["keypoints"] = np.concatenate([p, np.ones((K, 1))], axis=1).ravel().tolist()
            results.append(result)
    with contextlib.redirect_stdout(io.StringIO()):
        reference = coco.COCO()
        reference.dataset = {
            "images": [{"id": i} for i in range(len(boxes))],
            "annotations": truth,
            "categories": [{"id": 1}],
        }
        reference.createIndex()
        evaluation = COCOeval(reference, reference.loadRes(results), kind)
        if sigma is not None:
            evaluation.params.kpt_oks_sigmas = np.full(K, sigma)
        evaluation.evaluate()
        evaluation.accumulate()
    # Precision at all thresholds and recalls, all areas, the largest number of detections.
    precision = evaluation.eval["precision"][:, :, 0, 0, -1]
    return float(precision[precision > -1].mean())


def own_ap(similarities, found, most, ignored=None):
    count = len(similarities)
    ignored = np.zeros(count, bool) if ignored is None else ignored
    return PrecisionTable([f[2] for f in found], similarities, np.ones(count, bool), ignored, most).average()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_box_ap_equals_pycocotools(seed):
    boxes, points, inside, found = random_case(seed)
    own = own_ap([box_iou(f[0], box) for f, box in zip(found, boxes)], found, BOXES_PER_IMAGE)
    assert 0.05 < own < 0.95
    assert own == pytest.approx(coco_ap(boxes, points, inside, found, "bbox"), abs=1e-6)


# COCO's own sigma is half of what the paper's formula takes, and the area is the box's.
@pytest.mark.parametrize(("definition", "sigma", "area"), [("paper", 0.5 / K, 1.0), ("coco", 1.0 / K, 0.53)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_keypoint_ap_equals_pycocotools(seed, definition, sigma, area):
    boxes, points, inside, found = random_case(seed)
    inside[0] = False  # COCO ignores a target without visible keypoints, and a detection that matches it
    similarities = [
        keypoint_similarity(f[1], point, seen, box, definition)
        for f, point, seen, box in zip(found, points, inside, boxes)
    ]
    own = own_ap(similarities, found, KEYPOINT_SETS_PER_IMAGE, ~inside.any(axis=1))
    expected = coco_ap(boxes, points, inside, found, "keypoints", sigma, area)
    assert 0.05 < own < 0.95
    assert own == pytest.approx(expected, abs=1e-6)


def test_definitions_by_hand():
    box = np.array([0.0, 0, 40, 10])
    target = np.zeros((K, 2))
    shifted = np.full((1, K, 2), [3.0, 0.0])
    visible = np.ones(K, bool)
    paper = keypoint_similarity(shifted, target, visible, box, "paper")[0]
    coco = keypoint_similarity(shifted, target, visible, box, "coco")[0]
    assert paper == pytest.approx(np.exp(-9 * K**2 / (2 * 400)))
    assert coco == pytest.approx(np.exp(-9 * K**2 / (2 * 4 * 0.53 * 400)))


def test_weights_equal_repeated_images():
    boxes, _, _, found = random_case(3, images=20)
    similarities = [box_iou(f[0], box) for f, box in zip(found, boxes)]
    chosen = np.random.default_rng(0).integers(0, 20, 20)
    weights = np.bincount(chosen, minlength=20).astype(float)
    # Distinct scores: among equal ones the order of repeated images would differ.
    found = [(b, p, s + 1e-6 * (10 * i + np.arange(len(s)))) for i, (b, p, s) in enumerate(found)]
    whole = PrecisionTable([f[2] for f in found], similarities, np.ones(20, bool), np.zeros(20, bool), 100)
    repeated = own_ap([similarities[i] for i in np.sort(chosen)], [found[i] for i in np.sort(chosen)], 100)
    assert whole.average(weights) == pytest.approx(repeated, abs=1e-3)


def test_nothing_found_is_zero_and_everything_right_is_one():
    boxes = np.array([[0.0, 0, 10, 10], [5.0, 5, 30, 20]])
    nothing = [np.zeros(0), np.zeros(0)]
    present, ignored = np.ones(2, bool), np.zeros(2, bool)
    assert PrecisionTable(nothing, nothing, present, ignored, 100).average() == 0
    exact = [box_iou(box[None], box) for box in boxes]
    assert PrecisionTable([np.ones(1)] * 2, exact, present, ignored, 100).average() == pytest.approx(1)
