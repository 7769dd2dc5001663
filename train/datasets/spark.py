"""SPARK 2022, stream 2 (trajectories of Proba-2): poses of image sequences.

``{train,val}/{train,val}.csv`` with ``{train,val}/images/SEQUENCE/``, as the README of the organisers' utilities (SPARK 2022 Utils,
SnT, University of Luxembourg) gives it. Columns: filename, sequence, Tx, Ty, Tz in metres, Qx, Qy, Qz, Qw. Images have 1440 x 1080
pixels; the camera matrix is the one of the challenge, which no file of the data holds. p_camera = R(q) p + T. The domain is
`spark`. There are no keypoints. The trajectories of SPARK 2024 are not read: their layout could not be verified.
"""

from pathlib import Path

import numpy as np

from visaug_train.datasets.reader import SPLIT_WORDS, Reader, columns, unit_quaternions
from visaug_train.geometry import Pinhole
from visaug_train.speed import PoseSet

# The challenge's: focal lengths and principal point in pixels; no distortion is published.
CAMERA = Pinhole(
    1440,
    1080,
    np.array([[1744.92206139719, 0, 737.272795902663], [0, 1746.58640701753, 528.471960188736], [0, 0, 1]]),
    np.zeros(5),
)


def _domains(root: Path) -> dict[str, tuple[str, ...]]:
    splits = [split for word, split in SPLIT_WORDS.items() if (root / word / f"{word}.csv").is_file()]
    return {"spark": tuple(dict.fromkeys(splits))}


def _read(root: Path, domain: str, split: str) -> PoseSet:
    words = [word for word, meant in SPLIT_WORDS.items() if meant == split]
    word = next(word for word in words if (root / word / f"{word}.csv").is_file())
    file = root / word / f"{word}.csv"
    texts, values = columns(file, ("sequence", "filename"), ("Tx", "Ty", "Tz", "Qw", "Qx", "Qy", "Qz"))
    files = tuple(root / word / "images" / sequence / name for sequence, name in texts)
    quaternions = unit_quaternions(values[:, 3:], file)
    return PoseSet(f"{domain}/{split}", CAMERA, files, quaternions, values[:, :3], spacecraft="Proba-2")


SPARK = Reader("SPARK 2022", ("train/train.csv", "val/val.csv"), _domains, _read)
