"""From a downloaded archive of a pose data set to a ready dataset: unpacked, checked, converted where asked.

Unpacking goes on where it was stopped, into ``NAME.partial``, which gets its name when all is there and
checked.
"""

import gzip
import lzma
import os
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path, PurePosixPath
from typing import IO

from visaug.core.errors import InputError
from visaug.core.files import whole_file, write_json
from visaug.core.progress import Progress
from visaug_train.checks import check_target
from visaug_train.config import LARGEST_SIDE
from visaug_train.convert import coco_annotations, convert
from visaug_train.datasets import READERS, domains, keypoints_of, read_poses, reader_of
from visaug_train.speed import PoseSet

LISTS = ("camera.json", "train.json")  # of which the uppermost folder of a dataset holds one


def prepare_archive(
    archive: str | Path, destination: str | Path | None, progress: Progress | None = None
) -> Path:
    """Unpack an archive (zip, tar ...) into `destination`, or take a folder where it lies, and check it; its root."""
    archive = Path(archive)
    if archive.is_dir():
        root = find_root(archive)
        check(root)
        return root
    if destination is None:
        _check_file(archive)
        raise InputError(f"is missing for {archive}", field="-o", expected="-o DIR, a folder of the dataset")
    destination = Path(destination)
    sizes = {PurePosixPath(name): size for name, size, _, _ in _members(archive)}
    inside = _root([*sizes], archive)
    if destination.is_dir():
        for path, size in sizes.items():
            file = destination / path.relative_to(inside) if path.is_relative_to(inside) else None
            if file is not None and not (file.is_file() and file.stat().st_size == size):
                problem = f"is not what {archive} holds: {path.name} is missing or another file"
                raise InputError(problem, file=destination, expected="a new folder")
        check(destination)
        return destination
    unfinished = destination.with_name(destination.name + ".partial")
    unpack(archive, unfinished, progress)
    check(unfinished / inside)
    (unfinished / inside).rename(destination)
    if unfinished.exists():
        shutil.rmtree(unfinished)
    return destination


def unpack(archive: Path, folder: Path, progress: Progress | None = None) -> None:
    """Writes missing members to `folder`; a member outside it is refused."""
    for done, (name, size, total, read) in enumerate(_members(archive), start=1):
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts:
            problem = f"holds {name}, which would lie outside"
            raise InputError(problem, file=archive, expected="a SPEED archive")
        target = folder / path
        if not target.is_file() or target.stat().st_size != size:
            with _whole(archive), whole_file(target) as half, read() as content, half.open("wb") as out:
                shutil.copyfileobj(content, out)
        if progress:
            progress("unpacking", done, total)


def find_root(folder: Path) -> Path:
    """The folder inside `folder`, at most three levels down, that has the layout of a data set."""
    if reader_of(folder) is not None:
        return folder
    marks = [*LISTS, *(mark for reader in READERS for mark in reader.marks)]
    found = [path for depth in range(4) for mark in marks for path in folder.glob("*/" * depth + mark)]
    return folder / _root([PurePosixPath(path.relative_to(folder)) for path in found], folder)


def _root(files: list[PurePosixPath], where: Path) -> PurePosixPath:
    """The uppermost folder among these files that has a reader's layout, or else SPEED's; `synthetic` is a part of SPEED+."""

    def roots(marks: Iterable[str]) -> set[PurePosixPath]:
        found = [(path, mark.count("/") + 1) for mark in marks for path in files if path.match(mark)]
        return {path.parents[length - 1] for path, length in found if len(path.parts) - length <= 3}

    found = roots(mark for reader in READERS for mark in reader.marks)
    found = found or {root for root in roots(LISTS) if root.name != "synthetic"}
    if not found:
        problem = f"has no SPEED or SPEED+ layout, nor that of {', '.join(reader.name for reader in READERS)}"
        raise InputError(problem, file=where, expected="camera.json or train.json in it")
    return min(found, key=lambda path: (len(path.parts), str(path)))


def check(root: Path) -> dict[str, PoseSet]:
    """Read every domain and split, which checks them; those without poses too."""
    parts = [(domain, split) for domain, splits in domains(root).items() for split in splits]
    found = {f"{domain}/{split}": read_poses(root, domain, split, labels=False) for domain, split in parts}
    if not any(poses.labelled for poses in found.values()):
        raise InputError("no image has a pose", file=root, expected="train.json with poses")
    return found


def prepare_dataset(
    archive: Path,
    output: Path | None = None,
    size: str | None = None,
    keypoints: str = "tango",
    coco: bool = False,
    progress: Progress | None = None,
) -> str:
    """All that `visaug prepare` does; what to print.

    Args:
        archive: an archive, or a folder.
        output: folder of the dataset. A folder is used where it lies: there, `output` only names what `coco` and `size` write,
            which otherwise lies beside the dataset.
        size: "WIDTHxHEIGHT" of copies with labels.
        keypoints: name or file of the points of the spacecraft.
        coco: write COCO annotations.
    """
    width_height = _size(size)
    unused = archive.is_dir() and output is not None and not (coco or size)
    if unused and not (output.exists() and output.samefile(find_root(archive))):
        problem = f"has no use: {archive} is a folder, and is checked where it lies"
        raise InputError(problem, field="-o", expected="no -o, or --coco or --size, which write beside it")
    root = prepare_archive(archive, output, progress)
    output = Path(os.path.abspath(root if output is None else output))
    sets = check(root)
    if width_height is not None:
        _trained(sets, root)
    said = [f"{name}: {len(p)} images{'' if p.labelled else ', no labels'}" for name, p in sets.items()]
    labelled = {name: poses for name, poses in sets.items() if poses.labelled}
    models = {}
    if coco or width_height is not None:
        models = {name: keypoints_of(keypoints, poses) for name, poses in labelled.items()}
    if len(labelled) < len(sets) and reader_of(root) is None:
        bare = ", ".join(name for name in sets if name not in labelled)
        said.append(
            f"note: {bare}: this is SPEED+ as it was before 2023, without labels of the laboratory's images; speedplusv2 has "
            "them (https://purl.stanford.edu/wv398fc4383). Until then they serve for submissions alone"
        )
    if coco:
        folder = output.with_name(f"{output.name}-coco")
        for name, poses in labelled.items():
            files = [file.relative_to(root).as_posix() for file in poses.files]
            content = coco_annotations(poses, models[name], files)
            write_json(folder / f"{name.replace('/', '-')}.json", content)
        said.append(f"COCO annotations: {folder}")
    if width_height is not None:
        first, *more = _trained(sets, root)
        parts, model = _parts(labelled, first), models[f"{first}/train"]
        for poses in parts.values():
            check_target(keypoints, model, parts["train"], poses)
        place = output.with_name(f"{output.name}-{width_height[0]}x{width_height[1]}")
        data_yaml = convert(parts, model, place, width_height, progress)
        said.append(f"labels: {data_yaml}")
        if more:
            left = ", ".join(more)
            said.append(f"note: --size converts the first domain with a train split, {first}; not {left}")
    return "\n".join([*said, f"ready: {root}"])


def _trained(sets: dict[str, PoseSet], root: Path) -> list[str]:
    """The domains that have labelled images for training; one at least."""
    found = [name.split("/")[0] for name, poses in sets.items() if name.endswith("/train") and poses.labelled]
    if not found:
        problem = f"{root} has no labelled train split, for whose training the copies are"
        raise InputError(problem, field="--size", expected="a data set to train with, or no --size")
    return found


def _parts(labelled: dict[str, PoseSet], domain: str) -> dict[str, PoseSet]:
    """The splits of a domain under the names that ultralytics has for them."""
    words = {"train": "train", "validation": "val", "test": "test"}
    return {words[n.split("/")[1]]: poses for n, poses in labelled.items() if n.split("/")[0] == domain}


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.partition("x")
    sides = [int(side) if side.isdecimal() and len(side) < 9 else 0 for side in (width, height)]
    if not all(0 < side <= LARGEST_SIDE for side in sides):
        expected = f"WIDTHxHEIGHT such as 640x400, at most {LARGEST_SIDE}"
        raise InputError(f"{text!r} is not a size", field="--size", expected=expected)
    return sides[0], sides[1]


def _members(archive: Path) -> Iterator[tuple[str, int, int, Callable[[], IO[bytes]]]]:
    """Name, size, number of all, and how to read it, of each file in an archive."""
    _check_file(archive)
    with _whole(archive):
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as opened:
                infos = [info for info in opened.infolist() if not info.is_dir()]
                for info in infos:
                    yield info.filename, info.file_size, len(infos), partial(opened.open, info)
        elif tarfile.is_tarfile(archive):
            with tarfile.open(archive) as tar:
                members = [member for member in tar.getmembers() if member.isfile()]
                # to the end, where the checksum of a compressed one is: tarfile stops before
                while tar.fileobj and tar.fileobj.read(2**20):
                    pass
                for member in members:
                    yield member.name, member.size, len(members), partial(_content, tar, member)
        else:
            raise InputError("is no archive that can be read", file=archive, expected="zip or tar")


def _content(tar: tarfile.TarFile, member: tarfile.TarInfo) -> IO[bytes]:
    content = tar.extractfile(member)
    assert content is not None  # a regular file
    return content


def _check_file(archive: Path) -> None:
    if not archive.is_file():
        raise InputError("no such file", file=archive, expected="a downloaded archive")


@contextmanager
def _whole(archive: Path) -> Iterator[None]:
    """What a damaged, encrypted or oddly packed archive raises, in one line."""
    broken = (zipfile.BadZipFile, tarfile.TarError, EOFError, zlib.error, lzma.LZMAError, gzip.BadGzipFile)
    try:
        yield
    except broken as error:
        raise InputError(f"is damaged ({error})", file=archive, expected="a whole download") from None
    except (NotImplementedError, RuntimeError) as error:  # of zipfile for unknown compression and encryption
        problem = f"cannot be unpacked ({error})"
        raise InputError(problem, file=archive, expected="zip or tar as published") from None
