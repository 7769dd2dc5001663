"""Named sets of arrays on disk, protected by a checksum.

An entry is a checksum followed by an .npz without pickles. An entry that does not match its checksum or cannot be read is
removed and computed again. The store has its own folder and suffix and touches nothing else.
"""

import hashlib
import io
import os
import tempfile
import time
from pathlib import Path

import numpy as np

MOST = 2**30  # largest size in bytes; the least recently used entries are removed first
SUFFIX = ".arrays"
SCRATCH = ".writing-"  # prefix of files that are being written
STALE_S = 3600.0  # seconds after which such a file belongs to a process that was killed
CHECK_BYTES = 32


def folder() -> Path:
    """Folder of the entries: $VISAUG_CACHE, or a folder in the user's cache folder."""
    base = os.environ.get("VISAUG_CACHE")
    if not base:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "visaug"
    return Path(base) / "diagnosis"


def load(name: str) -> dict[str, np.ndarray] | None:
    """The arrays of an entry; None if it does not exist or is damaged."""
    path = folder() / f"{name}{SUFFIX}"
    try:
        content = path.read_bytes()
    except OSError:
        return None
    arrays = _unpack(name, content)
    try:
        if arrays is None:
            path.unlink()
        else:
            os.utime(path)
    except OSError:
        pass
    return arrays


def keep(name: str, arrays: dict[str, np.ndarray]) -> None:
    """Writes an entry; a failure to write is ignored."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    content = buffer.getvalue()
    try:
        place = folder()
        place.mkdir(parents=True, exist_ok=True)
        handle, scratch = tempfile.mkstemp(prefix=SCRATCH, dir=place)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(_check(name, content) + content)
            os.replace(scratch, place / f"{name}{SUFFIX}")
        finally:
            Path(scratch).unlink(missing_ok=True)
        _make_room(place)
    except OSError:
        pass


def _unpack(name: str, content: bytes) -> dict[str, np.ndarray] | None:
    check, packed = content[:CHECK_BYTES], content[CHECK_BYTES:]
    if check != _check(name, packed):
        return None
    try:
        with np.load(io.BytesIO(packed), allow_pickle=False) as archive:
            return dict(archive)
    except Exception:  # whatever the bytes lead to
        return None


def _check(name: str, content: bytes) -> bytes:
    """Checksum of an entry and its name."""
    named = hashlib.blake2b(name.encode(), digest_size=CHECK_BYTES).digest()
    return hashlib.blake2b(content, digest_size=CHECK_BYTES, key=named).digest()


def _make_room(among: Path) -> None:
    for file in among.glob(f"{SCRATCH}*"):
        if time.time() - file.stat().st_mtime > STALE_S:
            file.unlink(missing_ok=True)
    files = []
    for file in among.glob(f"*{SUFFIX}"):
        try:
            files.append((file.stat(), file))
        except FileNotFoundError:  # another process made room meanwhile
            continue
    excess = sum(stat.st_size for stat, _ in files) - MOST
    for stat, file in sorted(files, key=lambda pair: pair[0].st_mtime_ns):
        if excess <= 0:
            break
        file.unlink(missing_ok=True)
        excess -= stat.st_size
