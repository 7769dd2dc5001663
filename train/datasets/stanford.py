"""SHIRT and SPE3R of Stanford's Space Rendezvous Laboratory, whose records are SPEED+'s (`filename`, `q_vbs2tango_true`,
`r_Vo2To_vbs_true`).

SHIRT, two rendezvous trajectories with Tango, each rendered and taken in the laboratory: ``camera.json`` and, for TRAJECTORY roe1
and roe2, ``TRAJECTORY/TRAJECTORY.json`` with ``TRAJECTORY/{synthetic,lightbox}/images/``; both domains share the list of poses.
Source: T. H. Park and S. D'Amico, https://purl.stanford.edu/zq716br5462, as public readers of it open it. The domains are
roe1_synthetic, roe1_lightbox and so on; all images are test images.

SPE3R, 64 spacecraft of 1000 images each; a domain is a spacecraft: ``camera.json``, ``splits.csv`` (spacecraft, train or test; no
head) and ``SPACECRAFT/{labels.json,images/}``. Source: T. H. Park and S. D'Amico, https://purl.stanford.edu/pk719hm4806, and the
authors' own loader: a file name without its suffix (.jpg), a quaternion with the scalar first. Of the spacecraft for training the
images 401 to 500 and 901 to 1000 validate. The published ``images.zip`` of each spacecraft is to be unpacked into ``images/``.
There are no keypoints.
"""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug_train.datasets.reader import Reader
from visaug_train.geometry import Pinhole
from visaug_train.speed import PoseSet, read_listing


def _shirt_domains(root: Path) -> dict[str, tuple[str, ...]]:
    lists = [file for file in sorted(root.glob("roe[12]/roe[12].json")) if file.stem == file.parent.name]
    folders = [images for file in lists for images in sorted(file.parent.glob("*/images"))]
    return {f"{images.parent.parent.name}_{images.parent.name}": ("test",) for images in folders}


def _read_shirt(root: Path, domain: str, split: str) -> PoseSet:
    trajectory, _, source = domain.partition("_")
    images = root / trajectory / source / "images"
    camera = Pinhole.load(root / "camera.json")
    return read_listing(root / trajectory / f"{trajectory}.json", images, camera, f"{domain}/{split}")


def _spe3r_domains(root: Path) -> dict[str, tuple[str, ...]]:
    file = root / "splits.csv"
    try:
        with file.open(newline="", encoding="utf-8-sig") as opened:
            rows = [[cell.strip() for cell in row] for row in csv.reader(opened) if row]
    except (UnicodeDecodeError, csv.Error):
        raise InputError("is no CSV text", file=file, expected="spacecraft,train in UTF-8") from None
    if not all(len(row) == 2 and row[1] in ("train", "test") for row in rows):
        expected = "spacecraft,train or spacecraft,test on each line"
        raise InputError("is malformed", file=file, expected=expected)
    splits = {"train": ("train", "validation"), "test": ("test",)}
    return {name: splits[split] for name, split in rows if (root / name / "labels.json").is_file()}


def _read_spe3r(root: Path, domain: str, split: str) -> PoseSet:
    folder = root / domain
    if not (folder / "images").is_dir():
        raise InputError("is missing", file=folder / "images", expected="images.zip, unpacked there")
    camera = Pinhole.load(root / "camera.json")
    every = read_listing(folder / "labels.json", folder / "images", camera, domain)
    files = tuple(f if f.suffix else f.with_suffix(".jpg") for f in every.files)
    poses = replace(every, name=f"{domain}/{split}", files=files, spacecraft=domain)
    if split == "test":
        return poses
    stems = [file.stem.removeprefix("img") for file in files]
    if unnumbered := [f.name for f, stem in zip(files, stems) if not (stem.isdecimal() and len(stem) < 10)]:
        problem = f"{unnumbered[0]} has no number, by which images train or validate"
        raise InputError(problem, file=folder / "labels.json", field="filename", expected="img000001")
    numbers = np.array([int(stem) for stem in stems])
    # as the authors' loader has it
    held_out = ((numbers > 400) & (numbers <= 500)) | ((numbers > 900) & (numbers <= 1000))
    return poses.select(np.flatnonzero(held_out == (split == "validation")))


SHIRT = Reader("SHIRT", ("roe1/roe1.json", "roe2/roe2.json"), _shirt_domains, _read_shirt)
SPE3R = Reader("SPE3R", ("splits.csv",), _spe3r_domains, _read_spe3r)
