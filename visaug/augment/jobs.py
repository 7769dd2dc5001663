"""Which pictures `visaug augment` makes from which originals, and where their labels lie."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from visaug.augment.image_io import SUFFIXES
from visaug.core.errors import InputError


@dataclass
class Jobs:
    """Place below the output folder -> original, in the order of names; and what folders held besides.

    Attributes:
        sources: name of each copy -> its original.
        skipped: suffix -> number of files that are no pictures.
    """

    sources: dict[str, Path] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)


def plan_jobs(inputs: Sequence[Path], output: Path, copies: int = 1, labels: bool = False) -> Jobs:
    """One job for each copy of each picture.

    Args:
        inputs: pictures and folders; folders are searched whole, linked ones too.
        output: folder of the copies; files in it are not read as inputs.
        copies: of each picture; with more than one, `a.png` becomes `a_1.png`, `a_2.png`, ...
        labels: .txt files are labels, and not counted as skipped.
    """
    jobs = Jobs()
    for start in inputs:
        for name, source in _files(start, output):
            suffix = source.suffix.lower()
            if suffix not in SUFFIXES:
                if not (labels and suffix == ".txt"):
                    jobs.skipped[suffix or "without a suffix"] += 1
                continue
            for copy in copy_names(name, copies):
                other = jobs.sources.get(copy)
                if other is not None and other.resolve() != source.resolve():
                    raise InputError(f"would be written to {copy}, as {other} would", file=source)
                if (output / copy).resolve() == source.resolve():
                    raise InputError("would be overwritten", file=source, expected="another output folder")
                jobs.sources[copy] = source
    if not jobs.sources:
        raise InputError(
            "holds no pictures",
            file=", ".join(map(str, inputs)),
            expected="files ending in " + " ".join(SUFFIXES),
        )
    jobs.sources = dict(sorted(jobs.sources.items()))
    return jobs


def copy_names(name: str, copies: int) -> list[str]:
    """Names of a picture's copies: more copies leave the names of the first ones as they were."""
    if copies == 1:
        return [name]
    stem, dot, suffix = name.rpartition(".")
    return [f"{stem}_{number}{dot}{suffix}" for number in range(1, copies + 1)]


def label_place(picture: Path) -> Path:
    """Where ultralytics looks for a picture's YOLO labels.

    The last folder `images` of the path is replaced by `labels`; without one, the folder is the same.
    """
    parts = list(picture.absolute().parts)
    folders = [number for number, part in enumerate(parts[:-1]) if part == "images"]
    if folders:
        parts[folders[-1]] = "labels"
    return Path(*parts).with_suffix(".txt")


def find_label(picture: Path) -> Path | None:
    """The YOLO labels of a picture: in the parallel folder `labels`, or beside it."""
    for place in (label_place(picture), picture.with_suffix(".txt")):
        if place.is_file():
            return place
    return None


def _files(start: Path, output: Path) -> Iterator[tuple[str, Path]]:
    """(name below `start`, path) of its visible files."""
    if start.is_file():
        if start.suffix.lower() not in SUFFIXES:
            raise InputError(
                "is not a picture", file=start, expected="a name ending in " + " ".join(SUFFIXES)
            )
        yield start.name, start
    elif start.is_dir():
        for path in _walk(start, output.resolve(), ()):
            yield path.relative_to(start).as_posix(), path
    else:
        raise InputError("no such file or folder", file=start)


def _walk(folder: Path, output: Path, above: tuple[Path, ...]) -> Iterator[Path]:
    """Files below, through links, but for hidden ones, the output folder, and a link back to a folder above."""
    here = folder.resolve()
    if here in above or (here == output and above):
        return
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            if entry.name.startswith("."):
                continue
            if entry.is_dir():
                yield from _walk(folder / entry.name, output, (*above, here))
            elif entry.is_file():
                yield folder / entry.name
