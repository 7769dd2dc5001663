"""Statistics of simulated sets on disk, by name: what was simulated once is not simulated again, and interrupted work resumes.

One SQLite file holds all entries. An entry that does not match its checksum is removed and computed again, and so is a file that
is no database. The store has its own folder and touches nothing else.
"""

import hashlib
import sqlite3
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from visaug.core.files import cache_folder

MOST = 2**30  # largest size in bytes; the least recently used entries are removed first
CHECK_BYTES = 16
TABLE = "CREATE TABLE IF NOT EXISTS sets (name TEXT PRIMARY KEY, used REAL, content BLOB)"


def file() -> Path:
    return cache_folder() / "diagnosis" / "simulated.sqlite"


def load(names: Sequence[str]) -> dict[str, tuple[np.ndarray, ...]]:
    """The arrays of those entries that exist and are whole, by name."""
    found: dict[str, tuple[np.ndarray, ...]] = {}

    def read(base: sqlite3.Connection) -> None:
        for name in dict.fromkeys(names):
            row = base.execute("SELECT content FROM sets WHERE name = ?", (name,)).fetchone()
            if row is not None and (arrays := _unpacked(name, row[0])) is not None:
                found[name] = arrays
        now = time.time()
        base.executemany("UPDATE sets SET used = ? WHERE name = ?", [(now, name) for name in found])

    if file().is_file():
        _attempt(read)
    return found


def keep(entries: Mapping[str, Sequence[np.ndarray]]) -> None:
    """Writes entries of (n,) float64 arrays; a failure to write is ignored."""
    now = time.time()
    rows = [(name, now, _packed(name, arrays)) for name, arrays in entries.items()]

    def write(base: sqlite3.Connection) -> None:
        base.executemany("INSERT OR REPLACE INTO sets VALUES (?, ?, ?)", rows)
        _make_room(base)

    if rows:
        _attempt(write)


def _attempt(do: Callable[[sqlite3.Connection], None]) -> None:
    """Does something in the database, or gives it up. A file that is no database is removed."""
    place = file()
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        # `timeout`: seconds for another process that writes
        with closing(sqlite3.connect(place, timeout=5.0)) as base, base:
            base.execute("PRAGMA synchronous = OFF")  # a checksum guards every entry
            base.execute(TABLE)
            do(base)
    except (OSError, sqlite3.OperationalError):  # the disk is full, or another process writes for long
        pass
    except sqlite3.DatabaseError:
        place.unlink(missing_ok=True)


def _packed(name: str, arrays: Sequence[np.ndarray]) -> bytes:
    """A checksum, the number of arrays, their lengths, and their values."""
    lengths = np.array([len(arrays), *map(len, arrays)], "<i8").tobytes()
    content = b"".join([lengths, *(np.asarray(a, "<f8").tobytes() for a in arrays)])
    return _check(name, content) + content


def _unpacked(name: str, packed: bytes) -> tuple[np.ndarray, ...] | None:
    content = packed[CHECK_BYTES:]
    if packed[:CHECK_BYTES] != _check(name, content):
        return None
    try:
        count = int(np.frombuffer(content, "<i8", 1)[0])
        lengths = np.frombuffer(content, "<i8", count, 8)
        values = np.frombuffer(content, "<f8", int(lengths.sum()), 8 * (1 + count)).astype(float)
    except ValueError:  # whatever the bytes lead to
        return None
    return tuple(np.split(values, np.cumsum(lengths)[:-1]))


def _check(name: str, content: bytes) -> bytes:
    """Checksum of an entry and its name."""
    named = hashlib.blake2b(name.encode(), digest_size=32).digest()
    return hashlib.blake2b(content, digest_size=CHECK_BYTES, key=named).digest()


def _make_room(base: sqlite3.Connection) -> None:
    size = sum(base.execute("SELECT SUM(LENGTH(content)) FROM sets").fetchone())
    if size <= MOST:
        return
    oldest = base.execute("SELECT name, LENGTH(content) FROM sets ORDER BY used").fetchall()
    gone = []
    for name, length in oldest:
        if size <= 0.8 * MOST:  # room for a while, so that not every set removes another
            break
        gone.append((name,))
        size -= length
    base.executemany("DELETE FROM sets WHERE name = ?", gone)
