"""What `visaug augment` has made in a folder: with which settings, from which state of each original, and which bytes."""

import hashlib
import json
import os
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from visaug.core.documents import parse_json
from visaug.core.errors import InputError
from visaug.core.files import folder_lock

JOURNAL = ".visaug-augment.jsonl"


class Journal:
    """Which copies in a folder are done.

    One line of JSON a file, written after the file is in place; other settings start it anew. A copy is done if its
    original and the copy itself are as they were then. One command at a time writes into the folder.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]) -> None:
        self.folder, self.path = folder, folder / JOURNAL
        self.head = json.dumps({"settings": settings}, sort_keys=True)
        self.done: dict[str, dict[str, Any]] = {}
        self._open = ExitStack()

    def __enter__(self) -> "Journal":
        with ExitStack() as opening:
            opening.enter_context(folder_lock(self.folder))
            if self.path.is_symlink():
                raise InputError("is a link", file=self.path, expected="a file that visaug wrote, or none")
            lines = self.path.read_bytes().split(b"\n") if self.path.exists() else [b""]
            same = lines[0] == self.head.encode()
            for line in lines[1:] if same else []:
                try:
                    entry = parse_json(line.decode())
                    self.done[entry["name"]] = {key: entry[key] for key in ("original", "copy")}
                except (InputError, UnicodeDecodeError, TypeError, KeyError):  # torn, or from elsewhere
                    continue
            self._handle = opening.enter_context(open(self.path, "a" if same else "w", encoding="utf-8"))
            # A line feed first closes a line that an interruption tore.
            self._handle.write("\n" if same else self.head + "\n")
            self._handle.flush()
            self._open = opening.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def holds(self, name: str, source: Path) -> bool:
        """Whether the copy is there, whole, and made from the original as it is now."""
        made = self.done.get(name)
        if made is None or made["original"] != _state(source):
            return False
        try:
            return made["copy"] == _content(self.folder / name)
        except OSError:
            return False

    def add(self, name: str, source: Path) -> None:
        """The copy is in its place."""
        entry = {"name": name, "original": _state(source), "copy": _content(self.folder / name)}
        self._handle.write(json.dumps(entry) + "\n")
        self._handle.flush()


def _state(path: Path) -> list[int]:
    """Size and time of change, by which an original is known again."""
    status = path.stat()
    return [status.st_size, status.st_mtime_ns]


def _content(path: Path) -> list[int | str]:
    """Size and checksum, by which a copy is known to be whole."""
    with open(path, "rb") as file:
        return [os.fstat(file.fileno()).st_size, hashlib.file_digest(file, "sha256").hexdigest()]
