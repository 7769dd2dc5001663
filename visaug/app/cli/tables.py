"""Tables on the terminal."""

from collections.abc import Iterable, Sequence

from visaug.core.wording import printable


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
