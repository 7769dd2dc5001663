"""One exposure of a batch of images by one camera: numbers, scale and random numbers, for both implementations of the chain."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor

from visaug.augment.draws import number_of_clips
from visaug.camera import Camera, fast, fast_gpu
from visaug.camera.colour import ColourPath
from visaug.camera.scale import Scale, scale_of
from visaug.camera.strength import at_strength
from visaug.core.sampling import Stream

NOMINAL = torch.ones(1)  # share of the saturation exposure


class Exposure(NamedTuple):
    """What a camera does to a batch.

    Attributes:
        draws: of the images; see `visaug.augment.draws`.
        changed: the camera's numbers that are drawn for each image or given by the user, by path.
        one_specimen: every image has the fixed pattern of one camera.
        strength, black_level, full_scale_photons, origin: options of `SensorNoise`.
    """

    camera: Camera
    draws: Mapping[str, Tensor]
    changed: Mapping[str, Tensor]
    one_specimen: bool
    strength: float
    black_level: str
    full_scale_photons: float | None
    origin: tuple[int, int] | None

    def by_tables(self, light: Tensor, path: ColourPath | None = None, white: int = 0) -> Tensor | None:
        """By the fused implementation, where it has the camera's law; else None.

        Args:
            light: (B, C, H, W) float32, or whole numbers of which `white` is 1.
            path: through colour filters, to one plane of the sensor.
        """
        clips = 1 if self.one_specimen else number_of_clips(self.draws)
        if clips > 1:  # the tables take pixel patterns that are drawn anew for temporal noise
            return None
        values = self.camera.arrays()
        for name, value in self.changed.items():
            values[name] = value.detach().double().cpu().numpy().reshape(-1)
        values = values if self.strength == 1 else at_strength(values, self.strength)
        kept = clips == 1
        if not fast.suits(self.camera, values, kept):
            return None
        scale = self._scale(values, self.draws.get("exposure", NOMINAL).double().numpy())
        keys, patterns = self.draws["keys"], self.draws["pattern_keys"]
        patterns = patterns[:1] if kept else patterns
        origin = self.origin or (0, 0)
        if path is not None:
            light = path.plane(light)
        if light.device.type == "cpu":
            return fast.take(self.camera, light, scale, values, keys, patterns, kept, origin, white=white)
        return fast_gpu.take(self.camera, light, scale, values, keys, patterns, kept, origin)

    def by_chain(self, light: Tensor, path: ColourPath | None = None) -> Tensor:
        """By the differentiable chain, effect by effect."""
        values = {
            name: torch.as_tensor(value, dtype=torch.float32, device=light.device).reshape(-1, 1, 1, 1)
            for name, value in self._given().items()
        }
        scale = self._scale(values, self.draws.get("exposure", NOMINAL).to(light).view(-1, 1, 1, 1))
        if path is not None:
            light = path.light(light)
        photons = light * (scale.electrons / values["quantum_efficiency"])
        stream = self._stream(light, light.shape[1] if path is None else 1)
        # Unless the image is a crop, it is the whole sensor: vignetting is centred on it.
        rows, columns = light.shape[2:]
        crop = self.origin or self.camera.sensor_maps
        mosaic = None if path is None else path.mosaic
        dn = self.camera.expose(
            photons, stream, values, resolution=None if crop else (rows, columns), mosaic=mosaic
        )
        plane = ((dn - scale.less_dn) * scale.per_dn).clamp(0, 1)
        seen = light if mosaic is None else mosaic(light)
        return torch.where(seen.isnan(), torch.nan, plane)  # of which the chain would make a count of 0

    def finish(self, picture: Tensor) -> Tensor:
        """The picture after the effects of the picture stage."""
        return self.camera.finish(picture, self._stream(picture, picture.shape[1]), self._given())

    def _given(self) -> dict[str, Any]:
        """Every number of the camera by path: given by the user, drawn for each image, or nominal."""
        given = self.camera.values() | dict(self.changed)
        return given if self.strength == 1 else at_strength(given, self.strength)

    def _scale(self, values: Mapping[str, Any], share: Any) -> Scale:
        subtract = self.black_level == "subtract"
        return scale_of(self.camera, values, share, subtract, self.full_scale_photons)

    def _stream(self, images: Tensor, planes: int) -> Stream:
        """The random numbers of a number of sensor planes."""
        (rows, columns), (r0, c0) = images.shape[2:], self.origin or (0, 0)
        window = (range(r0, r0 + rows), range(c0, c0 + columns))
        patterns = self.draws["pattern_keys"][:1] if self.one_specimen else self.draws["pattern_keys"]
        return Stream(self.draws["keys"], patterns, planes, window, images.device)
