"""JPEG, WebP and BMP, by Pillow."""

from pathlib import Path
from typing import Any

import numpy as np

from visaug.augment.image_io.picture import Hints, Picture, check_single, three_axes
from visaug.core.errors import InputError
from visaug.frames.limits import pillow_image

# How each is written. JPEG: 4:4:4, for coarser tables would smooth the noise away. WebP: without loss, for with loss
# it halves the resolution of colour.
_JPEG: dict[str, Any] = {"format": "JPEG", "quality": 95, "subsampling": 0}
_WEBP: dict[str, Any] = {"format": "WEBP", "lossless": True, "exact": True}
WRITTEN = {".jpg": _JPEG, ".jpeg": _JPEG, ".webp": _WEBP, ".bmp": {"format": "BMP"}}
FORMATS = ("JPEG", "WEBP", "BMP", "PNG", "TIFF", "MPO")
_OF_JPEG = ("icc_profile", "exif", "xmp", "dpi", "comment")
KEPT = {"JPEG": _OF_JPEG, "MPO": _OF_JPEG, "WEBP": ("icc_profile", "exif", "xmp"), "BMP": ("dpi",)}


def read_with_pillow(path: Path) -> Picture:
    with pillow_image(path, FORMATS) as image:
        # A JPEG of a phone (MPO) may hold a preview or a gain map beside the picture, which goes.
        check_single(1 if image.format == "MPO" else getattr(image, "n_frames", 1), "pictures", path)
        extras = {key: image.info[key] for key in KEPT.get(image.format or "", ()) if key in image.info}
        hints = Hints(icc=image.info.get("icc_profile"), exif_space=exif_space(image.info.get("exif")))
        # named as a format of 8 bit: Pillow would cut these, colour here and gray where it is written
        is_deep = any(";16" in str(tile[3]) for tile in getattr(image, "tile", ()))
        if image.format in ("PNG", "TIFF") and is_deep:
            expected = f"a name ending in .{image.format.lower()}"
            raise InputError(f"is a {image.format} picture of 16 bit", file=path, expected=expected)
        palette = image.mode in ("P", "PA")
        if palette:
            image = image.convert("RGBA" if "transparency" in image.info or image.mode == "PA" else "RGB")
        elif image.mode in ("1", "YCbCr"):
            image = image.convert("L" if image.mode == "1" else "RGB")
        elif image.mode not in ("L", "LA", "RGB", "RGBA"):
            raise InputError(f"has colour mode {image.mode}", file=path, expected="gray or RGB of 8 bit")
        pixels = three_axes(np.asarray(image))
    return Picture.encoded(pixels, hints, extras=extras | {"palette": palette})


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
