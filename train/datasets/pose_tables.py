"""SPARK 2022 and SpaceSense-Bench, whose poses are tables with a head. There are no keypoints.

SPARK 2022, stream 2 (trajectories of Proba-2): ``{train,val}/{train,val}.csv`` with ``{train,val}/images/SEQUENCE/``, as the README
of the organisers' utilities (SPARK 2022 Utils, SnT, University of Luxembourg) gives it. Columns: filename, sequence, Tx, Ty, Tz in
metres, Qx, Qy, Qz, Qw. Images have 1440 x 1080 pixels; the camera matrix is the one of the challenge, which no file of the data
holds. p_camera = R(q) p + T. The domain is `spark`. The trajectories of SPARK 2024 are not read: their layout could not be
verified.

SpaceSense-Bench, 136 spacecraft, rendered; a domain is a spacecraft: ``SPACECRAFT/SEQUENCE/{pose_ground_truth.csv,
image/TIMESTAMP.png}``, with one more folder SPACECRAFT around where archives were unpacked side by side. Source:
github.com/wuaodi/SpaceSense-Bench: example data, convert/airsim_to_yolo.py (the split by spacecraft) and
convert/project_lidar2img.py (the camera). Images have a field of view of 50 degrees over their width, square pixels and the
principal point in the middle. The camera's axes are AirSim's: x forward, y right, z down; positions are in metres, quaternions
have the scalar first and turn the body's axes into the camera's. All images of a spacecraft are in one split; `share` of a
config's source takes a part of them.
"""

import math
from pathlib import Path

import numpy as np

from visaug_train.datasets.reader import SPLIT_WORDS, Reader, columns, matrix_quaternions, unit_quaternions
from visaug_train.geometry import Pinhole, rotation_matrix
from visaug_train.speed import PoseSet, image_size

# The challenge's: focal lengths and principal point in pixels; no distortion is published.
SPARK_CAMERA = Pinhole(
    1440,
    1080,
    np.array([[1744.92206139719, 0, 737.272795902663], [0, 1746.58640701753, 528.471960188736], [0, 0, 1]]),
    np.zeros(5),
)


def _spark_domains(root: Path) -> dict[str, tuple[str, ...]]:
    splits = [split for word, split in SPLIT_WORDS.items() if (root / word / f"{word}.csv").is_file()]
    return {"spark": tuple(dict.fromkeys(splits))}


def _read_spark(root: Path, domain: str, split: str) -> PoseSet:
    words = [word for word, meant in SPLIT_WORDS.items() if meant == split]
    file = next(file for word in words if (file := root / word / f"{word}.csv").is_file())
    texts, values = columns(file, ("sequence", "filename"), ("Tx", "Ty", "Tz", "Qw", "Qx", "Qy", "Qz"))
    files = tuple(file.parent / "images" / sequence / name for sequence, name in texts)
    quaternions = unit_quaternions(values[:, 3:], file)
    return PoseSet(f"{domain}/{split}", SPARK_CAMERA, files, quaternions, values[:, :3], spacecraft="Proba-2")


VALIDATION = {"ACE", "CALIPSO", "Dawn", "ExoMars_TGO", "GRAIL", "Integral", "LADEE", "OSIRIS_REX", "Proba_2"}
VALIDATION |= {"Lunar_Reconnaissance_Orbiter", "Mercury_Magnetospheric_Orbiter"}
VALIDATION |= {"SOHO", "Suomi_NPP", "Ulysses"}
RESERVED = {"Van_Allen_Probe", "Venus_Express", "Voyager", "WIND", "XMM_newton"}  # for future tests


def _lists(root: Path) -> dict[str, list[Path]]:
    """The tables of poses by spacecraft."""
    found: dict[str, list[Path]] = {}
    for file in (file for mark in SPACESENSE.marks for file in sorted(root.glob(mark))):
        found.setdefault(file.parent.parent.name, []).append(file)
    return found


def _spacesense_domains(root: Path) -> dict[str, tuple[str, ...]]:
    def split(name: str) -> str:
        return "validation" if name in VALIDATION else "test" if name in RESERVED else "train"

    return {name: (split(name),) for name in _lists(root)}


def _read_spacesense(root: Path, domain: str, split: str) -> PoseSet:
    files: list[Path] = []
    quaternions, shifts = [], []
    # x right, y down, z forward, from AirSim's axes
    to_opencv = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    target = "target_spacecraft_in_camera"
    numbers = [f"{target}_pos_{axis}(m)" for axis in "xyz"] + [f"{target}_quat_{part}" for part in "wxyz"]
    for table in _lists(root)[domain]:
        texts, values = columns(table, ("timestamp",), numbers)
        files += [table.parent / "image" / f"{stamp}.png" for (stamp,) in texts]
        turns = to_opencv @ rotation_matrix(unit_quaternions(values[:, 3:], table))
        quaternions.append(matrix_quaternions(turns, table))
        shifts.append(values[:, :3] @ to_opencv.T)
    width, height = image_size(files[0])
    field_of_view_deg = 50.0  # over the width
    focal_px = width / 2 / math.tan(math.radians(field_of_view_deg) / 2)
    matrix = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
    camera, name = Pinhole(width, height, matrix, np.zeros(5)), f"{domain}/{split}"
    turns, places = np.concatenate(quaternions), np.concatenate(shifts)
    return PoseSet(name, camera, tuple(files), turns, places, spacecraft=domain)


SPARK = Reader("SPARK 2022", ("train/train.csv", "val/val.csv"), _spark_domains, _read_spark)
_TABLES = ("*/*/pose_ground_truth.csv", "*/*/*/pose_ground_truth.csv")
SPACESENSE = Reader("SpaceSense-Bench", _TABLES, _spacesense_domains, _read_spacesense)
