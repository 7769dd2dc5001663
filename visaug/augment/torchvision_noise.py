"""Camera noise as a torchvision transform; imports torchvision."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import PIL.Image
import torch
from torch import Tensor
from torchvision import tv_tensors
from torchvision.transforms import v2

from visaug.augment.draws import nth_frame, of_frames
from visaug.augment.exposure import check_pixels
from visaug.augment.images import like, probability, say_what_auto_means, take, to_tensor, used_bits
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.core.errors import InputError


class TorchvisionNoise(v2.Transform):
    """Camera noise as a torchvision v2 transform: images and videos change, boxes and masks do not.

    The frames of a video share the fixed pattern of one camera and have independent temporal noise; so do several images of
    one sample, for example a stereo pair. A tensor or Image with leading axes, (B, C, H, W), is a batch: each image has its
    own camera, gain and pattern, as from separate calls.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to a sample, or to an image of a batch, 0 to 1.
        bits: see `ImageNoise`.
        options: keywords of `SensorNoise`.

    Raises:
        InputError: a sample without a PIL image, tensor or video, for example a NumPy array alone.

    Examples:
        >>> import torch
        >>> from visaug.augment import TorchvisionNoise
        >>> TorchvisionNoise("sony_imx174")(torch.rand(1, 32, 32)).shape
        torch.Size([1, 32, 32])
    """

    _transformed_types = (v2.functional.is_pure_tensor, PIL.Image.Image, tv_tensors.Image, tv_tensors.Video)

    def __init__(
        self, camera: Source | Sequence[Source], p: float = 1.0, bits: int | None = None, **options: Any
    ):
        super().__init__()
        self.noise = SensorNoise(camera, **options)
        say_what_auto_means(self.noise)
        self.p, self.bits = probability(p), used_bits(bits)

    def check_inputs(self, flat_inputs: list[Any]) -> None:
        if not v2._utils.has_any(flat_inputs, *self._transformed_types):
            kinds = ", ".join(sorted({type(one).__name__ for one in flat_inputs}))
            expected = "a PIL image, a tensor or a tv_tensor; put v2.ToImage() before the noise"
            raise InputError(f"a sample contains no image, only {kinds}", expected=expected)

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """For all images of a sample: decisions and draws by the size of a batch, and how many images had them so far."""
        several = sum(isinstance(one, Tensor | PIL.Image.Image) for one in flat_inputs) > 1
        return {"drawn": {}, "images": Counter(), "several": several}

    def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
        is_pil = isinstance(inpt, PIL.Image.Image)
        images = to_tensor(inpt) if is_pil else inpt.as_subclass(Tensor)
        check_pixels(images.shape)
        if images.numel() == 0:  # a batch of none, or a video without frames
            return inpt
        planes = images[None] if images.ndim == 2 else images
        frames = planes.shape[-4] if isinstance(inpt, tv_tensors.Video) else 1
        batch = planes.reshape(-1, frames, *planes.shape[-3:])
        chosen, draws = self._drawn(len(batch), params)
        if not chosen.any():
            return inpt
        lit = batch[chosen]
        clips = {name: value[chosen].repeat_interleave(frames, 0) for name, value in draws.items()}
        taken = take(self.noise, lit.flatten(0, 1), of_frames(clips), self.bits, alpha=is_pil)
        own = iter(taken.reshape(lit.shape))
        parts = [next(own) if yes else clean for clean, yes in zip(batch, chosen.tolist())]
        noisy = torch.stack(parts).reshape(images.shape)
        return like(noisy, inpt) if is_pil else tv_tensors.wrap(noisy, like=inpt)

    def _drawn(self, count: int, params: dict[str, Any]) -> tuple[Tensor, dict[str, Tensor]]:
        """Which of `count` images, or clips, get noise, and their draws: of the next image of a sample."""
        if count not in params["drawn"]:
            params["drawn"][count] = torch.rand(count) < self.p, self.noise.draw(count)
        chosen, draws = params["drawn"][count]
        number = params["images"][count]
        params["images"][count] += 1
        return chosen, nth_frame(draws, number) if params["several"] else draws
