"""SpaceSense-Bench: 136 spacecraft, rendered; a domain is a spacecraft.

``SPACECRAFT/SEQUENCE/{pose_ground_truth.csv,image/TIMESTAMP.png}``, with one more folder SPACECRAFT around where archives were
unpacked side by side. Source: github.com/wuaodi/SpaceSense-Bench: example data, convert/airsim_to_yolo.py (the split by
spacecraft) and convert/project_lidar2img.py (the camera). Images have a field of view of 50 degrees over their width, square
pixels and the principal point in the middle. The camera's axes are AirSim's: x forward, y right, z down; positions are in
metres, quaternions have the scalar first and turn the body's axes into the camera's. There are no keypoints. All images of a
spacecraft are in one split; `share` of a config's source takes a part of them.
"""

import math
from pathlib import Path

import numpy as np

from visaug_train.datasets.reader import Reader, columns, matrix_quaternions, unit_quaternions
from visaug_train.geometry import Pinhole, rotation_matrix
from visaug_train.speed import PoseSet, image_size

TO_OPENCV = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # x right, y down, z forward, from AirSim's axes
POSITION = tuple(f"target_spacecraft_in_camera_pos_{axis}(m)" for axis in "xyz")
QUATERNION = tuple(f"target_spacecraft_in_camera_quat_{part}" for part in "wxyz")
VALIDATION = frozenset(
    [
        "ACE",
        "CALIPSO",
        "Dawn",
        "ExoMars_TGO",
        "GRAIL",
        "Integral",
        "LADEE",
        "Lunar_Reconnaissance_Orbiter",
        "Mercury_Magnetospheric_Orbiter",
        "OSIRIS_REX",
        "Proba_2",
        "SOHO",
        "Suomi_NPP",
        "Ulysses",
    ]
)
# for future tests
RESERVED = frozenset(["Van_Allen_Probe", "Venus_Express", "Voyager", "WIND", "XMM_newton"])


def _lists(root: Path) -> dict[str, list[Path]]:
    """The tables of poses by spacecraft."""
    found: dict[str, list[Path]] = {}
    for depth in ("*/*", "*/*/*"):
        for file in sorted(root.glob(f"{depth}/pose_ground_truth.csv")):
            found.setdefault(file.parent.parent.name, []).append(file)
    return found


def _domains(root: Path) -> dict[str, tuple[str, ...]]:
    def split(name: str) -> str:
        return "validation" if name in VALIDATION else "test" if name in RESERVED else "train"

    return {name: (split(name),) for name in _lists(root)}


def _read(root: Path, domain: str, split: str) -> PoseSet:
    files: list[Path] = []
    quaternions, translations = [], []
    for table in _lists(root)[domain]:
        texts, values = columns(table, ("timestamp",), (*POSITION, *QUATERNION))
        files += [table.parent / "image" / f"{stamp}.png" for (stamp,) in texts]
        turns = TO_OPENCV @ rotation_matrix(unit_quaternions(values[:, 3:], table))
        quaternions.append(matrix_quaternions(turns, table))
        translations.append(values[:, :3] @ TO_OPENCV.T)
    width, height = image_size(files[0])
    field_of_view_deg = 50.0  # over the width
    focal_px = width / 2 / math.tan(math.radians(field_of_view_deg) / 2)
    matrix = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]])
    return PoseSet(
        f"{domain}/{split}",
        Pinhole(width, height, matrix, np.zeros(5)),
        tuple(files),
        np.concatenate(quaternions),
        np.concatenate(translations),
        spacecraft=domain,
    )


SPACESENSE = Reader(
    "SpaceSense-Bench", ("*/*/pose_ground_truth.csv", "*/*/*/pose_ground_truth.csv"), _domains, _read
)
