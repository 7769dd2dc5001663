"""VISNoise: the noise of a camera as a kornia augmentation."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from kornia.augmentation import IntensityAugmentationBase2D
from torch import Tensor

from visaug.augment.draws import of_frames
from visaug.augment.options import Range, check_images, check_number
from visaug.augment.sensor_noise import SensorNoise, Source


class VISNoise(IntensityAugmentationBase2D):
    """Noise of a visible image sensor, at home in kornia: `AugmentationSequential` with keypoints, boxes and masks,

    `p`, `same_on_batch`, replay by `params=noise._params`.

    Args:
        camera: a Camera, the file or name of one, or a list of these, of which each image gets one at random.
        p: probability for each image to be taken by the camera; the others pass unchanged.
        fixed_pattern, transfer, black_level, resolution, fast, seed, mono, gain_db, exposure, strength, further: see
            `SensorNoise`.
        same_on_batch: one draw (and one noise) for all images of a batch.
        keepdim: True gives (C, H, W) for (C, H, W); False adds the batch's axis, as kornia does.

    Shape:
        (B, 1|3, H, W) in [0, 1] -> the same shape, dtype and device, in [0, 1]. Computed in float32.

    Example:
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
        self.sensor = SensorNoise(
            camera,
            fixed_pattern=fixed_pattern,
            transfer=transfer,
            black_level=black_level,
            resolution=resolution,
            fast=fast,
            seed=seed,
            mono=mono,
            gain_db=gain_db,
            exposure=exposure,
            strength=strength,
            **further,
        )

    def forward(self, input: Any, *args: Any, **kwargs: Any) -> Any:
        if not isinstance(input, Tensor) or not input.dtype.is_floating_point:
            check_images(input)
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
        clips = not self.same_on_batch and not torch.compiler.is_compiling()
        return self.sensor.apply_draws(input, of_frames(params) if clips else params)

    def __repr__(self) -> str:
        return f"VISNoise({self.sensor.described()}, p={self.p})"
