"""BOP's scene-wise format: one object an image, with its pose and its model's bounding box.

``{train,val,test}[_TYPE]/SCENE/{scene_camera.json,scene_gt.json[,scene_gt_info.json]}`` with the images in ``rgb/`` or
``gray/``, and ``models[_TYPE]/models_info.json``. Source: docs/bop_datasets_format.md of github.com/thodan/bop_toolkit. Lengths
are in millimetres; p_camera = cam_R_m2c p_model + cam_t_m2c with the axes of OpenCV. The pixel coordinates of cam_K are taken
over as they are. The domain is TYPE, or `bop` where there is none. The keypoints are the eight corners of the model's box
(M. Rad and V. Lepetit, ICCV 2017). Images of several objects and sets of several camera matrices are refused.
"""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug_train.datasets.reader import SPLIT_WORDS, Reader, matrix_quaternions, numbers_of
from visaug_train.geometry import Keypoints, Pinhole
from visaug_train.speed import PoseSet, by_domain, image_size

M_PER_MM = 1e-3
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")


def _folders(root: Path) -> dict[tuple[str, str], Path]:
    """Folders of scenes by domain and split."""
    found = {}
    for folder in sorted(root.iterdir()):
        word, _, kind = folder.name.partition("_")
        if word in ("train", "val", "test") and next(folder.glob("*/scene_camera.json"), None):
            found[kind or "bop", SPLIT_WORDS[word]] = folder
    return found


def _read(root: Path, domain: str, split: str) -> PoseSet:
    folder = _folders(root)[domain, split]
    files: list[Path] = []
    turns: list[np.ndarray] = []
    shifts: list[np.ndarray] = []
    boxes: list[np.ndarray] = []
    matrix, objects = None, set()
    for listing in sorted(folder.glob("*/scene_camera.json")):
        scene = listing.parent
        cameras, truths = _table(listing), _optional(scene / "scene_gt.json")
        infos, images = _optional(scene / "scene_gt_info.json"), _images(scene)
        for key in sorted(cameras, key=int):
            if int(key) not in images:
                raise InputError(
                    "names an image that is missing", file=listing, field=key, expected=f"{scene}/rgb"
                )
            own = numbers_of(cameras[key], "cam_K", 9, listing, key).reshape(3, 3)
            matrix = own if matrix is None else matrix
            if not np.allclose(own, matrix, rtol=0, atol=1e-6):
                raise InputError(
                    "differs", file=listing, field=f"{key}.cam_K", expected="one camera in the set"
                )
            truth = _only(truths.get(key, []), scene / "scene_gt.json", key)
            files.append(images[int(key)])
            if truth is None:
                turns.append(np.full(9, np.nan))
                shifts.append(np.full(3, np.nan))
            else:
                objects.add(truth.get("obj_id"))
                turns.append(numbers_of(truth, "cam_R_m2c", 9, scene / "scene_gt.json", key))
                shifts.append(numbers_of(truth, "cam_t_m2c", 3, scene / "scene_gt.json", key) * M_PER_MM)
            info = _only(infos.get(key, []), scene / "scene_gt_info.json", key)
            boxes.append(_box(info, scene / "scene_gt_info.json", key))
    if len(objects) > 1:
        raise InputError(f"shows the objects {sorted(objects)}", file=folder, expected="one spacecraft")
    assert matrix is not None  # _folders saw a scene; an empty one is refused by _table
    known = np.isfinite(shifts).all(axis=1)
    if known.any() and not known.all():
        raise InputError("some images have no pose", file=folder, expected="scene_gt.json of all, or of none")
    rotations = np.array(turns).reshape(-1, 3, 3)
    quaternions = matrix_quaternions(rotations, folder) if known.all() else np.full((len(files), 4), np.nan)
    return PoseSet(
        f"{domain}/{split}",
        Pinhole(*image_size(files[0]), matrix, np.zeros(5)),
        tuple(files),
        quaternions,
        np.array(shifts),
        keypoints=_corners(root, objects.pop()) if objects else None,
        boxes=np.array(boxes) if np.isfinite(boxes).any() else None,
        spacecraft="an object of its own",
    )


def _corners(root: Path, number: Any) -> Keypoints | None:
    """The corners of the model's bounding box, metres."""
    file = next(iter(sorted(root.glob("models*/models_info.json"))), None)
    if file is None:
        return None
    info = _table(file).get(str(number))
    if not isinstance(info, dict):
        raise InputError(
            "is missing", file=file, field=str(number), expected="min_x ... size_z of this object"
        )
    low = np.array([numbers_of(info, f"min_{axis}", 0, file, str(number)) for axis in "xyz"])
    size = np.array([numbers_of(info, f"size_{axis}", 0, file, str(number)) for axis in "xyz"])
    corners = np.array(list(product((0, 1), repeat=3)))
    names = tuple("corner_" + "".join(map(str, corner)) for corner in corners)
    return Keypoints(f"obj_{int(number):06d}", names, (low + corners * size) * M_PER_MM)


def _images(scene: Path) -> dict[int, Path]:
    """The images of a scene by their number."""
    for kind in ("rgb", "gray"):
        files = sorted(scene.glob(f"{kind}/*"))
        found = {int(f.stem): f for f in files if f.suffix.lower() in SUFFIXES and f.stem.isdigit()}
        if found:
            return found
    raise InputError("holds no images", file=scene, expected="rgb/000000.png or gray/000000.png")


def _table(file: Path) -> dict[str, Any]:
    content = read_json(file)
    if not isinstance(content, dict) or not content:
        raise InputError("holds no object of images", file=file, expected="BOP's JSON with one key an image")
    return content


def _optional(file: Path) -> dict[str, Any]:
    return _table(file) if file.is_file() else {}


def _only(entries: Any, file: Path, key: str) -> dict[str, Any] | None:
    """The one entry of an image; None where it has none."""
    if not isinstance(entries, list) or len(entries) > 1 or not all(isinstance(e, dict) for e in entries):
        raise InputError("is not a list of one object", file=file, field=key, expected="one target an image")
    return entries[0] if entries else None


def _box(info: dict[str, Any] | None, file: Path, key: str) -> np.ndarray:
    """The visible part's box as x0 y0 x1 y1; NaN where it is not given."""
    if info is None or "bbox_visib" not in info:
        return np.full(4, np.nan)
    x, y, width, height = numbers_of(info, "bbox_visib", 4, file, key)
    return np.array([x, y, x + width, y + height]) if min(width, height) > 0 else np.full(4, np.nan)


BOP = Reader("BOP", ("*/*/scene_camera.json",), lambda root: by_domain(_folders(root)), _read)
