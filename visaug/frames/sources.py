"""Folders that describe their frames in their own way: EMVA 1288 descriptors, FITS headers, plain
pictures.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

from visaug.core.errors import InputError
from visaug.frames.headers import frames_of
from visaug.frames.names import facts_of_name
from visaug.frames.pixels import ARRAYS, FITS, HDF5, PHOTOS, PICTURES, SUFFIXES, TIFFS, suffix_of
from visaug.frames.record import FrameRecord
from visaug.frames.survey import DESCRIPTOR, frame_files, survey

_ASKS = (
    "kind",
    "exposure_s",
    "temperature_c",
    "photons",
    "bit_depth",
    "descriptor",
)  # notes that ask for what a table lacks


def read_descriptor(path: Path) -> tuple[list[FrameRecord], int, tuple[int, int]]:
    """Records, bit depth and (rows, columns) of an EMVA 1288 descriptor file.

    Lines: ``n bits width height``, ``b exposure_ns photons`` (bright), ``d exposure_ns`` (dark), ``i image``.
    Temperature is not told there.
    """
    records: list[FrameRecord] = []
    bits, shape, state = 0, None, None
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
    return records, bits, shape


def read_fits_folder(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord]:
    """Records of FITS files by their headers (IMAGETYP or OBSTYPE, EXPTIME, CCD-TEMP, GAIN, ...), their folders'
    names where a header is silent, by DATE-OBS or name.
    """
    found = survey(folder, files=files)
    warnings += [note for note in found.notes if note.split(":")[0] not in _ASKS]
    return found.records()


def read_named(folder: Path, files: list[Path], warnings: list[str]) -> list[FrameRecord] | None:
    """Records of pictures that a laboratory named (``bias_000.tif``, ``darks/dark_2s_20C_003.tif``); None where the
    names are those of ordinary pictures.

    Frames of a laboratory are those among which a bias frame is named, or dark frames and flats.
    """
    kinds: list[str | None] = []
    for file in files:
        by_name = facts_of_name(file.relative_to(folder).as_posix()).get("kind")
        if suffix_of(file) in (".npz", *HDF5):
            kinds += [facts.get("kind") or by_name for _, facts in frames_of(file)]
        else:
            kinds.append(by_name)
    named = sum(kind in ("bias", "dark", "flat") for kind in kinds)
    if not ({"bias"} <= set(kinds) or {"dark", "flat"} <= set(kinds)) or 2 * named <= len(kinds):
        return None
    found = survey(folder, files=files)
    records = found.records()
    warnings.append(
        "read_from_names: kinds and exposures are taken from headers and file names; `visaug frames` shows them"
    )
    warnings += [note for note in found.notes if note.split(":")[0] not in _ASKS]
    return records


def read_pictures(folder: Path, files: list[Path]) -> list[FrameRecord]:
    """Plain pictures, of which nothing is known, by name."""
    records = []
    for n, file in enumerate(sorted(files)):
        facts = frames_of(file)[0][1] if suffix_of(file) in PHOTOS else {}
        known = {name: facts[name] for name in ("bayer", "bit_depth") if facts.get(name)}
        records.append(FrameRecord(n, file.relative_to(folder).as_posix(), "image", **known))
    return records


def find(path: Path) -> tuple[str, Path, list[Path]]:
    """What lies at `path` (``table``, ``descriptor``, ``fits``, ``pictures``), its folder, the files meant.

    frames.csv wins over a descriptor, a descriptor over FITS headers, these over plain pictures.
    """
    if path.is_file():
        if path.suffix.lower() == ".csv":
            return "table", path.parent, [path]
        if path.suffix.lower() == ".txt":
            return "descriptor", path.parent, [path]
        if suffix_of(path) in SUFFIXES:
            return "pictures", path.parent, [path]
        raise InputError(
            "is not a frame set", file=path, expected=f"a folder, a frames.csv, an {DESCRIPTOR} or a picture"
        )
    if not path.is_dir():
        raise InputError("no such file or folder", file=path)
    for kind, name in (("table", "frames.csv"), ("descriptor", DESCRIPTOR)):
        if (path / name).is_file():
            return kind, path, [path / name]
    files = sorted(f for f in path.iterdir() if f.is_file())
    for kind, suffixes in (
        ("fits", FITS),
        ("pictures", (*PICTURES, *TIFFS, *PHOTOS, ".npy", ".raw")),
        ("named", (*ARRAYS, *HDF5)),
    ):
        chosen = [f for f in files if suffix_of(f) in suffixes]
        if chosen:
            return kind, path, chosen
    below = frame_files(path)
    kinds = {facts_of_name(f.relative_to(path).as_posix()).get("kind") for f in below}
    if kinds & {"bias", "dark", "flat"}:
        return ("fits" if all(suffix_of(f) in FITS for f in below) else "named"), path, below
    raise nothing_here(path, len(below))


def nothing_here(folder: Path, below: int) -> InputError:
    """The error for a folder without frames; `below` is the number of files in or below it that may contain some."""
    return InputError(
        "holds no frames" if not below else f"does not describe its frames; {below} files may contain some",
        file=folder,
        expected=f"frames.csv (`visaug frames {folder} -o {folder / 'frames.csv'}` writes one), {DESCRIPTOR}, FITS "
        f"files, pictures ({' '.join(SUFFIXES)}), or folders named bias, dark and flat",
    )
