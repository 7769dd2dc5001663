"""Readers of pose data: what domains a folder has, and the images of one of them with their labels.

A folder that no reader recognises is taken for SPEED's or SPEED+'s layout (`visaug_train.speed`).
"""

from pathlib import Path

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug_train import speed
from visaug_train.datasets.bop import BOP
from visaug_train.datasets.coco import COCO
from visaug_train.datasets.pose_tables import SPACESENSE, SPARK
from visaug_train.datasets.reader import Reader
from visaug_train.datasets.stanford import SHIRT, SPE3R
from visaug_train.geometry import Keypoints
from visaug_train.speed import PoseSet

# COCO last: its files have no name of their own
READERS: list[Reader] = [SHIRT, SPE3R, SPARK, SPACESENSE, BOP, COCO]


def reader_of(root: str | Path) -> Reader | None:
    """Which reader takes a folder; None for SPEED, SPEED+ and whatever is not recognised."""
    root = Path(root)
    if not root.is_dir() or speed.is_speed_layout(root):
        return None
    return next((reader for reader in READERS if reader.recognises(root)), None)


def domains(root: str | Path) -> dict[str, tuple[str, ...]]:
    """The domains of a folder, with the splits that each has."""
    reader = reader_of(root)
    return speed.domains(root) if reader is None else reader.domains(Path(root))


def read_poses(
    root: str | Path, domain: str, split: str | None = None, seed: int = 0, labels: bool = True
) -> PoseSet:
    """The images of a domain, checked; see `visaug_train.speed.read_poses`."""
    reader, root = reader_of(root), Path(root)
    if reader is None:
        return speed.read_poses(root, domain, split, seed, labels)
    poses = reader.read(root, domain, speed.chosen_split(reader.domains(root), domain, split, root))
    if labels and not poses.labelled:
        raise InputError("the images have no labels", file=root, field=poses.name, expected="labelled images")
    speed.check_images(poses, root / domain)
    if poses.posed:
        speed.check_camera(poses, root / domain)
    return poses


def keypoints_of(source: str | Path, poses: PoseSet) -> Keypoints:
    """The spacecraft's points: those of a file; for `tango`, which is the default, the data set's own where it has some."""
    if str(source) != "tango":
        return Keypoints.load(source)
    if poses.keypoints is not None:
        return poses.keypoints
    if poses.spacecraft != "tango":
        problem = f"{poses.name} shows {poses.spacecraft} and brings no keypoints"
        expected = "a YAML file with points_m in metres in its body frame"
        raise InputError(problem, field="keypoints", expected=expected)
    return Keypoints.load(source)


def files_of(root: str | Path) -> dict[str, set[Path]]:
    """Files of the images by domain/split."""
    reader, root = reader_of(root), Path(root)
    if reader is not None:
        parts = [(domain, split) for domain, splits in reader.domains(root).items() for split in splits]
        return {f"{domain}/{split}": set(reader.read(root, domain, split).files) for domain, split in parts}
    found = {}
    for name, (listing, images) in speed.listings(root).items():
        records = read_json(listing)
        records = records if isinstance(records, list) else []
        found[name] = {images / str(record.get("filename")) for record in records if isinstance(record, dict)}
    return found
