"""A set of frames: acquisition conditions, order, and pixels that are read on demand."""

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence, Sized
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.frames import sources
from visaug.frames.checks import check, other_size
from visaug.frames.dark_folder import as_dark
from visaug.frames.record import FrameRecord, Group, group_records
from visaug.frames.stacks import counted_along_the_last_axis, of_which_green_is_read
from visaug.frames.stores import FileStore, MemoryStore, Store
from visaug.frames.table import read_table
from visaug.frames.writers import save


class FrameSet:
    """Frames in order of acquisition. Pixels are read on demand, so a set may be larger than memory.

    Make one with `FrameSet.load` (from disk) or `FrameSet.from_arrays` (in memory). Positions `i` count the records of
    this set from 0; ``records[i].sequence`` is the number in the order of acquisition.

    Attributes:
        records: one record per frame, sorted by ``sequence``.
        warnings: assumptions made while reading, one sentence each.
        loaded_from: the path given to `load`; None for a set made in memory or a part of a set.

    Examples:
        >>> import numpy as np, visaug
        >>> from visaug.frames import FrameRecord
        >>> records = [FrameRecord(sequence=k, file=f"{k}", kind="bias") for k in range(2)]
        >>> visaug.FrameSet.from_arrays(records, np.zeros((2, 8, 8), np.uint16), bit_depth=12)
        FrameSet(2 bias)
    """

    def __init__(
        self,
        records: Sequence[FrameRecord],
        store: Store,
        positions: Sequence[int] | None = None,
        warnings: list[str] | None = None,
    ) -> None:
        positions = range(len(records)) if positions is None else positions
        order = sorted(range(len(records)), key=lambda i: records[i].sequence)
        self.records: tuple[FrameRecord, ...] = tuple(records[i] for i in order)
        self._positions = tuple(positions[i] for i in order)
        self._store = store
        self.warnings: list[str] = store.warnings if warnings is None else warnings
        self._groups: tuple[Group, ...] | None = None
        self.loaded_from: Path | None = None

    @classmethod
    def of(cls, source: "FrameSet | str | Path", resolution: Sequence[int] | None = None) -> "FrameSet":
        """The frame set itself, or the one at a path.

        Raises:
            InputError: neither a frame set nor a path, or one without frames.
        """
        frames = source if isinstance(source, FrameSet) else cls.load(source, resolution)
        if not len(frames):
            raise InputError("there are none", field="frames", expected="at least one frame")
        return frames

    @classmethod
    def load(
        cls,
        path: str | Path,
        resolution: Sequence[int] | None = None,
        bit_depth: int | None = None,
        *,
        byte_order: str | None = None,
        bits_at: str | None = None,
    ) -> "FrameSet":
        """Loads the frame set at `path`. Pixels are read on demand.

        Args:
            path: a folder with frames.csv, an EMVA 1288 descriptor (or its folder), FITS files or pictures.
            resolution: rows and columns of the sensor; required for .raw files.
            bit_depth: bits of the converter, 1 to 32; None uses the depth stated by the files.
            byte_order: ``little`` or ``big`` for .raw files; None determines it from the pixels.
            bits_at: ``top`` or ``bottom``, the position of fewer than 16 bits in 16-bit data; None determines it from the
                pixels.

        Raises:
            InputError: there are no frames at `path`, or their description is not valid.
        """
        if not isinstance(path, str | Path):
            problem, expected = f"{type(path).__name__} is not a frame set", "a FrameSet, or the path of one"
            raise InputError(problem, field="frames", expected=expected)
        path = Path(path)
        kind, root, files = sources.find(path)
        warnings: list[str] = []
        if kind == "table":
            records = counted_along_the_last_axis(read_table(files[0], warnings), root, warnings)
            warnings += of_which_green_is_read(records, root)
        elif kind == "descriptor":
            records, bits, shape = sources.read_descriptor(files[0], warnings)
            bit_depth, resolution = bit_depth or bits, resolution or shape
            warnings.append(
                f"order_assumed: {files[0].name} does not state the order of acquisition; the order of its list is used"
            )
        elif kind == "fits":
            records = sources.read_headed(root, files, warnings)
        elif kind == "named" or path.is_dir():
            named = sources.read_named(root, files, warnings)
            if named is None and kind == "named":
                raise sources.nothing_here(path, len(files))
            records = named or sources.read_pictures(root, files, warnings)
        else:
            records = sources.read_pictures(root, files)
        bit_depth = bit_depth or _common_depth(records)
        store = FileStore(records, root, _pair(resolution), bit_depth, byte_order, bits_at, warnings)
        frames = cls(records, store)
        if kind == "pictures" and (dark := as_dark(frames)):
            frames = frames.with_records(dark)
            warnings.append(
                "exposure_unknown: the names say that these are dark frames, and nothing tells their exposure; what they "
                "collect in it counts as black level and DSNU, and there is no dark current. `visaug frames --exposure` gives it"
            )
        frames.loaded_from = path
        return frames

    @classmethod
    def from_arrays(
        cls,
        records: Sequence[FrameRecord],
        frames: np.ndarray | Sequence[np.ndarray],
        cleans: Mapping[str, np.ndarray] | None = None,
        bit_depth: int | None = None,
    ) -> "FrameSet":
        """Makes a frame set from arrays in memory.

        Args:
            records: one record per frame.
            frames: (n, H, W), or n arrays (H, W), in DN; ``frames[i]`` belongs to ``records[i]``.
            cleans: noiseless targets of scenes in photons per pixel, by the name in ``record.clean``.
            bit_depth: bits of the converter, 1 to 32.

        Raises:
            InputError: the numbers of records and frames differ, or a value is not valid.
        """
        for thing, given in (("records", records), ("frames", frames)):
            if not isinstance(given, Sized):
                raise InputError(f"{given!r} is no sequence", field=thing, expected="one for each frame")
        wrong = next((record for record in records if not isinstance(record, FrameRecord)), None)
        if wrong is not None:
            problem = f"a {type(wrong).__name__} is no record"
            raise InputError(problem, field="records", expected="a visaug.frames.FrameRecord for each frame")
        if len(records) != len(frames):
            problem = f"{len(records)} records but {len(frames)} frames"
            raise InputError(problem, field="frames", expected="equal numbers of records and frames")
        bit_depth = bit_depth or _common_depth(records)
        return cls(records, MemoryStore(records, frames, dict(cleans or {}), bit_depth))

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        kinds = [r.kind for r in self.records]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        return f"FrameSet({counts or 'empty'})"

    @property
    def is_pictures(self) -> bool:
        """Whether there are frames and all are ordinary pictures, of which nothing is known."""
        return bool(self.records) and all(record.kind == "image" for record in self.records)

    @property
    def bit_depth(self) -> int | None:
        """Bits of the converter: as stated, or from the data type (8 or 16); None for floats."""
        return self._store.bit_depth

    @property
    def told_bits(self) -> int | None:
        """Bits of the converter if stated by the caller, a table or a descriptor; else None."""
        return self._store.told_bits

    def read(self, i: int) -> np.ndarray:
        """Reads frame `i` as (H, W) float32 in DN.

        Raises:
            InputError: the file is missing or truncated, a value is NaN, negative or too large, or the size differs from that
                of the set.
        """
        return self._store.read(self._positions[i])

    def read_many(self, indices: Iterable[int]) -> np.ndarray:
        """Reads frames of one size as (n, H, W) float32 in DN."""
        return self.stack(indices).astype(np.float32, copy=False)

    def stack(self, indices: Iterable[int]) -> np.ndarray:
        """The same; uint16 where frames are held in memory as uint16, of which no copy in float32 is made."""
        indices = list(indices)
        if not indices:
            raise InputError("no frames to read", field="indices")
        first = self._store.numbers(self._positions[indices[0]])
        stack = np.empty((len(indices), *first.shape), first.dtype)
        stack[0] = first
        for n, i in enumerate(indices[1:], start=1):
            frame = self._store.numbers(self._positions[i])
            if frame.shape != first.shape:
                whose = f" as {self.records[indices[0]].file}"
                raise other_size(self.records[i].file, frame, first.shape, whose)
            if frame.dtype != stack.dtype:
                stack = stack.astype(np.float32)
            stack[n] = frame
        return stack

    def clean(self, i: int) -> np.ndarray:
        """Noiseless target of scene `i`, (H, W) float32 in photons per pixel, read-only."""
        if self.records[i].clean is None:
            expected = "the file of the scene in photons per pixel, .npy or float TIFF"
            file = self.records[i].file
            raise InputError("has no noiseless target", file=file, field="clean", expected=expected)
        return self._store.clean(self._positions[i])

    def shape(self, i: int) -> tuple[int, int]:
        """Rows and columns of frame `i`."""
        return self._store.shape(self._positions[i])

    def path(self, i: int) -> Path | None:
        """The file of frame `i`; None where the set is in memory."""
        return self._store.path(self._positions[i])

    def groups(self) -> tuple[Group, ...]:
        """Groups of frames taken under equal conditions, in order of first appearance."""
        if self._groups is None:
            self._groups = group_records(self.records)
        return self._groups

    def subset(self, indices: Iterable[int]) -> "FrameSet":
        """Returns the frames at these positions as a new set, in order of acquisition. Pixels are shared."""
        indices = list(indices)
        records, positions = [self.records[i] for i in indices], [self._positions[i] for i in indices]
        return FrameSet(records, self._store, positions, self.warnings)

    def with_records(self, records: Sequence[FrameRecord]) -> "FrameSet":
        """Returns the same pixels with other records, one per frame in the same order."""
        return FrameSet(records, self._store, self._positions, self.warnings)

    def assuming_bits(self, bit_depth: int) -> "FrameSet":
        """Returns the frames with a converter of `bit_depth` bits, if 16-bit files do not state the bit depth."""
        if self.told_bits is not None or self.bit_depth != 16 or bit_depth >= 16:
            return self
        return FrameSet(self.records, self._store.with_bits(bit_depth), self._positions, self.warnings)

    def check(self) -> list[str]:
        """Checks all pixels and returns named warnings (``duplicate_frames: ...``), see `visaug.frames.checks`."""
        return check(self)

    def save(
        self,
        folder: str | Path,
        *,
        keep_names: bool = False,
        overwrite: bool = False,
        beside: Callable[[Path], object] | None = None,
    ) -> Path:
        """Writes frames.csv, the frames and the noiseless targets to a folder, completely or not at all.

        Args:
            folder: the folder to write; it must be empty or not exist unless `overwrite`.
            keep_names: write each frame to the `file` of its record (the suffix selects the format) instead of one
                frames.npz.
            overwrite: replace an existing frame set; files of the folder that it does not name stay.
            beside: called with the folder before it is complete, to add further files.

        Raises:
            InputError: the folder is not empty, or a frame cannot be written in the format of its suffix.
        """
        return save(self, Path(folder), keep_names, overwrite, beside)


def _common_depth(records: Sequence[FrameRecord]) -> int | None:
    """The bit depth that the records give, None where they give none."""
    given = {r.bit_depth: r for r in records if r.bit_depth is not None}
    if len(given) > 1:
        (one, _), (other, record), *_ = given.items()
        problem = f"{other} and {one} bits are mixed in one set"
        expected = "frames of one bit depth; put the others in a separate set"
        raise InputError(problem, file=record.file, field="bit_depth", expected=expected)
    return next(iter(given), None)


def _pair(resolution: Sequence[int] | None) -> tuple[int, int] | None:
    if resolution is None:
        return None
    try:
        rows, columns = (operator.index(n) for n in resolution)
    except (TypeError, ValueError):
        rows = columns = 0
    if min(rows, columns) < 1:
        expected = "rows and columns, as (1024, 1280)"
        raise InputError(f"{resolution!r} is not a size", field="resolution", expected=expected)
    return rows, columns


def simulated_set(
    records: Sequence[FrameRecord],
    frames: Sequence[np.ndarray],
    cleans: dict[str, np.ndarray],
    bit_depth: int,
    in_range: bool,
) -> FrameSet:
    """A frame set of simulated frames, (H, W) uint16, as `FrameSet.from_arrays` makes it.

    Args:
        in_range: the converter came last, so that values need no check; an effect of a user's own may follow it.
    """
    return FrameSet(records, MemoryStore(records, frames, cleans, bit_depth, checked=in_range))
