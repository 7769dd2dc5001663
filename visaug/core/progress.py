"""Progress bars on the terminal for callables that take `progress(description, done, total)`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, int, int], None]


@contextmanager
def progress_bars(single: bool = False, quiet: bool = False) -> Iterator[Progress]:
    """A `progress(description, done, total)` that draws bars on standard error.

    A bar whose `done` reaches `total` stays; without a terminal one line per phase is written.

    Args:
        single: one bar for everything, which shows what is being done and how much of that is left; else one per description.
        quiet: draw and write nothing.
    """
    if quiet:
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    bars = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        disable=not console.is_terminal,
    )
    tasks: dict[str, TaskID] = {}
    phases: set[str] = set()

    def report(description: str, done: int, total: int) -> None:
        key = "" if single else description
        if key not in tasks:
            tasks[key] = bars.add_task(description, total=total)
        phase = phase_of(description) if single else description
        if not console.is_terminal and phase not in phases:
            phases.add(phase)
            console.print(phase)
        bars.update(tasks[key], description=description, completed=done, total=total)

    with bars:
        yield report


def phase_of(description: str) -> str:
    """One phase for all effects that are tried, one for all that are refined."""
    for word in ("refitting with", "trying again", "trying", "refining"):
        if description.startswith(f"{word} "):
            return f"{word} each effect"
    return description
