"""MATLAB files before version 7.3 through SciPy; those of 7.3 are HDF5 files, see `visaug.frames.hdf5`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import readable
from visaug.frames.limits import Index, check_index, check_shape, chosen_array

_HINT = "truncated, or not a MATLAB file"


class MatFile:
    """One variable, held whole; the same interface as `ArrayFile`."""

    def __init__(self, path: Path, key: str | None = None) -> None:
        import scipy.io

        self.path, self.key = path, key
        shapes = {name: shape for name, shape, _ in mat_arrays(path)}
        name = chosen_array(list(shapes), key, path, "array")
        check_shape(shapes[name], path)
        with readable(path, _HINT):
            self._whole: np.ndarray = scipy.io.loadmat(path, variable_names=[name])[name]
        self.shape, self.dtype, self.held_bytes = self._whole.shape, self._whole.dtype, self._whole.nbytes

    def read(self, index: Index) -> np.ndarray:
        check_index(index, self.shape, self.path, self.key)
        return self._whole[index]

    def close(self) -> None:
        pass


def mat_arrays(path: Path) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and no attributes of every array of numbers."""
    import scipy.io

    with readable(path, _HINT):
        found = scipy.io.whosmat(path)
    numeric = [n for n in found if len(n[1]) >= 2 and n[2].startswith(("uint", "int", "single", "double"))]
    return [
        (name, tuple(map(int, shape)), {}) for name, shape, _ in numeric if min(shape) > 1 or len(shape) > 2
    ]
