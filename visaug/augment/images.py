"""Images as datasets hand them out, PIL, NumPy and tensors of 8 bit, 16 bit and floats: to the sensor and back; and `ImageNoise`.

Channels: 1 is gray, 3 colour; 2 and 4 are gray and colour with alpha, which is no light and stays as it is; more are bands.
See `visaug.augment.exposure.light_channels`.
"""

import logging
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
import torch
from torch import Tensor

from visaug.augment.exposure import MOST, check_pixels, light_channels
from visaug.augment.options import is_whole
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.core.errors import InputError

DEPTHS = {torch.uint8: 8, torch.uint16: 16}
PIL_MODES = ("L", "LA", "RGB", "RGBA", "I;16", "I;16L", "I;16B", "I;16N")  # 16 bit by the order of the bytes
# Pillow's convert() cuts these two at 255.
PIL_ARRAYS = {"I": "np.asarray(image).astype(np.uint16)", "F": "np.asarray(image), scaled to [0, 1]"}

_log = logging.getLogger("visaug")
_said: list[str] = []


def to_unit(image: Tensor, bits: int | None) -> Tensor:
    """Whole numbers of `bits` (as the type has, where None) as float32 in [0, 1]; floats as they are."""
    if image.dtype.is_floating_point:
        check_bits(bits, "floating point")
        return image
    if image.dtype not in DEPTHS:
        raise InputError(f"an image has type {image.dtype}", expected="float, uint8 or uint16")
    check_bits(bits, str(image.dtype).removeprefix("torch."))
    white = _top(image.dtype, bits)
    highest = int(image.to(torch.int32).max()) if bits is not None and image.numel() else 0
    if highest > MOST * white:
        expected = f"at most {white}, the highest value of {bits} bits, or another number of bits"
        raise InputError(f"the largest value is {highest}", field="bits", expected=expected)
    return image.float() / white


def from_unit(image: Tensor, dtype: torch.dtype, bits: int | None) -> Tensor:
    """The inverse of `to_unit`, rounded."""
    return image.to(dtype) if dtype.is_floating_point else (image * _top(dtype, bits)).round().to(dtype)


def _top(dtype: torch.dtype, bits: int | None) -> int:
    """The value of white; `bits` applies to 16-bit data only."""
    return 2 ** (bits if bits is not None and dtype == torch.uint16 else DEPTHS[dtype]) - 1


def check_bits(bits: int | None, kind: str) -> None:
    """Refuses a number of bits of 16-bit words for data of another type."""
    if bits is not None and kind != "uint16" and not (kind == "uint8" and bits == 8):
        problem = f"{bits} bit are given for an image of {kind}, whose range is known"
        raise InputError(problem, field="bits", expected="no number of bits; only images of uint16 need one")


def take(
    noise: SensorNoise,
    images: Tensor,
    draws: Mapping[str, Tensor],
    bits: int | None,
    *,
    bgr: bool = False,
    alpha: bool = False,
) -> Tensor:
    """Images (B, C, H, W) of any of the types through a camera; alpha stays.

    With transfer="auto", colour of 8 bit is sRGB, everything else linear; see `say_what_auto_means`.

    Args:
        bgr: three channels of light are blue, green and red.
        alpha: the last of 2 or 4 channels is alpha, whatever the noise's option `mono`.
    """
    check_pixels(images.shape)
    colours = light_channels(images.shape[1], noise.mono, alpha)
    if bgr and colours == 3:
        turned = torch.cat([images[:, :3].flip(1), images[:, 3:]], 1)
        noisy = take(noise, turned, draws, bits, alpha=alpha)
        return torch.cat([noisy[:, :3].flip(1), noisy[:, 3:]], 1)
    light = images[:, :colours]
    transfer = "srgb" if images.dtype == torch.uint8 and colours == 3 else "linear"
    linear = (transfer if noise.transfer == "auto" else noise.transfer) == "linear"
    noisy = None
    with torch.no_grad():
        if light.dtype in DEPTHS and linear:
            check_bits(bits, str(light.dtype).removeprefix("torch."))
            white = _top(light.dtype, bits)
            # Words above white are there only where `bits` are below those of the type.
            whole = bits is None or white == 2 ** DEPTHS[light.dtype] - 1
            if whole or int(light.to(torch.int32).max()) <= white:
                noisy = noise.apply_to_words(light, draws, white)
        if noisy is None:
            unit = noise.apply_draws(to_unit(light, bits), draws, transfer=transfer)
            noisy = from_unit(unit, light.dtype, bits)
    return noisy if colours == images.shape[1] else torch.cat([noisy, images[:, colours:]], 1)


def say_what_auto_means(noise: SensorNoise) -> None:
    """One line for the user, once in a process, through the logger `visaug`.

    Said where an adapter is made and not where it is used, for that is in one process, and use in every DataLoader worker.
    """
    if noise.transfer == "auto" and not _said:
        _said.append("auto")
        taken = "colour images of 8 bit are taken as sRGB, all others as linear in light"
        _log.warning(f"transfer='auto': {taken}; transfer='srgb' or 'linear' decides")


def to_tensor(image: Any) -> Tensor:
    """A PIL image, array (H, W), (H, W, C) or tensor (C, H, W) as a tensor (C, H, W)."""
    if isinstance(image, Tensor):
        if image.ndim != 3:
            raise InputError(f"an image has shape {tuple(image.shape)}", expected="(C, H, W)")
        tensor, place = image, 0
    elif isinstance(image, np.ndarray):
        if image.ndim not in (2, 3):
            raise InputError(f"an image has shape {image.shape}", expected="(H, W) or (H, W, C)")
        planes = image[..., None] if image.ndim == 2 else image
        if planes.shape[2] > 4 and 1 <= planes.shape[0] <= 4:
            problem = f"an array has shape {image.shape}, channels first"
            raise InputError(problem, expected="(H, W, C), or a tensor (C, H, W)")
        native = planes.astype(planes.dtype.newbyteorder("="), copy=False)  # FITS and some TIFF: big-endian
        whole = np.ascontiguousarray(native.transpose(2, 0, 1))
        # nothing writes to it, but PyTorch warns of memory that is read-only
        tensor, place = torch.from_numpy(whole if whole.flags.writeable else whole.copy()), 2
    elif hasattr(image, "mode") and hasattr(image, "getbands"):
        if image.mode not in PIL_MODES:
            expected = PIL_ARRAYS.get(image.mode, "image.convert('RGB') or 'L'")
            raise InputError(f"a PIL image has mode {image.mode}", expected=expected)
        return to_tensor(np.array(image))
    else:
        raise InputError(f"an image is a {type(image).__name__}", expected="PIL, NumPy or a tensor")
    channels_last = place == 0 and tensor.shape[0] > 4 and tensor.shape[2] <= 4
    if not tensor.shape[0] or channels_last:
        problem = f"an image has shape {tuple(image.shape)}" + (", channels last" if channels_last else "")
        raise InputError(problem, expected="(C, H, W) in a tensor and (H, W, C) in an array")
    return tensor


def like(noisy: Tensor, image: Any) -> Any:
    """A tensor (C, H, W) in the form that the image has."""
    if isinstance(image, Tensor):
        return noisy
    array = noisy.numpy().transpose(1, 2, 0)
    if isinstance(image, np.ndarray):
        return np.ascontiguousarray(array.reshape(image.shape), dtype=image.dtype)
    from PIL import Image

    plane = np.ascontiguousarray(array[..., 0] if array.shape[2] == 1 else array)
    made = Image.fromarray(plane.astype(">u2") if image.mode == "I;16B" else plane)
    made.info = dict(image.info)
    return made


class ImageNoise:
    """A callable that adds camera noise to one image, for a dataset's `transform`.

    Random numbers follow `torch.manual_seed`. Each DataLoader worker has its own stream, and a seeded run is reproducible.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to an image, 0 to 1.
        bits: number of bits used in uint16 data if fewer than 16: 10, 12 or 14.
        order: order of the colour channels of arrays and tensors: "RGB", or "BGR" as OpenCV has them. PIL images state theirs.
        options: keywords of `SensorNoise`. With transfer="auto", 8-bit colour images are taken as sRGB, all others as
            linear.

    Shape:
        PIL image, tensor (C, H, W), or array (H, W) or (H, W, C); uint8, uint16 or float in [0, 1] -> the same. C is 1 or
        3, or 2 or 4 with an alpha channel, which is not changed; more are bands, as are all with mono=False, each with
        noise of its own.

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> import numpy as np
        >>> from visaug.augment import ImageNoise
        >>> ImageNoise("sony_imx174", transfer="srgb")(np.full((8, 8, 3), 120, np.uint8)).shape
        (8, 8, 3)
    """

    def __init__(
        self,
        camera: Source | Sequence[Source],
        p: float = 1.0,
        bits: int | None = None,
        order: str = "RGB",
        **options: Any,
    ):
        self.noise = SensorNoise(camera, **options)
        say_what_auto_means(self.noise)
        self.p, self.bits, self.order = probability(p), used_bits(bits), channel_order(order)

    def __call__(self, image: Any) -> Any:
        to_tensor(image)  # refuses what is no image, whether or not it gets noise
        return image if torch.rand(()) >= self.p else self.noised(image, self.noise.draw(1), self.order)

    def noised(self, image: Any, draws: Mapping[str, torch.Tensor], order: str) -> Any:
        """The image with the noise of the draws; order is that of an array or tensor."""
        is_pil = hasattr(image, "getbands")
        bgr = order == "BGR" and not is_pil
        noisy = take(self.noise, to_tensor(image)[None], draws, self.bits, bgr=bgr, alpha=is_pil)
        return like(noisy[0], image)

    def __repr__(self) -> str:
        return f"ImageNoise({self.noise!r}, p={self.p}, bits={self.bits}, order={self.order!r})"


def channel_order(order: str) -> str:
    """The value, if it is an order of colour channels."""
    if order not in ("RGB", "BGR"):
        raise InputError(f"{order!r} is not a choice", field="order", expected="RGB or BGR")
    return order


def probability(p: float) -> float:
    """The value, if it is a probability."""
    if isinstance(p, bool) or not isinstance(p, Real) or not 0 <= p <= 1:
        raise InputError(f"{p!r} is not a probability", field="p", expected="a number from 0 to 1")
    return float(p)


def used_bits(bits: int | None) -> int | None:
    """The value, if it is a number of bits that uint16 data can use."""
    if bits is None:
        return None
    if not is_whole(bits) or not 1 <= bits <= 16:
        expected = "a whole number from 1 to 16, the depth of data in uint16 words"
        raise InputError(f"{bits!r} is not valid", field="bits", expected=expected)
    return int(bits)
