"""The command group, and the one place where a user's mistake becomes exit status 2."""

import gc
import io
import logging
import os
import re
import signal
import sys
import threading
from types import FrameType

import click

from visaug import __version__
from visaug.app.cli import cameras, learn, measure, pictures, take
from visaug.core.errors import InputError, NoSensorNoise, PartlyFailed, described, user_line
from visaug.core.wording import printable


class _Program(click.Group):
    """Ends with status 0 where the reader of the output has left, as `head` does; click itself would give 1."""

    def invoke(self, ctx: click.Context) -> object:
        try:
            result = super().invoke(ctx)
            if sys.stdout is not None:  # as it is where the output is closed
                sys.stdout.flush()
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            for stream in (sys.stdout, sys.stderr):  # which are flushed at the end
                os.dup2(nowhere, stream.fileno())
            sys.exit(0)
        return result


@click.group(cls=_Program, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="visaug")
def program() -> None:
    """Physical image-sensor noise: augment images, characterize a camera, find effects that its model lacks.

    \b
    Example:
      visaug augment photos/ -o noisy/ --camera sony_imx174 --gain-db 0:24
    """


on_pictures = pictures.augment, pictures.preview, pictures.example, cameras.cameras
on_frames = take.simulate, take.plan, take.frames, take.effects, take.inspect
of_cameras = measure.characterize, measure.compare, measure.diagnose, measure.lab
of_networks = learn.demo, learn.prepare, learn.train, learn.ablate, learn.evaluate
for command in (*on_pictures, *on_frames, *of_cameras, *of_networks):
    program.add_command(command)


class _Terminated(KeyboardInterrupt):
    """SIGTERM: ends what runs as Ctrl-C does, so that temporary files go."""


def _terminate(_signal: int, _frame: FrameType | None) -> None:
    raise _Terminated


def main(arguments: list[str] | None = None) -> None:
    """Run the program; ends the process with status 0, 1 where part of the work failed, 2 on bad input or an error of the
    operating system, 130 when interrupted, 143 when terminated.
    """
    gc.set_threshold(10_000)  # imports and compilation make hundreds of thousands of objects that stay
    # the error of a damaged file is one line, without the library's own
    logging.getLogger("tifffile").addHandler(logging.NullHandler())
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        # the terminal's encoding may not have the characters of a file's name
        sys.stdout.reconfigure(errors="backslashreplace")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _terminate)
    try:
        program.main(args=arguments, prog_name="visaug", standalone_mode=False)
    except click.ClickException as mistake:
        # click's own mistakes (unknown option, missing file) already carry status 2 or 1.
        if isinstance(mistake, click.UsageError) and mistake.format_message().startswith("Usage:"):
            mistake.show()  # no arguments at all: the help
        else:
            click.echo(f"visaug: {said(mistake)}", err=True)
        sys.exit(2)
    except (KeyboardInterrupt, click.exceptions.Abort) as stop:
        terminated = isinstance(stop, _Terminated) or isinstance(stop.__cause__, _Terminated)
        word = "terminated" if terminated else "interrupted"
        click.echo(f"visaug: {word}; run the same command again to resume", err=True)
        sys.exit(143 if terminated else 130)
    except PartlyFailed as partly:
        click.echo(printable(str(partly)))
        sys.exit(1)
    except NoSensorNoise as none:
        json_out = {"-", "--json=-"} & set(sys.argv if arguments is None else arguments)
        click.echo(str(none), err=bool(json_out))  # standard output is left to JSON
        sys.exit(0)
    except (InputError, OSError, MemoryError) as mistake:
        click.echo(f"visaug: {one_line(mistake)}", err=True)
        sys.exit(2)
    except Exception as failure:
        is_loop = str(failure).startswith("Symlink loop")  # pathlib's, which is no OSError
        fault = str(failure) if is_loop else users_fault(failure)
        if fault is None:
            raise
        click.echo(f"visaug: {fault}", err=True)
        sys.exit(2)


def said(mistake: click.ClickException) -> str:
    """click's message as one line like those of visaug, with where to look."""
    text = " ".join(mistake.format_message().split()).rstrip(".")
    if isinstance(mistake, click.MissingParameter) and "--camera" in getattr(mistake.param, "opts", ()):
        text = "--camera is missing; expected for example --camera sony_imx174 (`visaug cameras` lists all)"
    text = re.sub(r"is not a valid integer( range)?", "is not a whole number", text)
    text = re.sub(r"is not a valid float( range)?", "is not a number", text)
    context = getattr(mistake, "ctx", None)
    return printable(f"{text}; see `{context.command_path} --help`" if context else text)


def one_line(mistake: BaseException) -> str:
    """The message without line breaks; `file: what` for an operating system's error."""
    if isinstance(mistake, MemoryError):
        return f"not enough memory ({mistake})" if str(mistake) else "not enough memory"
    if isinstance(mistake, OSError) and mistake.strerror:
        place = "" if mistake.filename is None else f"{os.fsdecode(mistake.filename)}: "
        return printable(f"{place}{mistake.strerror}")
    return printable(" ".join(str(mistake).split()))


def users_fault(failure: Exception) -> str | None:
    """One line on an exception that a user's effect raised: file, line, what; None for any other."""
    at = user_line(failure)
    return at and printable(" ".join(f"{at}: {described(failure)}".split()))
