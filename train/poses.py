"""Poses in a CSV, as the Kelvins competition takes them: file, q1..q4 (scalar first), r1..r3 (metres), no head."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.core.files import write_text
from visaug_train.speed import PoseSet

Pose = tuple[np.ndarray, np.ndarray]  # quaternion (4), scalar first, and translation (3) in metres
LINE = "file, q1, q2, q3, q4, r1, r2, r3"


def save_poses(path: str | Path, poses: PoseSet, found: Sequence[Pose | None]) -> None:
    """One line per image for which a pose was found."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    for file, pose in zip(poses.files, found):
        if pose is not None:
            writer.writerow([file.name, *(f"{value:.9g}" for part in pose for value in part)])
    write_text(path, buffer.getvalue())


def load_poses(path: str | Path, poses: PoseSet) -> list[Pose | None]:
    """The pose of each image of `poses`; None for an image that the file does not name. A head is passed over."""
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row]
    except FileNotFoundError:
        raise InputError("no such file", file=path, expected=f"a CSV with {LINE}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError("is no CSV text", file=path, expected=LINE) from None
    if rows and not _is_number(rows[0][-1]):
        rows = rows[1:]
    if not rows:
        raise InputError("holds no poses", file=path, expected=LINE)
    known = {file.name: i for i, file in enumerate(poses.files)}
    found: list[Pose | None] = [None] * len(poses)
    for number, row in enumerate(rows):
        where = f"pose {number}"
        if len(row) != 8 or not all(map(_is_number, row[1:])):
            raise InputError(f"holds {','.join(row)[:60]!r}", file=path, field=where, expected=LINE)
        index = known.get(Path(row[0].strip()).name)
        if index is None:
            expected = f"a name such as {poses.files[0].name}"
            raise InputError(
                f"{row[0]!r} is no image of {poses.name}", file=path, field=where, expected=expected
            )
        if found[index] is not None:
            raise InputError(f"{row[0]} comes twice", file=path, field=where, expected="one pose an image")
        values = np.array(row[1:], dtype=float)
        length = float(np.linalg.norm(values[:4]))
        if abs(length - 1) > 1e-2:
            raise InputError(
                f"the quaternion has length {length:.4g}",
                file=path,
                field=where,
                expected="a unit quaternion",
            )
        found[index] = values[:4] / length, values[4:]
    return found


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
