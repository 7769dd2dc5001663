"""Progress bars on the terminal for callables that take `progress(description, done, total)`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, int, int], None]


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """A `progress(description, done, total)` that draws one bar per description on standard error.

    A bar whose `done` reaches `total` stays; without a terminal one line per description is written.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    bars = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
    )
    tasks: dict[str, object] = {}

    def report(description: str, done: int, total: int) -> None:
        if description not in tasks:
            tasks[description] = bars.add_task(description, total=total)
            if not console.is_terminal:
                console.print(description)
        bars.update(tasks[description], completed=done, total=total)  # type: ignore[arg-type]

    with bars:
        yield report
