"""Pictures as files: PNG, TIFF and JPEG of 8 or 16 bit, gray or colour, with or without transparency."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from visaug.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
JPEG_QUALITY = 95  # 4:4:4; coarser tables would smooth the noise away
CHANNELS_BY_MODE = {1: "mono", 3: "rgb", 4: "rgba"}


@dataclass
class Picture:
    """A picture in memory.

    Attributes:
        pixels: (H, W, C) uint8 or uint16; C is 1 (gray), 2 (gray, alpha), 3 (colour) or 4 (colour, alpha).
        extras: what is written back unchanged: colour profile and EXIF block, or a TIFF's compression.
    """

    pixels: np.ndarray
    extras: dict[str, Any] = field(default_factory=dict)

    @property
    def colours(self) -> int:
        """Number of channels that light made: without alpha."""
        channels = self.pixels.shape[2]
        return channels - 1 if channels in (2, 4) else channels


def read_picture(path: Path) -> Picture:
    """Read a picture; a palette becomes colour, one bit becomes eight.

    Raises:
        InputError: not a picture, damaged, or of another depth than 8 or 16 bit.
    """
    try:
        if path.suffix.lower() in (".tif", ".tiff"):
            return _read_tiff(path)
        if deep_channels := _deep_png_channels(path):
            return _read_deep_png(path, deep_channels)
        return _read_with_pillow(path)
    except (InputError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:  # decoders raise many kinds for damaged files
        raise InputError(f"cannot be read ({error})", file=path, expected="an intact picture") from None


def write_picture(path: Path, picture: Picture) -> None:
    """Write in the format that the suffix names. The same picture gives the same bytes."""
    pixels = picture.pixels
    flat = pixels[..., 0] if pixels.shape[2] == 1 else pixels
    suffix = path.suffix.lower()
    if suffix in (".tif", ".tiff"):
        _write_tiff(path, picture)
    elif pixels.dtype == np.uint16 and pixels.shape[2] > 1:
        import kornia_rs.io

        kornia_rs.io.write_image_png_u16(
            str(path), np.ascontiguousarray(pixels), CHANNELS_BY_MODE[pixels.shape[2]]
        )
    else:
        from PIL import Image

        if suffix == ".png":
            options: dict[str, Any] = {"format": "PNG"}
        else:
            options = {"format": "JPEG", "quality": JPEG_QUALITY, "subsampling": 0}
        Image.fromarray(flat).save(path, **options, **picture.extras)


def _read_with_pillow(path: Path) -> Picture:
    from PIL import Image

    with Image.open(path) as image:
        extras = {key: image.info[key] for key in ("icc_profile", "exif") if key in image.info}
        if image.mode == "P":
            image = image.convert("RGBA" if "transparency" in image.info else "RGB")
        elif image.mode == "1":
            image = image.convert("L")
        elif image.mode not in ("L", "LA", "RGB", "RGBA", "I;16"):
            raise InputError(
                f"has colour mode {image.mode}", file=path, expected="gray or RGB of 8 or 16 bit"
            )
        return Picture(_three_axes(np.asarray(image)), extras)


def _deep_png_channels(path: Path) -> int:
    """Channels of a PNG of 16 bit and several channels, which Pillow would cut to 8 bit; else 0."""
    with open(path, "rb") as handle:
        head = handle.read(26)
    if head[:8] != b"\x89PNG\r\n\x1a\n" or len(head) < 26 or head[24] != 16:
        return 0
    channels = {2: 3, 4: 2, 6: 4}.get(head[25], 0)
    if channels == 2:
        raise InputError(
            "is a 16-bit gray PNG with alpha", file=path, expected="one without alpha, or in colour"
        )
    return channels


def _read_deep_png(path: Path, channels: int) -> Picture:
    import kornia_rs.io

    return Picture(np.asarray(kornia_rs.io.read_image_png_u16(str(path), CHANNELS_BY_MODE[channels])))


def _read_tiff(path: Path) -> Picture:
    import tifffile

    with tifffile.TiffFile(path) as file:
        if len(file.pages) != 1:
            raise InputError(f"holds {len(file.pages)} pages", file=path, expected="one image in a file")
        page = file.pages.first
        compressed = page.compression != 1
        try:
            pixels = page.asarray()
        except ValueError:  # a codec that tifffile lacks, LZW most often
            pixels = _read_packed_tiff(path, page.dtype, page.samplesperpixel)
        if (
            pixels.ndim == 3 and page.axes == "SYX" and pixels.shape[0] == page.samplesperpixel
        ):  # planes apart
            pixels = np.moveaxis(pixels, 0, -1)
        pixels = _three_axes(pixels)
        if pixels.dtype not in (np.uint8, np.uint16) or pixels.shape[2] > 4:
            raise InputError(
                f"holds {pixels.shape[2]} channels of {pixels.dtype}",
                file=path,
                expected="gray or colour of uint8 or uint16",
            )
        return Picture(pixels, {"compression": "zlib" if compressed else None})


def _read_packed_tiff(path: Path, dtype: np.dtype | None, channels: int) -> np.ndarray:
    """A compressed TIFF by other decoders; Pillow would cut colour of 16 bit to 8."""
    if dtype == np.uint8:
        return _read_with_pillow(path).pixels
    if dtype == np.uint16 and channels in (1, 3):
        import kornia_rs.io

        return np.asarray(kornia_rs.io.read_image_tiff_u16(str(path), CHANNELS_BY_MODE[channels]))
    raise InputError("has a compression that cannot be read", file=path, expected="none, or deflate")


def _write_tiff(path: Path, picture: Picture) -> None:
    import tifffile

    pixels = picture.pixels
    channels = pixels.shape[2]
    tifffile.imwrite(
        path,
        pixels[..., 0] if channels == 1 else pixels,
        photometric="rgb" if channels >= 3 else "minisblack",
        planarconfig="contig" if channels > 1 else None,
        extrasamples=["unassalpha"] if channels in (2, 4) else None,
        compression=picture.extras.get("compression"),
        metadata=None,
        software=False,
    )


def _three_axes(pixels: np.ndarray) -> np.ndarray:
    return pixels[..., None] if pixels.ndim == 2 else pixels
