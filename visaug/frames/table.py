"""frames.csv: one row a frame."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from visaug.errors import InputError
from visaug.frames.record import FrameRecord, format_window, parse_window

COLUMNS = ("sequence", "file", "kind", "exposure_s", "temperature_c", "gain_db", "photons", "clean")
_REQUIRED = ("sequence", "file", "kind")
_MAY_LACK_EXPOSURE = ("bias", "image")


def read_table(path: str | Path) -> list[FrameRecord]:
    """The records of a frames.csv, in order of ``sequence``.

    Raises:
        InputError: file, row, column and what was expected.
    """
    path = Path(path)
    try:
        with open(path, newline="", encoding="utf-8-sig") as handle:
            rows = list(csv.reader(handle))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read ({error})", file=path, expected="a CSV file in UTF-8") from None
    rows = [(n, row) for n, row in enumerate(rows, start=1) if any(cell.strip() for cell in row)]
    if not rows:
        raise InputError("is empty", file=path, expected="the columns " + ",".join(COLUMNS))
    header = [cell.strip() for cell in rows[0][1]]
    _check_header(header, path)
    records: list[FrameRecord] = []
    seen: dict[int, int] = {}
    for number, row in rows[1:]:
        record = _record(header, row, path, number)
        if record.sequence in seen:
            raise InputError(
                f"{record.sequence} stands in row {seen[record.sequence]} too",
                file=path,
                field=f"row {number}, sequence",
                expected="a number of its own for each frame",
            )
        seen[record.sequence] = number
        records.append(record)
    if not records:
        raise InputError("names no frames", file=path, expected="one row for each frame")
    return sorted(records, key=lambda r: r.sequence)


def write_table(path: str | Path, records: Iterable[FrameRecord]) -> None:
    """Write records as a frames.csv; a `region` column appears where a record has a window."""
    records = list(records)
    windows = any(r.window is not None for r in records)
    with open(path, "w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow([*COLUMNS, "region"] if windows else COLUMNS)
        for r in records:
            row = [
                r.sequence,
                r.file,
                r.kind,
                _number(r.exposure_s),
                _number(r.temperature_c),
                _number(r.gain_db),
                _number(r.photons),
                r.clean or "",
            ]
            if windows:
                row.append("" if r.window is None else format_window(r.window))
            writer.writerow(row)


def _check_header(header: list[str], path: Path) -> None:
    known = {*COLUMNS, "region"}
    for name in _REQUIRED:
        if name not in header:
            raise InputError(
                f"has no column {name!r}", file=path, expected="the columns " + ",".join(COLUMNS)
            )
    for name in header:
        if name not in known:
            raise InputError(
                f"{name!r} is no column of a frame set",
                file=path,
                field="header",
                expected="columns out of " + ",".join((*COLUMNS, "region")),
            )
        if header.count(name) > 1:
            raise InputError(f"the column {name!r} stands there twice", file=path, field="header")


def _record(header: list[str], row: list[str], path: Path, number: int) -> FrameRecord:
    if len(row) == len(header) + 1 and header[-1] == "region":
        row = [*row[:-2], f"{row[-2]},{row[-1]}"]  # r0:r1,c0:c1 written without quotation marks
    if len(row) > len(header) or len(row) < len(_REQUIRED):
        raise InputError(
            f"has {len(row)} cells", file=path, field=f"row {number}", expected=f"{len(header)} cells"
        )
    cells = dict(zip(header, [cell.strip() for cell in row], strict=False))

    def number_in(column: str, default: float | None) -> float | None:
        text = cells.get(column, "")
        if not text:
            return default
        try:
            return float(text)
        except ValueError:
            raise InputError(
                f"{text!r} is no number", file=path, field=f"row {number}, {column}", expected="a number"
            ) from None

    try:
        sequence = int(cells["sequence"])
    except ValueError:
        raise InputError(
            f"{cells['sequence']!r} is no whole number",
            file=path,
            field=f"row {number}, sequence",
            expected="the place in the order of acquisition",
        ) from None
    if not cells["file"]:
        raise InputError("is blank", file=path, field=f"row {number}, file", expected="the name of a file")
    exposure_s = number_in("exposure_s", None)
    if exposure_s is None:
        if cells["kind"] not in _MAY_LACK_EXPOSURE:
            raise InputError(
                "is blank", file=path, field=f"row {number}, exposure_s", expected="seconds, 0 or more"
            )
        exposure_s = 0.0
    try:
        return FrameRecord(
            sequence=sequence,
            file=cells["file"],
            kind=cells["kind"],
            exposure_s=exposure_s,
            temperature_c=number_in("temperature_c", None),
            gain_db=number_in("gain_db", 0.0) or 0.0,
            photons=number_in("photons", None),
            clean=cells.get("clean") or None,
            window=parse_window(cells["region"]) if cells.get("region") else None,
        )
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(
            error.problem, file=path, field=f"row {number}, {error.field}", expected=error.expected
        ) from None


def _number(value: float | None) -> str:
    return "" if value is None else repr(float(value)) if value != int(value) else str(int(value))
