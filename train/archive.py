"""From a downloaded archive of SPEED or SPEED+ to a ready dataset: unpacked, checked, converted where asked.

Unpacking goes on where it was stopped, into ``NAME.partial``, which gets its name when all is there and
checked.
"""

import argparse
import bz2
import gzip
import lzma
import shutil
import sys
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO

from visaug.core.errors import InputError
from visaug.core.files import whole_file
from visaug_train.convert import convert
from visaug_train.geometry import Keypoints
from visaug_train.speed import domains, read_poses

Progress = Callable[[str, int, int], None]


def prepare_archive(archive: str | Path, destination: str | Path, progress: Progress | None = None) -> Path:
    """Unpack an archive (zip, tar, tar.gz ...) or take a folder, check it, and return the dataset's root."""
    archive, destination = Path(archive), Path(destination)
    if destination.is_dir():
        check(destination)
        return destination
    if archive.is_dir():
        check(find_root(archive))
        return find_root(archive)
    partial = destination.with_name(destination.name + ".partial")
    unpack(archive, partial, progress)
    root = find_root(partial)
    check(root)
    root.rename(destination)
    if partial.exists():
        shutil.rmtree(partial)
    return destination


def unpack(archive: Path, folder: Path, progress: Progress | None = None) -> None:
    """Writes missing members to `folder`; a member outside it is refused."""
    for done, (name, size, total, read) in enumerate(_members(archive), start=1):
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts:
            raise InputError(
                f"holds {name}, which would lie outside", file=archive, expected="a SPEED archive"
            )
        target = folder / path
        if not target.is_file() or target.stat().st_size != size:
            with (
                _whole(archive),
                whole_file(target) as temporary,
                temporary.open("wb") as out,
                read() as content,
            ):
                shutil.copyfileobj(content, out)
        if progress:
            progress("unpacking", done, total)


def find_root(folder: Path) -> Path:
    """The folder inside `folder`, at most three levels down, that has SPEED's or SPEED+'s layout."""
    candidates = [
        folder,
        *sorted(p for depth in ("*", "*/*", "*/*/*") for p in folder.glob(depth) if p.is_dir()),
    ]
    for candidate in candidates:
        listed = (candidate / "camera.json").is_file() or (candidate / "train.json").is_file()
        if listed and candidate.name != "synthetic":
            return candidate
    raise InputError("has no SPEED or SPEED+ layout", file=folder, expected="camera.json or train.json in it")


def check(root: Path) -> dict[str, int]:
    """Read every domain and split, which checks them; returns the number of images of each."""
    found = {
        f"{domain}/{split}": len(read_poses(root, domain, split))
        for domain, splits in domains(root).items()
        for split in splits
    }
    return found


def main(arguments: list[str] | None = None) -> int:
    """The command line; 2 with one line on bad input."""
    parser = argparse.ArgumentParser(
        prog="prepare_speed",
        description="Unpack and check a SPEED or SPEED+ archive.",
        epilog="example: prepare_speed speedplusv2.zip -o datasets/speedplus --size 640x400",
    )
    parser.add_argument("archive", type=Path, help="the downloaded archive, or a folder already unpacked")
    parser.add_argument("-o", "--output", type=Path, required=True, help="where the dataset goes")
    parser.add_argument("--size", help="also write ultralytics labels with copies of WIDTHxHEIGHT beside it")
    parser.add_argument("--keypoints", default="tango", help="a keypoints file; Tango's where left out")
    given = parser.parse_args(arguments)
    from visaug.core.progress import progress_bars

    try:
        size = _size(given.size)
        with progress_bars() as progress:
            root = prepare_archive(given.archive, given.output, progress)
            for name, count in check(root).items():
                print(f"{name}: {count} images")
            if size is not None:
                first, splits = next((d, s) for d, s in domains(root).items() if "train" in s)
                names = {"train": "train", "validation": "val", "test": "test"}
                parts = {names[split]: read_poses(root, first, split) for split in splits}
                place = given.output.with_name(f"{given.output.name}-{size[0]}x{size[1]}")
                print(f"labels: {convert(parts, Keypoints.load(given.keypoints), place, size, progress)}")
    except (InputError, OSError) as error:
        print(f"prepare_speed: {error}", file=sys.stderr)
        return 2
    print(f"ready: {root}")
    return 0


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) > 0 and int(height) > 0):
        raise InputError(f"{text!r} is not a size", field="--size", expected="WIDTHxHEIGHT such as 640x400")
    return int(width), int(height)


def _members(archive: Path) -> Iterator[tuple[str, int, int, Callable[[], IO[bytes]]]]:
    """Name, size, number of all, and how to read it, of each file in an archive."""
    if not archive.is_file():
        raise InputError("no such file", file=archive, expected="a downloaded archive")
    with _whole(archive):
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as opened:
                files = [info for info in opened.infolist() if not info.is_dir()]
                for info in files:
                    yield info.filename, info.file_size, len(files), lambda info=info: opened.open(info)
        elif tarfile.is_tarfile(archive):
            _check_stream(archive)
            with tarfile.open(archive) as opened:
                files = [member for member in opened.getmembers() if member.isfile()]
                for member in files:
                    yield member.name, member.size, len(files), lambda m=member: opened.extractfile(m)  # type: ignore[return-value]
        else:
            raise InputError("is no archive that can be read", file=archive, expected="zip or tar")


@contextmanager
def _whole(archive: Path) -> Iterator[None]:
    """What a damaged, encrypted or oddly packed archive raises, in one line."""
    try:
        yield
    except (
        zipfile.BadZipFile,
        tarfile.TarError,
        EOFError,
        zlib.error,
        lzma.LZMAError,
        gzip.BadGzipFile,
    ) as error:
        raise InputError(f"is damaged ({error})", file=archive, expected="a whole download") from None
    except (
        NotImplementedError,
        RuntimeError,
    ) as error:  # raised by zipfile for unknown compression and encryption
        raise InputError(
            f"cannot be unpacked ({error})", file=archive, expected="zip or tar as published"
        ) from None


def _check_stream(archive: Path) -> None:
    """Read a compressed tar to its end, where its checksum is: tarfile stops before, and has none of the content."""
    with archive.open("rb") as file:
        head = file.read(6)
    opener = {b"\x1f\x8b": gzip.open, b"BZ": bz2.open}.get(head[:2]) or (
        lzma.open if head == b"\xfd7zXZ\0" else None
    )
    if opener:
        with opener(archive) as stream:
            while stream.read(2**20):
                pass


if __name__ == "__main__":
    sys.exit(main())
