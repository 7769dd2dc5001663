"""MATLAB files before version 7.3 through SciPy; those of 7.3 are HDF5 files, see `visaug.frames.hdf5`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug.frames.limits import Index, check_index, check_shape, chosen_array


class MatFile:
    """One variable, held whole; the same interface as `ArrayFile`."""

    def __init__(self, path: Path, key: str | None = None) -> None:
        self.path, self.key = path, key
        name = chosen_array([name for name, _, _ in mat_arrays(path)], key, path, "array")
        self._whole: np.ndarray = _loaded(path, [name])[name]
        self.shape, self.dtype, self.held_bytes = self._whole.shape, self._whole.dtype, self._whole.nbytes

    @property
    def frame_shape(self) -> tuple[int, ...]:
        return self.shape[-2:]

    def read(self, index: Index) -> np.ndarray:
        check_index(index, self.shape, self.path, self.key)
        return self._whole[index]

    def close(self) -> None:
        pass


def mat_arrays(path: Path) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and no attributes of every array of numbers."""
    import scipy.io

    try:
        found = scipy.io.whosmat(path)
    except FileNotFoundError:
        raise InputError("no such file", file=path) from None
    except Exception as error:  # SciPy raises many kinds for damaged files
        raise InputError(f"cannot be read ({error}); truncated, or not a MATLAB file", file=path) from None
    numeric = [n for n in found if len(n[1]) >= 2 and n[2].startswith(("uint", "int", "single", "double"))]
    return [(name, tuple(shape), {}) for name, shape, _ in numeric if min(shape) > 1 or len(shape) > 2]


def _loaded(path: Path, names: list[str]) -> dict[str, np.ndarray]:
    import scipy.io

    for name, shape, _ in mat_arrays(path):
        if name in names:
            check_shape([int(n) for n in shape], path)
    try:
        return scipy.io.loadmat(path, variable_names=names)
    except Exception as error:  # SciPy raises many kinds for damaged files
        raise InputError(f"cannot be read ({error}); truncated, or not a MATLAB file", file=path) from None
