"""One exposure of a batch of images by one camera: numbers, scale and random numbers, and both implementations of the chain."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from visaug.augment.draws import SHARED
from visaug.camera import Camera, fast
from visaug.camera.colour import ColourPath
from visaug.camera.scale import at_strength, scale_of
from visaug.core.sampling import Stream

if TYPE_CHECKING:
    from visaug.augment.sensor_noise import SensorNoise


class Exposure:
    """What a camera does to a batch: its numbers, scale and random numbers, made once.

    Args:
        camera: one camera for all images.
        draws: of the images; see `visaug.augment.draws`.
        changed: the camera's numbers that are drawn for each image or given by the user, by path.
        device: of the images.
        may_be_fast: the fused implementation is taken where it has the camera's law.
        noise: whose options are taken: fixed_pattern, strength, black_level, full_scale_photons, origin.

    Attributes:
        fused: whether the fused implementation is taken; if not, the differentiable chain.
        values: every number of the camera by path, arrays (1,) or (B,) where `fused`, else tensors (1 or B, 1, 1, 1).
        scale: from image values to electrons and from DN to image values, of the same kind.
        patterns: (B,) keys of the fixed patterns, or (1,) where all images have one.
    """

    def __init__(
        self,
        camera: Camera,
        draws: Mapping[str, Tensor],
        changed: Mapping[str, Tensor],
        device: torch.device,
        may_be_fast: bool,
        noise: "SensorNoise",
    ):
        self.camera, self.keys, self.origin = camera, draws["keys"], noise.origin
        one_specimen = noise.fixed_pattern == "camera"  # every image has its fixed pattern
        clips = 1 if one_specimen else _number_of_clips(draws) if may_be_fast else 0
        self.kept = clips == 1
        self.patterns = draws["pattern_keys"][:1] if self.kept else draws["pattern_keys"]
        share = draws.get("exposure", torch.ones(1))  # of the saturation exposure
        self.values: Mapping[str, Any] = {}
        # The tables take pixel patterns that are drawn anew for temporal noise, so none that some images share.
        if may_be_fast and clips <= 1:
            own = {path: value.detach().double().cpu().numpy().reshape(-1) for path, value in changed.items()}
            self.values = at_strength(camera.arrays() | own, noise.strength)
        self.fused = bool(self.values) and fast.suits(camera, self.values)
        if self.fused:
            share = share.double().numpy()
        else:
            self.values = {
                path: torch.as_tensor(value, dtype=torch.float32, device=device).reshape(-1, 1, 1, 1)
                for path, value in at_strength(camera.values() | dict(changed), noise.strength).items()
            }
            share = share.to(device, torch.float32).view(-1, 1, 1, 1)
        subtract, full_scale = noise.black_level == "subtract", noise.full_scale_photons
        self.scale = scale_of(camera, self.values, share, subtract, full_scale)

    def of_light(self, light: Tensor, path: ColourPath | None, scale: int) -> Tensor:
        """One exposure of each image, (B, C, H, W) float32 in [0, 1].

        Args:
            light: (B, C, H, W) float32.
            path: through colour filters, to one plane of the sensor and back to three channels.
            scale: sensor pixels to each side of an image pixel, which is their mean.
        """
        if scale > 1:
            light = light.repeat_interleave(scale, 2).repeat_interleave(scale, 3)
        noisy = self.by_tables(light, path) if self.fused else self.by_chain(light, path)
        if path is not None:
            noisy = path.develop(noisy)
        return avg_pool2d(noisy, scale) if scale > 1 else noisy

    def by_chain(self, light: Tensor, path: ColourPath | None) -> Tensor:
        """Planes of the sensor by the differentiable chain, effect by effect."""
        stream = self.stream(light, light.shape[1] if path is None else 1)
        # Unless the image is a crop, it is the whole sensor: vignetting is centred on it.
        resolution = None if self.origin or self.camera.sensor_maps else (light.shape[2], light.shape[3])
        light = light if path is None else path.light(light)
        photons = light * (self.scale.electrons / self.values["quantum_efficiency"])
        mosaic = None if path is None else path.mosaic
        dn = self.camera.expose(photons, stream, self.values, resolution=resolution, mosaic=mosaic)
        plane = ((dn - self.scale.less_dn) * self.scale.per_dn).clamp(0, 1)
        seen = light if mosaic is None else mosaic(light)
        return torch.where(seen.isnan(), torch.nan, plane)  # of which the chain would make a count of 0

    def by_tables(self, light: Tensor, path: ColourPath | None, white: int = 0) -> Tensor:
        """Planes of the sensor by the fused implementation; also of whole numbers of which `white` is 1."""
        light = light if path is None else path.plane(light)
        numbers = self.scale, self.values, self.keys, self.patterns, self.kept
        return fast.take(self.camera, light, *numbers, self.origin or (0, 0), white=white)

    def finish(self, picture: Tensor) -> Tensor:
        """The picture after the effects of the picture stage."""
        return self.camera.finish(picture, self.stream(picture, picture.shape[1]), self.values)

    def stream(self, images: Tensor, planes: int) -> Stream:
        """The random numbers of a number of sensor planes."""
        (rows, columns), (r0, c0) = images.shape[2:], self.origin or (0, 0)
        window = (range(r0, r0 + rows), range(c0, c0 + columns))
        return Stream(self.keys, self.patterns, planes, window, images.device)


def _number_of_clips(draws: Mapping[str, Tensor]) -> int:
    """Number of different fixed patterns among images that share some; 0 where each image has its own."""
    count = len(draws["keys"])
    if SHARED in draws:
        return len(set(draws["pattern_keys"].tolist()))
    if count == 1:
        return 0
    patterns = len(set(draws["pattern_keys"].tolist()))
    return 0 if patterns == count or len(set(draws["keys"].tolist())) == patterns else patterns
