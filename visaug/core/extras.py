"""Packages that only an extra of visaug installs: a missing one is one line that names the extra."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from visaug.core.errors import InputError

# Extras of pyproject.toml, and the top-level modules that each installs.
_MODULES = {
    "kornia": "kornia kornia_rs",
    "measure": "astropy tifffile matplotlib jinja2",
    "lab": "starlette uvicorn",
    "train": "ultralytics cv2 torchvision visaug_train",
    "cluster": "ray",
    "raw": "rawpy h5py",
    "exr": "OpenEXR",
}
EXTRAS = {module: extra for extra, modules in _MODULES.items() for module in modules.split()}


@contextmanager
def extra(file: str | Path | None = None, field: str | None = None) -> Iterator[None]:
    """Around imports: a missing package of an extra becomes an InputError, which names the file or field that needs it; any other
    stays ModuleNotFoundError.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        name = (error.name or "").split(".")[0]
        if name not in EXTRAS:
            raise
        raise _missing(name, file, field) from None


def check_installed(*modules: str, file: str | Path | None = None) -> None:
    """Raise InputError where one of the modules is missing, without importing it: before long work that needs it."""
    for name in modules:
        with suppress(ValueError):  # no package, but an entry of sys.modules without a specification
            if find_spec(name) is not None:
                continue
        raise _missing(name, file, None)


def _missing(name: str, file: str | Path | None, field: str | None) -> InputError:
    expected = f"pip install 'visaug[{EXTRAS[name]}]'"
    return InputError(f"{name} is not installed", file=file, field=field, expected=expected)
