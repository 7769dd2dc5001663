"""A user's mistake: which file, which field, what was expected, in one line; and work of which a part failed."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import walk_tb

USER_MODULE = "visaug_user_"  # how the names of modules from a user's effect files begin


class InputError(ValueError):
    """Bad input by a user. The message is one line; commands print it and end with status 2.

    Args:
        problem: what is wrong, for instance ``"-1 is negative"``.
        file: the file at fault.
        field: the field, key path, column or row at fault.
        expected: what would have been right, for instance ``"a number of seconds, 0 or more"``.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        field: str | None = None,
        expected: str | None = None,
    ) -> None:
        self.problem, self.file, self.field, self.expected = problem, file, field, expected
        place = ": ".join(str(part) for part in (file, field) if part not in (None, ""))
        message = f"{place}: {problem}" if place else problem
        if expected:
            message += f" Expected {expected}" if message.endswith("?") else f"; expected {expected}"
        super().__init__(" ".join(message.split()))


@contextmanager
def naming(file: str | Path) -> Iterator[None]:
    """Around work on what a file holds: its InputErrors name the file."""
    try:
        yield
    except InputError as mistake:
        raise InputError(mistake.problem, file=file, field=mistake.field, expected=mistake.expected) from None


class NoSensorNoise(InputError):
    """Pictures without noise, as renders are: no fault of the user's, and nothing is measured. Commands end with status 0."""


class PartlyFailed(Exception):
    """Work that was done but for a part. The message is what there is to tell; commands print it and end with status 1."""


@contextmanager
def readable(file: str | Path, hint: str) -> Iterator[None]:
    """Around the reading of a file: what libraries raise for a damaged one, of many kinds, becomes an InputError.

    `hint` is what may be wrong with it, for instance ``truncated, or not a TIFF file``.
    """
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("no such file", file=file) from None
    except Exception as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read ({reason}); {hint}", file=file) from None


def described(error: BaseException) -> str:
    """Kind and text of an exception, whose own text may fail."""
    try:
        return f"{type(error).__name__}: {error}"
    except Exception:
        return type(error).__name__


def with_user_line(error: Exception) -> Exception:
    """The exception, with what `user_line` tells of it kept on its way to another process, which loses the traceback."""
    vars(error)["_user_line"] = user_line(error)
    return error


def user_line(error: BaseException) -> str | None:
    """`file: line n` of a user's effect file that raised the exception; None where no such file took part."""
    at = vars(error).get("_user_line")
    for frame, line in walk_tb(error.__traceback__):
        if str(frame.f_globals.get("__name__", "")).startswith(USER_MODULE):
            at = f"{frame.f_code.co_filename}: line {line}"
    return at
