"""Frame sets on disk: written beside their place and renamed, so a broken run leaves nothing half done."""

import os
import shutil
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, count
from math import prod
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.core.files import check_folder, whole_folder
from visaug.frames.pixels import split_name
from visaug.frames.table import read_table, write_table

if TYPE_CHECKING:
    from visaug.frames.frameset import FrameSet
    from visaug.frames.record import FrameRecord

SUFFIXES = (".npy", ".npz", ".tif", ".tiff", ".fits", ".fit", ".fts", ".png", ".raw")
_FORMATS = ".npy, .npz, .tif or .fits; .png and .raw for whole DN of 16 bits"


def save(
    frames: "FrameSet", folder: Path, keep_names: bool, overwrite: bool, beside: Callable | None
) -> Path:
    """Write a set to `folder`; see `FrameSet.save`."""
    if overwrite:
        check_output(folder)
    with whole_folder(folder, overwrite) as temporary:
        cleans = _write_cleans(frames, temporary)
        # 8 and 16 bits show in the files; what lies between does not.
        bits = None if frames.bit_depth in (8, 16) else frames.bit_depth
        records = [replace(r, clean=cleans.get(r.clean or ""), bit_depth=bits) for r in frames.records]
        if keep_names:
            _write_named(frames, temporary)
        else:
            files = _write_archive(frames, temporary / "frames.npz")
            records = [replace(r, file=file) for r, file in zip(records, files, strict=True)]
        write_table(temporary / "frames.csv", records)
        if beside is not None:
            beside(temporary)
        if overwrite and folder.is_dir():
            _take_along(folder, temporary)
    return folder


def check_output(folder: Path) -> None:
    """Refuse a folder that cannot be made, or holds something and no frame set that can be replaced."""
    check_folder(folder)
    if folder.is_dir() and any(folder.iterdir()) and not (folder / "frames.csv").is_file():
        problem = "holds no frame set that can be replaced"
        raise InputError(problem, file=folder, expected="a new or empty folder")


def _take_along(folder: Path, temporary: Path) -> None:
    """Into the folder that takes its place: all files but those of the frame set that is replaced."""
    replaced = {"frames.csv", "camera.yaml"}
    try:
        for record in read_table(folder / "frames.csv", []):
            replaced |= {split_name(name)[0] for name in (record.file, record.clean) if name}
    except InputError:  # no table, or a plan that cannot be read: what it names is not known
        pass
    folder = Path(os.path.realpath(folder))
    for file in folder.rglob("*"):
        if temporary in (file, *file.parents):  # which may lie inside
            continue
        place = file.relative_to(folder)
        new = temporary / place
        if place.as_posix() in replaced or new.exists() or not (file.is_symlink() or file.is_file()):
            continue
        new.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(file, new)
        except OSError:  # a link, or a file system without hard links
            shutil.copy2(file, new, follow_symlinks=False)


def _write_archive(frames: "FrameSet", path: Path) -> list[str]:
    """All frames into one .npz, an array for each size, one frame in memory at a time; returns their names."""
    shapes = [frames.shape(i) for i in range(len(frames))]
    names = [""] * len(frames)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for n, shape in enumerate(dict.fromkeys(shapes)):
            key = "frames" if n == 0 else f"frames_{n}"
            members = [i for i, s in enumerate(shapes) if s == shape]
            dtype = _smallest_type(frames, members)
            head = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False}
            with archive.open(f"{key}.npy", "w", force_zip64=True) as handle:
                np.lib.format.write_array_header_2_0(handle, head | {"shape": (len(members), *shape)})
                for k, i in enumerate(members):
                    handle.write(np.ascontiguousarray(frames.read(i).astype(dtype)).tobytes())
                    names[i] = f"{path.name}#{key}[{k}]"
    return names


def _smallest_type(frames: "FrameSet", indices: Iterable[int]) -> np.dtype:
    """uint8 or uint16 where that loses nothing, else float32."""
    if frames.bit_depth is not None and frames.bit_depth <= 16:
        return np.dtype(np.uint8 if frames.bit_depth <= 8 else np.uint16)
    largest = 0.0
    for i in indices:
        frame = frames.read(i)
        largest = max(largest, float(frame.max()))
        if largest > 65535 or not (frame == np.rint(frame)).all():
            return np.dtype(np.float32)
    return np.dtype(np.uint8 if largest <= 255 else np.uint16)


def _write_cleans(frames: "FrameSet", folder: Path) -> dict[str, str]:
    """Noiseless targets as .npy; returns the new name of each."""
    names: dict[str, str] = {}
    files = {PurePosixPath(split_name(r.file)[0]) for r in frames.records}
    taken = {str(path) for file in files for path in (file, *file.parents)} | {"frames.npz"}
    for i, record in enumerate(frames.records):
        if record.clean and record.clean not in names:
            stem = PurePosixPath(split_name(record.clean)[0]).stem or "clean"
            numbered = (f"clean_{stem}_{n}.npy" for n in count(2))
            name = next(n for n in chain([f"{stem}.npy", f"clean_{stem}.npy"], numbered) if n not in taken)
            taken.add(name)
            np.save(folder / name, frames.clean(i))
            names[record.clean] = name
    return names


def _write_named(frames: "FrameSet", folder: Path) -> None:
    """Every frame under its record's own name; frames of one archive are put together at the end of it."""
    parts = places(frames.records)
    stacks: dict[str, list[int]] = {}
    for i, (file, _, index) in enumerate(parts):
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix.lower() == ".npz" or index:
            stacks.setdefault(file, []).append(i)
        else:
            write_frame(path, frames.read(i), _smallest_type(frames, [i]), frames.records[i].file)
    for file, members in stacks.items():
        _write_stack(frames, folder / file, {i: parts[i][1:] for i in members})


def places(records: "Sequence[FrameRecord]") -> list[tuple[str, str | None, tuple[int, ...]]]:
    """File, key and index of each frame, no two of which are the same place or in each other's way."""
    found: list[tuple[str, str | None, tuple[int, ...]]] = []
    files: dict[str, bool] = {}  # whether it holds several frames

    def check(allowed: bool, record: "FrameRecord", problem: str, expected: str) -> None:
        if not allowed:
            raise InputError(f"{record.file!r} {problem}", field="file", expected=expected)

    for record in records:
        file, key, index = split_name(record.file)
        path = PurePosixPath(file)
        file = str(path)  # without ./ and //
        inside = not path.is_absolute() and ".." not in path.parts
        inside = inside and file not in (".", "frames.csv", "camera.yaml")
        check(inside, record, "cannot be written", "a path inside the folder")
        is_known = path.suffix.lower() in SUFFIXES
        check(is_known, record, "cannot be written", f"a name that ends in {_FORMATS}")
        numbers = tuple(n for n in index if isinstance(n, int))
        check(len(numbers) == len(index), record, "cannot be written", "frames along the first axis")
        archive = path.suffix.lower() == ".npz"
        expected = "file.npz#key[index]" if archive else "a key in .npz alone"
        check(archive == bool(key), record, "names no array", expected)
        several = archive or bool(index)
        same = files.setdefault(file, several) == several
        expected = "an index for each frame, or one file per frame"
        check(same, record, "is used for one frame and for several", expected)
        found.append((file, key, numbers))
    seen: set[tuple] = set()
    for record, place in zip(records, found, strict=True):
        check(place not in seen, record, "names several frames", "a name for each frame")
        seen.add(place)
        for above in PurePosixPath(place[0]).parents:
            if str(above) in files or str(above) in ("frames.csv", "camera.yaml"):
                raise InputError(f"{above} is a file and a folder", file=record.file, field="file")
    return found


def _write_stack(
    frames: "FrameSet", path: Path, parts: dict[int, tuple[str | None, tuple[int, ...]]]
) -> None:
    dtype = _smallest_type(frames, parts)
    arrays: dict[str | None, np.ndarray] = {}
    most_gaps = 100  # places of an array for each frame of it that is there
    for key in {key for key, _ in parts.values()}:
        members = {i: index for i, (k, index) in parts.items() if k == key}
        lengths = {len(index) for index in members.values()}
        shapes = {frames.shape(i) for i in members}
        if len(lengths) > 1 or len(shapes) > 1:
            problem = "frames of different sizes or index depths share one array"
            raise InputError(problem, file=path.name, field=key)
        outer = tuple(max(n) + 1 for n in zip(*members.values()))
        if prod(outer) > most_gaps * len(members):
            problem = f"an array of {' x '.join(map(str, outer))} frames for {len(members)} of them"
            expected = "indices from 0 without large gaps"
            raise InputError(problem, file=path.name, field=key, expected=expected)
        array = np.zeros((*outer, *shapes.pop()), dtype)
        for i, index in members.items():
            array[index] = frames.read(i)
        arrays[key] = array
    if path.suffix.lower() == ".npz":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for key, array in arrays.items():
                with archive.open(f"{key}.npy", "w", force_zip64=True) as handle:
                    np.lib.format.write_array(handle, array, allow_pickle=False)
    else:
        write_frame(path, arrays[None], dtype, path.name)


def write_frame(
    path: Path,
    pixels: np.ndarray,
    dtype: np.dtype | None = None,
    name: str | None = None,
    cards: Mapping[str, str | float] | None = None,
) -> None:
    """One frame (or stack) in the format of the suffix: .npy, TIFF, PNG, FITS or .raw (16 bit, little endian). Errors call it
    `name`, where `path` is a temporary one. `cards` are of a FITS header.
    """
    suffix = path.suffix.lower()
    stored = pixels.astype(dtype or pixels.dtype)
    if suffix == ".npy":
        np.save(path, stored)
    elif suffix in (".tif", ".tiff"):
        with extra(path):
            import tifffile

        tifffile.imwrite(path, stored, photometric="minisblack")
    elif suffix in (".fits", ".fit", ".fts"):
        with extra(path):
            from astropy.io import fits

        fits.PrimaryHDU(stored, fits.Header(dict(cards or {}))).writeto(path, overwrite=True)
    elif suffix == ".png" and stored.dtype.kind == "u":
        from PIL import Image

        Image.fromarray(stored).save(path)
    elif suffix == ".raw" and stored.dtype.kind == "u":
        stored.astype("<u2").tofile(path)
    else:
        problem = f"{stored.dtype} pixels cannot be written as {suffix or 'a file without suffix'}"
        raise InputError(problem, file=name or path, expected=_FORMATS)
