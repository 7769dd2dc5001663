"""Predictions in files: COCO's results, poses as the Kelvins competition takes them, and a network's own.

A record of COCO's results names its image by `file_name`, or by `image_id`: a name, or a number where COCO's annotations file
says which image that is. A line of a CSV of poses is file, q1..q4 (scalar first), r1..r3 (metres), without a head.
"""

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path, PureWindowsPath
from typing import Any

import cv2
import numpy as np

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json, write_text
from visaug.core.progress import Progress
from visaug_train.datasets import files_of
from visaug_train.geometry import numbers_in
from visaug_train.metrics import Detections
from visaug_train.quiet import quiet_ultralytics
from visaug_train.readings import Say, pose_readings, starts_over, which_block
from visaug_train.reduction import fitting, read_image, reduced
from visaug_train.speed import PoseSet

Pose = tuple[np.ndarray, np.ndarray]  # quaternion (4), scalar first, and translation (3) in metres
LINE = "file, q1, q2, q3, q4, r1, r2, r3"


class ImageNames:
    """Names of the images of a set, as networks write them: with or without folders and suffix, `/` or `\\` between.

    Args:
        elsewhere: files of the images of the folder's other domains and splits, by domain/split. A file of predictions
            may hold these too.
        root: the folder, below which the folders of a file tell a set from the others.
    """

    def __init__(
        self, poses: PoseSet, elsewhere: Mapping[str, set[Path]] | None = None, root: str | Path | None = None
    ) -> None:
        self.poses = poses
        # names that were passed over, by domain
        self.passed: Counter[str] = Counter()
        # as `convert` names its copies, then the files' own names, which come first
        self.names = {name.replace("/", "-"): i for i, name in enumerate(poses.ids)}
        stems = Counter(map(_stem, poses.ids))
        self.names |= {_stem(name): i for i, name in enumerate(poses.ids) if stems[_stem(name)] == 1}
        self.names |= {name: i for i, name in enumerate(poses.ids)}
        # folders that a name must have
        self.depth = len(PureWindowsPath(poses.ids[0]).parts) if poses.ids else 1
        # which sets have an image of a name, and which words before it may mean a set
        self.holders: dict[str, set[str]] = {}
        self.words: dict[str, set[str]] = {}
        for name, files in {**(elsewhere or {}), poses.name: set(poses.files)}.items():
            self.words[name] = {name.split("/")[0]}
            for file in files:
                below = file if root is None or not file.is_relative_to(root) else file.relative_to(root)
                self.words[name].update(below.parent.parts)
                for key in (file.name, file.stem):
                    self.holders.setdefault(key, set()).add(name)

    def find(self, text: object, file: Path, field: str) -> int | None:
        """The image's number; None for an image of another domain or split of the folder. Refused where there is none."""
        sets, index = self._sets(text), self._index(text)
        if index is not None and self.poses.name in sets:
            return index
        if sets and self.poses.name not in sets:
            self.passed.update({name.split("/")[0] for name in sets})
            return None
        problem = f"{text!r} is no image of {self.poses.name}"
        raise InputError(problem, file=file, field=field, expected=f"a name such as {self.poses.ids[0]}")

    def also_of(self, text: object) -> set[str]:
        """The other domains of the folder that the name may mean as well."""
        return {name.split("/")[0] for name in self._sets(text)} - {self.poses.domain}

    def _index(self, text: object) -> int | None:
        path = _path(text)
        whole = "/".join(path.parts[-self.depth :])
        forms = (whole, _stem(whole), path.name, path.stem)
        return next((self.names[form] for form in forms if form in self.names), None)

    def _sets(self, text: object) -> set[str]:
        """The sets that have an image of this name; where its folders tell sets apart, those that have the folders too.

        The last folders count most: those before them may be of another place.
        """
        path = _path(text)
        sets = self.holders.get(path.name, set()) | self.holders.get(path.stem, set())
        sets |= {self.poses.name} if self._index(text) is not None else set()
        for folder in reversed(path.parts[:-1]):
            sets = {name for name in sets if folder in self.words[name]} or sets
        return sets

    def note(self, say: Say) -> None:
        """Say how many names were passed over that are of this domain, but of none of the images that are scored."""
        of, count = self.poses.domain, self.passed[self.poses.domain]
        if count:
            say(f"names of other images of {of} than those of {self.poses.name} were passed over: {count}")

    def none_found(self, file: Path) -> InputError:
        problem, expected = f"names no image of {self.poses.name}", f"images such as {self.poses.ids[0]}"
        return InputError(problem, file=file, expected=expected)


def _path(text: object) -> PureWindowsPath:
    return PureWindowsPath(text.strip() if isinstance(text, str) else "")


def _stem(name: str) -> str:
    """The name without its suffix, folders kept."""
    folders, slash, file = name.rpartition("/")
    return folders + slash + Path(file).stem


def names_elsewhere(root: str | Path, poses: PoseSet) -> dict[str, set[Path]]:
    """Files of the images of all other domains and splits of a folder, by domain/split."""
    own = set(poses.files)  # splits of the same list share them
    found = {name: files - own for name, files in files_of(root).items()}
    return {name: files for name, files in found.items() if files and name != poses.name}


def load_predictions(
    path: str | Path,
    poses: PoseSet,
    keypoints: int,
    images: str | Path | None = None,
    names: ImageNames | None = None,
    say: Say = lambda _: None,
) -> list[Detections]:
    """The detections of each image of `poses`; an image that the file does not name has none.

    Boxes of records without `bbox`, which COCO's results of keypoints need not have, are NaN. A file of several domains whose
    names do not say which is refused.

    Args:
        keypoints: how many a record has.
        images: COCO's annotations file, whose `images` map an `image_id` to a file.
        names: which image a name means; those of `poses` alone where left out.
        say: told of images with several records, where these may be of several domains.
    """
    path = Path(path)
    names = names or ImageNames(poses)
    files = {} if images is None else image_names(images)
    records, wrong = read_json(path), partial(InputError, file=path)
    if not isinstance(records, list):
        raise wrong("holds no list", expected="COCO's results format with file_name for image_id")
    found: list[list[tuple[np.ndarray, np.ndarray, float]]] = [[] for _ in poses.files]
    domains: set[str] = set()
    visits: list[tuple[int, str]] = []  # image and record, where the name may be of another domain
    for number, record in enumerate(records):
        field = f"record {number}"
        if not isinstance(record, dict):
            raise wrong("is not an object", field=field, expected="file_name, bbox, keypoints and score")
        name, key = record.get("file_name"), record.get("image_id")
        if name is None and files and not (isinstance(key, int | float | str) and key in files):
            problem = f"{key!r} is no image of the annotations file"
            raise wrong(problem, field=f"{field}.image_id", expected=f"an id of {images}")
        if name is None:  # a name, as AlphaPose and ultralytics write it, or a number
            name = files[key] if files else key if isinstance(key, str) else None
        if name is None:
            expected = "an image's name; for image_id give the annotations file (--images)"
            raise wrong("is missing", field=f"{field}.file_name", expected=expected)
        index = names.find(name, path, f"{field}.file_name")
        has_box = record.get("bbox") is not None
        box = _numbers(record, "bbox", 4, path, field) if has_box else np.full(4, np.nan)
        points = _numbers(record, "keypoints", 3 * keypoints, path, field).reshape(keypoints, 3)
        score = float(_numbers(record, "score", 0, path, field))
        if box[2] < 0 or box[3] < 0:
            raise wrong("a width or height is negative", field=f"{field}.bbox", expected="x, y, w, h")
        if index is not None:
            found[index].append((np.concatenate([box[:2], box[:2] + box[2:]]), points, score))
            if also := names.also_of(name):
                domains |= also
                visits.append((index, field))
    if records and not any(found):
        raise names.none_found(path)
    seen = [index for index, _ in visits]
    meant = f"{poses.domain}/{poses.files[0].name} where it is of {poses.domain}"
    if (start := starts_over(seen, len(domains))) is not None:
        problem = f"the names start over, as those of {', '.join(sorted({poses.domain, *domains}))} do"
        raise wrong(problem, field=visits[start][1], expected=meant)
    if several := sum(count > 1 for count in Counter(seen).values()):
        say(
            f"{several} images have several records, all taken for detections in {poses.domain}; "
            f"{', '.join(sorted(domains))} has the same names, so of several domains write {meant}"
        )
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
        corners = np.concatenate([each.boxes[:, :2], each.boxes[:, 2:] - each.boxes[:, :2]], axis=1)
        triples = np.concatenate([each.points, each.point_scores[..., None]], axis=2)
        for box, points, score in zip(corners.tolist(), triples, each.scores.tolist()):
            numbers = {"bbox": box, "keypoints": points.ravel().tolist()}
            numbers = {key: [round(value, 4) for value in values] for key, values in numbers.items()}
            records.append({"file_name": name, "category_id": 1, **numbers, "score": round(score, 6)})
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
    """Detections of a trained network with a score above 0.001, in pixels of the files; AP needs uncertain ones too.

    `size` and `reduce` are width and height to which the images are reduced before ultralytics sees them, and how: as the
    training images were. Without `size` the longer side gets `image_size` pixels, which is ultralytics' `imgsz`.
    """
    quiet_ultralytics(settings_folder)
    from ultralytics import YOLO

    model = YOLO(str(weights))
    size = size or fitting(poses.camera, image_size)
    back = np.array(poses.camera.size) / size
    detections: list[Detections] = []
    how: dict[str, Any] = {"imgsz": image_size, "conf": 0.001, "max_det": 20, "batch": 32, "device": device}
    for first in range(0, len(poses), 64):
        whole = (read_image(f, poses.camera, cv2.IMREAD_COLOR) for f in poses.files[first : first + 64])
        images = [reduced(image, size, reduce) for image in whole]
        results: Any = model.predict(images, verbose=False, save=False, **how)
        for result in results:
            found = result.boxes.xyxy, result.keypoints.data, result.boxes.conf
            boxes, points, scores = (tensor.cpu().numpy().astype(float) for tensor in found)
            boxes, places = boxes * np.tile(back, 2), points[..., :2] * back
            detections.append(Detections(boxes, places, points[..., 2], scores))
        if progress:
            progress(title, len(detections), len(poses))
    return detections


def _numbers(record: dict, key: str, count: int, path: Path, field: str) -> np.ndarray:
    """`count` finite numbers; 0 means a single one."""
    array = numbers_in(record.get(key))
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
    boxes, points, scores = (np.stack(part) for part in zip(*found))
    return Detections(boxes, points[..., :2], points[..., 2], scores)


def save_poses(path: str | Path, poses: PoseSet, found: Sequence[Pose | None]) -> None:
    """One line per image for which a pose was found."""
    buffer, known = io.StringIO(), [(n, pose) for n, pose in zip(poses.ids, found) if pose is not None]
    rows = ([name, *(f"{value:.9g}" for part in pose for value in part)] for name, pose in known)
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    write_text(path, buffer.getvalue())


def save_submission(path: str | Path, poses: PoseSet, found: Sequence[Pose | None]) -> int:
    """A line for every image, as Kelvins wants it; returns how many have no pose of their own.

    These get the median of the positions that were found, and no rotation.
    """
    if not (known := [pose for pose in found if pose is not None]):
        raise InputError("no pose was found", file=path, expected="predictions with four keypoints an image")
    default = np.array([1.0, 0, 0, 0]), np.median([translation for _, translation in known], axis=0)
    save_poses(path, poses, [pose or default for pose in found])
    return len(found) - len(known)


def load_poses(
    path: str | Path, poses: PoseSet, names: ImageNames | None = None, say: Say = lambda _: None
) -> list[Pose | None]:
    """The pose of each image of `poses`; None for an image that the file does not name. A head is passed over.

    Args:
        path: the CSV. It may hold other domains too, even under the same names, as a submission does.
        names: which image a name means; those of `poses` alone where left out.
        say: told of every convention but Kelvins' own that was recognised.
    """
    path = Path(path)
    names = names or ImageNames(poses)
    blocks: list[np.ndarray] = []
    foreign, repeated = [0], ("", "")
    for number, row in enumerate(_rows(path)):
        where = f"pose {number}"
        if len(row) != 8 or not all(map(_is_number, row[1:])):
            raise InputError(f"holds {','.join(row)[:60]!r}", file=path, field=where, expected=LINE)
        index = names.find(row[0], path, where)
        values = np.array(row[1:], dtype=float)
        length = float(np.linalg.norm(values[:4]))
        if abs(length - 1) > 1e-2:
            problem = f"the quaternion has length {length:.4g}"
            raise InputError(problem, file=path, field=where, expected="a unit quaternion")
        if index is None:
            foreign[-1] += 1
            continue
        if not blocks or np.isfinite(blocks[-1][index]).all():
            if blocks:
                foreign.append(0)
                repeated = row[0], where
            blocks.append(np.full((len(poses), 7), np.nan))
        blocks[-1][index] = np.concatenate([values[:4] / length, values[4:]])
    if not blocks:
        raise names.none_found(path)
    chosen = which_block(blocks, foreign, poses) if len(blocks) > 1 else 0
    if chosen is None:
        expected = f"one pose an image, or the domain before its name: {poses.domain}/{poses.files[0].name}"
        raise InputError(f"{repeated[0]} comes twice", file=path, field=repeated[1], expected=expected)
    if len(blocks) > 1:
        say(f"of {len(blocks)} poses under the same names, number {chosen + 1} was taken for {poses.domain}")
    quaternions, translations = pose_readings(blocks[chosen][:, :4], blocks[chosen][:, 4:], poses, say)
    return [(q, r) if np.isfinite(q).all() else None for q, r in zip(quaternions, translations)]


def _rows(path: Path) -> list[list[str]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except FileNotFoundError:
        raise InputError("no such file", file=path, expected=f"a CSV with {LINE}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError("is no CSV text", file=path, expected=LINE) from None
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    if not rows:
        raise InputError("holds no poses", file=path, expected=LINE)
    return rows


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
