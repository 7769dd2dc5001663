"""One frame's pixels from one file, whatever its format."""

import os
import re
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError, readable
from visaug.frames import fits, hdf5, photo, portable, ser, xisf
from visaug.frames.arrays import ArrayStore
from visaug.frames.limits import Index, check_numbers, check_shape, opened_tiff, outside, pillow_image
from visaug.frames.raw import read_raw

ARRAYS = (".npy", ".npz")
HDF5 = hdf5.SUFFIXES
TIFFS = (".tif", ".tiff")
FITS = fits.SUFFIXES
PHOTOS = photo.SUFFIXES
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm")
SUFFIXES = (*ARRAYS, *HDF5, *TIFFS, *FITS, xisf.SUFFIX, ser.SUFFIX, *PICTURES, *PHOTOS, ".raw")
_FRAGMENT = re.compile(r"^(?P<key>[^\[\]]*)(\[(?P<index>\s*([0-9]{1,9}|:)(\s*,\s*([0-9]{1,9}|:))*\s*)\])?$")


def split_name(name: str) -> tuple[str, str | None, Index]:
    """``file.npz#frames[3,0]`` as file, key and index; without ``#`` key None and index (). ``[:,:,3]`` counts the last axis.

    A ``#`` that does not follow the ending of a frame format is part of the file's name, as in ``bias #3.tif``.
    """
    marks = (at for at, sign in enumerate(name) if sign == "#")
    mark = next((at for at in marks if suffix_of(Path(name[:at])) in SUFFIXES), None)
    if mark is None:
        return name, None, ()
    file, fragment = name[:mark], name[mark + 1 :]
    match = _FRAGMENT.match(fragment)
    if match is None:
        expected = "file.npz#key[3] or file.npz#key[3,0]"
        raise InputError(f"{fragment!r} picks no frame", file=name, expected=expected)
    index = match["index"]
    parts = tuple(slice(None) if i.strip() == ":" else int(i) for i in index.split(",")) if index else ()
    return file, match["key"].strip() or None, parts


def suffix_of(path: Path) -> str:
    """The file's ending in small letters; both parts of ``.fits.fz`` and ``.fits.gz``."""
    last = path.suffix.lower()
    return Path(path.stem).suffix.lower() + last if last in (".fz", ".gz") else last


class PixelReader:
    """Reads frames named relative to a folder, as they are stored: (H, W), integer or float, native byte order; `layout` of .raw
    files is one of `visaug.frames.raw`.
    """

    def __init__(self, root: Path, layout: str = "little") -> None:
        self.root, self.layout = root, layout
        self._arrays = ArrayStore()

    def path(self, name: str) -> Path:
        return self.root / split_name(name)[0]

    def read(self, name: str, raw_shape: tuple[int, int] | None = None) -> np.ndarray:
        """Pixels of one frame."""
        file, key, index = split_name(name)
        path = self.root / file
        suffix = suffix_of(path)
        if suffix in ARRAYS or suffix in HDF5:
            pixels = self._arrays.read(path, key, index)
            index = ()
        elif not _is_file(path):
            raise InputError("is a folder" if os.path.isdir(path) else "no such file", file=path)
        elif key and suffix in SUFFIXES and suffix not in FITS:
            expected = "#[3] for the fourth frame of a stack, or no #"
            raise InputError(f"a {suffix} file has no array {key!r}", file=path, expected=expected)
        elif suffix == ".raw":
            pixels = read_raw(path, raw_shape, self.layout)
        elif suffix in TIFFS:
            pixels, index = _read_tiff(path, _numbers(index, path))
        elif suffix in FITS or suffix == ser.SUFFIX:
            numbers = _numbers(index, path)
            pixels = fits.read_fits(path, key, numbers) if suffix in FITS else ser.read_ser(path, numbers)
            index = ()
        elif suffix == xisf.SUFFIX:
            pixels = xisf.read_xisf(path)
        elif suffix in PHOTOS:
            pixels = photo.read_photo(path)
        elif suffix in PICTURES:
            pixels = _read_picture(path)
        else:
            problem = f"{suffix or 'no suffix'} is not a frame format"
            raise InputError(problem, file=path, expected="one of " + " ".join(SUFFIXES))
        try:
            pixels = pixels[index] if index else pixels
        except IndexError:
            raise outside(index, pixels.shape, path) from None
        if pixels.ndim == 3 and pixels.shape[0] == 1:
            pixels = pixels[0]
        if pixels.ndim != 2:
            expected = "one frame of rows x columns (pick one of a stack with #key[i])"
            raise InputError(f"has shape {pixels.shape}", file=self.root / name, expected=expected)
        check_numbers(pixels.dtype, self.root / name)
        return pixels

    def bits(self, name: str) -> int | None:
        """Bits that the file itself states; None for those of its data type."""
        path = self.path(name)
        return portable.pgm_bits(path) if suffix_of(path) == ".pgm" and _is_file(path) else None

    def dtype(self, name: str) -> np.dtype | None:
        """Type of the stored pixels if the header of the file contains it, else None."""
        file, key, _ = split_name(name)
        path = self.root / file
        suffix = suffix_of(path)
        if suffix in ARRAYS or suffix in HDF5:
            return self._arrays.dtype(path, key)
        if suffix == ".raw":
            return np.dtype(np.uint8 if self.layout == "mono8" else np.uint16)
        return np.dtype(np.uint16) if suffix in PHOTOS else None


def _numbers(index: Index, path: Path) -> tuple[int, ...]:
    if not all(isinstance(i, int) for i in index):
        raise InputError("an index with : is for arrays", file=path, expected="numbers, as #[3]")
    return tuple(i for i in index if isinstance(i, int))


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long, or a loop of links
        return False


def _read_tiff(path: Path, index: tuple[int, ...]) -> tuple[np.ndarray, tuple[int, ...]]:
    """Pixels, and the part of `index` that is still to be taken; of a plain stack one page alone is read."""
    with readable(path, "truncated, or not a TIFF file"), opened_tiff(path) as file:
        series = file.series[0]
        if len(index) == 1 and len(series.shape) == 3 and len(series.pages) == series.shape[0]:
            if index[0] >= series.shape[0]:
                raise outside(index, series.shape, path)
            page = series.pages[index[0]]
            if page is not None and page.shape == series.shape[1:]:
                check_shape([int(n) for n in page.shape], path)
                return page.asarray(), ()
        check_shape([int(n) for n in series.shape], path)
        pixels, axes = series.asarray(), series.axes
    if "S" not in axes:
        return _gray(pixels), index
    pixels = np.moveaxis(pixels, axes.index("S"), -1)  # red, green and blue may lie one behind the other
    if any(i >= n for i, n in zip(index, (*pixels.shape[:-3], pixels.shape[-1]), strict=False)):
        raise outside(index, series.shape, path)
    outer = pixels.ndim - 3
    of_stack = pixels[index[:outer]]
    if len(index) == outer + 1 and pixels.shape[-1] == 3:  # one of three planes, which a table names
        return of_stack[..., index[-1]], ()
    return _gray(of_stack), index[outer:]


def _read_picture(path: Path) -> np.ndarray:
    suffix = path.suffix.lower()
    if suffix == ".pgm":
        return portable.read_pgm(path)
    depth, colour = portable.png_type(path) if suffix == ".png" else (0, 0)
    if depth == 16 and colour in (2, 6):  # Pillow would silently cut it to 8 bits
        raise InputError("is a 16-bit colour PNG", file=path, expected="a gray 16-bit PNG or a TIFF")
    deep_gray = (depth, colour) == (16, 4)
    content = portable.as_eight_bit_colour(path) if deep_gray else None
    with readable(path, "truncated or no picture"), pillow_image(path, content=content) as picture:
        if picture.mode in ("P", "1", "CMYK", "YCbCr"):
            picture = picture.convert("RGB")
        pixels = np.asarray(picture)
    if deep_gray:
        return pixels[..., 0].astype(np.uint16) << 8 | pixels[..., 1]
    return _gray(pixels)


def _gray(pixels: np.ndarray) -> np.ndarray:
    """One channel: any where all are alike, else green, whose noise is that of one pixel and no average."""
    if pixels.ndim == 3 and pixels.shape[-1] in (2, 3, 4):
        return pixels[..., 0] if pixels.shape[-1] == 2 else pixels[..., 1]
    return pixels
