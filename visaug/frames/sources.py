"""Folders that describe their frames in their own way: EMVA 1288 descriptors, FITS headers, plain
pictures.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

from visaug.errors import InputError
from visaug.frames.pixels import FITS, PICTURES, SUFFIXES, TIFFS
from visaug.frames.record import FrameRecord

DESCRIPTOR = "EMVA1288_Data.txt"


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


def read_fits_folder(folder: Path, files: list[Path]) -> list[FrameRecord]:
    """Records of FITS files with the usual headers (IMAGETYP, EXPTIME, CCD-TEMP, GAIN_DB), by
    DATE-OBS or name.
    """
    from astropy.io import fits

    found = []
    for file in files:
        try:
            header = fits.getheader(file)
            if "IMAGETYP" not in header and header.get("NAXIS") == 0:
                header = fits.getheader(file, 1)
        except Exception as error:  # astropy raises many kinds for damaged files
            raise InputError(f"cannot be read ({error}); truncated or no FITS", file=file) from None
        found.append((str(header.get("DATE-OBS", "")), file.name, file, header))
    found.sort(key=lambda entry: entry[:2])
    return [_fits_record(n, folder, file, header) for n, (_, _, file, header) in enumerate(found)]


def _fits_record(number: int, folder: Path, file: Path, header) -> FrameRecord:
    text = str(header.get("IMAGETYP", header.get("FRAME", ""))).strip().lower()
    kinds = {
        "bias": "bias",
        "zero": "bias",
        "dark": "dark",
        "flat": "flat",
        "light": "scene",
        "object": "scene",
        "science": "scene",
        "scene": "scene",
    }
    kind = next((value for word, value in kinds.items() if word in text), None)
    if kind is None:
        raise InputError(
            f"IMAGETYP {text!r} is no kind of frame",
            file=file,
            field="IMAGETYP",
            expected="bias, zero, dark, flat, light or object",
        )

    def number_of(*names: str) -> float | None:
        for name in names:
            if header.get(name) not in (None, ""):
                try:
                    return float(header[name])
                except (TypeError, ValueError):
                    raise InputError(f"{header[name]!r} is no number", file=file, field=name) from None
        return None

    exposure_s = number_of("EXPTIME", "EXPOSURE")
    if exposure_s is None:
        if kind != "bias":
            raise InputError("is missing", file=file, field="EXPTIME", expected="the exposure in seconds")
        exposure_s = 0.0
    try:
        return FrameRecord(
            number,
            file.relative_to(folder).as_posix(),
            kind,
            exposure_s,
            number_of("CCD-TEMP", "CCD_TEMP", "DET-TEMP"),
            number_of("GAIN_DB", "GAINDB") or 0.0,
            photons=number_of("PHOTONS"),
        )
    except InputError as error:
        raise InputError(error.problem, file=file, field=error.field, expected=error.expected) from None


def read_pictures(folder: Path, files: list[Path]) -> list[FrameRecord]:
    """Plain pictures, of which nothing is known, by name."""
    return [
        FrameRecord(n, file.relative_to(folder).as_posix(), "image") for n, file in enumerate(sorted(files))
    ]


def find(path: Path) -> tuple[str, Path, list[Path]]:
    """What lies at `path` (``table``, ``descriptor``, ``fits``, ``pictures``), its folder, the files meant.

    frames.csv wins over a descriptor, a descriptor over FITS headers, these over plain pictures.
    """
    if path.is_file():
        if path.suffix.lower() == ".csv":
            return "table", path.parent, [path]
        if path.suffix.lower() == ".txt":
            return "descriptor", path.parent, [path]
        if path.suffix.lower() in SUFFIXES:
            return "pictures", path.parent, [path]
        raise InputError(
            "is no frame set", file=path, expected=f"a folder, a frames.csv, an {DESCRIPTOR} or a picture"
        )
    if not path.is_dir():
        raise InputError("no such file or folder", file=path)
    for kind, name in (("table", "frames.csv"), ("descriptor", DESCRIPTOR)):
        if (path / name).is_file():
            return kind, path, [path / name]
    files = sorted(f for f in path.iterdir() if f.is_file())
    for kind, suffixes in (("fits", FITS), ("pictures", (*PICTURES, *TIFFS, ".npy", ".raw"))):
        chosen = [f for f in files if f.suffix.lower() in suffixes]
        if chosen:
            return kind, path, chosen
    raise InputError(
        "holds no frames",
        file=path,
        expected=f"frames.csv, {DESCRIPTOR}, FITS files or pictures ({' '.join(SUFFIXES)})",
    )
