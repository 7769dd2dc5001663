"""SPEED/SPEED+ poses to ultralytics' pose labels: images/, labels/ and data.yaml, whole or not at all.

The result grows in ``NAME.partial`` beside its place, so an interrupted conversion goes on there, and gets
its name when it is done. Keypoints outside the image have visibility 0; boxes are cut at the border; an image
without a target in it has an empty label (background).
"""

import hashlib
import os
import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.documents import read_json, read_yaml
from visaug.core.errors import InputError
from visaug.core.files import write_bytes, write_json, write_text, write_yaml
from visaug.core.progress import Progress
from visaug_train.geometry import Keypoints, Pinhole
from visaug_train.reduction import Size, read_image, reduced, write_png
from visaug_train.speed import PoseSet


def convert(
    parts: dict[str, PoseSet],
    keypoints: Keypoints,
    destination: str | Path,
    size: Size | None = None,
    progress: Progress | None = None,
    reduce: str = "area",
    channels: int = 3,
) -> Path:
    """Write the parts (``train``, ``val``, ...) as a dataset for ultralytics and return its data.yaml.

    `size` is the width and height of resized copies; without it the images are linked, or copied where the file system has no
    links.
    """
    destination = Path(destination)
    beside, flip = destination.resolve().parent, list(keypoints.flip or ())
    known = np.isfinite(keypoints.points_m).all()
    links = {name: _way(poses.files[0].parent, destination, beside) for name, poses in parts.items()}
    described = {
        "keypoints": keypoints.points_m.tolist() if known else list(keypoints.names),
        **({"flip": flip} if flip else {}),
        "size": list(size) if size else None,
        "reduce": reduce,
        "channels": channels,
        "parts": {name: identity(poses) for name, poses in parts.items()},
        "linked": None if size else links,  # copies stand for themselves
    }
    data_yaml = destination / "data.yaml"
    content = {
        "path": str(destination.resolve()),  # ultralytics takes a relative one as of its own data folder
        **{name: f"images/{name}" for name in parts},
        "names": {0: keypoints.name},
        "kpt_shape": [len(keypoints), 3],
        **({"flip_idx": flip} if flip else {}),
        "channels": channels,
    }
    if data_yaml.is_file():
        if read_json(destination / "conversion.json") != described:
            problem = "was converted with other settings or images"
            raise InputError(problem, file=destination, expected="a new folder")
        if read_yaml(data_yaml) != content:  # the study was moved
            write_yaml(data_yaml, content)
        return data_yaml
    unfinished = destination.with_name(destination.name + ".partial")
    stamp = unfinished / "conversion.json"
    if unfinished.exists() and not (stamp.is_file() and read_json(stamp) == described):
        shutil.rmtree(unfinished)
    for name, poses in parts.items():
        _check_names(name, poses)
    write_json(stamp, described)
    total, done = sum(map(len, parts.values())), 0
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for name, poses in parts.items():
            folder = unfinished / "images" / name
            folder.mkdir(parents=True, exist_ok=True)
            copy = partial(_copy, folder, beside, poses.camera, size, reduce)
            copies = pool.map(copy, poses.files, poses.ids)
            for file, target, line in zip(poses.files, copies, label_lines(poses, keypoints)):
                write_text(unfinished / "labels" / name / f"{target.stem}.txt", line)
                if not target.is_file():
                    raise InputError("could not be copied", file=file)
                done += 1
                if progress:
                    progress("converting", done, total)
    write_yaml(unfinished / "data.yaml", content)
    if destination.exists():
        raise InputError("exists and is no converted dataset", file=destination, expected="a new folder")
    unfinished.rename(destination)
    return data_yaml


def _check_names(part: str, poses: PoseSet) -> None:
    """Refuse images whose copies would have one name; ultralytics finds a label by that name without its suffix."""
    first: dict[str, Path] = {}
    for file, name in zip(poses.files, poses.ids):
        if (other := first.setdefault(Path(name.replace("/", "-")).stem, file)) is not file:
            problem = f"would have the label of {other} in {part}"
            raise InputError(problem, file=file, expected="names that differ before the suffix")


def label_lines(poses: PoseSet, keypoints: Keypoints) -> list[str]:
    """One line of an ultralytics pose label per image, empty where no target is seen; all numbers as shares."""
    targets = poses.targets(keypoints)
    size = np.array(poses.camera.size, float)
    low, high = targets.boxes[:, :2] / size, targets.boxes[:, 2:] / size
    boxes = np.concatenate([(low + high) / 2, high - low], axis=1)
    points = np.where(targets.inside[..., None], targets.points / size, 0.0)
    rows = np.concatenate([points, 2.0 * targets.inside[..., None]], axis=2).reshape(len(poses), -1)
    numbers = np.concatenate([boxes, rows], axis=1)
    lines = [" ".join(["0", *(f"{value:.6f}" for value in row)]) for row in numbers]
    return [line + "\n" if seen else "" for seen, line in zip(targets.seen, lines)]


def coco_annotations(poses: PoseSet, keypoints: Keypoints, files: Sequence[str]) -> dict[str, Any]:
    """The set as an annotations file of COCO's keypoints, which other networks' trainings read, its images named as `files`.

    Ids count from 1; an image in which no target is seen has no annotation.
    """
    targets = poses.targets(keypoints)
    size = {"width": poses.camera.width, "height": poses.camera.height}
    annotations = []
    for i in np.flatnonzero(targets.seen):
        x0, y0, x1, y1 = (round(float(v), 3) for v in targets.boxes[i])
        inside = targets.inside[i]
        points = np.concatenate([targets.points[i], np.full((len(keypoints), 1), 2)], axis=1)
        annotations.append(
            {
                "id": len(annotations) + 1,
                "image_id": int(i) + 1,
                "category_id": 1,
                "bbox": [x0, y0, round(x1 - x0, 3), round(y1 - y0, 3)],
                "area": round((x1 - x0) * (y1 - y0), 3),
                "iscrowd": 0,
                "num_keypoints": int(inside.sum()),
                "keypoints": [round(float(v), 3) for v in np.where(inside[:, None], points, 0).ravel()],
            }
        )
    category = {
        "id": 1,
        "name": keypoints.name,
        "keypoints": list(keypoints.names),
        "skeleton": [],
        **({"flip_idx": list(keypoints.flip)} if keypoints.flip else {}),
        **({"sigmas": keypoints.sigmas.tolist()} if keypoints.sigmas is not None else {}),
    }
    return {
        "images": [{"id": i + 1, "file_name": file, **size} for i, file in enumerate(files)],
        "annotations": annotations,
        "categories": [category],
    }


def identity(poses: PoseSet) -> dict:
    """Identity of a set of images with poses, independent of its folder."""
    annotated = {"boxes": poses.boxes, "points": poses.points}
    sizes = [file.stat().st_size for file in poses.files]
    content = {}
    if len(set(sizes)) == 1:  # not compressed, so that their sizes tell nothing of what they show
        digest, most = hashlib.sha256(), 16
        for i in np.unique(np.linspace(0, len(poses) - 1, most).astype(int)):
            digest.update(poses.files[i].read_bytes())
        content["sha256"] = digest.hexdigest()
    return {
        "images": len(poses),
        "first": poses.files[0].name,
        "last": poses.files[-1].name,
        "bytes": sum(sizes),
        **content,
        "poses": float(np.abs(poses.quaternions).sum() + poses.translations.sum()).hex(),
        **{key: float(np.nansum(value)).hex() for key, value in annotated.items() if value is not None},
    }


def _copy(
    folder: Path, beside: Path, camera: Pinhole, size: Size | None, reduce: str, file: Path, name: str
) -> Path:
    """A copy of an image, or a link to it."""
    target = folder / name.replace("/", "-")  # ultralytics finds a label by its image's name alone
    target = target if size is None else target.with_suffix(".png")
    if target.is_file():
        return target
    if size is not None:
        write_png(target, reduced(read_image(file, camera), size, reduce))
        return target
    try:
        target.symlink_to(_way(file, folder, beside))
    except OSError:  # a file system or an account without links
        write_bytes(target, file.read_bytes())
    return target


def _way(to: Path, folder: Path, beside: Path) -> str:
    """Where a link in a folder leads: relative if both lie in `beside`, as rendered images do, which may be moved together."""
    to = to.resolve()
    return os.path.relpath(to, folder.resolve()) if to.is_relative_to(beside) else str(to)
