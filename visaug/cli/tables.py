"""Tables on the terminal."""

from collections.abc import Iterable, Sequence


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Cells wrap to a terminal's width; into a file or pipe a row is one line."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*head, box=None)
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))  # no markup in a cell
    terminal = Console()
    (terminal if terminal.is_terminal else Console(width=240)).print(table)


def printable(text: str) -> str:
    """The text as a terminal takes it: control characters and what is no Unicode are escaped."""
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)
