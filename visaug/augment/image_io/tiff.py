"""TIFF, by tifffile: palettes, floating point, and the tags beside the pixels."""

from pathlib import Path
from typing import Any

import numpy as np

from visaug.augment.image_io.picture import Hints, Picture, check_single, three_axes
from visaug.augment.image_io.pillow import read_with_pillow
from visaug.augment.image_io.png import KORNIA_MODES
from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.frames.limits import check_shape, opened_tiff

# Tags that say how the pixels lie in the file, which the writer sets; and folders of tags, which hold places in the
# old file. Every other tag is carried over.
OF_THE_FILE = {
    *range(254, 260), *range(262, 267), 273, *range(277, 285), *range(288, 294), 296, 317, *range(320, 326), 330,
    *range(338, 342), 347, *range(512, 533), 34665, 34853, 40965, 50838, 50839, 65535,
}  # fmt: skip


def read_tiff(path: Path) -> Picture:
    with extra(path):
        from tifffile import PHOTOMETRIC, TIFF

    with opened_tiff(path) as file:
        check_single(len(file.pages), "pages", path)
        page: Any = file.pages.first
        photometric = int(page.photometric)
        known = ("PALETTE", "MINISWHITE", "MINISBLACK", "RGB", "YCBCR")
        if photometric not in [PHOTOMETRIC[name] for name in known]:
            problem = f"has colours of kind {page.photometric.name}"
            raise InputError(problem, file=path, expected="gray or RGB")
        check_shape(page.shape, path)
        # along x, along y, unit: the writer takes them apart from other tags
        resolution = [page.tags.get(code) for code in (282, 283, 296)]
        extras: dict[str, Any] = {
            "resolution": [tag.value for tag in resolution] if all(resolution) else None,
            "compression": "zlib" if page.compression != 1 else None,
            "palette": photometric == PHOTOMETRIC.PALETTE,
            "ycbcr": photometric == PHOTOMETRIC.YCBCR,
            "white_is_zero": photometric == PHOTOMETRIC.MINISWHITE,
            "alpha": [int(kind) for kind in page.extrasamples],
            "tags": [
                (tag.code, int(tag.dtype), *_counted(tag.value, tag.count), True)
                for tag in page.tags
                if tag.code not in OF_THE_FILE
            ],
        }
        pixels = _pixels(path, page, extras)
        if page.is_shaped and page.shape != (pixels.shape if pixels.shape[2] > 1 else pixels.shape[:2]):
            # tifffile's own description: the shape that the old file had
            extras["tags"] = [tag for tag in extras["tags"] if tag[0] != TIFF.TAGS["ImageDescription"]]
        icc, nodata = (page.tags.get(TIFF.TAGS[name]) for name in ("InterColorProfile", "GDAL_NODATA"))
    if pixels.dtype not in (np.uint8, np.uint16) and pixels.dtype.kind != "f":
        raise InputError(f"holds {pixels.dtype}", file=path, expected="uint8, uint16 or floats")
    if pixels.shape[2] > 4:
        raise InputError(f"holds {pixels.shape[2]} channels", file=path, expected="gray or colour")
    keep, key = _no_data(pixels, None if nodata is None else nodata.value, extras["white_is_zero"])
    if extras["white_is_zero"]:
        pixels = _negative(pixels)
    hints = Hints(icc=None if icc is None else icc.value)
    return Picture.encoded(pixels, hints, keep=keep, key=key, extras=extras)


def write_tiff(path: Path, picture: Picture) -> None:
    with extra(path):
        import tifffile

    extras = picture.extras
    pixels = _negative(picture.pixels) if extras.get("white_is_zero") else picture.pixels
    channels = pixels.shape[2]
    gray = "miniswhite" if extras.get("white_is_zero") else "minisblack"
    resolution = extras.get("resolution")
    alpha = extras.get("alpha") or [2]  # 2: alpha that colours are not multiplied with
    tifffile.imwrite(
        path,
        pixels[..., 0] if channels == 1 else pixels,
        photometric="rgb" if channels >= 3 else gray,
        planarconfig="contig" if channels > 1 else None,
        extrasamples=alpha[:1] if channels in (2, 4) else None,
        compression=extras.get("compression"),
        resolution=resolution[:2] if resolution else None,
        resolutionunit=resolution[2] if resolution else None,
        metadata=None,
        software=False,
        extratags=extras.get("tags", []),
    )


def _pixels(path: Path, page: Any, extras: dict[str, Any]) -> np.ndarray:
    """(H, W, C) as they are stored; a palette's colours in 8 bit, YCbCr as RGB."""
    palette = extras["palette"]
    try:
        # tifffile gives the components of YCbCr as they are, and has no alpha for a palette
        known = not extras["ycbcr"] and not (palette and page.samplesperpixel > 1)
        pixels = page.asarray() if known else None
    except ValueError:  # a codec that tifffile lacks, LZW most often
        pixels = None
    if pixels is None:
        pixels = three_axes(_by_other_decoders(path, page.dtype, page.samplesperpixel))
        return _negative(pixels) if extras["white_is_zero"] else pixels  # these decoders turn it over
    if pixels.dtype == bool:
        return three_axes(pixels.astype(np.uint8) * 255)
    if palette:
        colours = page.colormap  # (3, entries), 16 bit each; some writers fill 8 of them
        if colours.max() > 255:
            colours = colours >> 8
        return np.moveaxis(colours.astype(np.uint8)[:, pixels], 0, -1)
    if pixels.ndim == 3 and page.axes == "SYX" and pixels.shape[0] == page.samplesperpixel:  # planes apart
        pixels = np.moveaxis(pixels, 0, -1)
    return three_axes(pixels)


def _by_other_decoders(path: Path, dtype: np.dtype | None, channels: int) -> np.ndarray:
    """A compressed TIFF; Pillow would cut colour of 16 bit to 8."""
    if dtype in (np.uint8, bool):
        return read_with_pillow(path).pixels
    if dtype == np.uint16 and channels in (1, 3):
        with extra(path):
            import kornia_rs.io

        return np.asarray(kornia_rs.io.read_image_tiff_u16(str(path), KORNIA_MODES[channels]))
    expected = "none, deflate without a predictor for floats, or `pip install imagecodecs`"
    raise InputError("has a compression that cannot be read", file=path, expected=expected)


def _counted(value: Any, count: int) -> tuple[int, Any]:
    """A tag's count and value; text as the bytes that it was, for the writer takes ASCII alone."""
    if isinstance(value, str):
        value = value.encode()
        return len(value) + 1, value + b"\0"
    return count, value


def _negative(pixels: np.ndarray) -> np.ndarray:
    """White is zero: colours turned over, alpha not."""
    turned = pixels.copy()
    turned[..., 0] = (1 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max) - pixels[..., 0]
    return turned


def _no_data(
    pixels: np.ndarray, nodata: str | None, turned: bool
) -> tuple[np.ndarray | None, tuple[float, ...] | None]:
    """Where all channels of the stored pixels hold the value by which GDAL marks missing data, and the value that it becomes
    (`turned`: white is zero).
    """
    try:
        value = float(str(nodata).strip("\0 "))
    except ValueError:
        return None, None
    if np.isnan(value) and pixels.dtype.kind == "f":
        missing: Any = np.isnan(pixels)
        return missing.all(-1), None
    if pixels.dtype.kind != "f" and not (value.is_integer() and 0 <= value <= np.iinfo(pixels.dtype).max):
        return None, None  # no pixel can hold it
    stored = np.full((1, 1, pixels.shape[2]), value, pixels.dtype)
    key = _negative(stored) if turned else stored
    return (pixels == stored).all(-1), tuple(key[0, 0].tolist())
