"""What `visaug augment` has made in a folder: which files, of what, and with which content."""

import hashlib
import json
import os
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from visaug.core import __version__
from visaug.core.documents import parse_json
from visaug.core.errors import InputError
from visaug.core.files import folder_lock

if TYPE_CHECKING:
    from visaug.augment.sensor_noise import SensorNoise

JOURNAL = ".visaug-augment.jsonl"


class Journal:
    """The files that visaug made in a folder.

    Lines of JSON, the last of a name counts: one before a file is written, so that an interrupted run knows it as its own,
    and one after. A file is done if it is there as it was written and was made of the same: settings, code, maps and original,
    as one hash.
    One command at a time writes into the folder. With `force`, files that visaug did not write may be replaced.
    """

    def __init__(self, folder: Path, force: bool = False) -> None:
        self.folder, self.path, self.force = folder, folder / JOURNAL, force
        self.made: dict[str, dict[str, str]] = {}
        self._open = ExitStack()

    def __enter__(self) -> "Journal":
        with ExitStack() as opening:
            opening.enter_context(folder_lock(self.folder))
            if self.path.is_symlink():
                raise InputError("is a link", file=self.path, expected="a file that visaug wrote, or none")
            self.made = made_in(self.folder)
            handle = open(self.path, "a", encoding="utf-8", errors="surrogateescape")
            self._handle = opening.enter_context(handle)
            self._handle.write("\n")  # closes a line that an interruption tore
            self._open = opening.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def holds(self, name: str, of: str) -> bool:
        """Whether the file is there, as visaug left it, and made of the same."""
        return self.made.get(name, {}).get("of") == of and self._as_left(name)

    def check_new(self, names: list[str]) -> None:
        """Refuses, before any work, names at which something lies that visaug did not write."""
        foreign = [name for name in names if name not in self.made and place_of(self.folder, name).exists()]
        if foreign and not self.force:
            more = f" (and {len(foreign) - 1} more)" if len(foreign) > 1 else ""
            problem = f"exists, and visaug did not write it{more}"
            raise _not_replaced(problem, place_of(self.folder, foreign[0]))

    def begin(self, name: str) -> None:
        """The file is about to be written; see `check`."""
        self.check(name)
        self._add(name)

    def check(self, name: str) -> None:
        """Refuses a place at which a file lies that is not as visaug left it."""
        place = place_of(self.folder, name)
        left = self.made.get(name, {}).get("copy")
        if place.exists() and not self.force and (left is None or (left and not self._as_left(name))):
            changed = "was changed since visaug wrote it"
            raise _not_replaced(changed if left else "exists, and visaug did not write it", place)

    def add(self, name: str, of: str) -> None:
        """The file is in its place."""
        place = place_of(self.folder, name)
        self._add(name, of, content_of(place), str(place.stat().st_size))

    def _as_left(self, name: str) -> bool:
        """Whether the file has the content that visaug wrote; its size tells most others without reading them."""
        place, left = place_of(self.folder, name), self.made[name]
        if not place.is_file() or left["bytes"] not in ("", str(place.stat().st_size)):
            return False
        return content_of(place) == left["copy"]

    def _add(self, name: str, of: str = "", copy: str = "", size: str = "") -> None:
        self.made[name] = {"of": of, "copy": copy, "bytes": size}
        # a name that is not UTF-8 is written as the bytes that it is: an escape of them would be no text
        self._handle.write(json.dumps({"name": name, **self.made[name]}, ensure_ascii=False) + "\n")
        self._handle.flush()


def _not_replaced(problem: str, place: Path) -> InputError:
    return InputError(problem, file=place, expected="another output folder, or --force to replace it")


def place_of(folder: Path, name: str) -> Path:
    """Path of a file by its name below the folder, or beside it: `../labels/a.txt`, as YOLO labels are."""
    return Path(os.path.normpath(folder / name)) if Path(name).parts[:1] == ("..",) else folder / name


def made_in(folder: Path) -> dict[str, dict[str, str]]:
    """What visaug made in a folder: names below it, and what the journal holds of each."""
    path, made = folder / JOURNAL, {}
    for line in path.read_bytes().split(b"\n") if path.is_file() else []:
        try:
            entry = parse_json(line.decode(errors="surrogateescape"))
            known = {"of": str(entry["of"]), "copy": str(entry["copy"])}
            made[str(entry["name"])] = {**known, "bytes": str(entry.get("bytes", ""))}
        except (InputError, TypeError, KeyError):  # torn, or from elsewhere
            continue
    return made


def content_of(path: Path) -> str:
    """Checksum of a file."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def settings_of(noise: "SensorNoise", seed: int, p: float, bits: int | None, options: dict[str, Any]) -> str:
    """One hash of all that makes a copy but its name and original: options, cameras, measured maps, the code of visaug and
    of effects from files.
    """
    from visaug.effects.catalogue import loaded_files

    digest = hashlib.blake2b(digest_size=16)
    words = [seed, p, bits, sorted((key, str(value)) for key, value in options.items())]
    words += [camera.to_yaml() for camera in noise.cameras]
    digest.update(repr((__version__, words)).encode())
    for camera in noise.cameras:
        for name, values in sorted(camera.maps.items()):
            digest.update(name.encode() + values.detach().cpu().numpy().tobytes())
    root, rooms = Path(__file__).resolve().parents[1], ("core/sampling", "effects", "camera", "augment")
    own = [file for room in rooms for file in (root / room).rglob("*.py")]
    for file in [*sorted(own), *loaded_files()]:
        digest.update(file.read_bytes())
    return digest.hexdigest()


def made_of(settings: str, name: str, source: Path) -> str:
    """The hash by which a copy is known to be done."""
    content = hashlib.blake2b(source.read_bytes(), digest_size=16)
    content.update(f"{settings}/{name}".encode(errors="surrogateescape"))
    return content.hexdigest()
