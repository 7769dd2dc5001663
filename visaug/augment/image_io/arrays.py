"""Linear pictures: NumPy arrays and OpenEXR, as renderers write them."""

from pathlib import Path
from typing import Any

import numpy as np

from visaug.augment.image_io.picture import LINEAR, Picture, check_single, three_axes
from visaug.core.errors import InputError
from visaug.core.extras import extra
from visaug.frames.limits import check_shape


def read_npy(path: Path) -> Picture:
    pixels = np.load(path, mmap_mode="r", allow_pickle=False)  # a shape is checked before memory is asked for
    shape = pixels.shape
    check_shape(shape, path)
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and not 1 <= shape[2] <= 4):
        raise InputError(f"has shape {shape}", file=path, expected="(H, W) or (H, W, 1 to 4 channels)")
    native = pixels.dtype.newbyteorder("=")
    if native not in (np.uint8, np.uint16) and native.kind != "f":
        raise InputError(f"holds {pixels.dtype}", file=path, expected="uint8, uint16 or floats")
    extras = {"axes": pixels.ndim, "dtype": pixels.dtype}
    return Picture(three_axes(np.array(pixels, native)), LINEAR, "NumPy array", extras=extras)


def write_npy(path: Path, picture: Picture) -> None:
    flat = picture.extras.get("axes") == 2
    pixels = picture.pixels[..., 0] if flat else picture.pixels
    with open(path, "wb") as handle:
        # in the byte order of the original
        np.save(handle, pixels.astype(picture.extras.get("dtype", pixels.dtype), copy=False))


def read_exr(path: Path) -> Picture:
    """Colour (R, G, B) or luminance (Y) with alpha; other channels are carried over."""
    exr = _openexr(path)
    with exr.File(str(path), separate_channels=True) as file:
        check_single(len(file.parts), "parts", path)
        header = dict(file.header())
        (x0, y0), (x1, y1) = header["dataWindow"]
        check_shape((int(y1) - int(y0) + 1, int(x1) - int(x0) + 1), path)
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    names = _picture_channels(list(channels), path)
    pixels = np.stack([channels[name] for name in names], -1)
    if pixels.dtype.kind != "f":
        raise InputError(f"holds {pixels.dtype}", file=path, expected="half or float channels")
    return Picture(pixels, LINEAR, "OpenEXR", extras={"header": header, "channels": channels, "names": names})


def _picture_channels(channels: list[str], path: Path) -> tuple[str, ...]:
    """Names of the channels of the picture: R, G, B or Y, alone or of one layer, `ViewLayer.Combined.R` as Blender has them.

    Layers that end in `Combined`, Blender's of all light, go before others, which hold parts: diffuse, emission, shadow.
    """
    found = []
    for layer in dict.fromkeys(name.rpartition(".")[0] for name in channels):
        for names in (("R", "G", "B", "A"), ("Y", "A")):
            whole = tuple(f"{layer}.{name}" if layer else name for name in names)
            if all(name in channels for name in whole[:-1]):
                found.append(whole)
    plain = [names for names in found if "." not in names[0]]
    combined = [names for names in found if names[0].split(".")[-2:-1] == ["Combined"]]
    chosen = plain[:1] or combined or found
    if len(chosen) != 1:
        several = ", ".join(names[0] for names in chosen)
        held = f"several pictures ({several})" if chosen else f"the channels {', '.join(channels)}"
        raise InputError(f"holds {held}", file=path, expected="R, G and B, or Y, of one layer")
    return tuple(name for name in chosen[0] if name in channels)


def write_exr(path: Path, picture: Picture) -> None:
    exr = _openexr(path)
    channels: dict[str, Any] = dict(picture.extras["channels"])
    for number, name in enumerate(picture.extras["names"]):
        channels[name] = np.ascontiguousarray(picture.pixels[..., number])
    exr.File(picture.extras["header"], channels).write(str(path))


def _openexr(path: Path) -> Any:
    with extra(path):
        import OpenEXR
    return OpenEXR
