"""Folders that describe their frames in their own way: EMVA 1288 descriptors, FITS headers, plain pictures."""

import re
import shlex
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
_LABORATORY = {"bias", "dark", "flat"}
_PLAIN = (*PICTURES, *TIFFS, *PHOTOS, ".npy", ".raw")  # formats of ordinary pictures
_VIDEO = "frames as the sensor gave them: SER, FITS, TIFF or PNG of 16 bits; video is compressed and has a tone curve"
_OTHERS = (".heic", ".heif", ".webp", ".gif", ".jp2", ".czi", ".nd2", ".lif", ".sif", ".spe")
# Formats that are not read, and what to write instead.
_FOREIGN = dict.fromkeys(_OTHERS, "TIFF, PNG or FITS")
_FOREIGN |= dict.fromkeys((".avi", ".mp4", ".mov", ".mkv"), _VIDEO)


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
                file = PureWindowsPath(rest.strip()).as_posix()  # as the standard's own data sets write paths
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
            problem, field = f"{line.strip()!r} cannot be understood", f"line {number}"
            expected = "'n bits width height', 'b exposure photons', 'd exposure' or 'i image'"
            raise InputError(problem, file=path, field=field, expected=expected) from None
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

    def stem_of(file: Path) -> Path:
        suffix = suffix_of(file)  # of two parts, or in capitals in the name
        return file.with_name(file.name.removesuffix(suffix) if file.name.endswith(suffix) else file.stem)

    stems = {stem_of(f) for f in files if suffix_of(f) in HEADED}

    def counts(file: Path) -> bool:
        if suffix_of(file) in HEADED:
            return True
        is_preview = stem_of(file) in stems or suffix_of(file) in (".jpg", ".jpeg", ".bmp")
        return not is_preview and kind_of_name(file.relative_to(folder).as_posix()) in _LABORATORY

    return _surveyed(folder, [f for f in files if counts(f)], warnings)


def _surveyed(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord]:
    """Records of the files; a file below the folder that says no kind or exposure is left out."""
    found = survey(folder, files=files)
    lacking = [*found.missing("kind"), *found.missing("exposure_s")]
    unknown = [row for row in lacking if "/" in split_name(row["file"])[0]]
    used = set(files)
    if len(unknown) < len(found.rows):
        found.rows = [r for r in found.rows if not any(r is u for u in unknown)]
        used -= {folder / split_name(r["file"])[0] for r in unknown}
    warnings += _left_out(folder, used)
    # Other notes ask for what a table lacks.
    asks = ("kind", "exposure_s", "temperature_c", "photons", "bit_depth", "descriptor")
    warnings += [note for note in found.notes if note.split(":")[0] not in asks]
    return found.records()


def read_named(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord] | None:
    """Records of pictures that a laboratory named (``bias_000.tif``, ``darks/dark_2s_20C_003.tif``): a bias frame is among them, or
    dark frames and flats. None where the names are those of ordinary pictures.

    Those in the folder itself are looked at alone where the whole tree holds more of other pictures.
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
        held = frames_of(file) if suffix_of(file) in (".npz", *HDF5) else [("", {})]
        kinds += [facts.get("kind") or by_name for _, facts in held]
    named = sum(kind in _LABORATORY for kind in kinds)
    return ("bias" in kinds or {"dark", "flat"} <= set(kinds)) and 2 * named > len(kinds)


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
        suffix = path.suffix.lower()
        kind = {".csv": "table", ".txt": "descriptor"}.get(suffix)
        if kind or suffix_of(path) in SUFFIXES:
            return kind or "pictures", path.parent, [path]
        expected = _FOREIGN.get(suffix, f"a folder, a frames.csv, an {DESCRIPTOR} or a picture")
        raise InputError("is not a frame set", file=path, expected=expected)
    if not path.is_dir():
        raise InputError("no such file or folder", file=path)
    for kind, name in (("table", "frames.csv"), ("descriptor", DESCRIPTOR)):
        if (path / name).is_file():
            return kind, path, [path / name]

    def is_of_its_own(file: Path) -> bool:
        """Whether a file belongs to a set in a subfolder, which has a description of its own."""
        folders = [path / p for p in file.relative_to(path).parents if p.name]
        return any((folder / name).is_file() for folder in folders for name in ("frames.csv", DESCRIPTOR))

    below = [f for f in frame_files(path) if not is_of_its_own(f)]
    top = {suffix_of(f) for f in below if f.parent == path}
    for kind, suffixes in (("fits", HEADED), ("pictures", _PLAIN), ("named", (*ARRAYS, *HDF5, ".ser"))):
        if top & {*suffixes}:
            return kind, path, below
    if any(kind_of_name(f.relative_to(path).as_posix()) in _LABORATORY for f in below):
        return ("fits" if all(suffix_of(f) in HEADED for f in below) else "named"), path, below
    raise nothing_here(path, len(below))


def _left_out(folder: Path, used: set[Path]) -> list[str]:
    """A warning that names the files in and below a folder that may hold frames and are not looked at; empty for none."""
    found = [f for f in frame_files(folder) if f not in used]
    found += [f for f in sorted(folder.rglob("*")) if f.suffix.lower() in _FOREIGN and f.is_file()]
    count, listed = len(found), first_of(f.relative_to(folder).as_posix() for f in found)
    said = f"files_left_out: {count} files in or below the folder are not read ({listed}); `visaug frames` lists what each tells, "
    return [f"{said}and a frames.csv decides"] if found else []


def nothing_here(folder: Path, below: int) -> InputError:
    """The error for a folder without frames; `below` is the number of files in or below it that may contain some."""
    for file in sorted(folder.rglob("*")):
        if not below and (instead := _FOREIGN.get(file.suffix.lower())):
            return InputError("is no format that can be read", file=file, expected=instead)
    if not below:
        expected = f"frames.csv, {DESCRIPTOR}, or files of the kinds {' '.join(SUFFIXES)}"
        return InputError("holds no frames", file=folder, expected=expected)
    command = shlex.join(["visaug", "frames", str(folder), "-o", str(folder / "frames.csv")])
    problem = f"does not describe its frames; {below} files may contain some"
    expected = f"frames.csv (`{command}` writes one), or folders named bias, dark and flat"
    return InputError(problem, file=folder, expected=expected)
