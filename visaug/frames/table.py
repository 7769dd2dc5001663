"""frames.csv: one row a frame."""

import codecs
import csv
import difflib
import io
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError
from visaug.core.nearest import did_you_mean
from visaug.frames.names import is_master, kind_of
from visaug.frames.record import KINDS, FrameRecord, format_window, parse_window
from visaug.frames.units import WARMEST_C, celsius, is_no_temperature

COLUMNS = ("sequence", "file", "kind", "exposure_s", "temperature_c", "gain_db", "photons", "clean")
FURTHER = ("region", "setting", "filter", "combined", "bayer", "bit_depth", "time_s")
SETTINGS = ("gain", "offset", "iso", "readoutm", "readout_mode")  # columns that together are the setting
_REQUIRED = ("file", "kind")
_UNITS = {
    "exposure_s": "seconds, such as 0.01",
    "temperature_c": "degrees Celsius, such as 20",
    "gain_db": "decibels, such as 6",
    "photons": "photons per pixel, such as 5000",
}


def read_table(path: str | Path, warnings: list[str] | None = None) -> list[FrameRecord]:
    """The records of a frames.csv, in order of ``sequence`` (of ``time_s``, or of rows, where it is absent).

    Comma, semicolon and tab separate; capitals and small letters are alike; where semicolons or tabs separate,
    a comma is a decimal point. Columns of other names are left out and named in `warnings`.

    Raises:
        InputError: file, row, column and what was expected.
    """
    path = Path(path)
    rows, decimal = _rows(path)
    header = ["_".join(cell.lower().split()) for cell in rows[0][1]]
    ignored = _check_header(header, path)
    if ignored and warnings is not None:
        warnings.append(f"columns_ignored: {path.name} has further columns: {', '.join(ignored)}")
    said: list[str] = []
    records = [
        _Row(_cells(header, row, path, number), decimal, path, number, said).record(order)
        for order, (number, row) in enumerate(rows[1:])
    ]
    if said and warnings is not None:
        warnings += [f"{word} ({path.name}, {said.count(word)} frames)" for word in dict.fromkeys(said)]
    if not records:
        raise InputError("lists no frames", file=path, expected="one row for each frame")
    if "sequence" not in header:  # in order of time where every frame has one, else as they stand
        if all(record.time_s is not None for record in records):
            records.sort(key=lambda record: record.time_s or 0.0)
        return [replace(record, sequence=n) for n, record in enumerate(records)]
    seen: dict[int, int] = {}
    for (number, _), record in zip(rows[1:], records, strict=True):
        if (other := seen.setdefault(record.sequence, number)) != number:
            field, expected = f"row {number}, sequence", "a unique number for each frame"
            problem = f"{record.sequence} is also used in row {other}"
            raise InputError(problem, file=path, field=field, expected=expected)
    return sorted(records, key=lambda r: r.sequence)


def write_table(path: str | Path, records: Iterable[FrameRecord]) -> None:
    """Write records as a frames.csv; a column beyond `COLUMNS` appears where a record fills it."""
    with open(path, "w", newline="", encoding="utf-8") as handle:
        handle.write(rows_text({name: getattr(r, name) for name in _DEFAULTS} for r in records))


def rows_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """The content of a frames.csv from mappings with the fields of `FrameRecord`; None leaves a cell blank."""
    rows = list(rows)
    for name in (str(r["file"]) for r in rows):
        if any("\ud800" <= c <= "\udfff" for c in name):  # bytes of a name that are no text
            raise InputError("has a name that is not UTF-8", file=name, expected="another name, for a table")
    used = [name for name in FURTHER if any(_written(r, name) for r in rows)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *used])
    writer.writerows([_written(r, name) for name in (*COLUMNS, *used)] for r in rows)
    return text.getvalue()


_DEFAULTS = {f.name: f.default for f in fields(FrameRecord)}


def _written(row: Mapping[str, Any], column: str) -> str:
    value = row["window" if column == "region" else column]
    if value is None or (column in FURTHER and value == _DEFAULTS.get(column)):
        return ""
    if column == "region":
        return format_window(value)
    if isinstance(value, str):
        return value
    return repr(float(value)) if value != int(value) else str(int(value))


def _decoded(data: bytes) -> str:
    """UTF-8, UTF-16 with its mark, or what spreadsheets of Western Europe write where it is neither."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252")


def _rows(path: Path) -> tuple[list[tuple[int, list[str]]], str]:
    """Numbered rows that hold something, and the sign of decimals, ``.`` or ``,``."""
    try:
        text = _decoded(path.read_bytes())
        first = next((line for line in text.splitlines() if line.strip()), "")
        delimiter = max((",", ";", "\t"), key=first.count)
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read ({reason})", file=path, expected="a CSV file") from None
    held = [(n, row) for n, row in enumerate(rows, start=1) if any(cell.strip() for cell in row)]
    if not held:
        raise InputError("is empty", file=path, expected="the columns " + ",".join(COLUMNS))
    return held, "." if delimiter == "," else ","


def _check_header(header: list[str], path: Path) -> list[str]:
    """Refuse what cannot be a frame set's header; returns the columns that mean nothing here."""
    columns = (*COLUMNS, *FURTHER)
    known = (*columns, *SETTINGS)
    for name in _REQUIRED:
        if name not in header:
            problem = f"has no column {name!r}" + did_you_mean(name, sorted(set(header) - set(known)))
            expected = "at least the columns file and kind, of " + ",".join(columns)
            raise InputError(problem, file=path, field="header", expected=expected)
    for name in header:
        if name and header.count(name) > 1:
            raise InputError(f"the column {name!r} is listed twice", file=path, field="header")
    ignored = [name for name in header if name and name not in known]
    missing = [column for column in columns if column not in header]
    alike = 0.75  # similarity of difflib from which an unknown column is taken for a slip of the pen
    for name in ignored:
        likely = [c for c in missing if name == c.rsplit("_", 1)[0]]
        if likely := likely or difflib.get_close_matches(name, missing, 1, alike):
            problem = f"{name!r} is not a column of a frame set; did you mean {likely[0]}?"
            raise InputError(problem, file=path, field="header")
    return ignored


def _cells(header: list[str], row: list[str], path: Path, number: int) -> dict[str, str]:
    row = _whole_indices(row) if len(row) > len(header) else row
    if len(row) == len(header) + 1 and "region" in header:  # r0:r1,c0:c1 written without quotation marks
        at = header.index("region")
        row = [*row[:at], f"{row[at]},{row[at + 1]}", *row[at + 2 :]]
    wanted = f"{len(header)} cells"
    if any(cell.strip() for cell in row[len(header) :]) or len(row) < len(_REQUIRED):
        raise InputError(f"has {len(row)} cells", file=path, field=f"row {number}", expected=wanted)
    cells = dict(zip(header, [cell.strip() for cell in row], strict=False))
    for name in _REQUIRED:
        if name not in cells:
            raise InputError("is missing", file=path, field=f"row {number}, {name}", expected=wanted)
    return cells


def _whole_indices(row: list[str]) -> list[str]:
    """The cells, one of ``a.npz#frames[3,0]`` written without quotation marks put together."""
    made: list[str] = []
    for cell in row:
        if made and "#" in made[-1] and made[-1].count("[") > made[-1].count("]"):
            made[-1] += f",{cell}"
        else:
            made.append(cell)
    return made


@dataclass
class _Row:
    """The cells of one row by their columns, the sign of decimals, and what is said of what was read."""

    cells: dict[str, str]
    decimal: str
    path: Path
    place: int
    said: list[str]

    def record(self, order: int) -> FrameRecord:
        cells, place_in_order = self.cells, "the place in the order of acquisition"
        if "sequence" in cells and not cells["sequence"]:
            raise self.wrong("sequence", "is blank", place_in_order)
        if not cells["file"]:
            raise self.wrong("file", "is blank", "the name of a file")
        kind = kind_of(cells["kind"])
        if kind is None:
            raise self.wrong("kind", f"{cells['kind']!r} is not a kind of frame", " or ".join(KINDS))
        exposure_s = self.number("exposure_s")
        if exposure_s is None and kind not in ("bias", "image"):
            if "exposure_s" in cells:
                raise self.wrong("exposure_s", "is blank", "seconds, 0 or more")
            problem = f"is no column of the table; {kind} frames need it"
            expected = "a column exposure_s: seconds, 0 or more"
            raise InputError(problem, file=self.path, field="exposure_s", expected=expected)
        parts = [cells.get("setting"), *(f"{n.upper()}={cells[n]}" for n in SETTINGS if cells.get(n))]
        averaged = 0 if is_master(cells["kind"]) else 1
        try:
            return FrameRecord(
                sequence=self.whole("sequence", order, place_in_order),
                file=cells["file"],
                kind=kind,
                exposure_s=exposure_s or 0.0,
                temperature_c=self.temperature(),
                gain_db=self.number("gain_db") or 0.0,
                photons=self.number("photons"),
                clean=cells.get("clean") or None,
                window=parse_window(cells["region"]) if cells.get("region") else None,
                setting=" ".join(filter(None, parts)) or None,
                filter=cells.get("filter") or None,
                combined=self.whole("combined", averaged, "how many exposures, 0 or more"),
                bayer=cells.get("bayer", "").upper() or None,
                bit_depth=self.whole("bit_depth", 0, "bits of the converter") or None,
                time_s=self.time(),
            )
        except InputError as error:
            if error.file is not None:
                raise
            raise self.wrong(str(error.field), error.problem, str(error.expected)) from None

    def wrong(self, column: str, problem: str, expected: str) -> InputError:
        return InputError(problem, file=self.path, field=f"row {self.place}, {column}", expected=expected)

    def number(self, column: str) -> float | None:
        text = self.cells.get(column, "")
        if not text:
            return None
        try:
            return float(text.replace(",", ".") if self.decimal == "," else text)
        except ValueError:
            expected = _UNITS.get(column, "a number")
            raise self.wrong(column, f"{text!r} is not a number", expected) from None

    def whole(self, column: str, default: int, what: str) -> int:
        value = self.number(column)
        if value is None:
            return default
        if not value.is_integer() or abs(value) > 1e15:
            raise self.wrong(column, f"{self.cells[column]!r} is not a whole number", what)
        return int(value)

    def temperature(self) -> float | None:
        """Degrees Celsius: a thermometer that is not there is unknown, what can only be Kelvin is converted, and both are said."""
        value = self.number("temperature_c")
        if value is None or value != value:
            return value
        degrees, made = celsius(value)
        if made == "kelvin":
            said = f"kelvin: temperatures above {WARMEST_C:g} are read as Kelvin and converted"
        elif is_no_temperature(value):
            said = f"unknown: {value:g} stands for no thermometer; the temperature is not known"
        else:
            return value if degrees is None else degrees
        self.said.append(f"temperature_{said}")
        return degrees

    def time(self) -> float | None:
        """Seconds, from a number or a date and time as ISO 8601 writes it."""
        text = self.cells.get("time_s", "")
        seconds = iso_seconds(text)
        try:
            return self.number("time_s") if seconds is None else seconds
        except InputError:
            expected = "seconds, or 2026-01-31T23:59:58.5"
            raise self.wrong("time_s", f"{text!r} is not a time", expected) from None


def iso_seconds(text: str) -> float | None:
    """Seconds since 1970 of ``2026-01-31T23:59:58.5`` (UTC where no zone is given); None for other text."""
    # Python 3.10 reads fractions of three or six digits alone, and no Z
    written = re.sub(r"\.(\d{1,6})\d*", lambda found: f".{found[1]:0<6}", text).replace("Z", "+00:00")
    try:
        moment = datetime.fromisoformat(written)
    except ValueError:
        return None
    if "-" not in text:  # 20260131 is a number of seconds as well
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=timezone.utc)).timestamp()
