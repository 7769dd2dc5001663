"""A folder's frames by their headers, subfolders and names: the table that frames.csv would be."""

import os
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError, naming
from visaug.core.wording import first_of
from visaug.frames import pixels
from visaug.frames.agreement import agreed, names
from visaug.frames.headers import Facts, frames_of
from visaug.frames.names import Named, read_name
from visaug.frames.raw import check_size
from visaug.frames.record import FrameRecord
from visaug.frames.table import rows_text

_FIELDS = tuple(f.name for f in fields(FrameRecord) if f.name not in ("sequence", "file", "clean"))
DESCRIPTOR = "EMVA1288_Data.txt"
_SAID = {  # what was made of a header or a name
    "name_unclear": "no exposure or temperature is taken from a number of two meanings",
    "temperature_unknown": "the temperature is not known",
    "temperature_kelvin": "the temperature is converted from Kelvin",
    "kind_contradicted": "keywords of the header name different kinds",
    "exposure_contradicted": "keywords of the header state different exposures",
    "exposure_unit": "the exposure is converted to seconds",
    "overscan": "columns or rows without light are cut off, where the header says which they are",
    "colour_planes": "three colours of a picture are no three frames; green alone is used",
    "stack_axis_assumed": "frames lie along the last axis",
}


# How to give what the named frames lack, or what is made of them.
_ASKED = {
    "kind": "not known for {}; put them into folders named bias, dark or flat, or fill in the column kind",
    "exposure_s": "the exposure of {} is not known; put it into the names (dark_2s_003), give it with --exposure if it is the "
    "same for all, or fill in the column",
    "temperature_c": "not known for {}; without it the dark current has no temperature law. Give --temperature, or fill in the "
    "column",
    "photons": "not known for {}; without them the quantum efficiency is not determined. If the light was measured, fill in the "
    "mean number of photons per pixel",
    "combined": "{} are combined from several exposures; they are not raw frames and give no temporal noise",
}


@dataclass
class Survey:
    """What was found in a folder: one mapping a frame with the fields of `FrameRecord`, in which `kind` and `exposure_s` are None
    where nothing tells them; and notes on what could not be found, how to give it, and what was assumed.
    """

    folder: Path
    rows: list[Facts]
    notes: list[str] = field(default_factory=list)

    @property
    def complete(self) -> bool:
        return not self.missing("kind") and not self.missing("exposure_s")

    def missing(self, name: str) -> list[Facts]:
        """Rows that lack a field which a frame set cannot do without."""
        if name == "exposure_s":
            return [r for r in self.rows if r[name] is None and r["kind"] not in (None, "bias", "image")]
        return [r for r in self.rows if r[name] is None]

    def records(self) -> list[FrameRecord]:
        """The rows as records; refused where they are not complete."""
        for name, what in (("kind", "bias, dark, flat or scene"), ("exposure_s", "seconds")):
            if lacking := self.missing(name):
                command = f"visaug frames {self.folder} -o {self.folder / 'frames.csv'}"
                expected = f"{what}: write a table with `{command}` and complete it"
                problem = f"the {name} of {names(lacking)} is not known"
                raise InputError(problem, file=self.folder, field=name, expected=expected)
        records = []
        for row in self.rows:
            values = {name: row[name] for name in ("sequence", "file", "clean", *_FIELDS)}
            with naming(row["file"]):
                records.append(FrameRecord(**values | {"exposure_s": values["exposure_s"] or 0.0}))
        return records

    def text(self, folder: Path | None = None) -> str:
        """The content of a frames.csv in `folder`; unknown cells are blank."""
        if folder is None or folder.resolve() == self.folder.resolve():
            return rows_text(self.rows)
        way = Path(os.path.relpath(self.folder.resolve(), folder.resolve()))
        return rows_text([{**r, "file": (way / r["file"]).as_posix()} for r in self.rows])

    def told_by(self) -> dict[tuple, list[str]]:
        """Files by (kind, what gave it, exposure in s, what gave it, temperature in degC, what gave it)."""
        found: dict[tuple, list[str]] = {}
        for row in self.rows:
            told = [(row[n], row["_from"].get(n, "")) for n in ("kind", "exposure_s", "temperature_c")]
            found.setdefault(sum(told, ()), []).append(row["file"])
        return found

    def conditions(self) -> Counter:
        """Number of frames by kind, exposure, temperature, gain, setting, filter and photons."""
        names = ("kind", "exposure_s", "temperature_c", "gain_db", "setting", "filter", "photons")
        return Counter(tuple(r[name] for name in names) for r in self.rows)


def survey(
    folder: str | Path,
    given: Mapping[str, Any] | None = None,
    resolution: tuple[int, int] | None = None,
    files: Sequence[Path] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Survey:
    """Find every frame below `folder` and what is known of it.

    A header is believed before a file's name, a file's name before its folder's, all before `given`. A file that cannot
    be read is left out with a note, unless `files` names it.

    Args:
        folder: searched with its subfolders; hidden ones are left out.
        given: values for frames without them, by the columns of frames.csv.
        resolution: rows and columns of .raw files, written as their region.
        files: look at these alone.
        progress: called with (description, done, total).
    """
    folder = Path(folder)
    FrameRecord(0, "", "dark", **{name: value for name, value in (given or {}).items() if value is not None})
    if not folder.is_dir():
        raise InputError("is not a folder", file=folder, expected="the folder that holds the frames")
    named, files = files is not None, frame_files(folder) if files is None else files
    if not files:
        expected = "files of the kinds " + " ".join(pixels.SUFFIXES)
        raise InputError("holds no frames", file=folder, expected=expected)
    rows: list[Facts] = []
    unreadable: list[InputError] = []
    for n, file in enumerate(files):
        name = file.relative_to(folder).as_posix()
        by_name = read_name(name)
        size = resolution if file.suffix.lower() == ".raw" else None
        try:
            frames = frames_of(file)
            if size is not None:
                check_size(file, size)
        except InputError as error:
            if named and file.parent == folder:
                raise
            unreadable.append(error)
            continue
        if not frames:
            expected = "arrays of rows x columns, or stacks of such"
            unreadable.append(InputError("holds no frames", file=file, expected=expected))
        for fragment, facts in frames:
            rows.append(_row(f"{name}#{fragment}" if fragment else name, facts, by_name, given or {}))
            if size is not None:
                rows[-1]["window"] = rows[-1]["window"] or (0, size[0], 0, size[1])
        if progress is not None:
            progress("reading headers", n + 1, len(files))
    if not rows and unreadable:
        raise unreadable[0]
    rows, notes = agreed(rows, folder)
    notes += _order(rows)
    if unreadable:
        files_are = "file is" if len(unreadable) == 1 else "files are"
        listed = first_of(unreadable, between="; ")
        notes.append(f"unreadable_files: {len(unreadable)} {files_are} left out: {listed}")
    found = Survey(folder, rows, notes)
    found.notes += _notes(found)
    return found


def parse_resolution(text: str | None) -> tuple[int, int] | None:
    """Rows and columns of ``1024x1280``."""
    if text is None:
        return None
    match = re.fullmatch(r"\s*([1-9]\d*)\s*[x×]\s*([1-9]\d*)\s*", text)
    if match is None:
        expected = "rows x columns, as 1024x1280"
        raise InputError(f"{text!r} is not a size", field="--resolution", expected=expected)
    return int(match[1]), int(match[2])


def frame_files(folder: Path) -> list[Path]:
    """Files that may hold frames, in natural order of their paths (2 before 10)."""
    paths = {f.relative_to(folder): f for f in folder.rglob("*") if pixels.suffix_of(f) in pixels.SUFFIXES}
    visible = [p for p in paths if not any(part.startswith(".") for part in p.parts) and paths[p].is_file()]
    return [paths[p] for p in sorted(visible, key=lambda p: natural(p.as_posix()))]


def natural(text: str) -> list[tuple[int, int, str]]:
    """A key that sorts numbers in names by value."""
    return [(1, int(p), "") if p.isdigit() else (0, 0, p) for p in re.split(r"(\d+)", text)]


def _row(file: str, facts: Facts, by_name: Named, given: Mapping[str, Any]) -> Facts:
    row: Facts = {"sequence": 0, "file": file, "clean": None}
    words = row["_from"] = {}
    for name in _FIELDS:
        for values, word in (
            (facts, facts.get("words", {}).get(name, "the header")),
            (by_name.facts, f"{by_name.words.get(name, '')} in the name"),
            (given, "an option"),
        ):
            if row.setdefault(name, None) is None and values.get(name) is not None:
                row[name], words[name] = values[name], word
    # Headers rarely state that a frame is not a master.
    if facts.get("combined") == 1 and "combined" in by_name.facts:
        row["combined"] = by_name.facts["combined"]
    row["gain_db"] = row["gain_db"] or 0.0
    row["combined"] = 1 if row["combined"] is None else row["combined"]
    if row["kind"] == "bias":  # of the shortest exposure there is, whatever is given for the others
        row["exposure_s"] = facts.get("exposure_s") or by_name.facts.get("exposure_s") or 0.0
    if row["kind"] in ("bias", "dark"):
        row["filter"] = row["photons"] = None
    row["_header_kind"], row["_name_kind"] = facts.get("kind"), by_name.facts.get("kind")
    for name in ("colour", "plane", "calibrated", "ceiling", "body"):
        row[f"_{name}"] = facts.get(name)
    row["_said"] = dict(facts.get("said", {}))
    if by_name.unclear and (row["exposure_s"] is None or row["temperature_c"] is None):
        row["_said"]["name_unclear"] = f"{', '.join(by_name.unclear)} can be read in two ways"
    return row


def _order(rows: list[Facts]) -> list[str]:
    """Number the rows by time where all have one, else as they stand."""
    timed = all(r["time_s"] is not None for r in rows)
    if timed:
        rows.sort(key=lambda r: (r["time_s"], natural(r["file"])))
    for n, row in enumerate(rows):
        row["sequence"] = n
    said = "not every frame has its time of acquisition; they are numbered by name. If that was not the order, give it in the "
    return [] if timed else [f"order_assumed: {said}column sequence"]


def _notes(found: Survey) -> list[str]:
    notes = []
    if (found.folder / DESCRIPTOR).is_file():
        notes.append(
            f"descriptor: {DESCRIPTOR} describes these frames; give the folder to the commands unchanged, "
            "without a frames.csv, which would take precedence"
        )
    rows = found.rows

    def ask(name: str, lacking: list[Facts]) -> None:
        if lacking:
            notes.append(f"{name}: {_ASKED[name].format(names(lacking))}")

    ask("kind", found.missing("kind"))
    ask("exposure_s", found.missing("exposure_s"))
    ask("temperature_c", [r for r in found.missing("temperature_c") if r["kind"] == "dark"])
    ask("photons", [r for r in found.missing("photons") if r["kind"] == "flat"])
    if any(r["bit_depth"] is None and not r["file"].lower().endswith((".png", ".jpg")) for r in rows):
        notes.append(
            "bit_depth: not stated by the files; cameras with 10, 12 or 14 bits often write 16-bit files. Give --bit-depth"
        )
    unlike = [r for r in rows if r["_header_kind"] and r["_name_kind"] not in (None, r["_header_kind"])]
    if unlike:
        notes.append(f"kind: header and name disagree for {names(unlike)}; the header is used")
    ask("combined", [r for r in rows if r["combined"] != 1])
    for word in dict.fromkeys(word for r in rows for word in r["_said"]):
        those = [r for r in rows if word in r["_said"]]
        details = sorted({r["_said"][word] for r in those})
        notes.append(f"{word}: {_SAID[word]} ({first_of(details, between='; ')}): {names(those)}")
    return notes
