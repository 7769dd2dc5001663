"""Decoded frames, kept in a temporary file: a set is read several times, and a compressed one is decoded once."""

import math
import os
import tempfile
import threading
from typing import IO
from weakref import WeakSet

import numpy as np

from visaug.core.files import cache_folder

LARGEST = 2**30  # bytes of frames that are kept; further ones are decoded at each reading
MOST_OPEN = 16  # sets that keep frames at a time: each has a file open


class KeptFrames:
    """Frames as they were decoded, by number, in a file without a name that goes with this object.

    The system keeps in memory what there is room for. Where no temporary file can be written, nothing is kept; and a process
    forked from that which began the file reads what is in it and adds nothing.
    """

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None
        self._owner, self._lock = os.getpid(), threading.Lock()
        self._places: dict[int, tuple[int, tuple[int, ...], np.dtype]] = {}
        self._size = 0

    def keep(self, i: int, frame: np.ndarray) -> None:
        if os.getpid() != self._owner or not hasattr(os, "pread"):
            return
        with self._lock:
            is_open = self._file is not None or len(_open) < MOST_OPEN
            if is_open and self._size + frame.nbytes <= LARGEST and i not in self._places:
                self._write(i, frame)

    def _write(self, i: int, frame: np.ndarray) -> None:
        try:
            if self._file is None:
                folder = cache_folder()  # a folder for temporary files is often memory
                folder.mkdir(parents=True, exist_ok=True)
                self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - kept open
            _open.add(self)
            at, self._size = self._size, self._size + frame.nbytes
            if os.pwrite(self._file.fileno(), np.ascontiguousarray(frame).tobytes(), at) == frame.nbytes:
                self._places[i] = at, frame.shape, frame.dtype
        except (OSError, RuntimeError):  # the disk is full, or there is no home
            self._size = LARGEST

    def read(self, i: int) -> np.ndarray | None:
        """The frame; None if it is not kept."""
        if i not in self._places or self._file is None:
            return None
        at, shape, dtype = self._places[i]
        size = math.prod(shape) * dtype.itemsize
        content = os.pread(self._file.fileno(), size, at)
        return np.frombuffer(content, dtype).reshape(shape) if len(content) == size else None

    def __reduce__(self) -> tuple:
        return KeptFrames, ()  # a copy in another process begins with nothing


_open: WeakSet[KeptFrames] = WeakSet()
