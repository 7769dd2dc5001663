"""SPEED and SPEED+ folders, read from their own layout and checked on opening.

SPEED+: ``camera.json``, ``synthetic/{train,validation}.json`` with ``synthetic/images/``,
``lightbox/test.json`` and ``sunlamp/test.json`` with their ``images/``. SPEED: ``train.json`` with
``images/train/`` (and ``real.json``). A folder of one's own in the SPEED+ layout is read the same way; its
domains may have any name.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image

from visaug.core.documents import read_json
from visaug.core.errors import InputError
from visaug.core.files import write_json
from visaug_train.geometry import Keypoints, Pinhole, Targets, finite_array, project_targets

# SPEED's starter kit: 17.6 mm, 5.86 um, no distortion. Used where a SPEED folder has no camera.json.
SPEED_CAMERA = Pinhole(
    1920, 1200, np.array([[0.0176 / 5.86e-6, 0, 960], [0, 0.0176 / 5.86e-6, 600], [0, 0, 1.0]]), np.zeros(5)
)
SPLITS = ("train", "validation", "test")


@dataclass(frozen=True, eq=False)
class PoseSet:
    """Images of one camera and one spacecraft, with what the data set says of each; what it does not have is None."""

    name: str  # domain/split
    camera: Pinhole  # intrinsics; all images have its size
    files: tuple[Path, ...]  # the images (N)
    quaternions: np.ndarray  # of the poses, (N, 4) scalar first, p_camera = R p_body + r; NaN if unknown
    translations: np.ndarray  # of the poses, (N, 3) in metres
    keypoints: Keypoints | None = None  # the data set's own points of the spacecraft
    boxes: np.ndarray | None = None  # annotated, (N, 4) x0 y0 x1 y1 in pixels; NaN: no target in the image
    points: np.ndarray | None = None  # annotated keypoints (N, K, 3): x, y in pixels and COCO's visibility
    spacecraft: str = "tango"  # whose points are meant where `keypoints` is None

    def __len__(self) -> int:
        return len(self.files)

    @property
    def domain(self) -> str:
        """The data set's own name of the domain: `name` is domain/split."""
        return self.name.split("/")[0]

    @property
    def posed(self) -> bool:
        return bool(np.isfinite(self.quaternions).all())

    @property
    def labelled(self) -> bool:
        return self.posed or self.points is not None

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """A name of each image that no other has, `a.png` or `scene_1/rgb/a.png`: with as many folders as that takes."""
        longest = max((len(file.parts) for file in self.files), default=1)
        parts = 1
        while parts < longest and len({file.parts[-parts:] for file in self.files}) < len(self.files):
            parts += 1
        return tuple("/".join(file.parts[-parts:]) for file in self.files)

    def targets(self, keypoints: Keypoints) -> Targets:
        """Boxes and keypoints in pixels: as annotated where they are, else projected by the pose.

        Both ways boxes are cut at the border, points outside are not visible, and a target of less than a pixel is not seen.
        """
        if self.points is not None:
            if (count := self.points.shape[1]) != len(keypoints):
                problem = f"{self.name}: {count} keypoints are annotated, the model has {len(keypoints)}"
                raise InputError(problem, field="keypoints", expected="the model of the annotations")
            boxes = np.full((len(self), 4), np.nan) if self.boxes is None else self.boxes
            boxes, points = self._cut(np.nan_to_num(boxes)), self.points[..., :2]
            seen = np.asarray(((boxes[:, 2:] - boxes[:, :2]) >= 1.0).all(axis=1))
            within = ((points >= 0) & (points <= np.array(self.camera.size))).all(axis=2)
            return Targets(boxes, points, within & (self.points[..., 2] > 0) & seen[:, None], seen)
        targets = project_targets(self.camera, keypoints, self.quaternions, self.translations)
        if self.boxes is None:
            return targets
        boxes = self._cut(self.boxes)
        known = np.asarray(((boxes[:, 2:] - boxes[:, :2]) >= 1.0).all(axis=1))  # NaN is not
        return replace(targets, boxes=np.where(known[:, None], boxes, targets.boxes))

    def _cut(self, boxes: np.ndarray) -> np.ndarray:
        """Boxes cut at the border of the image."""
        return np.clip(boxes, 0, np.tile(self.camera.size, 2))

    def select(self, indices: np.ndarray) -> "PoseSet":
        arrays = {name: getattr(self, name) for name in ("quaternions", "translations", "boxes", "points")}
        chosen = {name: None if array is None else array[indices] for name, array in arrays.items()}
        return replace(self, files=tuple(self.files[i] for i in indices), **chosen)


def is_speed(root: Path) -> bool:
    """Whether `root` has SPEED's layout rather than SPEED+'s."""
    return (root / "train.json").is_file() and (root / "images").is_dir()


def is_speed_layout(root: Path) -> bool:
    """Whether a folder has SPEED's or SPEED+'s lists of images, which are JSON lists."""
    if is_speed(root):
        with (root / "train.json").open("rb") as opened:
            return opened.read(64).lstrip()[:1] != b"{"  # COCO's annotations are an object
    return any((f / f"{s}.json").is_file() for f in root.iterdir() if (f / "images").is_dir() for s in SPLITS)


def domains(root: str | Path) -> dict[str, tuple[str, ...]]:
    """The domains of a folder that may have poses, with the splits that each has."""
    root = Path(root)
    if is_speed(root):
        found: dict[str, tuple[str, ...]] = {"speed": SPLITS}
        return found | ({"real": ("test",)} if (root / "real.json").is_file() else {})
    return by_domain(name.split("/") for name in listings(root))


def by_domain(pairs: Iterable[Sequence[str]]) -> dict[str, tuple[str, ...]]:
    """The splits of each domain, from (domain, split)."""
    found: dict[str, tuple[str, ...]] = {}
    for domain, split in pairs:
        found[domain] = (*found.get(domain, ()), split)
    return found


def chosen_split(found: dict[str, tuple[str, ...]], domain: str, split: str | None, root: Path) -> str:
    """The split that is meant, one of `found`, the splits by domain; left out, test, else validation, else train."""
    if domain not in found:
        raise InputError(f"{root}: domain: expected one of {', '.join(found)}, got {domain}")
    split = split or next(s for s in ("test", "validation", "train") if s in found[domain])
    if split not in found[domain]:
        raise InputError(f"{root}: {domain}: split: expected one of {', '.join(found[domain])}, got {split}")
    return split


def listings(root: Path) -> dict[str, tuple[Path, Path]]:
    """The lists of images of a folder, each with the folder of its images, by domain/split.

    SPEED's train.json, which is split at random, is one list: speed/all.
    """
    if not root.is_dir():
        raise InputError(f"{root}: no such folder; expected a SPEED or SPEED+ folder")
    if is_speed(root):
        stems = {"speed/all": "train", "real/test": "real"}
        stems |= {"test/test": "test", "real_test/test": "real_test"}
        places = {name: (root / f"{stem}.json", root / "images" / stem) for name, stem in stems.items()}
    else:
        folders = [folder for folder in sorted(root.iterdir()) if (folder / "images").is_dir()]
        parts = [(folder, split) for folder in folders for split in SPLITS]
        places = {f"{f.name}/{split}": (f / f"{split}.json", f / "images") for f, split in parts}
    if not (found := {name: place for name, place in places.items() if place[0].is_file()}):
        expected = "train.json and images/, or folders like synthetic/ with train.json"
        raise InputError(f"{root}: expected {expected}")
    return found


def read_poses(
    root: str | Path, domain: str, split: str | None = None, seed: int = 0, labels: bool = True
) -> PoseSet:
    """The images of a domain with poses, checked.

    `split` is train, validation or test; left out, it is the domain's test split, else validation, else
    train. SPEED has one list, which is split at random by `seed` in the paper's proportions 7680 : 1920 :
    2400. Images without poses (SPEED's domains `test` and `real_test`, and lightbox and sunlamp of SPEED+ as it was before
    2023) are refused unless `labels` is false.
    """
    root = Path(root)
    lists, found, of_speed = listings(root), domains(root), is_speed(root)
    if of_speed and not labels:
        found |= {name.split("/")[0]: ("test",) for name in lists if name.endswith("test/test")}
    split = chosen_split(found, domain, split, root)
    is_split = of_speed and domain == "speed"
    listing, images = lists["speed/all" if is_split else f"{domain}/{split}"]
    bare = of_speed and not (root / "camera.json").is_file()
    camera = SPEED_CAMERA if bare else Pinhole.load(root / "camera.json")
    poses = read_listing(listing, images, camera, f"{domain}/{split}")
    if labels and not poses.labelled:
        expected = "an archive with labels: SPEED+ has those of lightbox and sunlamp since 2023 (speedplusv2)"
        raise InputError("the images have no poses", file=listing, expected=expected)
    if is_split:
        poses = poses.select(split_indices(len(poses), seed)[split])
    check_images(poses, listing)
    if poses.labelled:
        check_camera(poses, listing)
    return poses


def part_of(poses: PoseSet, share: tuple[float, float], seed: int) -> PoseSet:
    """A part of the images in random order: shares that do not overlap hold different images."""
    order = np.random.default_rng([20261126, seed]).permutation(len(poses))
    first, last = (round(end * len(poses)) for end in share)
    if first == last:
        raise InputError(f"{poses.name}: a share of {list(share)} of {len(poses)} images is none")
    return poses.select(np.sort(order[first:last]))


def split_indices(count: int, seed: int) -> dict[str, np.ndarray]:
    """Indices of the images that train, validate and test, each part sorted: a permutation cut as the paper splits SPEED's 12,000
    labelled synthetic images, 7680 : 1920 : 2400 (it does not say which image goes where).
    """
    order = np.random.default_rng([20250711, seed]).permutation(count)
    first = round(count * 7680 / 12000)
    second = first + round(count * 1920 / 12000)
    return {name: np.sort(part) for name, part in zip(SPLITS, np.split(order, [first, second]))}


def read_listing(listing: Path, images: Path, camera: Pinhole, name: str) -> PoseSet:
    """The images of a list of SPEED+'s records, which lie in the folder `images`; files are not checked."""
    records = read_json(listing)
    if not isinstance(records, list) or not records:
        raise InputError(f"{listing}: expected a list of records with filename, quaternion and position")
    files, found = [], []
    given = [r if isinstance(r, dict) else {} for r in records]
    turns = [r.get("q_vbs2tango_true", r.get("q_vbs2tango")) for r in given]
    shifts = [r.get("r_Vo2To_vbs_true") for r in given]
    unlabelled = all(each is None for each in (*turns, *shifts))
    for number, (record, turn, shift) in enumerate(zip(given, turns, shifts)):
        where = f"{listing}: record {number}"
        if not isinstance(record.get("filename"), str):
            raise InputError(f"{where}: filename: expected a file name")
        files.append(images / record["filename"])
        if unlabelled:
            found.append(np.full(7, np.nan))
            continue
        quaternion = finite_array(turn, (4,), f"{where}: q_vbs2tango_true")
        translation = finite_array(shift, (3,), f"{where}: r_Vo2To_vbs_true")
        norm = float(np.linalg.norm(quaternion))
        if abs(norm - 1) > 1e-2:
            raise InputError(f"{where}: q_vbs2tango_true: expected a unit quaternion, got length {norm:.4g}")
        if not translation[2] > 0:
            raise InputError(f"{where}: r_Vo2To_vbs_true: expected a target before the camera (z > 0 m)")
        found.append(np.concatenate([quaternion / norm, translation]))
    if len(set(files)) < len(files):
        raise InputError(f"{listing}: filename: expected every image once")
    poses = np.array(found)
    return PoseSet(name, camera, tuple(files), poses[:, :4], poses[:, 4:])


def write_listing(
    listing: Path, names: Iterable[str], quaternions: np.ndarray, translations: np.ndarray
) -> None:
    poses = zip(names, quaternions.tolist(), translations.tolist())
    write_json(listing, [{"filename": n, "q_vbs2tango_true": q, "r_Vo2To_vbs_true": r} for n, q, r in poses])


def check_images(poses: PoseSet, listing: Path) -> None:
    """Refuse a list of images that are not there, or not of the camera's size."""
    folders = {file.parent for file in poses.files}
    present = {file for folder in folders if folder.is_dir() for file in folder.iterdir()}
    if missing := [file for file in poses.files if file not in present]:
        problem = f"{len(missing)} of {len(poses)} images are missing, the first is {missing[0]}"
        raise InputError(problem, file=listing)
    for file in poses.files[:: max(1, len(poses) // 32)]:  # the rest is checked when it is read
        if (size := image_size(file)) != poses.camera.size:
            own, found = (f"{width} x {height}" for width, height in (poses.camera.size, size))
            problem = f"wrong camera: camera.json says {own} pixels, the image has {found}"
            raise InputError(problem, file=file)


def image_size(file: Path) -> tuple[int, int]:
    """Width and height of an image."""
    try:
        with Image.open(file) as image:
            return image.size
    except OSError:
        raise InputError("cannot be read", file=file, expected="an image") from None


def check_camera(poses: PoseSet, listing: Path) -> None:
    """With a wrong camera (or frames mixed up) most targets fall outside the image."""
    centre = Keypoints("centre", ("centre",), np.zeros((1, 3)))
    points = project_targets(poses.camera, centre, poses.quaternions, poses.translations).points[:, 0]
    size = np.array(poses.camera.size)
    near = (np.abs(points - size / 2) < 0.75 * size).all(axis=1)
    if near.mean() < 0.5:
        share = f"{100 * (1 - near.mean()):.0f} %"
        problem = f"wrong camera: {share} of the targets lie outside the image by camera.json"
        raise InputError(problem, file=listing, expected="most of them inside")
