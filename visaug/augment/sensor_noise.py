"""The noise of a camera, or of a population of cameras, on batches of images. Knows torch alone, no image library."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, distributed, nn
from torch.nn.functional import avg_pool2d
from torch.utils.data import get_worker_info

from visaug.augment import draws as drawing
from visaug.augment.light import image_to_photons, linear_to_srgb, srgb_to_linear
from visaug.camera import Camera, fast, fast_gpu
from visaug.camera.randomize import spreads
from visaug.errors import InputError
from visaug.sampling import Stream, derive_key

Source = Camera | str | Path | Mapping[str, Any]
CHOICES = {
    "fixed_pattern": ("image", "camera"),
    "transfer": ("linear", "srgb"),
    "black_level": ("subtract", "keep"),
    "resolution": ("network", "sensor"),
}


class SensorNoise(nn.Module):
    """Images as a camera would have taken them.

    Args:
        camera: a Camera, the file or name of one, or a list of these: a population, of which each image gets one.
        fixed_pattern: "image" draws row, column and pixel patterns anew for every image, as of another specimen;
            "camera" keeps one specimen's, chosen by `seed`.
        transfer: "linear" takes pixel values as linear in light; "srgb" makes them linear first and encodes again.
        black_level: "subtract" takes the camera's offset off again, "keep" leaves it in.
        resolution: "network": each pixel of the image is a pixel of the sensor. "sensor": each pixel of the image
            stands for k x k pixels of the sensor, k as the sensor's size over the image's has it (rounded, at least
            1). The noise acts on these and is averaged, so it is about k times weaker.
        fast: True takes the table-driven path where it has the same law: base chain, physical reading, no gradient
            wanted, CPU. False always runs the exact chain.
        seed: of the kept fixed pattern, and of the random numbers; None follows `torch.manual_seed`. Ranks of a
            distributed training share the kept pattern and have random numbers of their own.
        full_scale_photons: mean photons per pixel that the image's value 1 stands for. None: as many as make DN
            of the camera's full range at the gain and quantum efficiency of each image (the paper's eq. 7), so
            that these change the noise and not the brightness.
        values: numbers that replace the camera's by path, e.g. {"read_noise.sigma_e": nn.Parameter(...)};
            gradients reach them.
        origin: row and column of the sensor at which the image begins, where it is a crop; then kept patterns are
            the crop of the sensor's, and effects that depend on the place on the sensor know it.

    Shape:
        (B, 1|3, H, W) in [0, 1] -> the same shape, dtype and device, in [0, 1]. Three equal channels, as a gray
        image has them, get the same noise; different ones get noise of their own.
    """

    def __init__(
        self,
        camera: Source | Sequence[Source],
        *,
        fixed_pattern: str = "image",
        transfer: str = "linear",
        black_level: str = "subtract",
        resolution: str = "network",
        fast: bool = True,
        seed: int | None = None,
        full_scale_photons: float | None = None,
        values: Mapping[str, Tensor | float] | None = None,
        origin: tuple[int, int] | None = None,
    ):
        super().__init__()
        self.cameras = _population(camera)
        self._spreads = [spreads(camera) for camera in self.cameras]
        options = {"fixed_pattern": fixed_pattern, "transfer": transfer}
        options |= {"black_level": black_level, "resolution": resolution}
        for name, word in options.items():
            if word not in CHOICES[name]:
                raise InputError(f"{word!r} is not a choice", field=name, expected=" or ".join(CHOICES[name]))
        self.fixed_pattern, self.transfer, self.black_level = fixed_pattern, transfer, black_level
        self.resolution, self.fast, self.seed, self.origin = resolution, fast, seed, origin
        self.full_scale_photons = full_scale_photons
        self._generator: tuple[tuple[int | None, int], torch.Generator] | None = None
        self._names: dict[str, str] = {}
        for path, value in (values or {}).items():
            self._add_value(path, value)

    def _add_value(self, path: str, value: Tensor | float) -> None:
        known = self.cameras[0].values()
        if path not in known:
            raise InputError(
                "is no parameter of this camera", field=path, expected=f"one of {', '.join(known)}"
            )
        name = self._names[path] = "value_" + path.replace(".", "_")
        if isinstance(value, nn.Parameter):
            self.register_parameter(name, value)
        else:
            self.register_buffer(name, torch.as_tensor(value, dtype=torch.float32), persistent=False)

    def draw(self, count: int, same_on_batch: bool = False) -> dict[str, Tensor]:
        """Fresh random draws for `count` images; see `visaug.augment.draws`."""
        key = drawing.pattern_key_of(self.seed or 0) if self.fixed_pattern == "camera" else None
        drawn = drawing.draw(self._spreads, 1 if same_on_batch else count, self._random_source(), key)
        return {name: value.expand(count) for name, value in drawn.items()} if same_on_batch else drawn

    def _random_source(self) -> torch.Generator | None:
        """Torch's own generator, or one of the seed and DataLoader worker; another on each rank of a training."""
        rank = 0 if torch.compiler.is_compiling() else _rank()
        if self.seed is None:
            if rank == 0:
                return None
            word = int(torch.randint(2**62, ()))  # ranks that are seeded alike still part here
            return torch.Generator().manual_seed(derive_key(word, "rank", rank) >> 1)
        worker = get_worker_info()
        place = (None if worker is None else worker.seed, rank)
        if self._generator is None or self._generator[0] != place:
            seed = derive_key(self.seed, "draws", *(place if rank else place[:1])) >> 1
            self._generator = (place, torch.Generator().manual_seed(seed))
        return self._generator[1]

    def forward(self, images: Tensor) -> Tensor:
        return self.apply_draws(images, self.draw(images.shape[0]))

    def apply_draws(self, images: Tensor, draws: Mapping[str, Tensor]) -> Tensor:
        """The noisy images that belong to the draws: the same draws and images, the same noise."""
        if images.ndim != 4:
            raise InputError(f"images have shape {tuple(images.shape)}", expected="(B, C, H, W)")
        light = images.float()
        if self.transfer == "srgb":
            light = srgb_to_linear(light)
        noisy = self._by_camera(light, draws)
        if self.transfer == "srgb":
            noisy = linear_to_srgb(noisy)
        return noisy.to(images.dtype)

    def _by_camera(self, light: Tensor, draws: Mapping[str, Tensor]) -> Tensor:
        if len(self.cameras) == 1:
            return self._gray_or_colour(self.cameras[0], light, draws)
        noisy = torch.empty_like(light)
        for number in draws["camera"].unique().tolist():
            chosen = (draws["camera"] == number).nonzero().squeeze(1)
            own = {
                name: value[chosen]
                for name, value in draws.items()
                if value.shape[:1] == draws["camera"].shape
            }
            here = chosen.to(light.device)
            noisy = noisy.index_copy(0, here, self._gray_or_colour(self.cameras[number], light[here], own))
        return noisy

    def _gray_or_colour(self, camera: Camera, light: Tensor, draws: Mapping[str, Tensor]) -> Tensor:
        """Equal channels are one image of a mono camera; the numbers of a plane depend on its place, not on others."""
        if light.shape[1] == 1:
            return self._take(camera, light, draws)
        gray = (light == light[:, :1]).flatten(1).all(1).view(-1, 1, 1, 1)
        if not torch.compiler.is_compiling() and bool(gray.all()):
            return self._take(camera, light[:, :1], draws).expand(light.shape).clone()
        noisy = self._take(camera, light, draws)
        return torch.where(gray, noisy[:, :1], noisy)

    def _take(self, camera: Camera, light: Tensor, draws: Mapping[str, Tensor]) -> Tensor:
        """One exposure of each image, scaled back to [0, 1]."""
        scale = self._pixels_per_pixel(camera, light)
        if scale > 1:
            light = light.repeat_interleave(scale, 2).repeat_interleave(scale, 3)
        noisy = self._fast(camera, light, draws) if self._may_be_fast(light) else None
        if noisy is None:
            noisy = self._exact(camera, light, draws)
        return avg_pool2d(noisy, scale) if scale > 1 else noisy

    def _pixels_per_pixel(self, camera: Camera, light: Tensor) -> int:
        if self.resolution == "network":
            return 1
        rows, columns = camera.resolution
        return max(1, round(max(rows / light.shape[2], columns / light.shape[3])))

    def _may_be_fast(self, light: Tensor) -> bool:
        if not self.fast or torch.compiler.is_compiling() or light.device.type not in ("cpu", "cuda"):
            return False
        if light.device.type == "cpu" and fast.kernel() is None:
            return False
        tensors = (light, *(getattr(self, name) for name in self._names.values()))
        return not torch.is_grad_enabled() or not any(tensor.requires_grad for tensor in tensors)

    def _fast(self, camera: Camera, light: Tensor, draws: Mapping[str, Tensor]) -> Tensor | None:
        """By tables, where they have the camera's law; else None."""
        given = self._given(camera, draws)
        values = {
            path: value.detach().double().numpy().reshape(-1)
            if isinstance(value, Tensor)
            else np.array([value])
            for path, value in given.items()
        }
        kept = self.fixed_pattern == "camera"
        if not fast.suits(camera, values, kept):
            return None
        gain = values["gain_e_per_dn"] * 10 ** ((camera.spec.gain_db - values["gain_db"]) / 20)
        electrons = _max_dn(camera) * gain
        if self.full_scale_photons is not None:
            electrons = self.full_scale_photons * values["quantum_efficiency"]
        take = fast.take if light.device.type == "cpu" else fast_gpu.take
        return take(
            camera,
            light,
            electrons,
            values,
            draws["keys"],
            draws["pattern_keys"][:1] if kept else draws["pattern_keys"],
            kept,
            self.origin or (0, 0),
            self.black_level == "subtract",
        )

    def _exact(self, camera: Camera, light: Tensor, draws: Mapping[str, Tensor]) -> Tensor:
        """By the differentiable chain."""
        values = {
            path: torch.as_tensor(value, dtype=torch.float32, device=light.device).reshape(-1, 1, 1, 1)
            for path, value in self._given(camera, draws).items()
        }
        if self.full_scale_photons is None:
            gain = values["gain_e_per_dn"] * 10 ** ((camera.spec.gain_db - values["gain_db"]) / 20)
            photons = image_to_photons(light, _max_dn(camera), gain, values["quantum_efficiency"])
        else:
            photons = light * self.full_scale_photons
        rows, columns = light.shape[2:]
        r0, c0 = self.origin or (0, 0)
        window = (range(r0, r0 + rows), range(c0, c0 + columns))
        patterns = draws["pattern_keys"][:1] if self.fixed_pattern == "camera" else draws["pattern_keys"]
        stream = Stream(draws["keys"], patterns, light.shape[1], window, light.device)
        # Unless the image is a crop, it is the whole sensor: vignetting is centred on it.
        whole = None if self.origin or camera.maps else (rows, columns)
        dn = camera.expose(photons, stream, values, resolution=whole)
        if self.black_level == "subtract":
            dn = dn - values["black_level_dn"]
        return (dn * (1 / _max_dn(camera))).clamp(0, 1)

    def _given(self, camera: Camera, draws: Mapping[str, Tensor]) -> dict[str, Tensor | float]:
        """Every number of the camera by path: given by the user, drawn for each image, or nominal."""
        given: dict[str, Tensor | float] = dict(camera.values())
        given |= {path: draws[path] for path in given if path in draws}
        return given | {path: getattr(self, name) for path, name in self._names.items()}


def _rank() -> int:
    """Of this process in a distributed training, 0 outside; workers know it from what they inherit."""
    if distributed.is_available() and distributed.is_initialized():
        return distributed.get_rank()
    return max(int(os.environ.get("RANK", 0)), 0)


def _max_dn(camera: Camera) -> int:
    return 2**camera.bit_depth - 1


def _population(camera: Source | Sequence[Source]) -> tuple[Camera, ...]:
    several = camera if isinstance(camera, Sequence) and not isinstance(camera, str) else [camera]
    cameras = tuple(Camera.load(one) for one in several)
    if not cameras:
        raise InputError("the population is empty", field="camera", expected="one camera or more")
    return cameras
