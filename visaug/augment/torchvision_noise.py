"""Camera noise as a torchvision transform; imports torchvision."""

from collections.abc import Sequence
from typing import Any

import PIL.Image
import torch
from torch import Tensor
from torchvision import tv_tensors
from torchvision.transforms import v2

from visaug.augment.image_noise import probability, used_bits
from visaug.augment.images import like, say_what_auto_means, take, to_tensor
from visaug.augment.sensor_noise import SensorNoise, Source
from visaug.core.errors import InputError


class TorchvisionNoise(v2.Transform):
    """Camera noise as a torchvision v2 transform: images and videos change, boxes and masks do not.

    The frames of a video share the fixed pattern of one camera and have independent temporal noise.

    Args:
        camera: see `SensorNoise`.
        p: probability that noise is applied to a sample, 0 to 1.
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

    _transformed_types = (
        v2.functional.is_pure_tensor,
        PIL.Image.Image,
        tv_tensors.Image,
        tv_tensors.Video,
    )

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
            raise InputError(
                f"a sample contains no image, only {kinds}",
                expected="a PIL image, a tensor or a tv_tensor; put v2.ToImage() before the noise",
            )

    def make_params(self, flat_inputs: list[Any]) -> dict[str, Any]:
        """One decision, and one draw, for all images of a sample."""
        return {"take": bool(torch.rand(()) < self.p), "draws": self.noise.draw(1)}

    def transform(self, inpt: Any, params: dict[str, Any]) -> Any:
        if not params["take"]:
            return inpt
        if isinstance(inpt, PIL.Image.Image):
            return like(take(self.noise, to_tensor(inpt)[None], params["draws"], self.bits)[0], inpt)
        images = inpt.as_subclass(Tensor)
        batch = (images[None] if images.ndim == 2 else images).reshape(-1, *images.shape[-3:])
        draws = params["draws"]
        if len(batch) > 1:  # frames of a video: one camera, noise of their own
            keys = self.noise.draw(len(batch))["keys"]
            draws = {name: value.expand(len(batch)) for name, value in draws.items()} | {"keys": keys}
        noisy = take(self.noise, batch, draws, self.bits).reshape(images.shape)
        return tv_tensors.wrap(noisy, like=inpt)  # pyright: ignore[reportCallIssue]
