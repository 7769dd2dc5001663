"""Predictions in a file, in COCO's results format; and a network's own.

A record names its image by `file_name`, or by `image_id`: a name, or a number where COCO's annotations file says which
image that is.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json
from visaug.core.progress import Progress
from visaug_train.image_names import ImageNames
from visaug_train.metrics import Detections
from visaug_train.quiet import quiet_ultralytics
from visaug_train.reduction import fitting, read_image, reduced
from visaug_train.speed import PoseSet


def load_predictions(
    path: str | Path,
    poses: PoseSet,
    keypoints: int,
    images: str | Path | None = None,
    names: ImageNames | None = None,
) -> list[Detections]:
    """The detections of each image of `poses`; an image that the file does not name has none.

    Args:
        path: COCO's results.
        poses: the images.
        keypoints: how many a record has.
        images: COCO's annotations file, whose `images` map an `image_id` to a file.
        names: which image a name means; those of `poses` alone where left out.

    Returns:
        Boxes of records without `bbox`, which COCO's results of keypoints need not have, are NaN.
    """
    path = Path(path)
    names = names or ImageNames(poses)
    files = {} if images is None else image_names(images)
    records = read_json(path)
    if not isinstance(records, list):
        raise InputError(
            "holds no list", file=path, expected="COCO's results format with file_name for image_id"
        )
    found: list[list[tuple[np.ndarray, np.ndarray, float]]] = [[] for _ in poses.files]
    for number, record in enumerate(records):
        field = f"record {number}"
        if not isinstance(record, dict):
            raise InputError(
                "is not an object", file=path, field=field, expected="file_name, bbox, keypoints and score"
            )
        name = record.get("file_name")
        if name is None and isinstance(record.get("image_id"), str) and not files:
            name = record["image_id"]  # as AlphaPose and ultralytics write it
        if name is None and files:
            name = files.get(record.get("image_id"))
            if name is None:
                raise InputError(
                    f"{record.get('image_id')!r} is no image of the annotations file",
                    file=path,
                    field=f"{field}.image_id",
                    expected=f"an id of {images}",
                )
        if name is None:
            raise InputError(
                "is missing",
                file=path,
                field=f"{field}.file_name",
                expected="an image's name; for image_id give the annotations file (--images)",
            )
        index = names.find(name, path, f"{field}.file_name")
        box = np.full(4, np.nan)
        if record.get("bbox") is not None:
            box = _numbers(record, "bbox", 4, path, field)
        points = _numbers(record, "keypoints", 3 * keypoints, path, field).reshape(keypoints, 3)
        score = float(_numbers(record, "score", 0, path, field))
        if box[2] < 0 or box[3] < 0:
            raise InputError(
                "a width or height is negative", file=path, field=f"{field}.bbox", expected="x, y, w, h"
            )
        if index is not None:
            found[index].append((box, points, score))
    if records and not any(found):
        raise names.none_found(path)
    return [_stack(each, keypoints) for each in found]


def image_names(path: str | Path) -> dict[Any, str]:
    """Which file each id is, by a COCO annotations file."""
    content = read_json(path)
    images = content.get("images") if isinstance(content, dict) else None
    if not isinstance(images, list) or not images:
        raise InputError("is missing", file=path, field="images", expected="COCO's list of id and file_name")
    found = {}
    for number, image in enumerate(images):
        known = isinstance(image, dict) and isinstance(image.get("file_name"), str)
        if not known or not isinstance(image.get("id"), int | str):
            raise InputError("is malformed", file=path, field=f"images.{number}", expected="id and file_name")
        found[image["id"]] = image["file_name"]
    return found


def save_predictions(path: str | Path, poses: PoseSet, detections: list[Detections]) -> None:
    """Write detections in the format that `load_predictions` reads."""
    records: list[dict[str, Any]] = []
    for name, each in zip(poses.ids, detections):
        for box, points, point_scores, score in zip(each.boxes, each.points, each.point_scores, each.scores):
            corners = np.concatenate([box[:2], box[2:] - box[:2]])
            triples = np.concatenate([points, point_scores[:, None]], axis=1)
            records.append(
                {
                    "file_name": name,
                    "category_id": 1,
                    "bbox": [round(float(v), 4) for v in corners],
                    "keypoints": [round(float(v), 4) for v in triples.ravel()],
                    "score": round(float(score), 6),
                }
            )
    write_json(path, records)


def predict(
    weights: str | Path,
    poses: PoseSet,
    image_size: int,
    settings_folder: Path,
    device: str | None = None,
    title: str = "evaluating",
    progress: Progress | None = None,
    size: tuple[int, int] | None = None,
    reduce: str = "area",
) -> list[Detections]:
    """Detections of a trained network with a score above 0.001; AP needs uncertain ones too.

    Args:
        weights: the network's file.
        poses: the images.
        image_size: ultralytics' `imgsz`.
        size, reduce: width and height to which the images are reduced before ultralytics sees them, and how: as the
            training images were. Without `size` the longer side gets `image_size` pixels.

    Returns:
        Boxes and points in pixels of the files.
    """
    quiet_ultralytics(settings_folder)
    from ultralytics import YOLO

    model = YOLO(str(weights))
    size = size or fitting(poses.camera, image_size)
    back = np.array([poses.camera.width, poses.camera.height]) / size
    detections = []
    least_score, most_per_image = 0.001, 20
    for first in range(0, len(poses), 64):
        images = [
            reduced(read_image(file, poses.camera, cv2.IMREAD_COLOR), size, reduce)
            for file in poses.files[first : first + 64]
        ]
        results: Any = model.predict(
            images,
            imgsz=image_size,
            conf=least_score,
            max_det=most_per_image,
            batch=32,
            verbose=False,
            save=False,
            device=device,
        )
        for result in results:
            points = result.keypoints.data.cpu().numpy().astype(float)
            detections.append(
                Detections(
                    result.boxes.xyxy.cpu().numpy().astype(float) * np.tile(back, 2),
                    points[..., :2] * back,
                    points[..., 2],
                    result.boxes.conf.cpu().numpy().astype(float),
                )
            )
        if progress:
            progress(title, len(detections), len(poses))
    return detections


def _numbers(record: dict, key: str, count: int, path: Path, field: str) -> np.ndarray:
    """`count` finite numbers; 0 means a single one."""
    try:
        array = np.array(record.get(key), dtype=float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.shape != ((count,) if count else ()) or not np.isfinite(array).all():
        expected = f"{count} finite numbers" if count else "a finite number"
        if key == "keypoints":
            expected += f": x y score of {count // 3} points"
        problem = "is missing" if key not in record else "is malformed"
        if array.ndim == 1 and len(array) != count:
            problem = f"has {len(array)} numbers"
        raise InputError(problem, file=path, field=f"{field}.{key}", expected=expected)
    return array


def _stack(found: list[tuple[np.ndarray, np.ndarray, float]], keypoints: int) -> Detections:
    if not found:
        return Detections.none(keypoints)
    boxes = np.stack([box for box, _, _ in found])
    points = np.stack([points for _, points, _ in found])
    boxes[:, 2:] += boxes[:, :2]
    return Detections(boxes, points[..., :2], points[..., 2], np.array([score for _, _, score in found]))
