"""An arm's noise as modules on batches (B, C, H, W) in [0, 1]."""

from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from visaug.augment.sensor_noise import SensorNoise
from visaug.camera import Camera, draw
from visaug.camera.scale import gain_of, white_dn
from visaug.core.errors import InputError
from visaug_train.arms import Arm, Vis, White
from visaug_train.batch_noise import AugmentationModule, BatchAugmentation, add_white, chosen

# of `visaug.VISNoise`, given as an arm's `vis` has them
OPTIONS = {"resolution", "fixed_pattern", "transfer", "black_level"}
OPTIONS |= {"gain_db", "exposure", "strength", "full_scale_photons"}


def batch_noise(arm: Arm) -> nn.Module:
    """All steps of an arm, in their order."""
    return nn.Sequential(*(_module(step) for _, step in arm if isinstance(step, BatchAugmentation | Vis)))


def _module(step: BatchAugmentation | Vis) -> nn.Module:
    if isinstance(step, BatchAugmentation):
        return AugmentationModule(step)
    return white_noise(step) if isinstance(step, White) else vis_noise(step)


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
    options = vis.model_dump(include=OPTIONS, exclude_none=True)
    is_drawn = any(isinstance(value, list | tuple) for entry in vis.effects for value in entry.values())
    if is_drawn or any(entry.get("p", 1.0) < 1 for entry in vis.effects):
        return RandomEffects(cameras, vis.effects, vis.p, options)
    for entry in vis.effects:
        cameras = [camera.with_effect(**_at(entry, 0)) for camera in cameras]
    return visaug.VISNoise(cameras if len(cameras) > 1 else cameras[0], p=vis.p, **options)


def changed_camera(vis: Vis, name: str) -> Camera:
    """A camera with the arm's values, which are then not randomised."""
    changed = Camera.load(name).replace(vis.set)
    if vis.white_std_present:
        gain_db = changed.spec.gain_db if vis.gain_db is None else float(np.mean(vis.gain_db))
        full_scale_e = (2**changed.bit_depth - 1) * changed.gain_at(gain_db)
        left = changed.spec.read_noise.sigma_e**2 - (vis.white_std_present * full_scale_e) ** 2
        changed = changed.replace({"read_noise.sigma_e": max(left, 0.0) ** 0.5})
    content = changed.to_dict()
    spreads = content.get("randomize", {})
    if not spreads.keys() & vis.set.keys():
        return changed
    content["randomize"] = {path: spread for path, spread in spreads.items() if path not in vis.set}
    return changed.with_content(content)


class WhiteSensorNoise(nn.Module):
    """White Gaussian noise of a camera's variance, the paper's eq. 6: one standard deviation for the whole image.

    Its variance in electrons is that of the photons at the image's mean level, the dark current and the read
    noise; fixed patterns have no part in it. Camera parameters are drawn per image as for the sensor noise.
    """

    def __init__(self, camera: Camera, p: float = 1.0) -> None:
        super().__init__()
        self.camera, self.p = camera, p

    def forward(self, images: Tensor) -> Tensor:
        seed = int(torch.randint(2**31, (1,)))
        drawn = draw(self.camera, len(images), np.random.default_rng(seed))
        values = {name: value.double() for name, value in drawn.items()}
        gain, white = gain_of(self.camera, values), white_dn(self.camera, values)
        mean_e = images.mean(dim=(1, 2, 3)).double().cpu() * white * gain
        dark = values["exposure_s"] * values["dark_current.a_e_per_s"]
        heat = self.camera.spec.dark_current.exponent(values["temperature_c"])
        dark = dark * torch.exp(values["dark_current.b_per_c"] * heat)
        read = values["read_noise.sigma_e"] ** 2 + (values["read_noise.after_gain_dn"] * gain) ** 2
        std = (mean_e + dark + read).sqrt() / gain / white
        noisy = add_white(images, std.to(images)[:, None, None, None])
        return torch.where(chosen(self.p, images), noisy, images)


class WhiteTwin(nn.Module):
    """White Gaussian noise with the variance that a noise module adds, image by image.

    Its mean, its patterns and its dependence on the level are left out, so that it differs from the module in
    structure alone.
    """

    def __init__(self, noise: nn.Module) -> None:
        super().__init__()
        self.noise = noise

    def forward(self, images: Tensor) -> Tensor:
        std = (self.noise(images) - images).std(dim=(1, 2, 3), keepdim=True)
        return torch.where(std > 0, add_white(images, std), images)


class RandomEffects(nn.Module):
    """Sensor noise whose further effects, as `Vis.effects`, come in a share of the images only, with strengths drawn for each.

    Each image gets one of the cameras at random; `p` is the share of the images that a camera takes.
    """

    def __init__(
        self, cameras: list[Camera], effects: list[dict[str, Any]], p: float, options: dict[str, Any]
    ) -> None:
        super().__init__()
        self.cameras, self.effects, self.p, self.options = cameras, effects, p, options
        self._noises: dict[tuple[int, ...], SensorNoise] = {}
        # with all effects: a name or a value at fault is refused at once; these are the modules by which a training decides
        # on transfer function and channels
        self.sensors = nn.ModuleList(self._noise((n, *[1] * len(effects))) for n in range(len(cameras)))

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
        noise, sensor = self._noise(case), self._noise((case[0], *[1] * len(self.effects)))
        noise.transfer, noise.mono = sensor.transfer, sensor.mono
        draws = noise.draw(len(images))
        for effect, acts in zip(self.effects, case[1:]):
            for key, value in effect.items():
                if acts and isinstance(value, list | tuple):
                    draws[f"{effect['name']}.{key}"] = torch.empty(len(images)).uniform_(*value)
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
    """An effect's parameters without `p`, ranges at their low (0) or high (1) end."""
    found = {key: value for key, value in effect.items() if key != "p"}
    for key, value in found.items():
        if isinstance(value, list | tuple):
            numbers = [v for v in value if isinstance(v, int | float) and not isinstance(v, bool)]
            if len(value) != 2 or len(numbers) != 2 or value[0] > value[1]:
                field = f"effects.{effect['name']}.{key}"
                raise InputError(f"is {value}", field=field, expected="a number or [low, high]")
            found[key] = value[end]
    return found
