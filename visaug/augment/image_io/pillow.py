"""JPEG, WebP and BMP, by Pillow."""

from pathlib import Path
from typing import Any

import numpy as np

from visaug.augment.image_io.picture import Picture, three_axes
from visaug.augment.image_io.transfer import Hints, transfer_of
from visaug.core.errors import InputError
from visaug.frames.limits import pillow_image

# How each is written. JPEG: 4:4:4, for coarser tables would smooth the noise away. WebP: without loss, for with loss
# it halves the resolution of colour.
WRITTEN: dict[str, dict[str, Any]] = {
    ".jpg": {"format": "JPEG", "quality": 95, "subsampling": 0},
    ".jpeg": {"format": "JPEG", "quality": 95, "subsampling": 0},
    ".webp": {"format": "WEBP", "lossless": True, "exact": True},
    ".bmp": {"format": "BMP"},
}
FORMATS = ("JPEG", "WEBP", "BMP", "PNG", "TIFF", "MPO")
KEPT = {
    "JPEG": ("icc_profile", "exif", "dpi", "comment"),
    "MPO": ("icc_profile", "exif", "dpi", "comment"),
    "WEBP": ("icc_profile", "exif", "xmp"),
    "BMP": ("dpi",),
}


def read_with_pillow(path: Path) -> Picture:
    with pillow_image(path, FORMATS) as image:
        # A JPEG of a phone (MPO) may hold a preview or a gain map beside the picture, which goes.
        count = getattr(image, "n_frames", 1)
        if image.format != "MPO" and count > 1:
            raise InputError(f"holds {count} pictures", file=path, expected="a single picture in a file")
        extras = {key: image.info[key] for key in KEPT.get(image.format or "", ()) if key in image.info}
        hints = Hints(icc=image.info.get("icc_profile"), exif_space=exif_space(image.info.get("exif")))
        # named as a format of 8 bit: Pillow would cut these, colour here and gray where it is written
        if image.format in ("PNG", "TIFF") and any(
            ";16" in str(tile[3]) for tile in getattr(image, "tile", ())
        ):
            raise InputError(
                f"is a {image.format} picture of 16 bit",
                file=path,
                expected=f"a name ending in .{image.format.lower()}",
            )
        palette = image.mode in ("P", "PA")
        if palette:
            image = image.convert("RGBA" if "transparency" in image.info or image.mode == "PA" else "RGB")
        elif image.mode == "1":
            image = image.convert("L")
        elif image.mode not in ("L", "LA", "RGB", "RGBA"):
            raise InputError(f"has colour mode {image.mode}", file=path, expected="gray or RGB of 8 bit")
        pixels = three_axes(np.asarray(image))
    colours = pixels.shape[2] - (pixels.shape[2] in (2, 4))
    transfer, reason = transfer_of(hints, pixels.dtype, colours)
    return Picture(pixels, transfer, reason, extras=extras | {"palette": palette})


def write_with_pillow(path: Path, picture: Picture) -> None:
    from PIL import Image

    pixels = picture.pixels[..., 0] if picture.pixels.shape[2] == 1 else picture.pixels
    extras = {key: value for key, value in picture.extras.items() if key != "palette"}
    Image.fromarray(pixels).save(path, **WRITTEN[path.suffix.lower()], **extras)


def exif_space(block: bytes | None) -> int | None:
    """ColorSpace of an EXIF block, None where there is none."""
    if not block:
        return None
    from PIL import ExifTags, Image

    try:
        exif = Image.Exif()
        exif.load(block)
        return exif.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.ColorSpace)
    except Exception:  # a damaged block contains no information
        return None
