"""Files and folders appear whole or not at all: written beside their place, flushed to the disk, then renamed.

What a killed process left half-written is removed by the next one that writes into the same folder.
"""

import json
import os
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import blake2b
from pathlib import Path
from typing import Any

from visaug.core.errors import InputError

DEFECTS = "row,column,type,height_dn\n"  # the first line of a list of defects
# what a page, an SVG and a PNG hold near their beginning, and JSON beside `schema`, if visaug wrote them
_MARKS = (b'<meta name="generator" content="visaug">', b"<dc:title>visaug</dc:title>", b"Software\0visaug")
_KEYS = {"answer", "error", "operating_points", "parameters"}
_HALF = ".visaug-half-"  # of what is being written; host and process follow
_OLD = ".visaug-old-"  # of a folder that is being replaced; its name follows
_HOST = blake2b(socket.gethostname().encode(), digest_size=4).hexdigest()
_cleaned: set[Path] = set()


def cache_folder() -> Path:
    """Where visaug keeps what it can make again: $VISAUG_CACHE, or `visaug` in the user's cache folder."""
    own, user = os.environ.get("VISAUG_CACHE"), os.environ.get("XDG_CACHE_HOME")
    return Path(own) if own else Path(user or Path.home() / ".cache") / "visaug"


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a path in the same folder to write to; it is renamed to `path` when the block ends well.

    The temporary name keeps the suffix, as many writers choose the format by it. Missing folders are made. A link stays a link:
    what it leads to is replaced. A device or a pipe gets the content when the block ends well. A folder is refused.
    """
    path = Path(path)
    check_place(path)
    is_special = _is_special(path)
    path = path if is_special else Path(os.path.realpath(path))
    folder = Path(tempfile.gettempdir()) if is_special else path.parent
    folder.mkdir(parents=True, exist_ok=True)
    remove_leftovers(folder)
    temporary: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=_prefix(), suffix=path.suffix, dir=folder)
        os.close(handle)
        temporary = Path(name)
        yield temporary
        if is_special:
            with open(path, "wb") as target:
                target.write(temporary.read_bytes())
            return
        temporary.chmod(0o666 & ~_umask())
        _flush(temporary)
        temporary.replace(path)
    except OSError as error:
        _name_place(error, path)
        raise
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def check_place(path: Path) -> None:
    """Refuse a path at which no file can be written: a folder, or one below a file or in a read-only folder."""
    if path.is_dir():
        raise InputError("is a folder", file=path, expected="the name of a file")
    if not _is_special(path):
        _check_folder(Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent)


def check_folder(path: Path) -> None:
    """Refuse the path of a folder that cannot be made or replaced."""
    _check_folder(path)
    place = Path(os.path.realpath(path))
    if not _is_held(place):
        _check_folder(place.parent)


def _is_held(place: Path) -> bool:
    """Whether a folder has to stay where it is: one that is mounted, or in which the caller's shell is, to which another folder
    of the same name would be a stranger.
    """
    try:
        here = Path.cwd()
    except FileNotFoundError:  # it was removed
        here = None
    return place.is_dir() and (os.path.ismount(place) or (here is not None and here.is_relative_to(place)))


def _is_special(path: Path) -> bool:
    """Whether a device or a pipe is there, which are written to and not replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _check_folder(path: Path) -> None:
    """Refuse the path of a folder that is a file, or lies below one, or into which nothing can be written."""
    for place in (path, *path.parents):
        if place.exists():
            if not place.is_dir():
                raise InputError("is a file", file=place, expected="a folder")
            if not os.access(place, os.W_OK | os.X_OK):
                raise InputError("is read-only", file=place, expected="a folder that you may write to")
            return


def _name_place(error: OSError, path: Path) -> None:
    """The name of a temporary file or folder tells a user nothing: the error names what was to be written."""
    name = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes | Path) else ""
    if error.errno is not None and (not name or _HALF in name):
        error.filename = os.fspath(path)


@contextmanager
def whole_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """Yield a folder beside `path` to fill; it becomes `path` when the block ends well.

    A file is refused, and so is a folder that holds something, unless `overwrite` says to replace all of it. A mounted folder, and
    that of the caller's shell, stays: what it holds is replaced, one entry after the other.
    """
    path = Path(path)
    check_folder(path)
    place = Path(os.path.realpath(path))  # a link stays a link: what it leads to is replaced
    is_held = _is_held(place)
    place.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(place if is_held else place.parent)
    old = place.parent / (_OLD + place.name)
    if old.exists():  # killed while one was being replaced
        if place.exists():
            shutil.rmtree(old)
        else:
            old.rename(place)
    if place.is_dir() and any(place.iterdir()) and not overwrite:
        raise InputError("is not empty", file=path, expected="a new or empty folder")
    temporary: Path | None = None
    try:
        temporary = Path(tempfile.mkdtemp(prefix=_prefix(), dir=place if is_held else place.parent))
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        for file in temporary.rglob("*"):
            if file.is_file():
                _flush(file)
        if is_held:
            _move_into(place, temporary)
            return
        if place.is_dir():
            place.rename(old)
        temporary.rename(place)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        _name_place(error, path)
        raise
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def _move_into(place: Path, temporary: Path) -> None:
    """Let what `temporary`, a folder inside `place`, holds take the place of all else there."""
    stale = [old for old in place.iterdir() if old != temporary]
    for new in list(temporary.iterdir()):
        there = place / new.name
        if there.is_dir() and not there.is_symlink():
            shutil.rmtree(there)
        new.replace(there)
        stale = [old for old in stale if old != there]
    for old in stale:
        shutil.rmtree(old) if old.is_dir() and not old.is_symlink() else old.unlink()


@contextmanager
def folder_lock(folder: str | Path) -> Iterator[None]:
    """Keep other commands from writing into the folder, which is made; refuse one that another process has, and a file.

    The lock ends with the process, however it ends. Where the system has no such locks, nothing is locked.
    """
    folder = Path(folder)
    _check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import fcntl
    except ModuleNotFoundError:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            problem = "another visaug command is writing there"
            expected = "another folder, or wait until it ends"
            raise InputError(problem, file=folder, expected=expected) from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove what processes of this machine that are gone left half-written, once for each folder."""
    if folder in _cleaned:
        return
    _cleaned.add(folder)
    for left in folder.glob(f"{_HALF}{_HOST}-*"):
        process = left.name.removeprefix(f"{_HALF}{_HOST}-").partition("-")[0]
        if process.isdigit() and not _runs(int(process)):
            shutil.rmtree(left) if left.is_dir() and not left.is_symlink() else left.unlink(missing_ok=True)


def _prefix() -> str:
    return f"{_HALF}{_HOST}-{os.getpid()}-"


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (OSError, OverflowError) as error:  # one of another user, or none
        return not isinstance(error, ProcessLookupError)
    return True


def _flush(file: Path) -> None:
    with open(file, "rb") as handle:
        os.fsync(handle)


def write_text(path: str | Path, text: str) -> None:
    """Write UTF-8 text whole."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_bytes(path: str | Path, content: bytes) -> None:
    """Write bytes whole."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: str | Path, value: Any) -> None:
    """Write JSON whole; NaN and infinities, which JSON lacks, are refused."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def write_yaml(path: str | Path, value: Any) -> None:
    """Write YAML whole, keys in the given order, short lists and mappings on one line."""
    import yaml

    write_text(path, yaml.safe_dump(value, sort_keys=False, default_flow_style=None, allow_unicode=True))


def is_result(path: Path) -> bool:
    """Whether a file is a result that visaug wrote, or empty: a page or picture that names it, a list of defects, or JSON with
    the keys of a result.
    """
    with open(path, "rb") as file:
        start = file.read(2048)
        if not start or any(mark in start for mark in _MARKS) or start.startswith(DEFECTS.encode()):
            return True
        if not start.lstrip().startswith(b"{"):
            return False
        try:
            content = json.loads(start + file.read())
        except ValueError:
            return False
    scores = all(
        isinstance(each, dict) and {"images", "poses_found"} <= each.keys() for each in content.values()
    )
    measured = content.get("schema") == 1 and bool(_KEYS & content.keys())
    return measured or content.keys() == {"warnings"} or (bool(content) and scores)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
