"""Data sets in HDF5 files, one frame at a time (extra `raw`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from visaug.core.errors import InputError, readable
from visaug.core.extras import extra
from visaug.frames.limits import Index, check_index, check_shape, chosen_array

SUFFIXES = (".h5", ".hdf5", ".hdf", ".mat")
_MATLAB = "MATLAB_class"  # attribute of the arrays of MATLAB 7.3, whose axes HDF5 holds in reverse


class Hdf5File:
    """One data set, read in slices along its leading axes; the same interface as `ArrayFile`."""

    held_bytes = 0

    def __init__(self, path: Path, key: str | None = None) -> None:
        self.path, self.key = path, key
        self._file = open_hdf5(path)
        name = chosen_array([name for name, _, _ in _data_sets(self._file)], key, path, "data set")
        self._set = self._file[name]
        self._reversed = _MATLAB in self._set.attrs
        self.shape, self.dtype = _shape(self._set), self._set.dtype
        if self.dtype.kind not in "uif":
            raise InputError(
                f"holds {self.dtype}", file=path, field=name, expected="integers or floats in DN"
            )

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


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, whose mark may follow a block of the user's own (MATLAB 7.3: 512 bytes)."""
    try:
        with open(path, "rb") as handle:
            content = handle.read(520)
    except OSError:
        return False
    return b"\x89HDF\r\n\x1a\n" in (content[:8], content[512:520])


def open_hdf5(path: Path) -> Any:
    with extra(path):
        import h5py
    with readable(path, "truncated, or not an HDF5 file"):
        return h5py.File(path, "r")


def data_sets(path: Path) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and attributes (those of its groups and the file under them) of every data set of numbers."""
    with open_hdf5(path) as file:
        return _data_sets(file)


def _data_sets(file: Any) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    found = []

    def visit(name: str, thing: Any) -> None:
        if hasattr(thing, "dtype") and thing.dtype.kind in "uif" and len(thing.shape) >= 2:
            attributes = dict(file.attrs)
            parts = name.split("/")
            for n in range(1, len(parts) + 1):
                attributes.update(file["/".join(parts[:n])].attrs)
            found.append((name, _shape(thing), {k: _plain(v) for k, v in attributes.items()}))

    file.visititems(visit)
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value.item() if getattr(value, "size", 0) == 1 else value
