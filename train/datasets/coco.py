"""COCO keypoints of one target an image, as COCO publishes them and as most tools export them.

``annotations/NAME.json`` (or ``NAME.json``) with `images`, `annotations` and `categories`; the images lie under their `file_name`
in the root, in ``images/``, or in a folder named as NAME ends (``train2017/`` for ``person_keypoints_train2017.json``). Source:
https://cocodataset.org/#format-data (keypoint detection). NAME holds `train`, `val` or `test`; what is left of it is the domain,
`coco` where nothing is. A category may have `sigmas` and `flip_idx` (as `visaug prepare --coco` writes them). There are no poses,
so there are no pose errors. Images of several sizes or targets are refused.
"""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug_train.datasets.reader import SPLIT_WORDS, Reader, numbers_of
from visaug_train.geometry import Keypoints, Pinhole
from visaug_train.speed import PoseSet, by_domain

SPLIT = re.compile(r"(?:^|[-_. ])((train|validation|val|test)\d*)$")


def _listings(root: Path) -> dict[tuple[str, str], tuple[Path, str]]:
    """Annotation files by domain and split, each with the word that names its images' folder."""
    found = {}
    for file in sorted([*root.glob("annotations/*.json"), *root.glob("*.json")]):
        match = SPLIT.search(file.stem)
        if match and _is_coco(file):
            domain = file.stem[: match.start()] or "coco"
            found[domain, SPLIT_WORDS[match[2]]] = file, match[1]
    return found


def _is_coco(file: Path) -> bool:
    with file.open("rb") as opened:
        if opened.read(64).lstrip()[:1] != b"{":
            return False
    content = read_json(file)
    if not all(isinstance(content.get(key), list) for key in ("images", "annotations", "categories")):
        return False
    return any(map(_has_keypoints, content["categories"]))


def _read(root: Path, domain: str, split: str) -> PoseSet:
    listing, word = _listings(root)[domain, split]
    content, wrong = read_json(listing), partial(InputError, file=listing)
    if not (images := content["images"]):
        raise wrong("is empty", field="images", expected="COCO's list of images")
    rows: dict[Any, int] = {}
    sizes = set()
    for number, image in enumerate(images):
        try:
            if not isinstance(image["id"], int | str):
                raise TypeError
            rows[image["id"]] = number
            sizes.add((int(image["width"]), int(image["height"])))
            str.strip(image["file_name"])
        except (TypeError, KeyError, ValueError):
            expected = "id, file_name, width, height"
            raise wrong("is malformed", field=f"images.{number}", expected=expected) from None
    if len(rows) < len(images):
        raise wrong("repeats an id", field="images", expected="every id once")
    if len(sizes) > 1:
        raise wrong(f"has images of {len(sizes)} sizes", expected="images of one camera")
    keypoints, category = _model(content["categories"], listing)
    boxes, points = np.full((len(images), 4), np.nan), np.zeros((len(images), len(keypoints), 3))
    for number, entry in enumerate(content["annotations"]):
        where = f"annotations.{number}"
        image = entry.get("image_id") if isinstance(entry, dict) else None
        if not isinstance(image, int | str) or image not in rows:
            raise wrong("names no image", field=f"{where}.image_id", expected="an id of images")
        if entry.get("category_id") != category or entry.get("iscrowd"):
            continue
        row = rows[image]
        if np.isfinite(boxes[row]).any():
            raise wrong("is a second target of its image", field=where, expected="one an image")
        x, y, width, height = numbers_of(entry, "bbox", 4, listing, where)
        if width < 0 or height < 0:
            raise wrong("a width or height is negative", field=f"{where}.bbox", expected="x, y, w, h")
        boxes[row] = x, y, x + width, y + height
        points[row] = numbers_of(entry, "keypoints", points[row].size, listing, where).reshape(-1, 3)
    unknown = np.full((len(images), 7), np.nan)
    # There is no lens in COCO: only the size of this camera is used.
    camera = Pinhole(*sizes.pop(), np.eye(3), np.zeros(5))
    files = _located(root, word, [image["file_name"] for image in images], listing)
    poses = PoseSet(f"{domain}/{split}", camera, files, unknown[:, :4], unknown[:, 4:], keypoints, boxes)
    annotated = bool(np.isfinite(boxes).any())  # else the list is one of images alone, as of a test set
    return replace(poses, points=points if annotated else None, spacecraft=keypoints.name)


def _model(categories: list[Any], file: Path) -> tuple[Keypoints, Any]:
    """The one category with keypoints; their places on the body are not known (NaN)."""
    found = [c for c in categories if _has_keypoints(c) and c["keypoints"]]
    wrong = partial(InputError, file=file)
    if len(found) != 1:
        raise wrong(f"{len(found)} have keypoints", field="categories", expected="one that has")
    names = tuple(map(str, found[0]["keypoints"]))
    sigmas, flip = found[0].get("sigmas"), found[0].get("flip_idx")
    if sigmas is not None:
        sigmas = numbers_of(found[0], "sigmas", len(names), file, "categories")
        if not (sigmas > 0).all():
            raise wrong("must be above 0", field="categories.sigmas", expected="one number a point")
    if flip is not None:
        if not isinstance(flip, list) or sorted(map(repr, flip)) != sorted(map(repr, range(len(names)))):
            raise wrong("is no order of the points", field="categories.flip_idx", expected="numbers from 0")
        flip = tuple(flip)
    points = np.full((len(names), 3), np.nan)
    return Keypoints(str(found[0].get("name", "target")), names, points, sigmas, flip), found[0].get("id")


def _has_keypoints(category: Any) -> bool:
    return isinstance(category, dict) and isinstance(category.get("keypoints"), list)


def _located(root: Path, word: str, names: list[str], listing: Path) -> tuple[Path, ...]:
    """The files, in the first folder that has the first of them."""
    places = [root, root / "images", root / word, root / "images" / word, listing.parent]
    for place in places:
        if (place / names[0]).is_file():
            return tuple(place / name for name in names)
    tried = ", ".join(str(place) for place in places)
    raise InputError(f"{names[0]} is missing", file=listing, field="images", expected=f"it in one of {tried}")


class _CocoReader(Reader):
    """Recognised by what the JSON holds, for its name says little."""

    def recognises(self, root: Path) -> bool:
        return bool(_listings(root))


COCO = _CocoReader("COCO keypoints", ("annotations/*.json",), lambda root: by_domain(_listings(root)), _read)
