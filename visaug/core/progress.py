"""Progress bars on the terminal for callables that take `progress(description, done, total)`."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from time import monotonic

EVERY_S = 30.0  # seconds between lines where there is no terminal: what a log of an hour can bear
# how a step begins: the name of its phase
WORDS = dict.fromkeys(("trying again", "following"), "refitting")
WORDS |= {"trying": "trying", "refining": "refining", "limit of": "limits"}
FOUND = " found: "
Progress = Callable[[str, int, int], None]


@contextmanager
def progress_bars(single: bool = False, quiet: bool = False) -> Iterator[Progress]:
    """A `progress(description, done, total)` that draws bars on standard error.

    A bar names the step, k of n, and the time left; one whose `done` reaches `total` stays. `single` draws one bar for everything,
    not one per description; `quiet` nothing. Without a terminal a line is written at the start of a phase, and every `EVERY_S`
    seconds where it takes longer.
    """
    if quiet:
        yield lambda *_: None
        return
    from rich import progress as rich
    from rich.console import Console

    console = Console(stderr=True)
    done_so_far = rich.TextColumn("{task.description}"), rich.BarColumn(), rich.MofNCompleteColumn()
    times = rich.TimeElapsedColumn(), rich.TextColumn("left"), rich.TimeRemainingColumn()
    bars = rich.Progress(*done_so_far, *times, console=console, disable=not console.is_terminal)
    tasks: dict[str, rich.TaskID] = {}
    named: set[str] = set()
    current, told = "", 0.0
    # of the phase: when it began, how much was done then, and how much at last
    began, first, last = 0.0, 0, 0

    def write_line(phase: str, description: str, done: int, total: int) -> None:
        nonlocal current, began, first, last, told
        now, new = monotonic(), phase not in named
        named.add(phase)
        if phase != current or done < last or done == 0:  # a phase that comes again has its own time
            current, began, first = phase, now, done
        last = done
        if new:
            console.print(phase)
        elif now - told >= EVERY_S and done < total:
            left = ""
            if done > first:
                left = f", about {clock((now - began) * (total - done) / (done - first))} left"
            console.print(f"{description} ({done} of {total}){left}")
        else:
            return
        told = now

    def report(description: str, done: int, total: int) -> None:
        key = "" if single else description
        if key not in tasks:
            tasks[key] = bars.add_task(description, total=total)
        if not console.is_terminal:
            write_line(phase_of(description) if single else description, description, done, total)
        bars.update(tasks[key], description=description, completed=done, total=total)

    with bars:
        yield report


def clock(seconds: float) -> str:
    """A duration in words, in seconds below two minutes and in minutes beyond."""
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def phase_of(description: str) -> str:
    """One phase for all effects that are tried, one for all that are refined; what was found before it, see `beside`, is kept."""
    before, colon, step = description.rpartition(FOUND)
    phase = next((name for word, name in WORDS.items() if step.startswith(f"{word} ")), None)
    return before + colon + (f"{phase}, one effect after the other" if phase else step)


def beside(report: Progress, found: Sequence[str]) -> Progress:
    """Progress that names what was found so far before each step."""
    return lambda step, done, total: report(f"{' and '.join(found)}{FOUND}{step}", done, total)
