"""The one way from a result up to its report: no room imports one above it, so the package says here who writes reports."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

Writer = Callable[[Path, Any], object]
_writer: list[Writer] = []


def set_writer(writer: Writer) -> None:
    """Names the function that writes the report of any result: `writer(path, result)`."""
    _writer[:] = [writer]


class Reported:
    """A result that can write its report."""

    def report(self, path: str | Path) -> Path:
        """Writes the report as one HTML file, whose path is returned; a comparison also writes the pictures of its views into a
        folder beside it.
        """
        (writer,) = _writer
        writer(Path(path), self)
        return Path(path)
