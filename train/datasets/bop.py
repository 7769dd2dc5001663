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
    rows, matrix, objects = [], None, set()
    for listing in sorted(folder.glob("*/scene_camera.json")):
        scene = listing.parent
        poses, details = scene / "scene_gt.json", scene / "scene_gt_info.json"
        cameras, images = _table(listing), _images(scene)
        truths, infos = (_table(file) if file.is_file() else {} for file in (poses, details))
        if wrong := [key for key in cameras if not _is_number(key)]:
            raise InputError("is no image's number", file=listing, field=wrong[0], expected="0, 1, ...")
        for key in sorted(cameras, key=int):
            if int(key) not in images:
                expected = f"{scene}/rgb"
                raise InputError("names an image that is missing", file=listing, field=key, expected=expected)
            own = numbers_of(cameras[key], "cam_K", 9, listing, key).reshape(3, 3)
            matrix = own if matrix is None else matrix
            if not np.allclose(own, matrix, rtol=0, atol=1e-6):
                field = f"{key}.cam_K"
                raise InputError("differs", file=listing, field=field, expected="one camera in the set")
            row = np.full(16, np.nan)  # rotation, translation, and the visible part's box as x0 y0 x1 y1
            if (truth := _only(truths.get(key, []), poses, key)) is not None:
                number = str(truth.get("obj_id"))
                if not _is_number(number):
                    field = f"{key}.obj_id"
                    raise InputError("is no object's number", file=poses, field=field, expected="1, 2, ...")
                objects.add(int(number))
                row[:9] = numbers_of(truth, "cam_R_m2c", 9, poses, key)
                row[9:12] = numbers_of(truth, "cam_t_m2c", 3, poses, key) / 1000
            if "bbox_visib" in (info := _only(infos.get(key, []), details, key) or {}):
                x, y, width, height = numbers_of(info, "bbox_visib", 4, details, key)
                row[12:] = (x, y, x + width, y + height) if min(width, height) > 0 else np.nan
            files.append(images[int(key)])
            rows.append(row)
    if len(objects) > 1:
        raise InputError(f"shows the objects {sorted(objects)}", file=folder, expected="one spacecraft")
    assert matrix is not None  # _folders saw a scene; an empty one is refused by _table
    turns, shifts, boxes = np.split(np.array(rows), (9, 12), axis=1)
    known = np.isfinite(shifts).all(axis=1)
    if known.any() and not known.all():
        raise InputError("some images have no pose", file=folder, expected="scene_gt.json of all, or of none")
    quaternions = np.full((len(files), 4), np.nan)
    return PoseSet(
        f"{domain}/{split}",
        Pinhole(*image_size(files[0]), matrix, np.zeros(5)),
        tuple(files),
        matrix_quaternions(turns.reshape(-1, 3, 3), folder) if known.all() else quaternions,
        shifts,
        keypoints=_corners(root, objects.pop()) if objects else None,
        boxes=boxes if np.isfinite(boxes).any() else None,
        spacecraft="an object of its own",
    )


def _corners(root: Path, number: int) -> Keypoints | None:
    """The corners of the model's bounding box, metres."""
    if (file := next(iter(sorted(root.glob("models*/models_info.json"))), None)) is None:
        return None
    info = _table(file).get(str(number))
    if not isinstance(info, dict):
        expected = "min_x ... size_z of this object"
        raise InputError("is missing", file=file, field=str(number), expected=expected)
    names = [f"{of}_{axis}" for of in ("min", "size") for axis in "xyz"]
    low, size = np.split(np.array([numbers_of(info, name, 0, file, str(number)) for name in names]), 2)
    corners = np.array(list(product((0, 1), repeat=3)))
    names = tuple("corner_" + "".join(map(str, corner)) for corner in corners)
    return Keypoints(f"obj_{number:06d}", names, (low + corners * size) / 1000)


def _images(scene: Path) -> dict[int, Path]:
    for kind in ("rgb", "gray"):
        files = sorted(scene.glob(f"{kind}/*"))
        found = {int(f.stem): f for f in files if f.suffix.lower() in SUFFIXES and _is_number(f.stem)}
        if found:
            return found
    raise InputError("holds no images", file=scene, expected="rgb/000000.png or gray/000000.png")


def _is_number(text: str) -> bool:
    return text.isdecimal() and len(text) < 20


def _table(file: Path) -> dict[str, Any]:
    content = read_json(file)
    if not isinstance(content, dict) or not content:
        raise InputError("holds no object of images", file=file, expected="BOP's JSON with one key an image")
    return content


def _only(entries: Any, file: Path, key: str) -> dict[str, Any] | None:
    """The one entry of an image; None where it has none."""
    if not isinstance(entries, list) or len(entries) > 1 or not all(isinstance(e, dict) for e in entries):
        raise InputError("is not a list of one object", file=file, field=key, expected="one target an image")
    return entries[0] if entries else None


BOP = Reader("BOP", ("*/*/scene_camera.json",), lambda root: by_domain(_folders(root)), _read)
