"""An arm's noise as modules on batches (B, C, H, W) in [0, 1]."""

from typing import Any

import torch
from torch import Tensor, nn

from visaug.augment.sensor_noise import SensorNoise
from visaug.camera import Camera
from visaug.camera.spec import check_spec
from visaug.core.errors import InputError
from visaug_train.arms import Arm, Vis, White
from visaug_train.batch_noise import (
    AugmentationModule,
    BatchAugmentation,
    WhiteSensorNoise,
    WhiteTwin,
    chosen,
    uniform,
)


def batch_noise(arm: Arm) -> nn.Module:
    """All steps of an arm, in their order."""
    steps = [step for _, step in arm if isinstance(step, BatchAugmentation | Vis)]
    return nn.Sequential(*map(_module, steps))


def _module(step: BatchAugmentation | Vis) -> nn.Module:
    if isinstance(step, White):
        return white_noise(step)
    return vis_noise(step) if isinstance(step, Vis) else AugmentationModule(step)


def white_noise(white: White) -> nn.Module:
    """White noise of the variance that the paper's eq. 6, or the sensor noise itself, gives."""
    if white.variance == "sensor":
        return WhiteTwin(vis_noise(white))
    if len(white.cameras) > 1:
        raise InputError("is a list", field="white.camera", expected="one camera, or variance: sensor")
    return WhiteSensorNoise(changed_camera(white, white.cameras[0]), white.p)


def vis_noise(vis: Vis) -> nn.Module:
    """The sensor noise with the arm's changes to its cameras."""
    import visaug

    cameras = [changed_camera(vis, name) for name in vis.cameras]
    options: dict[str, Any] = {
        name: getattr(vis, name) for name in ("resolution", "fixed_pattern", "transfer", "black_level")
    }
    given = {name: getattr(vis, name) for name in ("gain_db", "exposure", "strength", "full_scale_photons")}
    options |= {name: value for name, value in given.items() if value is not None}
    drawn = (value for entry in vis.effects for value in entry.values())
    if any(e.get("p", 1.0) < 1 for e in vis.effects) or any(isinstance(v, list | tuple) for v in drawn):
        return RandomEffects(cameras, vis.effects, vis.p, options)
    for entry in vis.effects:
        effect = {key: value for key, value in entry.items() if key != "p"}
        cameras = [camera.with_effect(**effect) for camera in cameras]
    return visaug.VISNoise(cameras if len(cameras) > 1 else cameras[0], p=vis.p, **options)


def changed_camera(vis: Vis, name: str) -> Camera:
    """A camera with the arm's values, which are then not randomised."""
    camera = Camera.load(name)
    values = dict(vis.set)
    if vis.white_std_present:
        full_scale_e = (2**camera.bit_depth - 1) * camera.spec.gain_e_per_dn
        sigma_e = float(values.get("read_noise.sigma_e", camera.spec.read_noise.sigma_e))
        left = sigma_e**2 - (vis.white_std_present * full_scale_e) ** 2
        values["read_noise.sigma_e"] = max(left, 0.0) ** 0.5
    changed = camera.replace(values)
    content = changed.to_dict()
    spreads = content.get("randomize", {})
    if not spreads.keys() & vis.set.keys():
        return changed
    content["randomize"] = {path: spread for path, spread in spreads.items() if path not in vis.set}
    return Camera(check_spec(content), changed.folder, changed.maps)


class RandomEffects(nn.Module):
    """Sensor noise whose further effects come in a share of the images only, with strengths drawn for each.

    Args:
        cameras: of which each image gets one at random.
        effects: as `Vis.effects`.
        p: the share of the images that a camera takes; the others pass unchanged.
        options: of `SensorNoise`.
    """

    def __init__(
        self, cameras: list[Camera], effects: list[dict[str, Any]], p: float, options: dict[str, Any]
    ) -> None:
        super().__init__()
        self.cameras, self.effects, self.p, self.options = cameras, effects, p, options
        self._noises: dict[tuple[int, ...], SensorNoise] = {}
        for number in range(len(cameras)):  # with all effects: a name or a value at fault is refused at once
            self._noise((number, *[1] * len(effects)))

    def forward(self, images: Tensor) -> Tensor:
        count = len(images)
        acts = torch.rand(count, len(self.effects)) < torch.tensor([e.get("p", 1.0) for e in self.effects])
        camera = torch.randint(len(self.cameras), (count, 1))
        cases = torch.cat([camera, acts.long()], dim=1)
        noisy = images.clone()
        taken = chosen(self.p, images).flatten()
        for case in cases.unique(dim=0):
            here = ((cases == case).all(dim=1).to(images.device) & taken).nonzero().flatten()
            if len(here):
                noisy[here] = self._take(tuple(case.tolist()), images[here])
        return noisy

    def _take(self, case: tuple[int, ...], images: Tensor) -> Tensor:
        noise = self._noise(case)
        draws = noise.draw(len(images))
        for effect, acts in zip(self.effects, case[1:]):
            for key, value in effect.items():
                if acts and isinstance(value, list | tuple):
                    draws[f"{effect['name']}.{key}"] = uniform(len(images), tuple(value), torch.zeros(0))
        return noise.apply_draws(images, draws)

    def _noise(self, case: tuple[int, ...]) -> SensorNoise:
        """Of a camera with those of the effects that act."""
        if case not in self._noises:
            camera = self.cameras[case[0]]
            for effect, acts in zip(self.effects, case[1:]):
                if acts:
                    for end in (0, 1):  # both ends of each range are checked; the first stands as nominal
                        ready = camera.with_effect(**_at(effect, 1 - end))
                    camera = ready
            self._noises[case] = SensorNoise(camera, **self.options)
        return self._noises[case]


def _at(effect: dict[str, Any], end: int) -> dict[str, Any]:
    """An effect's parameters with its ranges at their low (0) or high (1) end."""
    found = {}
    for key, value in effect.items():
        if isinstance(value, list | tuple):
            numbers = [v for v in value if isinstance(v, int | float) and not isinstance(v, bool)]
            if len(value) != 2 or len(numbers) != 2 or value[0] > value[1]:
                raise InputError(
                    f"is {value}", field=f"effects.{effect['name']}.{key}", expected="a number or [low, high]"
                )
            value = value[end]
        if key != "p":
            found[key] = value
    return found
