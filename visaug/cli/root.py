"""The command group, and the one place where a user's mistake becomes exit status 2."""

import sys

import click

from visaug import __version__
from visaug.cli import learn, measure, take
from visaug.errors import InputError


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="visaug")
def program() -> None:
    """Physical image-sensor noise: augment images, characterize a camera, find the effect its model lacks.

    \b
    Example:
      visaug augment photos/ -o noisy/ --camera sony_imx174 --seed 1
    """


for module in (take, measure, learn):
    for command in module.COMMANDS:
        program.add_command(command)


def main(arguments: list[str] | None = None) -> None:
    """Run the program; ends the process with status 0, 2 on bad input, 130 when interrupted."""
    try:
        program.main(args=arguments, prog_name="visaug", standalone_mode=False)
    except click.ClickException as mistake:
        # click's own mistakes (unknown option, missing file) already carry status 2 or 1.
        mistake.show()
        sys.exit(2)
    except (InputError, FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as mistake:
        click.echo(f"visaug: {one_line(mistake)}", err=True)
        sys.exit(2)
    except (KeyboardInterrupt, click.exceptions.Abort):
        click.echo("visaug: interrupted; run the same command again to go on", err=True)
        sys.exit(130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)


def one_line(mistake: Exception) -> str:
    """The message without line breaks; `file: what` for an operating system's error."""
    if isinstance(mistake, OSError) and mistake.filename is not None:
        return f"{mistake.filename}: {mistake.strerror or 'cannot be used'}"
    return " ".join(str(mistake).split())
