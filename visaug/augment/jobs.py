"""Which pictures `visaug augment` makes from which originals, and where their labels lie."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

from visaug.augment.image_io import SUFFIXES
from visaug.augment.journal import JOURNAL, made_in, place_of
from visaug.core.errors import InputError


@dataclass
class CopyPlan:
    """Place below the output folder -> original, in the order of names; and what folders held besides."""

    sources: dict[str, Path] = field(default_factory=dict)  # name of each copy -> its original
    others: dict[str, Path] = field(default_factory=dict)  # name -> no picture, or not one of those chosen
    # folders of the inputs in which copies of `visaug augment` were passed over: all of a folder below an input, and in an
    # input itself the copies alone
    outputs: list[Path] = field(default_factory=list)
    again: list[Path] = field(default_factory=list)  # inputs that hold nothing but such copies


def plan_jobs(
    inputs: Sequence[Path], output: Path, copies: int, include: Sequence[str], exclude: Sequence[str]
) -> CopyPlan:
    """One job for each copy of each picture.

    Args:
        inputs: pictures and folders; folders are searched whole, linked ones too. Where files of several inputs would have
            one place, each is kept in the folders that tell the inputs apart.
        output: folder of the copies; files in it are not read as inputs, nor are those of earlier calls' output folders
            below an input.
        copies: of each picture; with more than one, `a.png` becomes `a_1.png`, `a_2.png`, ...
        include: patterns, of which a picture has to match one; see `matches`. Empty means every picture.
        exclude: patterns, of which it may match none.
    """
    jobs = CopyPlan()
    unused = set(include)
    for placed, name, source in _placed(inputs, output, jobs):
        suffix = source.suffix.lower()
        used = {pattern for pattern in include if matches(name, pattern)}
        unused -= used
        left_out = (include and not used) or any(matches(name, pattern) for pattern in exclude)
        if suffix not in SUFFIXES or left_out:
            jobs.others[placed] = source
            continue
        for copy in copy_names(placed, copies):
            other = jobs.sources.get(copy)
            if other is not None and other.resolve() != source.resolve():
                raise InputError(f"would be written to {copy}, as {other} would", file=source)
            jobs.sources[copy] = source
    if unused:
        expected = "a pattern of paths below an input, for example 'rgb/*.png'"
        raise InputError(f"{', '.join(sorted(unused))} matches no file", field="--include", expected=expected)
    if not jobs.sources:
        chosen = " that are included and not excluded" if include or exclude else ""
        where, expected = ", ".join(map(str, inputs)), "files ending in " + " ".join(SUFFIXES)
        raise InputError(f"holds no pictures{chosen}", file=where, expected=expected)
    jobs.sources = dict(sorted(jobs.sources.items()))
    return jobs


def check_kept(output: Path, written: Mapping[str, Path]) -> None:
    """Refuse places that are, or lead by a link to, a file that is read; `written`: name below `output` -> its original."""
    read = {source.resolve(): source for source in written.values()}
    for name in written:
        if (original := read.get(place_of(output, name).resolve())) is not None:
            raise InputError("would be overwritten", file=original, expected="another output folder")


def matches(name: str, pattern: str) -> bool:
    """Whether a path, or a folder above it, matches a pattern with `*`, `?` and `[...]`, where `*` takes `/` too.

    A pattern without a leading `*` also matches from any folder on: `rgb/*.png` takes `000000/rgb/1.png`.
    """
    path, pattern = PurePosixPath(name), pattern.rstrip("/")
    parts = [part.as_posix() for part in (path, *path.parents[:-1])]
    return any(fnmatchcase(part, form) for part in parts for form in (pattern, f"*/{pattern}"))


def _placed(inputs: Sequence[Path], output: Path, jobs: CopyPlan) -> list[tuple[str, str, Path]]:
    """(place below the output, name below its input, path) of every file of the inputs; `jobs` gets which copies are among them."""
    found = [(start, name, source) for start in inputs for name, source in _files(start, output, jobs)]
    first: dict[str, Path] = {}
    apart = any(first.setdefault(name, source).resolve() != source.resolve() for _, name, source in found)
    if not apart:
        return [(name, name, source) for _, name, source in found]
    folders = {start: Path(os.path.abspath(start if start.is_dir() else start.parent)) for start in inputs}
    common = Path(os.path.commonpath(list(folders.values())))
    below = {start: folder.relative_to(common) for start, folder in folders.items()}
    return [((below[start] / name).as_posix(), name, source) for start, name, source in found]


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
    if folders := [number for number, part in enumerate(parts[:-1]) if part == "images"]:
        parts[folders[-1]] = "labels"
    return Path(*parts).with_suffix(".txt")


def find_label(picture: Path) -> Path | None:
    """The YOLO labels of a picture: in the parallel folder `labels`, or beside it."""
    places = label_place(picture), picture.with_suffix(".txt")
    return next((place for place in places if place.is_file()), None)


def _files(start: Path, output: Path, jobs: CopyPlan) -> Iterator[tuple[str, Path]]:
    """(name below `start`, path) of its visible files."""
    if start.is_file():
        if start.suffix.lower() not in SUFFIXES:
            expected = "a name ending in " + " ".join(SUFFIXES)
            raise InputError("is not a picture", file=start, expected=expected)
        yield start.name, start
    elif start.is_dir():
        files = list(_walk(start, output.resolve(), jobs.outputs, ()))
        made = {start / name for name in made_in(start)}
        others = [path for path in files if path not in made]
        is_output = start.resolve() == output.resolve()
        if made and not is_output and not any(path.suffix.lower() in SUFFIXES for path in others):
            jobs.again.append(start)
        elif made:
            jobs.outputs.append(start)
            files = others
        for path in files:
            yield path.relative_to(start).as_posix(), path
    else:
        raise InputError("no such file or folder", file=start)


def _walk(folder: Path, output: Path, outputs: list[Path], above: tuple[Path, ...]) -> Iterator[Path]:
    """Files below, through links, but for hidden ones, output folders, and a link back to a folder above."""
    here = folder.resolve()
    if here in above:
        return
    if above and (here == output or (folder / JOURNAL).is_file()):
        outputs.append(folder)
        return
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            if entry.name.startswith("."):
                continue
            if entry.is_dir():
                yield from _walk(folder / entry.name, output, outputs, (*above, here))
            elif entry.is_file():
                yield folder / entry.name
