"""What the commands share: the camera, the seed, an example in the help, and one way to write results."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from visaug.camera import Camera

Decorator = Callable[[Callable], Callable]


class _Command(click.Command):
    """A command whose `--effects` takes several files: `--effects a.py b.py`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        spread: list[str] = []
        taking = False
        for word in args:
            if taking and word.endswith(".py") and spread[-1] != "--effects":
                spread.append("--effects")
            taking = word == "--effects" or (taking and word.endswith(".py"))
            spread.append(word)
        return super().parse_args(ctx, spread)


def command(name: str, *, example: str) -> Callable[[Callable], click.Command]:
    """A command with `--seed` and an example under its help."""

    def decorate(function: Callable) -> click.Command:
        seeded = click.option(
            "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Same seed, same result."
        )(function)
        return click.command(name, cls=_Command, epilog="\b\nExample:\n  " + example.replace("\n", "\n  "))(
            seeded
        )

    return decorate


def camera_option(required: bool = True) -> Decorator:
    return click.option(
        "--camera",
        "camera_name",
        metavar="CAMERA",
        required=required,
        help="A camera.yaml, or the name of one that comes with visaug (see `visaug cameras`).",
    )


frames_argument = click.argument("frames_path", metavar="FRAMES", type=click.Path(path_type=Path))
json_option = click.option(
    "--json", "json_path", metavar="F", type=click.Path(path_type=Path), help="Write it as JSON."
)
report_option = click.option(
    "--report",
    "report_path",
    metavar="F.html",
    type=click.Path(path_type=Path),
    help="Write a one-file page.",
)


def output_option(metavar: str, text: str, **more: Any) -> Decorator:
    return click.option(
        "-o", "--output", "output", metavar=metavar, type=click.Path(path_type=Path), help=text, **more
    )


def load_camera(name: str) -> "Camera":
    from visaug.camera import Camera

    return Camera.load(name)


def written(path: Path | None) -> None:
    """Say where a result lies."""
    if path is not None:
        click.echo(f"wrote {path}")
