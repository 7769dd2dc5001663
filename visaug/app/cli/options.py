"""What the commands share: the camera, the seed, an example in the help, one way to write results, and tables."""

import json
import shlex
from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import click

import visaug
from visaug.core.errors import InputError
from visaug.core.extras import check_installed
from visaug.core.files import check_place, is_result, write_json
from visaug.core.wording import printable

Decorator = Callable[[Callable], Callable]
STANDARD_OUTPUT = Path("-")


class _Path(click.Path):
    """A path, but not the empty one that an unset variable of the shell gives, which would be the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


PATH = _Path(path_type=Path)


class _Command(click.Command):
    """A command whose `--effects` takes several files: `--effects a.py b.py`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        spread: list[str] = []
        taking = False
        for word in args:
            if taking and word.endswith(".py") and spread[-1] != "--effects":
                spread.append("--effects")
            taking = word.startswith("--effects=") or word == "--effects" or (taking and word.endswith(".py"))
            spread.append(word)
        rest = super().parse_args(ctx, spread)
        _check_places(ctx)
        return rest


def _check_places(context: click.Context) -> None:
    """Refuse two options that write one file, of which only the last would stay, and a file that is called `-`."""
    writes = ("output", "json_path", "report_path", "defects_path", "maps_path", "poses_csv", "sheets")
    seen: dict[Path, str] = {}
    for option in context.command.params:
        given = context.params.get(option.name or "") if option.name in writes else None
        for path in given if isinstance(given, tuple) else (given,):
            if path == STANDARD_OUTPUT and option.name != "json_path":
                expected = "a name; --json alone writes to standard output"
                raise InputError("'-' is not a name", field=option.opts[0], expected=expected)
            if path is None or path == STANDARD_OUTPUT or (path.exists() and not path.is_file()):
                continue
            other = seen.setdefault(path.resolve(), option.opts[0])
            if other != option.opts[0]:
                problem = f"{other} and {option.opts[0]} name the same file"
                raise InputError(problem, file=path, expected="a name for each")


def with_default(name: str, kind: click.ParamType, default: Any, text: str) -> Decorator:
    """An option whose default the help shows."""
    return click.option(name, type=kind, default=default, show_default=True, help=text)


def choice_option(name: str, choices: Sequence[str], text: str) -> Decorator:
    """An option with a few choices, the first by default."""
    return with_default(name, click.Choice(choices), choices[0], text)


def command(name: str, example: str) -> Callable[[Callable], click.Command]:
    """A command with `--seed` and an example under its help."""
    epilog = "\b\nExample:\n  " + example.replace("\n", "\n  ")
    seeds = click.IntRange(0, 2**63 - 1)  # what torch takes
    seeded = with_default("--seed", seeds, 0, "Seed of all random numbers.")
    return lambda function: click.command(name, cls=_Command, epilog=epilog)(seeded(function))


def camera_option(required: bool = True, if_repeated: str = "") -> Decorator:
    """`--camera`; `if_repeated` says what a command that takes several does with them."""
    text = "A camera.yaml, or the name of a camera in the package or of your own (see `visaug cameras`)."
    names = "--camera camera_names" if if_repeated else "--camera camera_name"
    more = {"required": required, "multiple": bool(if_repeated)}
    return option(names, "CAMERA", f"{text} {if_repeated}".strip(), **more)


def check_result(context: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
    """Before any work: a file that visaug did not write is replaced with --force alone, where the command has it."""
    if any(parameter.name == "force" for parameter in context.command.params):
        may_replace(path, bool(context.params.get("force")))
    return path


def _check_report(context: click.Context, parameter: click.Parameter, path: Path | None) -> Path | None:
    """The same; and what reports are drawn and set with is installed."""
    if path is not None:
        check_installed("matplotlib", "jinja2", file=path)
    return check_result(context, parameter, path)


def option(names: str, metavar: str, text: str, **more: Any) -> Decorator:
    """An option with a value; `names` as "--json json_path"."""
    return click.option(*names.split(), metavar=metavar, help=text, **more)


def flag(names: str, text: str, **more: Any) -> Decorator:
    """An option without a value."""
    return click.option(*names.split(), is_flag=True, help=text, **more)


def path_option(names: str, metavar: str, text: str, **more: Any) -> Decorator:
    """An option that takes a path."""
    return option(names, metavar, text, type=PATH, **more)


def output_option(metavar: str, text: str, **more: Any) -> Decorator:
    return path_option("-o --output output", metavar, text, **more)


frames_argument = click.argument("frames_path", metavar="FRAMES", type=PATH)
force_option = click.option("--force", is_flag=True, is_eager=True, help="Overwrite existing files.")
json_option = path_option(
    "--json json_path",
    "F",
    "Write the result as JSON; `-` writes it to standard output and suppresses all other output.",
    callback=check_result,
)


def all_of(*options: Decorator) -> Decorator:
    """Several options as one decorator, in the order of the help."""
    return lambda function: reduce(lambda decorated, option: option(decorated), reversed(options), function)


# The options of a command that measures.
result_options = all_of(
    force_option,
    json_option,
    path_option("--report report_path", "F.html", "Write a report as one HTML file.", callback=_check_report),
    click.option("-q", "--quiet", is_flag=True, help="Print errors only, no progress and no tables."),
)


def _load_effects(_: click.Context, __: click.Parameter, files: tuple[Path, ...]) -> tuple[Path, ...]:
    """Loads them while the options are read, so that a camera file may name them."""
    from visaug.effects.catalogue import load_file

    for file in files:
        load_file(file)
    return files


def effects_option(
    text: str = "File with your own effects that the camera uses.", *, pass_on: bool = False
) -> Decorator:
    """`--effects FILE.py`, loaded before the command runs; handed to it as `effects` where `pass_on`."""
    text += " May be repeated."
    more = {"multiple": True, "callback": _load_effects, "expose_value": pass_on}
    return path_option("--effects effects", "FILE.py", text, **more)


bit_depth_option = option(
    "--bit-depth bit_depth",
    "N",
    "Bits of the converter, for example 12 for 12-bit data in 16-bit files.",
    type=click.IntRange(1, 32),
)


def may_write(path: Path | None, force: bool) -> None:
    """Refuse, before any work, a place where no file can be, and to overwrite what a user may have edited."""
    if path is None:
        return
    check_place(path)
    if path.is_file() and not force:
        raise InputError("already exists", file=path, expected="another name, or --force to overwrite it")


def may_replace(
    path: Path | None, force: bool, expected: str = "another name, or --force to replace it"
) -> None:
    """Refuse, before any work, a place where no file can be, and to replace a file that is no result of visaug."""
    if path is None or path == STANDARD_OUTPUT:
        return
    check_place(path)
    if path.is_file() and not force and not is_result(path):
        raise InputError("exists, and visaug did not write it", file=path, expected=expected)


def numbers(text: str, field: str) -> tuple[float, ...]:
    """Numbers of a list as ``0.1,0.5,2``."""
    try:
        return tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        problem = f"{text!r} is not a list of numbers"
        raise InputError(problem, field=field, expected="for instance 0.1,0.5,2") from None


def load_camera(name: str) -> "visaug.Camera":
    return visaug.Camera.load(name)


def load_frames(
    path: Path, resolution: tuple[int, int] | None, bit_depth: int | None, quiet: bool = False
) -> "visaug.FrameSet":
    """The frames; a line to standard error where those of a laboratory may have been taken for ordinary pictures."""
    frames = visaug.FrameSet.load(path, resolution, bit_depth)
    untold = frames.is_pictures and path.is_dir() and not (path / "frames.csv").exists()
    if untold and not quiet and (frames.bit_depth or 0) > 8:
        command = shlex.join(["visaug", "frames", str(path), "-o", str(path / "frames.csv")])
        said = "read as ordinary pictures, since no name or header tells bias, dark or flat frames"
        click.echo(f"{said}; if they are: {command}", err=True)
    return frames


def is_silent(quiet: bool, json_path: Path | None) -> bool:
    """Whether standard output is left to JSON, or to nothing."""
    return quiet or json_path == STANDARD_OUTPUT


def write_result(json_path: Path | None, content: Any) -> None:
    """The JSON of a result, to a file or to standard output."""
    if json_path == STANDARD_OUTPUT:
        click.echo(json.dumps(content, indent=2))
    elif json_path is not None:
        write_json(json_path, content)


def written(*paths: Path | None) -> None:
    """Say where results lie."""
    for path in paths:
        if path not in (None, STANDARD_OUTPUT):
            click.echo(f"wrote {path}")


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Cells wrap to a terminal's width; into a file or pipe a row is one line."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*head, box=None)
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))  # no markup in a cell
    terminal = Console()
    console = terminal if terminal.is_terminal else Console(width=240)
    with console.capture() as written:  # rich itself ends the program with status 1 where the reader has left
        console.print(table)
    click.echo(written.get(), nl=False)
