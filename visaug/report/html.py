"""One self-contained HTML page: sections of short text, tables and figures, pictures inline; and from what it was made."""

import base64
import hashlib
import io
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from visaug.core.extras import extra
from visaug.core.files import write_bytes, write_text
from visaug.core.wording import printable

if TYPE_CHECKING:
    import jinja2
    from matplotlib.figure import Figure as MatplotlibFigure

    from visaug.camera import Camera
    from visaug.frames import FrameSet
    from visaug.report.next_step import NextStep


@dataclass(frozen=True)
class Text:
    """A paragraph; `kind` sets it off as a finding, or as a note in small print. `command` is set below it as code."""

    text: str
    kind: Literal["plain", "finding", "note"] = "plain"
    command: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under a head; numbers are aligned right."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    strong: frozenset[int] = frozenset()  # rows that are set bold
    groups: Sequence[tuple[str, int]] = ()  # above the head: labels, each with the number of its columns

    def is_number(self, column: int) -> bool:
        cells = [row[column] for row in self.rows if column < len(row) and row[column].strip()]
        return bool(cells) and all(cell.strip()[0] in "+-−±.0123456789[" for cell in cells)


@dataclass(frozen=True)
class Figure:
    """A picture as a data URI, with a caption and a description (`alt`) for screen readers."""

    uri: str
    caption: str
    alt: str = ""
    wide: bool = True

    def save(self, stem: Path) -> Path:
        """Write the picture itself, whole, as `stem` with .png or .svg; returns the file."""
        head, content = self.uri.split(",", 1)
        path = stem.with_suffix(".svg" if "svg" in head else ".png")
        write_bytes(path, base64.b64decode(content))
        return path


Block = Text | Table | Figure


@dataclass(frozen=True)
class Section:
    """A heading and its content."""

    title: str
    blocks: Sequence[Block] = field(default_factory=list)

    @property
    def anchor(self) -> str:
        return "".join(c if c.isalnum() else "-" for c in self.title.lower()).strip("-")


@dataclass(frozen=True)
class Page:
    """A report: what was asked, the answer in a few facts, then the sections."""

    title: str
    lead: str
    sections: Sequence[Section]
    facts: Sequence[tuple[str, str]] = ()  # (value, what it is)
    footer: str = ""


def render(page: Page) -> str:
    """The page as HTML. It refers to nothing outside itself."""
    return template("page.html").render(page=page)


def next_text(step: "NextStep") -> Text:
    return Text(step.text, command=step.command)


def write_page(path: str | Path, page: Page) -> Path:
    write_text(path, render(page))
    return Path(path)


def figure(
    drawn: "MatplotlibFigure", caption: str, alt: str = "", *, wide: bool = True, raster: bool = False
) -> Figure:
    """A drawn figure for a page: SVG for curves, PNG (`raster`) where it holds images or many points."""
    with extra():
        import matplotlib as mpl

    buffer = io.BytesIO()
    # No date and fixed ids, so that the same data give the same bytes.
    form: dict = {"format": "svg", "metadata": {"Date": None, "Creator": "visaug"}}
    if raster:
        form = {"format": "png", "dpi": 140, "metadata": {"Software": "visaug"}}
    with mpl.rc_context({"svg.hashsalt": "visaug", "svg.fonttype": "path"}):
        drawn.savefig(buffer, **form, bbox_inches="tight", pad_inches=0.06)
    content = base64.b64encode(buffer.getvalue()).decode("ascii")
    kind = "png" if raster else "svg+xml"
    return Figure(f"data:image/{kind};base64,{content}", caption, alt or caption, wide)


@cache
def template(name: str) -> "jinja2.Template":
    """A template of this package, values escaped."""
    return templates("visaug.report").get_template(name)


def templates(package: str) -> "jinja2.Environment":
    """The templates of a package. Values are text: markup in them is escaped, and so is what cannot be seen."""
    with extra():
        import jinja2

    return jinja2.Environment(
        loader=jinja2.PackageLoader(package),
        autoescape=True,
        finalize=lambda v: printable(v) if type(v) is str else v,  # what a macro gives is no plain str
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


STARTED = time.monotonic()


def footer(camera: "Camera | None", frames: "FrameSet | None", seed: int | None = None) -> str:
    """Date, version, command, seed, inputs with hashes, and the time since the program started.
    `camera`: the camera file that was used.
    `frames`: the frames that were used; the hash covers their table, not their pixels.
    `seed`: of the simulations.
    """
    from visaug import __version__

    parts = [datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"), f"visaug {__version__}"]
    program = Path(sys.argv[0])
    if program.name == "visaug" or program.parts[-2:] == ("visaug", "__main__.py"):
        parts.append("visaug " + shlex.join(sys.argv[1:]))
    if seed is not None:
        parts.append(f"seed {seed}")
    if camera is not None:
        parts.append(f"camera {camera.name!r}, {_digest(camera.to_yaml())}")
    if frames is not None:
        table = "\n".join(str(record) for record in frames.records)
        parts.append(f"{len(frames.records)} frames, table {_digest(table)}")
    seconds = time.monotonic() - STARTED
    parts.append(f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min")
    return " · ".join(parts)


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "replace"), digest_size=6).hexdigest()
