"""Data sets in HDF5 files, one frame at a time (extra `raw`), and arrays of MATLAB files, which are HDF5 from version 7.3 on."""

from contextlib import suppress
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import readable
from visaug.core.extras import extra
from visaug.frames.limits import Index, check_index, check_numbers, check_shape, chosen_array

SUFFIXES = (".h5", ".hdf5", ".hdf", ".mat")
_MATLAB = "MATLAB_class"  # attribute of the arrays of MATLAB 7.3, whose axes HDF5 holds in reverse


class Hdf5File:
    """One data set, read in slices along its leading axes; the same interface as `ArrayFile`."""

    held_bytes = 0

    def __init__(self, path: Path, key: str | None = None) -> None:
        self.path, self.key = path, key
        self._file = open_hdf5(path)
        name = chosen_array([name for name, _, _ in data_sets(self._file)], key, path, "data set")
        self._set = self._file[name]
        self._reversed = _MATLAB in self._set.attrs
        self.shape, self.dtype = _shape(self._set), self._set.dtype
        check_numbers(self.dtype, path, name)

    def read(self, index: Index) -> np.ndarray:
        check_index(index, self.shape, self.path, self.key)
        whole = (*index, *[slice(None)] * (len(self.shape) - len(index)))
        check_shape([int(n) for i, n in zip(whole, self.shape) if isinstance(i, slice)], self.path)
        with readable(self.path, "truncated?"):
            return np.asarray(self._set[whole[::-1]]).T if self._reversed else np.asarray(self._set[index])

    def close(self) -> None:
        self._file.close()


def _shape(data_set: Any) -> tuple[int, ...]:
    return tuple(data_set.shape)[:: -1 if _MATLAB in data_set.attrs else 1]


def is_old_mat(path: Path) -> bool:
    """Whether a file is MATLAB's and not HDF5, whose mark may follow a block of the user's own (MATLAB 7.3: 512 bytes)."""
    content = b""
    if path.suffix.lower() != ".mat":
        return False
    with suppress(OSError), open(path, "rb") as handle:
        content = handle.read(520)
    return b"\x89HDF\r\n\x1a\n" not in (content[:8], content[512:520])


def open_hdf5(path: Path) -> Any:
    with extra(path):
        import h5py
    with readable(path, "truncated, or not an HDF5 file"):
        return h5py.File(path, "r")


def data_sets(file: Any) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and attributes (those of its groups and the file under them) of every data set of numbers."""
    found = []

    def visit(name: str, thing: Any) -> None:
        if hasattr(thing, "dtype") and thing.dtype.kind in "uif" and len(thing.shape) >= 2:
            attributes = dict(file.attrs)
            for part in accumulate(name.split("/"), "{}/{}".format):
                attributes.update(file[part].attrs)
            found.append((name, _shape(thing), {k: _plain(v) for k, v in attributes.items()}))

    file.visititems(visit)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value.item() if getattr(value, "size", 0) == 1 else value


class MatFile:
    """One variable of a file before version 7.3, held whole; the same interface as `ArrayFile`."""

    def __init__(self, path: Path, key: str | None = None) -> None:
        import scipy.io

        self.path, self.key = path, key
        shapes = {name: shape for name, shape, _ in mat_arrays(path)}
        name = chosen_array(list(shapes), key, path, "array")
        check_shape(shapes[name], path)
        with readable(path, "truncated, or not a MATLAB file"):
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

    with readable(path, "truncated, or not a MATLAB file"):
        found = scipy.io.whosmat(path)
    numeric = [n for n in found if len(n[1]) >= 2 and n[2].startswith(("uint", "int", "single", "double"))]
    no_lines = [n for n in numeric if min(n[1]) > 1 or len(n[1]) > 2]
    return [(name, tuple(map(int, shape)), {}) for name, shape, _ in no_lines]
