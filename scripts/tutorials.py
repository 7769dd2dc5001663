"""Run the tutorials and write their pages, with the text and the figures that they print.

    python scripts/tutorials.py [NAME ...]     without names: every tutorial of docs/tutorials

A tutorial is a Python file in jupytext's percent format: `jupytext --to ipynb FILE` makes a notebook of it.
"""

import argparse
import ast
import contextlib
import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "tutorials"


@dataclass(frozen=True)
class Cell:
    """A cell of a notebook: Markdown or Python."""

    text: str
    is_code: bool


def cells(path: Path) -> list[Cell]:
    """The cells of a file in percent format; what stands before the first mark is left out."""
    found = []
    for part in path.read_text().split("\n# %%")[1:]:
        head, _, body = part.partition("\n")
        is_code = "[markdown]" not in head
        lines = body.strip("\n").splitlines()
        text = "\n".join(lines if is_code else [line.removeprefix("#").removeprefix(" ") for line in lines])
        found.append(Cell(text.strip("\n"), is_code))
    return found


def run(cell: Cell, names: dict[str, Any]) -> tuple[str, Any]:
    """Execute a cell as a notebook does. Returns what it printed and the value of its last expression."""
    tree, value = ast.parse(cell.text), None
    last = tree.body[-1] if tree.body else None
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        if isinstance(last, ast.Expr):
            tree.body.pop()
        exec(compile(tree, "<cell>", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "<cell>", "eval"), names)
    return printed.getvalue(), value


def page(path: Path) -> str:
    """The Markdown of a tutorial; its figures are written beside it."""
    from matplotlib.figure import Figure

    names: dict[str, Any] = {}
    parts, figures = [], 0
    for cell in cells(path):
        if not cell.is_code:
            parts.append(cell.text)
            continue
        printed, value = run(cell, names)
        parts.append(f"```python\n{cell.text}\n```")
        if value is not None and not isinstance(value, Figure):
            printed += f"{value!r}\n"
        if printed:
            parts.append(f"```text\n{printed.rstrip()}\n```")
        if isinstance(value, Figure):
            figures += 1
            file = path.with_name(f"{path.stem}_{figures}.png")
            value.savefig(file, dpi=80)
            parts.append(f"![Figure {figures}]({file.name})")
    foot = f"*This page is [`{path.name}`]({path.name}), a notebook in jupytext's\npercent format, with its output.*"
    return "\n\n".join([*parts, foot]) + "\n"


def main() -> None:
    """Write the pages of the named tutorials, or of all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="such as find_missing_effect")
    names = parser.parse_args().names or [path.stem for path in sorted(FOLDER.glob("*.py"))]
    os.chdir(ROOT)
    for name in names:
        path = FOLDER / f"{name}.py"
        path.with_suffix(".md").write_text(page(path))
        print(path.with_suffix(".md"))


if __name__ == "__main__":
    main()
