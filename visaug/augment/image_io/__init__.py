"""Pictures as files: PNG, TIFF, JPEG, WebP, BMP, NumPy and OpenEXR, gray or colour, with or without transparency."""

from collections.abc import Callable
from pathlib import Path

from visaug.augment.image_io.arrays import read_exr, read_npy, write_exr, write_npy
from visaug.augment.image_io.picture import Picture
from visaug.augment.image_io.pillow import read_with_pillow, write_with_pillow
from visaug.augment.image_io.png import read_png, write_png
from visaug.augment.image_io.tiff import read_tiff, write_tiff
from visaug.core.errors import InputError

Reader = Callable[[Path], Picture]
Writer = Callable[[Path, Picture], None]
FORMATS: dict[str, tuple[Reader, Writer]] = {
    ".png": (read_png, write_png),
    ".jpg": (read_with_pillow, write_with_pillow),
    ".jpeg": (read_with_pillow, write_with_pillow),
    ".tif": (read_tiff, write_tiff),
    ".tiff": (read_tiff, write_tiff),
    ".webp": (read_with_pillow, write_with_pillow),
    ".bmp": (read_with_pillow, write_with_pillow),
    ".npy": (read_npy, write_npy),
    ".exr": (read_exr, write_exr),
}
SUFFIXES = tuple(FORMATS)

__all__ = ["FORMATS", "SUFFIXES", "Picture", "read_picture", "write_picture"]


def read_picture(path: Path) -> Picture:
    """Read a picture; a palette becomes colour, one bit becomes eight. A file of several pictures is refused."""
    reader, _ = _format(path)
    try:
        return reader(path)
    except InputError:
        raise
    except Exception as error:  # decoders raise many kinds for damaged files
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(f"cannot be read ({why})", file=path, expected="an intact picture") from None


def write_picture(path: Path, picture: Picture) -> None:
    """Write in the format that the suffix names, if it holds such pictures. The same picture gives the same bytes."""
    _, writer = _format(path)
    try:
        writer(path, picture)
    except Exception as error:  # encoders raise many kinds
        if isinstance(error, InputError) or getattr(error, "errno", None) is not None:  # a full disk
            raise
        problem = f"cannot be written in the format of its suffix ({error})"
        raise InputError(problem, expected=f"a picture that {path.suffix} holds, or another suffix") from None


def _format(path: Path) -> tuple[Reader, Writer]:
    if path.suffix.lower() not in FORMATS:
        raise InputError("is not a picture", file=path, expected="a name ending in " + " ".join(SUFFIXES))
    return FORMATS[path.suffix.lower()]
