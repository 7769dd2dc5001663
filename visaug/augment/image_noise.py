"""Camera noise for one image: PIL image, NumPy array or tensor, with 8 bits, 16 bits or floats; see `visaug.augment.images`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from visaug.augment.images import frames_draws, like, say_what_auto_means, take, to_tensor
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.core.errors import InputError


class ImageNoise:
    """A callable that adds camera noise to one image, for a dataset's `transform`.

    Random numbers follow `torch.manual_seed`. Each DataLoader worker has its own stream, and a seeded run is reproducible.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to an image, 0 to 1.
        bits: number of bits used in uint16 data if fewer than 16: 10, 12 or 14.
        options: keywords of `SensorNoise`. With transfer="auto", 8-bit colour images are taken as sRGB, all others as
            linear.

    Shape:
        PIL image, tensor (C, H, W), or array (H, W) or (H, W, C); uint8, uint16 or float in [0, 1] -> the same. C is 1 or
        3, or 2 or 4 with an alpha channel, which is not changed.

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> import numpy as np
        >>> from visaug.augment import ImageNoise
        >>> ImageNoise("sony_imx174", transfer="srgb")(np.full((8, 8, 3), 120, np.uint8)).shape
        (8, 8, 3)
    """

    def __init__(
        self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
    ):
        self.noise = SensorNoise(camera, **options)
        say_what_auto_means(self.noise)
        self.p, self.bits = probability(p), used_bits(bits)

    def __call__(self, image: Any) -> Any:
        tensor = to_tensor(image)
        if torch.rand(()) >= self.p:
            return image
        return like(take(self.noise, tensor[None], self.noise.draw(1), self.bits)[0], image)

    def clip(self, images: np.ndarray) -> np.ndarray:
        """Adds noise to the frames of one clip, (T, H, W) or (T, H, W, C): same fixed pattern, independent temporal noise."""
        if not len(images):
            return images
        batch = torch.stack([to_tensor(image) for image in images])
        noisy = take(self.noise, batch, frames_draws(self.noise, len(batch)), self.bits)
        return np.stack([like(one, image) for one, image in zip(noisy, images)])

    def __repr__(self) -> str:
        return f"ImageNoise({self.noise!r}, p={self.p}, bits={self.bits})"


def probability(p: float) -> float:
    """The value, if it is a probability.

    Raises:
        InputError: it is not in [0, 1].
    """
    if not 0 <= p <= 1:
        raise InputError(f"{p} is not a probability", field="p", expected="0 to 1")
    return float(p)


def used_bits(bits: int | None) -> int | None:
    """The value, if it is a number of bits that uint16 data can use.

    Raises:
        InputError: it is not in 1 to 16.
    """
    if bits is not None and not 1 <= bits <= 16:
        raise InputError(f"{bits} bit", field="bits", expected="1 to 16, the depth of data in uint16 words")
    return bits
