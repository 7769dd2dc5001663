"""Camera noise for one image: PIL image, NumPy array or tensor, with 8 bits, 16 bits or floats; see `visaug.augment.images`."""

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import torch

from visaug.augment.images import like, say_what_auto_means, take, to_tensor
from visaug.augment.options import is_whole
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.core.errors import InputError


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
        if torch.rand(()) >= self.p:
            return image
        return self.noised(image, self.noise.draw(1), self.order)

    def noised(self, image: Any, draws: Mapping[str, torch.Tensor], order: str) -> Any:
        """The image with the noise of the draws; order is that of an array or tensor."""
        is_pil = hasattr(image, "getbands")
        bgr = order == "BGR" and not is_pil
        noisy = take(self.noise, to_tensor(image)[None], draws, self.bits, bgr=bgr, alpha=is_pil)
        return like(noisy[0], image)

    def __repr__(self) -> str:
        return f"ImageNoise({self.noise!r}, p={self.p}, bits={self.bits}, order={self.order!r})"


def channel_order(order: str) -> str:
    """The value, if it is an order of colour channels.

    Raises:
        InputError: it is neither RGB nor BGR.
    """
    if order not in ("RGB", "BGR"):
        raise InputError(f"{order!r} is not a choice", field="order", expected="RGB or BGR")
    return order


def probability(p: float) -> float:
    """The value, if it is a probability.

    Raises:
        InputError: it is not in [0, 1].
    """
    if isinstance(p, bool) or not isinstance(p, Real) or not 0 <= p <= 1:
        raise InputError(f"{p!r} is not a probability", field="p", expected="a number from 0 to 1")
    return float(p)


def used_bits(bits: int | None) -> int | None:
    """The value, if it is a number of bits that uint16 data can use.

    Raises:
        InputError: it is not in 1 to 16.
    """
    if bits is None:
        return None
    if not is_whole(bits) or not 1 <= bits <= 16:
        expected = "a whole number from 1 to 16, the depth of data in uint16 words"
        raise InputError(f"{bits!r} is not valid", field="bits", expected=expected)
    return int(bits)
