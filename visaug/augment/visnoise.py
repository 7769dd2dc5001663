"""VISNoise: the noise of a camera as a module of torch, and as a kornia augmentation where kornia is installed."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from visaug.augment.draws import nth_frame, of_frames
from visaug.augment.exposure import check_images
from visaug.augment.options import Range, check_number
from visaug.augment.sensor_noise import SensorNoise, Source

if TYPE_CHECKING:
    from kornia.augmentation import AugmentationSequential, IntensityAugmentationBase2D
else:
    try:
        from kornia.augmentation import AugmentationSequential, IntensityAugmentationBase2D
    except ModuleNotFoundError:
        from visaug.augment.without_kornia import Augmentation as IntensityAugmentationBase2D

        AugmentationSequential = None

IMAGES = ("input", "image")  # kornia's data keys of images; in a dict further words may follow


class VISNoise(IntensityAugmentationBase2D):
    """Noise of an image sensor for visible light: an `nn.Module`, and a kornia augmentation where kornia is installed.

    It works in `kornia.augmentation.AugmentationSequential` with keypoints, boxes and masks, and a call can be repeated with
    `params=noise._params`. Several images of one call (`data_keys=["input", "input"]`, a stereo pair for example) share the
    camera and its fixed pattern, and each has temporal noise of its own.

    Args:
        camera: a Camera, its file or name, or a list of these from which one is drawn for each image.
        p: probability that noise is applied to an image, 0 to 1; other images are not changed.
        fixed_pattern: "image" or "camera", see `SensorNoise`.
        transfer: "auto", "linear" or "srgb", see `SensorNoise`.
        black_level: "subtract" or "keep", see `SensorNoise`.
        resolution: "network" or "sensor", see `SensorNoise`.
        fast: True uses the faster implementation where it follows the same law.
        same_on_batch: True uses the same draw, and the same noise, for all images of a batch.
        keepdim: True returns (C, H, W) for (C, H, W); False adds the batch axis, as kornia does.
        seed: of the kept fixed pattern and of the random numbers; None follows `torch.manual_seed`.
        mono: None, True or False, see `SensorNoise`.
        gain_db: gain in dB, or a pair (low, high) from which it is drawn uniformly for each image.
        exposure: fraction of the saturation exposure, from 1e-6 to 1, or a pair (low, high).
        strength: factor on the standard deviation of all noise, 0 to 100.
        further: other keywords of `SensorNoise`: full_scale_photons, values, origin.

    Shape:
        (B, C, H, W) in [0, 1] -> the same shape, dtype and device, in [0, 1]. Computed in float32. C as in `SensorNoise`.

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> import torch, visaug
        >>> noise = visaug.VISNoise(visaug.Camera.load({"resolution": [64, 64], "gain_e_per_dn": 0.5}))
        >>> noise(torch.rand(2, 1, 64, 64)).shape
        torch.Size([2, 1, 64, 64])
    """

    def __init__(
        self,
        camera: Source | Sequence[Source],
        p: float = 1.0,
        fixed_pattern: str = "image",
        transfer: str = "auto",
        black_level: str = "subtract",
        resolution: str = "network",
        fast: bool = True,
        same_on_batch: bool = False,
        keepdim: bool = True,
        seed: int | None = None,
        mono: bool | None = None,
        gain_db: Range = None,
        exposure: Range = None,
        strength: float = 1.0,
        **further: Any,
    ):
        p = check_number("p", p, 0, 1)
        super().__init__(p=p, same_on_batch=same_on_batch, keepdim=keepdim)
        words: dict[str, Any] = {"fixed_pattern": fixed_pattern, "transfer": transfer, "fast": fast}
        words |= {"black_level": black_level, "resolution": resolution, "mono": mono, "seed": seed}
        words |= {"gain_db": gain_db, "exposure": exposure, "strength": strength}
        self.sensor = SensorNoise(camera, **words, **further)

    def forward(self, input: Any, *args: Any, **kwargs: Any) -> Any:
        if not isinstance(input, Tensor) or not input.dtype.is_floating_point:
            check_images(input)
        # kornia refuses bfloat16 up to version 0.8.2; float32 holds the same values.
        elif input.dtype == torch.bfloat16:
            return super().forward(input.float(), *args, **kwargs).to(input.dtype)
        return super().forward(input, *args, **kwargs)

    def generate_parameters(self, batch_shape: tuple[int, ...]) -> dict[str, Tensor]:
        return self.sensor.draw(batch_shape[0], self.same_on_batch)

    def apply_transform(
        self,
        input: Tensor,
        params: Mapping[str, Tensor],
        flags: Mapping[str, Any],
        transform: Tensor | None = None,
    ) -> Tensor:
        if torch.compiler.is_compiling():
            return self.sensor.apply_draws(input, params)
        draws = params if self.same_on_batch else of_frames(params)
        if self._images is not None:
            draw = params["keys"].cpu().numpy().tobytes()
            draws = nth_frame(draws, self._images[draw])
            self._images[draw] += 1
        return self.sensor.apply_draws(input, draws)

    # within a call of a container with several images: those so far, by their draws
    _images: Counter[bytes] | None = None

    def __repr__(self) -> str:
        return f"VISNoise({self.sensor.described()}, p={self.p})"


def _counting(forward: Callable[..., Any]) -> Callable[..., Any]:
    """kornia's `AugmentationSequential.forward`, which applies one draw to every image of a call: here they are counted."""

    @wraps(forward)
    def counted(container: "AugmentationSequential", *args: Any, **kwargs: Any) -> Any:
        given = args[0] if len(args) == 1 and isinstance(args[0], dict) else kwargs.get("data_keys")
        keys = container.data_keys if given is None else given
        images = sum(str(getattr(key, "name", key)).lower().startswith(IMAGES) for key in keys or ())
        if images < 2:
            return forward(container, *args, **kwargs)
        noises = [part for part in container.modules() if isinstance(part, VISNoise) and part._images is None]
        for noise in noises:
            noise._images = Counter()
        try:
            return forward(container, *args, **kwargs)
        finally:
            for noise in noises:
                noise._images = None

    return counted


if AugmentationSequential is not None:
    AugmentationSequential.forward = _counting(AugmentationSequential.forward)
