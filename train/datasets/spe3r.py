"""SPE3R: 64 spacecraft of 1000 images each; a domain is a spacecraft.

``camera.json``, ``splits.csv`` (spacecraft, train or test; no head) and ``SPACECRAFT/{labels.json,images/}``. Source: T. H. Park
and S. D'Amico, https://purl.stanford.edu/pk719hm4806, and the authors' own loader: labels have SPEED+'s keys, a file name without
its suffix (.jpg), a quaternion with the scalar first. Of the spacecraft for training the images 401 to 500 and 901 to 1000
validate. The published ``images.zip`` of each spacecraft is to be unpacked into ``images/``. There are no keypoints.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug_train.datasets.reader import Reader
from visaug_train.geometry import Pinhole
from visaug_train.speed import PoseSet, read_listing

VALIDATION = {*range(401, 501), *range(901, 1001)}  # numbers of images, the authors' loader


def _domains(root: Path) -> dict[str, tuple[str, ...]]:
    file = root / "splits.csv"
    with file.open(newline="", encoding="utf-8") as opened:
        rows = [[cell.strip() for cell in row] for row in csv.reader(opened) if row]
    if not all(len(row) == 2 and row[1] in ("train", "test") for row in rows):
        raise InputError(
            "is malformed", file=file, expected="spacecraft,train or spacecraft,test on each line"
        )
    splits = {"train": ("train", "validation"), "test": ("test",)}
    return {name: splits[split] for name, split in rows if (root / name / "labels.json").is_file()}


def _read(root: Path, domain: str, split: str) -> PoseSet:
    folder = root / domain
    if not (folder / "images").is_dir():
        raise InputError("is missing", file=folder / "images", expected="images.zip, unpacked there")
    every = read_listing(
        folder / "labels.json", folder / "images", Pinhole.load(root / "camera.json"), domain
    )
    files = tuple(f if f.suffix else f.with_suffix(".jpg") for f in every.files)
    poses = replace(every, name=f"{domain}/{split}", files=files, spacecraft=domain)
    if split == "test":
        return poses
    held_out = np.array([int(file.stem.removeprefix("img") or 0) in VALIDATION for file in files])
    return poses.select(np.flatnonzero(held_out == (split == "validation")))


SPE3R = Reader("SPE3R", ("splits.csv",), _domains, _read)
