"""Folders that describe their frames in their own way: EMVA 1288 descriptors, FITS headers, plain
pictures.
"""

from __future__ import annotations

import re
from pathlib import Path, PureWindowsPath

from visaug.core.errors import InputError
from visaug.core.wording import first_of
from visaug.frames.headers import frames_of
from visaug.frames.names import kind_of_name
from visaug.frames.pixels import ARRAYS, FITS, HDF5, PHOTOS, PICTURES, SUFFIXES, TIFFS, split_name, suffix_of
from visaug.frames.record import FrameRecord
from visaug.frames.survey import DESCRIPTOR, frame_files, survey
from visaug.frames.units import number_or_none

HEADED = (*FITS, ".xisf")  # formats whose headers tell the conditions
_LABORATORY = ("bias", "dark", "flat")
_PLAIN = (*PICTURES, *TIFFS, *PHOTOS, ".npy", ".raw")  # formats of ordinary pictures
_PREVIEWS = (".jpg", ".jpeg", ".bmp")
_VIDEO = "frames as the sensor gave them: SER, FITS, TIFF or PNG of 16 bits; video is compressed and has a tone curve"
_FOREIGN: dict[str, str] = {}  # formats that are not read, and what to write instead
_FOREIGN.update(dict.fromkeys((".avi", ".mp4", ".mov", ".mkv"), _VIDEO))
_FOREIGN.update(
    dict.fromkeys(
        (".heic", ".heif", ".webp", ".gif", ".jp2", ".czi", ".nd2", ".lif", ".sif", ".spe"),
        "TIFF, PNG or FITS",
    )
)
# Notes of a survey that ask for what a table lacks.
_ASKS = ("kind", "exposure_s", "temperature_c", "photons", "bit_depth", "descriptor")


def read_descriptor(
    path: Path, warnings: list[str] | None = None
) -> tuple[list[FrameRecord], int, tuple[int, int]]:
    """Records, bit depth and (rows, columns) of an EMVA 1288 descriptor file.

    Lines: ``n bits width height``, ``b exposure_ns photons`` (bright), ``d exposure_ns`` (dark), ``i image``.
    Temperature is not told there.
    """
    records: list[FrameRecord] = []
    bits, shape, state = 0, None, None
    unknown: list[str] = []
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"cannot be read ({error})", file=path) from None
    for number, line in enumerate(lines, start=1):
        word, _, rest = line.strip().partition(" ")
        if not word or word.startswith("#") or word == "v":
            continue
        try:
            if word == "n":
                bits, width, height = (int(v) for v in rest.split()[:3])
                shape = (height, width)
            elif word == "b":
                exposure_ns, photons = (float(v) for v in rest.split()[:2])
                state = ("flat", exposure_ns * 1e-9, photons)
            elif word == "d":
                state = ("dark", float(rest.split()[0]) * 1e-9, None)
            elif word == "i" and state is not None:
                kind, exposure_s, photons = state
                # The standard's own data sets write Windows paths.
                file = PureWindowsPath(rest.strip()).as_posix()
                # 1e-9 leaves a rounding of 1e-17 that would part equal exposures.
                records.append(FrameRecord(len(records), file, kind, round(exposure_s, 12), photons=photons))
            elif word == "i" and unknown:
                continue
            elif re.fullmatch("[a-z]{1,3}", word) and None not in map(number_or_none, rest.split()):
                # of a later release: its images are of a kind that is not known here
                unknown.append(line.strip())
                state = None
            else:
                raise ValueError
        except (ValueError, IndexError):
            raise InputError(
                f"{line.strip()!r} cannot be understood",
                file=path,
                field=f"line {number}",
                expected="'n bits width height', 'b exposure photons', 'd exposure' or 'i image'",
            ) from None
    if shape is None or not records:
        raise InputError("has no 'n' line or no image", file=path, expected="an EMVA 1288 descriptor")
    if unknown and warnings is not None:
        warnings.append(
            f"descriptor_lines_ignored: {path.name} has lines that are not known ({'; '.join(unknown[:6])}); the images under "
            "them are not read"
        )
    return records, bits, shape


def read_headed(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord]:
    """Records of files with headers (IMAGETYP or OBSTYPE, EXPTIME, CCD-TEMP, GAIN, ...), their folders' names where a
    header is silent, by DATE-OBS or name.

    Other files beside them count where their names say bias, dark or flat and they are no preview of one with a header.
    """
    stems = {_stem_of(f) for f in files if suffix_of(f) in HEADED}

    def counts(file: Path) -> bool:
        if suffix_of(file) in HEADED:
            return True
        kind = kind_of_name(file.relative_to(folder).as_posix())
        return kind in _LABORATORY and _stem_of(file) not in stems and suffix_of(file) not in _PREVIEWS

    return _surveyed(folder, [f for f in files if counts(f)], warnings)


def _stem_of(file: Path) -> Path:
    return file.with_name(
        file.name.removesuffix(suffix_of(file)) if file.name.endswith(suffix_of(file)) else file.stem
    )


def _surveyed(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord]:
    """Records of the files; a file below the folder that says no kind or exposure is left out."""
    found = survey(folder, files=files)
    unknown = [
        r
        for name in ("kind", "exposure_s")
        for r in found.missing(name)
        if "/" in r["file"].partition("#")[0]
    ]
    used = set(files)
    if len(unknown) < len(found.rows):
        found.rows = [r for r in found.rows if not any(r is u for u in unknown)]
        used -= {folder / split_name(r["file"])[0] for r in unknown}
    warnings += _left_out(folder, used)
    warnings += [note for note in found.notes if note.split(":")[0] not in _ASKS]
    return found.records()


def read_named(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord] | None:
    """Records of pictures that a laboratory named (``bias_000.tif``, ``darks/dark_2s_20C_003.tif``); None where the
    names are those of ordinary pictures.

    Frames of a laboratory are those among which a bias frame is named, or dark frames and flats; those in the folder
    itself are looked at alone where the whole tree holds more of other pictures.
    """
    for chosen in (files, [f for f in files if f.parent == folder]):
        if chosen and _is_laboratory(folder, chosen):
            warnings.append(
                "read_from_names: kinds and exposures are taken from headers and file names; `visaug frames` shows them"
            )
            return _surveyed(folder, chosen, warnings)
    return None


def _is_laboratory(folder: Path, files: list[Path]) -> bool:
    kinds: list[str | None] = []
    for file in files:
        by_name = kind_of_name(file.relative_to(folder).as_posix())
        if suffix_of(file) in (".npz", *HDF5):
            kinds += [facts.get("kind") or by_name for _, facts in frames_of(file)]
        else:
            kinds.append(by_name)
    named = sum(kind in _LABORATORY for kind in kinds)
    return ({"bias"} <= set(kinds) or {"dark", "flat"} <= set(kinds)) and 2 * named > len(kinds)


def read_pictures(folder: Path, files: list[Path], warnings: list[str] | None = None) -> list[FrameRecord]:
    """Plain pictures, of which nothing is known, by name; those of subfolders are named in `warnings`."""
    records = []
    alone = files if len(files) == 1 else [f for f in files if f.parent == folder and suffix_of(f) in _PLAIN]
    for n, file in enumerate(sorted(alone)):
        facts = frames_of(file)[0][1] if suffix_of(file) in PHOTOS else {}
        known = {name: facts[name] for name in ("bayer", "bit_depth") if facts.get(name)}
        records.append(FrameRecord(n, file.relative_to(folder).as_posix(), "image", **known))
    if warnings is not None:
        warnings += _left_out(folder, set(alone))
    return records


def find(path: Path) -> tuple[str, Path, list[Path]]:
    """What lies at `path` (``table``, ``descriptor``, ``fits``, ``pictures``), its folder, the files meant.

    frames.csv wins over a descriptor, a descriptor over headers, these over plain pictures.
    """
    if path.is_file():
        if path.suffix.lower() == ".csv":
            return "table", path.parent, [path]
        if path.suffix.lower() == ".txt":
            return "descriptor", path.parent, [path]
        if suffix_of(path) in SUFFIXES:
            return "pictures", path.parent, [path]
        raise InputError(
            "is not a frame set",
            file=path,
            expected=_FOREIGN.get(
                path.suffix.lower(), f"a folder, a frames.csv, an {DESCRIPTOR} or a picture"
            ),
        )
    if not path.is_dir():
        raise InputError("no such file or folder", file=path)
    for kind, name in (("table", "frames.csv"), ("descriptor", DESCRIPTOR)):
        if (path / name).is_file():
            return kind, path, [path / name]
    below = [f for f in frame_files(path) if not _is_of_its_own(f, path)]
    top = [f for f in below if f.parent == path]
    for kind, suffixes in (
        ("fits", HEADED),
        ("pictures", _PLAIN),
        ("named", (*ARRAYS, *HDF5, ".ser")),
    ):
        if any(suffix_of(f) in suffixes for f in top):
            return kind, path, below
    kinds = {kind_of_name(f.relative_to(path).as_posix()) for f in below}
    if kinds & {"bias", "dark", "flat"}:
        return ("fits" if all(suffix_of(f) in HEADED for f in below) else "named"), path, below
    raise nothing_here(path, len(below))


def _is_of_its_own(file: Path, folder: Path) -> bool:
    """Whether a file belongs to a set in a subfolder, which has a description of its own."""
    between = file.relative_to(folder).parents
    return any(
        (folder / p / name).is_file() for p in between if p.name for name in ("frames.csv", DESCRIPTOR)
    )


def _left_out(folder: Path, used: set[Path]) -> list[str]:
    """A warning that names the files in and below a folder that may hold frames and are not looked at; empty for none."""
    found = [f for f in frame_files(folder) if f not in used]
    foreign = [f for f in sorted(folder.rglob("*")) if f.suffix.lower() in _FOREIGN and f.is_file()]
    if not (found := [*found, *foreign]):
        return []
    listed = first_of((f.relative_to(folder).as_posix() for f in found), 6)
    said = (
        f"files_left_out: {len(found)} files in or below the folder are not read ({listed}); `visaug frames` lists what "
        "each tells, and a frames.csv decides"
    )
    return [said]


def nothing_here(folder: Path, below: int) -> InputError:
    """The error for a folder without frames; `below` is the number of files in or below it that may contain some."""
    for file in sorted(folder.rglob("*")):
        if not below and file.suffix.lower() in _FOREIGN:
            return InputError(
                "is no format that can be read", file=file, expected=_FOREIGN[file.suffix.lower()]
            )
    return InputError(
        "holds no frames" if not below else f"does not describe its frames; {below} files may contain some",
        file=folder,
        expected=f"frames.csv (`visaug frames {folder} -o {folder / 'frames.csv'}` writes one), {DESCRIPTOR}, FITS "
        f"files, pictures ({' '.join(SUFFIXES)}), or folders named bias, dark and flat",
    )
