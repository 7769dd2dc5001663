"""Poses in a CSV, as the Kelvins competition takes them: file, q1..q4 (scalar first), r1..r3 (metres), no head."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug_train.image_names import ImageNames
from visaug_train.readings import Say, pose_readings, which_block
from visaug_train.speed import PoseSet

Pose = tuple[np.ndarray, np.ndarray]  # quaternion (4), scalar first, and translation (3) in metres
LINE = "file, q1, q2, q3, q4, r1, r2, r3"


def save_poses(path: str | Path, poses: PoseSet, found: Sequence[Pose | None]) -> None:
    """One line per image for which a pose was found."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    for name, pose in zip(poses.ids, found):
        if pose is not None:
            writer.writerow([name, *(f"{value:.9g}" for part in pose for value in part)])
    write_text(path, buffer.getvalue())


def save_submission(path: str | Path, poses: PoseSet, found: Sequence[Pose | None]) -> int:
    """A line for every image, as Kelvins wants it; returns how many have no pose of their own.

    These get the median of the positions that were found, and no rotation.
    """
    known = [pose for pose in found if pose is not None]
    if not known:
        raise InputError("no pose was found", file=path, expected="predictions with four keypoints an image")
    default = np.array([1.0, 0, 0, 0]), np.median([translation for _, translation in known], axis=0)
    save_poses(path, poses, [pose or default for pose in found])
    return len(found) - len(known)


def load_poses(
    path: str | Path, poses: PoseSet, names: ImageNames | None = None, say: Say = lambda _: None
) -> list[Pose | None]:
    """The pose of each image of `poses`; None for an image that the file does not name. A head is passed over.

    Args:
        path: the CSV. It may hold other domains too, even under the same names, as a submission does.
        poses: the images.
        names: which image a name means; those of `poses` alone where left out.
        say: told of every convention but Kelvins' own that was recognised.
    """
    path = Path(path)
    names = names or ImageNames(poses)
    blocks: list[np.ndarray] = []
    foreign, repeated = [0], ("", "")
    for number, row in enumerate(_rows(path)):
        where = f"pose {number}"
        if len(row) != 8 or not all(map(_is_number, row[1:])):
            raise InputError(f"holds {','.join(row)[:60]!r}", file=path, field=where, expected=LINE)
        index = names.find(row[0], path, where)
        values = np.array(row[1:], dtype=float)
        length = float(np.linalg.norm(values[:4]))
        if abs(length - 1) > 1e-2:
            problem = f"the quaternion has length {length:.4g}"
            raise InputError(problem, file=path, field=where, expected="a unit quaternion")
        if index is None:
            foreign[-1] += 1
            continue
        if not blocks or np.isfinite(blocks[-1][index]).all():
            if blocks:
                foreign.append(0)
                repeated = row[0], where
            blocks.append(np.full((len(poses), 7), np.nan))
        blocks[-1][index] = np.concatenate([values[:4] / length, values[4:]])
    if not blocks:
        raise names.none_found(path)
    chosen = 0
    if len(blocks) > 1:
        found = which_block(blocks, foreign, poses)
        if found is None:
            raise InputError(
                f"{repeated[0]} comes twice",
                file=path,
                field=repeated[1],
                expected=f"one pose an image, or the domain before its name: {poses.domain}/{poses.files[0].name}",
            )
        chosen = found
        say(f"of {len(blocks)} poses under the same names, number {chosen + 1} was taken for {poses.domain}")
    quaternions, translations = pose_readings(blocks[chosen][:, :4], blocks[chosen][:, 4:], poses, say)
    return [(q, r) if np.isfinite(q).all() else None for q, r in zip(quaternions, translations)]


def _rows(path: Path) -> list[list[str]]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except FileNotFoundError:
        raise InputError("no such file", file=path, expected=f"a CSV with {LINE}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError("is no CSV text", file=path, expected=LINE) from None
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    if not rows:
        raise InputError("holds no poses", file=path, expected=LINE)
    return rows


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
