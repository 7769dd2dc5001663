"""What a reader of a data set is, and what readers share."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug_train.geometry import finite_array, numbers_in
from visaug_train.speed import PoseSet

SPLIT_WORDS = {"train": "train", "val": "validation", "validation": "validation", "test": "test"}


@dataclass(frozen=True)
class Reader:
    """How a data set of one layout is recognised and read."""

    name: str  # of the data set
    marks: tuple[str, ...]  # patterns of files, relative to the root, of which the layout has one
    domains: Callable[[Path], dict[str, tuple[str, ...]]]  # of a root, with the splits that each has
    # the images of (root, domain, split); files need not be checked
    read: Callable[[Path, str, str], PoseSet]

    def recognises(self, root: Path) -> bool:
        return any(next(root.glob(mark), None) is not None for mark in self.marks)


def unit_quaternions(quaternions: np.ndarray, file: Path) -> np.ndarray:
    """Quaternions (N, 4) brought to length 1, from which they may be off by the digits of the file alone."""
    length = np.linalg.norm(quaternions, axis=1)
    if (wrong := np.flatnonzero(~(np.abs(length - 1) < 1e-2))).size:
        problem, field = f"has a quaternion of length {length[wrong[0]]:.4g}", f"record {wrong[0]}"
        raise InputError(problem, file=file, field=field, expected="unit quaternions")
    return quaternions / length[:, None]


def matrix_quaternions(matrices: np.ndarray, file: Path) -> np.ndarray:
    """Rotation matrices (N, 3, 3) as quaternions (N, 4), scalar first."""
    from scipy.spatial.transform import Rotation

    off = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    if (wrong := np.flatnonzero(~((off < 1e-2) & (np.linalg.det(matrices) > 0)))).size:
        field, expected = f"record {wrong[0]}", "R R^T = 1, det R = 1"
        raise InputError("is no rotation", file=file, field=field, expected=expected)
    return np.roll(Rotation.from_matrix(matrices).as_quat(), 1, axis=1)


def numbers_of(entry: Any, name: str, count: int, file: Path, key: str) -> np.ndarray:
    """`count` finite numbers of an entry of a JSON file; 0 means a single one."""
    value = entry.get(name) if isinstance(entry, dict) else None
    return finite_array(value, (count,) if count else (), f"{file}: {key}.{name}")


def columns(file: Path, words: Sequence[str], numbers: Sequence[str]) -> tuple[list[list[str]], np.ndarray]:
    """Columns of a CSV with a head: texts of `words`, one list a line, and `numbers` (N, M)."""
    try:
        rows = list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8-sig")), skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error):
        raise InputError("cannot be read", file=file, expected="a CSV with a head") from None
    head = ", ".join([*words, *numbers])
    if not rows:
        raise InputError("holds no line", file=file, expected=head)
    if missing := [name for name in [*words, *numbers] if name not in rows[0]]:
        raise InputError("is missing", file=file, field=f"column {missing[0]}", expected=head)
    values = np.empty((len(rows), len(numbers)))
    for i, row in enumerate(rows):
        for j, name in enumerate(numbers):
            found = numbers_in(row[name])
            if not np.isfinite(found):
                field = f"line {i + 2}, {name}"
                raise InputError(f"is {row[name]!r}", file=file, field=field, expected="a number")
            values[i, j] = found
    return [[row[name] or "" for name in words] for row in rows], values
