"""Arrays in .npy and .npz files, one frame at a time, without loading the rest.

A stored array is mapped into memory. A compressed one is read whole where it is small and otherwise as a stream: frames in
their order cost one pass, a step back starts it anew.
"""

import struct
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np

from visaug.core.errors import InputError, readable
from visaug.frames import hdf5
from visaug.frames.hdf5 import Hdf5File, MatFile, is_old_mat, mat_arrays
from visaug.frames.limits import Index, check_axes, check_index, check_shape, chosen_array

WHOLE_BYTES = 64 * 2**20  # a compressed array up to this size is decompressed at once and kept
MOST_OPEN = 32  # files at a time


class ArrayFile:
    """One array in a .npy or .npz file, read in slices along its leading axes; `key` chooses among several in an archive."""

    def __init__(self, path: Path, key: str | None = None) -> None:
        self.path, self.key = path, key
        self._whole: np.ndarray | None = None
        self._stored: np.ndarray | None = None
        with readable(path, "truncated, or not an array"), ExitStack() as opened:
            self._open(opened)
            self.close = opened.pop_all().close

    def read(self, index: Index) -> np.ndarray:
        """The sub-array at `index`, for instance one frame."""
        inner = self.shape[len(index) :]
        check_index(index, self.shape, self.path, self.key)
        check_shape(inner or (1,), self.path)
        if self._stored is not None:
            return np.array(self._stored[index])
        if self._whole is None and (self._fortran or prod(self.shape) * self.dtype.itemsize <= WHOLE_BYTES):
            flat = self._bytes(0, prod(self.shape))
            self._whole = flat.reshape(self.shape, order="F" if self._fortran else "C")
        if self._whole is not None:
            return self._whole[index]
        places = tuple(i for i in index if isinstance(i, int))
        if len(places) < len(index):
            problem = "is too large to be read along its last axis"
            raise InputError(problem, file=self.path, expected="an array that is not compressed")
        count = prod(inner)
        offset = int(np.ravel_multi_index(places, self.shape[: len(places)])) * count if places else 0
        return self._bytes(offset, count).reshape(inner)

    @property
    def held_bytes(self) -> int:
        return 0 if self._whole is None else self._whole.nbytes

    def _open(self, opened: ExitStack) -> None:
        start, compressed = 0, False
        handle: IO[bytes]
        if self.path.suffix.lower() == ".npz":
            archive = opened.enter_context(zipfile.ZipFile(self.path))
            self.key = chosen_array(_names_in(archive), self.key, self.path, "array")
            member = archive.getinfo(f"{self.key}.npy")
            compressed = member.compress_type != zipfile.ZIP_STORED
            if compressed:
                handle = opened.enter_context(archive.open(member))
            else:
                check_sum(archive, member, self.path)
                handle = opened.enter_context(self.path.open("rb"))
                start = _data_offset(handle, member)
                handle.seek(start)
            end = start + member.file_size
        else:
            handle, end = opened.enter_context(self.path.open("rb")), self.path.stat().st_size
        self._handle, form = handle, np.lib.format
        old = form.read_magic(handle) == (1, 0)
        read_header = form.read_array_header_1_0 if old else form.read_array_header_2_0
        self.shape, self._fortran, self.dtype = read_header(handle)
        self._data_start = handle.tell()
        if self.dtype.kind not in "uif":
            problem, expected = f"holds {self.dtype}, not real numbers", "integers or floats in DN"
            raise InputError(problem, file=self.path, field=self.key, expected=expected)
        check_axes(self.shape, self.path)
        check_shape(self.shape if self._fortran else self.shape[-2:], self.path)
        if self._data_start + prod(self.shape) * self.dtype.itemsize > end:
            raise ValueError(f"its header claims the shape {self.shape}, which is more than it holds")
        if not compressed:
            order = "F" if self._fortran else "C"
            self._stored = np.memmap(self.path, self.dtype, "r", self._data_start, self.shape, order)
            opened.close()

    def _bytes(self, offset: int, count: int) -> np.ndarray:
        size = count * self.dtype.itemsize
        try:
            self._handle.seek(self._data_start + offset * self.dtype.itemsize)
            data = self._handle.read(size)
        except Exception as error:  # the decompressors raise many kinds for damaged files
            problem = f"cannot be read ({error}); truncated?"
            raise InputError(problem, file=self.path, field=self.key) from None
        if len(data) < size:
            problem = f"is truncated: {len(data)} of {size} bytes at offset {offset}"
            raise InputError(problem, file=self.path, field=self.key)
        return np.frombuffer(data, dtype=self.dtype)


class ArrayStore:
    """Open array files, those used longest ago closed when they are many, or the decompressed ones grow large together."""

    def __init__(self) -> None:
        self._files: dict[tuple[Path, str | None], ArrayFile | Hdf5File | MatFile] = {}

    def read(self, path: Path, key: str | None, index: Index) -> np.ndarray:
        return self._use(path, key, lambda f: f.read(index))

    def dtype(self, path: Path, key: str | None) -> np.dtype:
        return self._use(path, key, lambda f: f.dtype)

    def _use(self, path: Path, key: str | None, what: Callable):
        name = (path, key)
        file = self._files.pop(name, None) or _open(path, key)
        self._files[name] = file  # the last used stands last
        result = what(file)
        while len(self._files) > 1 and (
            len(self._files) > MOST_OPEN or sum(f.held_bytes for f in self._files.values()) > 2 * WHOLE_BYTES
        ):
            self._files.pop(next(iter(self._files))).close()
        return result


def _open(path: Path, key: str | None) -> ArrayFile | Hdf5File | MatFile:
    if is_old_mat(path):
        return MatFile(path, key)
    return (Hdf5File if path.suffix.lower() in hdf5.SUFFIXES else ArrayFile)(path, key)


def arrays_in(path: Path) -> list[tuple[str, tuple[int, ...], dict[str, Any]]]:
    """Name, shape and attributes of every array of numbers in a .npy, .npz or HDF5 file."""
    if is_old_mat(path):
        return mat_arrays(path)
    if path.suffix.lower() in hdf5.SUFFIXES:
        with hdf5.open_hdf5(path) as held:
            return hdf5.data_sets(held)
    keys = [""]
    if path.suffix.lower() != ".npy":
        with readable(path, "truncated, or not an archive"), zipfile.ZipFile(path) as archive:
            keys = _names_in(archive)
    found = []
    for key in keys:
        file = ArrayFile(path, key or None)
        found.append((key, file.shape, {}))
        file.close()
    return found


def _names_in(archive: zipfile.ZipFile) -> list[str]:
    return [n.removesuffix(".npy") for n in archive.namelist() if n.endswith(".npy")]


def _data_offset(handle: IO[bytes], member: zipfile.ZipInfo) -> int:
    """Where a stored member's bytes begin: behind its local header, whose lengths may differ from the directory's."""
    handle.seek(member.header_offset)
    fields = struct.unpack("<4s5H3I2H", handle.read(30))
    if fields[0] != b"PK\x03\x04":
        raise zipfile.BadZipFile("bad local header")
    return member.header_offset + 30 + fields[-2] + fields[-1]


_checked: set[tuple] = set()  # members whose checksum was right, by file, size, time of change and name


def check_sum(archive: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path) -> None:
    """Refuse a stored member whose bytes do not match its checksum, once for each state of its file: zipfile checks only what it
    reads itself.
    """
    status = path.stat()
    known = (path.resolve(), status.st_size, status.st_mtime_ns, member.filename)
    if known in _checked:
        return
    with archive.open(member) as handle:
        while handle.read(2**20):
            pass
    _checked.add(known)
