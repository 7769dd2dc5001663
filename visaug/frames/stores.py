"""Where a set's pixels come from: files read one at a time, or arrays in memory. Both check what they hand out."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from numbers import Integral
from pathlib import Path
from typing import Protocol

import numpy as np

from visaug.core.errors import InputError
from visaug.frames.checks import check_frame, check_values
from visaug.frames.kept import KeptFrames
from visaug.frames.limits import check_numbers
from visaug.frames.pixels import PixelReader, suffix_of
from visaug.frames.raw import BYTE_ORDERS, LAYOUTS, guess_layout, unused_low_bits
from visaug.frames.record import FrameRecord

_FINDING = threading.Lock()
_PROBED = 8  # frames looked at to find where the bits lie


class Store(Protocol):
    """Pixels by position."""

    warnings: list[str]
    told_bits: int | None

    @property
    def bit_depth(self) -> int | None: ...
    def read(self, i: int) -> np.ndarray: ...
    def numbers(self, i: int) -> np.ndarray: ...
    def clean(self, i: int) -> np.ndarray: ...
    def shape(self, i: int) -> tuple[int, int]: ...
    def with_bits(self, bit_depth: int) -> "Store": ...
    def path(self, i: int) -> Path | None: ...


def _check_bits(bit_depth: int | None) -> None:
    if bit_depth is not None and not (isinstance(bit_depth, Integral) and 1 <= bit_depth <= 32):
        problem, expected = f"{bit_depth!r} is out of range", "a whole number of bits, 1 to 32"
        raise InputError(problem, field="bit_depth", expected=expected)


class MemoryStore:
    """Frames in memory. `checked`: they come from a simulated converter, so that each has its size and range."""

    def __init__(
        self,
        records: Sequence[FrameRecord],
        frames: Sequence[np.ndarray] | np.ndarray,
        cleans: dict[str, np.ndarray],
        bit_depth: int | None,
        checked: bool = False,
    ) -> None:
        _check_bits(bit_depth)
        self._records, self._frames = list(records), frames
        self._cleans = {name: np.asarray(c, np.float32) for name, c in cleans.items()}
        self._bit_depth = self.told_bits = bit_depth
        self.warnings: list[str] = []
        self._checked = set(range(len(frames))) if checked else set()

    @property
    def bit_depth(self) -> int | None:
        if self._bit_depth is None and len(self._frames):
            return _bits_of(np.asarray(self._frames[0]).dtype)
        return self._bit_depth

    def read(self, i: int) -> np.ndarray:
        return self.numbers(i).astype(np.float32)

    def numbers(self, i: int) -> np.ndarray:
        """The frame as `read` gives it; uint16 where it is held as such, else float32."""
        frame = np.asarray(self._frames[i])
        name = self._records[i].file
        if frame.ndim != 2:
            raise InputError(f"has shape {frame.shape}", file=name, expected="rows x columns")
        if i not in self._checked:  # statistics read the frames of a set several times
            check_numbers(frame.dtype, name)
            check_values(frame, self.bit_depth, name)
            check_frame(self._records[i], frame)
            self._checked.add(i)
        return frame if frame.dtype == np.uint16 else frame.astype(np.float32)

    def clean(self, i: int) -> np.ndarray:
        name = self._records[i].clean
        if name not in self._cleans:
            raise InputError("is not among the noiseless targets given", file=name, field="clean")
        return self._cleans[name]

    def shape(self, i: int) -> tuple[int, int]:
        shape = np.shape(self._frames[i])
        return shape[0], shape[1]

    def with_bits(self, bit_depth: int) -> "MemoryStore":
        return MemoryStore(self._records, self._frames, self._cleans, bit_depth)

    def path(self, i: int) -> Path | None:
        return None


class FileStore:
    """Frames in files, each read when asked for."""

    def __init__(
        self,
        records: Sequence[FrameRecord],
        root: Path,
        resolution: tuple[int, int] | None,
        bit_depth: int | None,
        byte_order: str | None,
        bits_at: str | None,
        warnings: list[str],
    ) -> None:
        orders, places = ("byte_order", byte_order, tuple(LAYOUTS)), ("bits_at", bits_at, ("top", "bottom"))
        for field, value, choices in (orders, places):
            if value is not None and value not in choices:
                raise InputError(f"{value!r} is unknown", field=field, expected=" or ".join(choices))
        _check_bits(bit_depth)
        self._records, self._root, self._resolution = list(records), root, resolution
        self._bits_at, self._byte_order, self.warnings = bits_at, byte_order, warnings
        self._bit_depth = self.told_bits = bit_depth
        self._reader = PixelReader(root, byte_order or "little")
        self._shift, self._knows_layout = 0, False
        self._shapes: dict[int, tuple[int, int]] = {}
        self._size: tuple[tuple[int, int], str] | None = None
        self._cleans: OrderedDict[str, np.ndarray] = OrderedDict()
        self._kept = KeptFrames()

    @property
    def bit_depth(self) -> int | None:
        if self._bit_depth is None:
            self._find_layout()
        return self._bit_depth

    def read(self, i: int) -> np.ndarray:
        self._find_layout()
        kept = self._kept.read(i)
        if kept is not None:
            return kept.astype(np.float32)
        record = self._records[i]
        pixels = self._stored(i)
        if self._shift and pixels.dtype.kind == "u":
            pixels = pixels >> self._shift
        check_values(pixels, self._bit_depth, self._root / record.file)
        check_frame(record, pixels)
        self._check_size(record, pixels.shape)
        self._shapes[i] = pixels.shape
        if suffix_of(self._reader.path(record.file)) not in (".npy", ".raw"):  # whose pixels need no decoding
            self._kept.keep(i, pixels)
        return pixels.astype(np.float32)

    numbers = read

    def clean(self, i: int) -> np.ndarray:
        name = self._records[i].clean
        assert name is not None
        cleans_kept = 8
        if name not in self._cleans:
            pixels = self._reader.read(name, self._shape_of_raw(self._records[i]))
            check_values(pixels, None, self._root / name)
            # A plan names frames that are not there yet: their size is known by window or sensor, or not.
            size = self._shapes.get(i) or self._shape_of_raw(self._records[i])
            if size is not None and pixels.shape != size:
                expected = "the size of its frame, {} x {}".format(*size)
                problem = "is {} x {}".format(*pixels.shape)
                raise InputError(problem, file=self._root / name, expected=expected)
            self._cleans[name] = pixels.astype(np.float32)
            if len(self._cleans) > cleans_kept:
                self._cleans.popitem(last=False)
        self._cleans.move_to_end(name)
        return self._cleans[name]

    def shape(self, i: int) -> tuple[int, int]:
        if i not in self._shapes:
            self.read(i)
        return self._shapes[i]

    def with_bits(self, bit_depth: int) -> "FileStore":
        how = bit_depth, self._byte_order, self._bits_at, self.warnings
        return FileStore(self._records, self._root, self._resolution, *how)

    def path(self, i: int) -> Path | None:
        return self._reader.path(self._records[i].file)

    def _stored(self, i: int) -> np.ndarray:
        return self._reader.read(self._records[i].file, self._shape_of_raw(self._records[i]))

    def _shape_of_raw(self, record: FrameRecord) -> tuple[int, int] | None:
        return record.window_size or self._resolution

    def _check_size(self, record: FrameRecord, shape: tuple[int, ...]) -> None:
        if record.window is not None or record.kind == "image":
            return
        if self._size is None:
            first = (shape[0], shape[1]), record.file
            self._size = (self._resolution, "the sensor") if self._resolution else first
        size, whose = self._size
        if shape != size:
            problem = f"frames differ in size: this one is {shape[0]} x {shape[1]}"
            expected = f"{size[0]} x {size[1]} as {whose}, or a region that states the window"
            raise InputError(problem, file=self._root / record.file, expected=expected)

    def _find_layout(self) -> None:
        """Once for the set: byte order, bit depth and where the bits lie, from a few frames spread over it."""
        if self._knows_layout:
            return
        with _FINDING:  # another thread would take the layout found so far
            if not self._knows_layout:
                self._look_for_layout()
                self._knows_layout = True

    def _look_for_layout(self) -> None:
        raws = [i for i, r in enumerate(self._records) if r.file.lower().endswith(".raw")]
        if raws and self._byte_order is None:
            spread = np.unique(np.linspace(0, len(raws) - 1, _PROBED).astype(int))
            probes = [self._records[raws[n]] for n in spread]
            votes = [guess_layout(self._root / r.file, self._shape_of_raw(r)) for r in probes]
            self._byte_order = self._reader.layout = max(dict.fromkeys(votes), key=votes.count)
            word, why = "packing", ", by their size and because neighbouring pixels are more similar so"
            if self._byte_order in BYTE_ORDERS:
                word, why = "byte_order", " endian, in which neighbouring pixels are more similar"
            self.warnings.append(f"{word}_assumed: .raw files are read as {self._byte_order}{why}")
        packed_bits = LAYOUTS[self._reader.layout].bits if raws else 16
        if packed_bits < 16 and self._bit_depth is None:
            self._bit_depth = packed_bits
        dtype = self._reader.dtype(self._records[0].file)
        if dtype is None:
            dtype = self._stored(0).dtype
        deep = dtype.kind == "u" and dtype.itemsize == 2 and packed_bits == 16
        unclear = (raws and self._bit_depth is None) or (deep and self._bit_depth not in (None, 16))
        if deep and (self._bits_at == "top" or (self._bits_at is None and unclear)):
            self._find_shift()
        if self._bit_depth is None:
            self._bit_depth = self._reader.bits(self._records[0].file) or _bits_of(dtype)

    def _find_shift(self) -> None:
        """Bits at the top of 16 leave the low bits 0 in every pixel."""

        def likely_level(i: int) -> tuple[int, float]:
            record = self._records[i]
            level = ("bias", "dark", "image", "scene", "flat").index(record.kind)
            return level, record.photons or record.exposure_s

        order = sorted(range(len(self._records)), key=likely_level)
        darkest, brightest = order[: _PROBED // 2], order[-_PROBED // 2 :]
        low = min(unused_low_bits(self._stored(i)) for i in (*brightest, *darkest))
        largest = max(float(self._stored(i).max()) for i in brightest)
        if self._bit_depth is not None:
            shift = 16 - self._bit_depth
            if self._bits_at == "top" or (low >= shift and largest > (1 << self._bit_depth) - 1):
                self._shift = shift
        elif low in (2, 4, 6):  # converters have 10, 12 or 14 bits
            self._shift, self._bit_depth = low, 16 - low
        if self._shift and self._bits_at is None:
            self.warnings.append(
                f"bits_at_top_assumed: the lowest {self._shift} of 16 bits are 0 in all frames looked "
                f"at; read as {self._bit_depth}-bit values at the top"
            )


def _bits_of(dtype: np.dtype) -> int | None:
    return 8 * dtype.itemsize if dtype.kind == "u" and dtype.itemsize <= 2 else None
