"""Camera files that others can rely on: every figure has a source or is marked as assumed.

`add_camera` keeps such a file among the user's own, `export_camera` writes what a maintainer needs to accept it.
"""

import hashlib
import re
import shutil
from pathlib import Path
from typing import Any

from visaug.camera.camera import Camera, camera_file, own_folder, shipped
from visaug.camera.maps import named_maps, set_map
from visaug.core.documents import parse_yaml
from visaug.core.errors import InputError
from visaug.core.files import whole_folder, write_bytes, write_text, write_yaml
from visaug.frames.pixels import suffix_of

# keys that are no figures
ABOUT = ("name", "source", "assumed", "licence", "randomize", "correlated", "reading")


def figures(content: dict[str, Any]) -> dict[str, Any]:
    """Every figure of a camera file by its path: `gain_db`, `read_noise.sigma_e`, `row_noise.sigma_e`."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        if key in ABOUT:
            continue
        if key == "effects":
            found |= {f"{e['name']}.{name}": v for e in value for name, v in e.items() if name != "name"}
        elif isinstance(value, dict):
            found |= {f"{key}.{name}": figure for name, figure in value.items()}
        else:
            found[key] = value
    return found


def documented(file: Path) -> Camera:
    """The camera of a file in which every figure has a source or is assumed.

    Raises:
        InputError: it is no camera; a figure has neither; one has both; or `assumed` names what is no figure of the file.
    """
    camera = Camera.load(file)
    content = parse_yaml(file.read_text(encoding="utf-8"), file)
    known, assumed, source = figures(content), camera.spec.assumed, camera.spec.source
    if not isinstance(source, dict):
        expected = "path: where it is from, such as {gain_e_per_dn: EMVA 1288 report of ...}"
        raise InputError(
            "does not name the source of each figure", file=file, field="source", expected=expected
        )
    for path, text in source.items():
        if not text.strip():
            raise InputError(
                "is empty", file=file, field=f"source.{path}", expected="where the figure is from"
            )
    told = {*source, *assumed}
    if untold := [path for path in known if not {path, path.partition(".")[0]} & told]:
        problem = f"{', '.join(untold)} {'has' if len(untold) == 1 else 'have'} neither a source nor an entry in `assumed`"
        raise InputError(problem, file=file, field="source", expected="one of the two for every figure")
    if both := sorted({*assumed} & source.keys()):
        raise InputError(f"{both[0]} has a source too", file=file, field="assumed", expected="one of the two")
    parts = {path.partition(".")[0] for path in known}
    if other := sorted({*assumed} - known.keys() - parts):
        raise InputError(
            f"{other[0]} is no figure of the file", file=file, field="assumed", expected="their paths"
        )
    return camera


def add_camera(file: str | Path, force: bool = False) -> Path:
    """Keep a documented camera file, with its measured maps, among the user's own; where it lies now.

    Its name is that in the file, in lower case with underscores.

    Raises:
        InputError: `documented` refuses the file; the name is that of a camera in the package, or taken and not `force`.
    """
    file = Path(file)
    if not file.is_file():
        problem = "is a folder" if file.is_dir() else "no such file"
        raise InputError(problem, file=file, expected="a camera.yaml")
    camera = documented(file)
    name = re.sub(r"[^a-z0-9]+", "_", camera.name.lower()).strip("_")
    if not name or len(name) > 64:  # it becomes a file's name
        raise InputError(
            f"is {camera.name!r}", file=file, field="name", expected="1 to 64 letters and digits"
        )
    if name in shipped():
        problem = f"{name} is a camera in the package"
        raise InputError(problem, file=file, field="name", expected="another name")
    target = own_folder() / f"{name}.yaml"
    if target.exists() and not force:
        raise InputError("already exists", file=target, expected="another name in the file, or --force")
    _copy(camera, file, target)
    return target


def export_camera(name: str | Path, destination: str | Path | None = None) -> Path:
    """A folder with the camera file, its maps and a page with its figures and their sources, as a maintainer reads it.

    Args:
        name: one of the user's cameras, or a file.
        destination: a new folder; NAME-camera where left out.

    Raises:
        InputError: `documented` refuses the file, it has no `licence`, or the folder holds something.
    """
    file = camera_file(name)
    camera = documented(file)
    if not camera.spec.licence:
        expected = "under which licence the figures may be passed on"
        raise InputError("is missing", file=file, field="licence", expected=expected)
    folder = Path(destination) if destination is not None else Path(f"{file.stem}-camera")
    with whole_folder(folder) as filled:
        target = filled / f"{file.stem}.yaml"
        _copy(camera, file, target)
        write_text(filled / "README.md", _page(camera, target))
    return folder


def _copy(camera: Camera, file: Path, target: Path) -> None:
    """The file as it is; where it names maps, these are copied to a folder beside and the file names them there."""
    maps = named_maps(camera.spec)
    if not maps:
        write_bytes(target, file.read_bytes())
        return
    content = parse_yaml(file.read_text(encoding="utf-8"), file)
    for effect, (name, key) in maps.items():
        name, mark, inside = name.partition("#")  # file.npz#key[0]
        source = (camera.folder or Path()) / name
        place = target.parent / f"{target.stem}_maps" / f"{effect}{suffix_of(source)}"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, place)
        set_map(content, key, place.relative_to(target.parent).as_posix() + mark + inside)
    write_yaml(target, content)


def _page(camera: Camera, file: Path) -> str:
    content = parse_yaml(file.read_text(encoding="utf-8"), file)
    assert isinstance(camera.spec.source, dict)  # `documented` saw to it
    source, assumed = camera.spec.source, {*camera.spec.assumed}
    rows = []
    for path, value in figures(content).items():
        part = path.partition(".")[0]
        where = source.get(path) or ("assumed" if path in assumed else source.get(part, "assumed"))
        rows.append([path, str(value), where])
    cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    further = [f"- {key}: {text}" for key, text in source.items() if key not in figures(content)]
    return "\n".join(
        [
            f"# {camera.name}",
            "",
            f"Licence of the figures: {camera.spec.licence}",
            "",
            f"`{file.name}`, SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()}",
            "",
            "| figure | value | source |",
            "| --- | --- | --- |",
            *(f"| {' | '.join(row)} |" for row in cells),
            *(["", "Further sources:", "", *further] if further else []),
            "",
            f"To accept it: copy `{file.name}` to `visaug/camera/data/`, add its row to the table of",
            "docs/cameras.md, and run `pytest tests/camera/test_camera_shipped.py`, which checks every camera file.",
            "",
        ]
    )
