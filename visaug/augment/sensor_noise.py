"""The noise of a camera, or of a population of cameras, on batches of images. Knows torch alone, no image library."""

import inspect
import os
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, distributed, nn
from torch.utils.data import get_worker_info

from visaug.augment import exposure as exposures
from visaug.augment import options
from visaug.augment.options import Range
from visaug.camera import Camera, fast
from visaug.camera.paths import place_of
from visaug.camera.randomize import spreads
from visaug.camera.scale import with_maps_at_strength
from visaug.core.errors import InputError
from visaug.core.sampling import derive_key, signed

Source = Camera | str | Path | Mapping[str, Any]


class SensorNoise(nn.Module):
    """Adds the noise of a camera to images.

    The image value 1 corresponds to the saturation of the exposure, min(full well, (max_dn - black level) gain), at the
    gain and quantum efficiency of each image, so `randomize` changes the noise and not the brightness. For a camera file
    with `reading: paper` it corresponds to the full range of the converter, eq. 7 of the paper.

    Args:
        camera: a Camera, its file or name, or a list of these from which one is drawn for each image.
        fixed_pattern: "image" draws new row, column and pixel patterns for every image, as from different specimens;
            "camera" keeps the patterns of one specimen, chosen by `seed`.
        transfer: "linear" takes pixel values as linear in light; "srgb" decodes them to linear values first and encodes the
            result. "auto" is linear here; adapters choose by file type or data type.
        black_level: "subtract" subtracts the camera's black level and scales so that saturation is 1; "keep" returns the
            DN of the converter as a fraction of its range.
        resolution: "network": an image pixel is a sensor pixel. "sensor": an image pixel is the mean of k x k sensor
            pixels, where k is the ratio of sensor size to image size, rounded, at least 1. The noise is then about k times
            weaker.
        fast: True uses the table-driven implementation where it follows the same law: base chain, physical reading, no
            gradient required, CPU. False always uses the exact chain.
        seed: of the kept fixed pattern and of the random numbers; None follows `torch.manual_seed`. The ranks of a
            distributed training share the kept pattern and have independent random numbers.
        full_scale_photons: mean photons per pixel at image value 1, > 0, instead of saturation. The brightness then depends
            on gain and quantum efficiency; the output is still 1 at saturation.
        values: replacements for camera parameters by path, e.g. {"read_noise.sigma_e": nn.Parameter(...)}: a number or tensor
            in the range of camera.yaml, or with one camera a tensor (B,) of one value for each image. Gradients reach them.
        origin: row and column of the sensor at which the image begins, if it is a crop, whole numbers from 0. Kept patterns
            and effects that depend on the position on the sensor then belong to this window.
        mono: how one sensor serves several channels. None follows the camera: a camera with `colour` filters images through
            its mosaic (see `visaug.camera.colour`), and a one-channel image gets the luminance of the result; a camera without
            filters is monochrome. True: the noise of the exposed luminance 0.2126 R + 0.7152 G + 0.0722 B is added to every
            channel, so equal channels stay equal. False: every channel is a separate sensor with independent noise. Bands
            (more than four channels) are separate sensors unless mono is True, which is an error; a camera with `colour`
            takes none.
        gain_db: gain in dB on the camera's scale (that of `gain_db` in its file), or a pair (low, high) from which it is
            drawn uniformly for each image. It replaces the camera's gain and its `randomize` entry.
        exposure: fraction of the saturation exposure, from 1e-6 to 1, or a pair (low, high) from which it is drawn uniformly.
            With 0.05 the image is exposed with a twentieth of the light and multiplied by 20 after the converter. Exposure
            time and dark current do not change.
        strength: factor on the standard deviation of all noise, temporal and fixed, at the same brightness, 0 to 100. 0
            returns the images unchanged, 1 is the camera. Implemented with 1/strength^2 of the electrons, see
            `visaug.camera.scale`: shot noise stays Poisson, and effects that are not noise (blur, fractions, densities) do
            not change.

    Shape:
        (B, C, H, W), floating point in [0, 1] -> the same shape, dtype and device, in [0, 1]. C is 1 (gray) or 3 (colour), or
        2 or 4 with an alpha channel, which is not changed; more are bands, as are all channels with mono=False. Values below 0 or
        above 1 are clipped by the sensor; values below -0.5 or above 1.5 are an error. A NaN stays at its pixel; demosaicing
        spreads it to neighbours. Effects of stage PICTURE (tone curve, JPEG) act last, on the encoded picture.

    Raises:
        InputError: an option or an image that is not valid.

    Examples:
        >>> import torch
        >>> from visaug.augment import SensorNoise
        >>> SensorNoise("sony_imx174", gain_db=(0, 24), exposure=0.1)(torch.rand(2, 1, 32, 32)).shape
        torch.Size([2, 1, 32, 32])
    """

    def __init__(
        self,
        camera: Source | Sequence[Source],
        *,
        fixed_pattern: str = "image",
        transfer: str = "auto",
        black_level: str = "subtract",
        resolution: str = "network",
        fast: bool = True,
        seed: int | None = None,
        full_scale_photons: float | None = None,
        values: Mapping[str, Tensor | float] | None = None,
        origin: tuple[int, int] | None = None,
        mono: bool | None = None,
        gain_db: Range = None,
        exposure: Range = None,
        strength: float = 1.0,
    ):
        super().__init__()
        self.cameras = _population(camera)
        self._spreads = [spreads(camera) for camera in self.cameras]
        drawn = {path for random in self._spreads for path in random.paths}
        known = [camera.values() for camera in self.cameras]
        # 0 where a camera has no such parameter
        self._nominal = {path: torch.tensor([values.get(path, 0.0) for values in known]) for path in drawn}
        self.fixed_pattern = options.check_choice("fixed_pattern", fixed_pattern)
        self.transfer = options.check_choice("transfer", transfer)
        self.black_level = options.check_choice("black_level", black_level)
        self.resolution = options.check_choice("resolution", resolution)
        self.fast, self.seed, self.origin = fast, options.check_seed(seed), options.check_origin(origin)
        self.mono = options.check_flag("mono", mono)
        self.full_scale_photons = photons = full_scale_photons
        if photons is not None:
            self.full_scale_photons = options.check_number("full_scale_photons", photons, 0, 1e12, above=True)
        self.gain_db = options.check_range("gain_db", gain_db, -60, 120)
        # At the least a pixel of the largest full wells (1e6 e-) holds one electron.
        self.exposure = options.check_range("exposure", exposure, 1e-6, 1)
        self.strength = options.check_strength(strength)
        if self.strength not in (0, 1):
            self.cameras = tuple(with_maps_at_strength(camera, self.strength) for camera in self.cameras)
        if not isinstance(values or {}, Mapping):
            raise InputError(f"{values!r} is not valid", field="values", expected="a dict of path and value")
        if gain_db is not None and "gain_db" in (values or {}):
            raise InputError("is given twice", field="gain_db", expected="the option, or an entry of values")
        if self.black_level == "keep" and mono is None and any(camera.spec.colour for camera in self.cameras):
            problem = "keep leaves an offset that white balance would turn into a colour cast"
            expected = "subtract for a colour camera, or mono=True"
            raise InputError(problem, field="black_level", expected=expected)
        self._generator: tuple[tuple[int | None, int], torch.Generator] | None = None
        self._names: dict[str, str] = {}  # of parameters of this module
        self._values: dict[str, Tensor] = {}  # the others; no buffers, which `.half()` would round
        for path, value in (values or {}).items():
            self._add_value(path, value)

    def _add_value(self, path: str, value: Tensor | float) -> None:
        known = {name: None for camera in self.cameras for name in camera.values()}
        if path not in known:
            expected = f"one of {', '.join(known)}"
            raise InputError("is not a parameter of this camera", field=path, expected=expected)
        parameter = place_of(path).parameter
        if path == "black_level_dn":  # as in a camera.yaml, it leaves a range for the signal
            parameter = replace(parameter, high=2 ** min(camera.bit_depth for camera in self.cameras) - 2)
        options.check_replacement(path, value, parameter)
        if len(self.cameras) > 1 and torch.as_tensor(value).numel() > 1:
            expected = "one number, for several cameras"
            raise InputError("has a value for each image", field=path, expected=expected)
        if isinstance(value, nn.Parameter):
            self._names[path] = "value_" + path.replace(".", "_")
            self.register_parameter(self._names[path], value)
        else:
            self._values[path] = torch.as_tensor(value, dtype=torch.float32)

    def draw(
        self, count: int, same_on_batch: bool = False, source: torch.Generator | None = None
    ) -> dict[str, Tensor]:
        """Draws random keys and parameters for `count` images; see `visaug.augment.draws`.

        Args:
            same_on_batch: one draw for all images.
            source: of the random numbers, whatever the seed, the worker and the rank; None follows these.
        """
        number, source = 1 if same_on_batch else count, source or self._random_source()
        draws = {"keys": _keys(number, source)}
        if self.fixed_pattern == "camera":  # the individual that `simulate` has at this seed
            kept = signed(derive_key(self.seed or 0, "camera"))
            draws["pattern_keys"] = torch.full((number,), kept, dtype=torch.int64)
        else:
            draws["pattern_keys"] = _keys(number, source)
        draws["camera"] = torch.randint(0, len(self.cameras), (number,), generator=source)
        for which, random in enumerate(self._spreads):
            uniform = torch.rand(number, len(random.paths), dtype=torch.float64, generator=source)
            for path, value in random.values(uniform).items():
                if len(self.cameras) > 1:
                    # images of other cameras have those cameras' own value, drawn or not
                    other = draws.get(path, self._nominal[path][draws["camera"]])
                    value = torch.where(draws["camera"] == which, value, other)
                draws[path] = value
        for name, ends in (("gain_db", self.gain_db), ("exposure", self.exposure)):
            if ends is not None:  # instead of a camera's own
                low, high = ends
                uniform = torch.rand(number, generator=source) if low < high else torch.zeros(number)
                draws[name] = low + (high - low) * uniform
        return {name: value.expand(count) for name, value in draws.items()} if same_on_batch else draws

    def _random_source(self) -> torch.Generator | None:
        """Torch's own generator, or one of the seed and DataLoader worker; another on each rank of a training."""
        rank = 0 if torch.compiler.is_compiling() else _rank()
        if self.seed is None:
            if rank == 0:
                return None
            word = int(torch.randint(2**62, ()))  # ranks with equal seeds differ from here on
            return torch.Generator().manual_seed(derive_key(word, "rank", rank) >> 1)
        worker = get_worker_info()
        place = (None if worker is None else worker.seed, rank)
        if self._generator is None or self._generator[0] != place:
            seed = derive_key(self.seed, "draws", *(place if rank else place[:1])) >> 1
            self._generator = (place, torch.Generator().manual_seed(seed))
        return self._generator[1]

    def forward(self, images: Tensor) -> Tensor:
        exposures.check_images(images)
        exposures.check_values(images)
        return self._noisy(images, self.draw(images.shape[0]), None)

    def apply_draws(self, images: Tensor, draws: Mapping[str, Tensor], transfer: str | None = None) -> Tensor:
        """Applies the noise given by `draws`: the same draws and images give the same noise.

        The random numbers are others, of the same law, where gradients are wanted, which pass only effect by effect, and may be
        others where an image is in another batch: with images that share a fixed pattern with one another, or whose camera has
        more electrons than the fast implementation counts.

        Args:
            images: (B, C, H, W) in [0, 1]; see the class.
            draws: the result of `draw(B)`.
            transfer: meaning of "auto" for these images: "linear" (also if None) or "srgb".
        """
        exposures.check_images(images)
        exposures.check_values(images)
        exposures.check_number_of_draws(draws, images)
        return self._noisy(images, draws, transfer)

    def _noisy(self, images: Tensor, draws: Mapping[str, Tensor], transfer: str | None) -> Tensor:
        """What the cameras make of images that have been checked."""
        if self.strength == 0 or len(images) == 0:
            return images.clone()  # what is done to it in place does not reach the input
        lit = exposures.light_channels(images.shape[1], self.mono)
        encoded = (transfer if self.transfer == "auto" else self.transfer) == "srgb"
        light = images[:, :lit].float()
        light = exposures.srgb_to_linear(light) if encoded else light
        groups = self._groups(draws)
        # in float32 also within autocast, whose half precision is coarser than the noise
        device = images.device.type
        halves = torch.is_autocast_enabled(device)
        with torch.autocast(device, enabled=False) if halves else nullcontext():
            pictures = [self._picture(camera, light[here], own, encoded) for camera, here, own in groups]
        if len(pictures) == 1:
            noisy = pictures[0].to(images.dtype)
        else:
            order = draws["camera"].argsort(stable=True)
            noisy = torch.cat(pictures)[order.argsort()].to(images.dtype)
        return noisy if lit == images.shape[1] else torch.cat([noisy, images[:, lit:]], 1)

    def _groups(
        self, draws: Mapping[str, Tensor]
    ) -> list[tuple[Camera, Tensor | slice, Mapping[str, Tensor]]]:
        """The cameras of a batch in order, each with its images and their draws."""
        if len(self.cameras) == 1:
            return [(self.cameras[0], slice(None), draws)]
        of, groups = draws["camera"], []
        for number in of.unique().tolist():
            here = (of == number).nonzero().squeeze(1)
            own = {name: value[here] for name, value in draws.items() if value.shape[:1] == of.shape}
            groups.append((self.cameras[number], here, own))
        return groups

    def apply_to_words(self, images: Tensor, draws: Mapping[str, Tensor], white: int) -> Tensor | None:
        """Whole numbers, linear in light, of which `white` is the image value 1, in one pass: `apply_draws`, rounded.

        Args:
            images: (B, C, H, W), uint8 or uint16.

        Returns:
            The same shape and type; None where only `apply_draws` can: colour, several cameras, effects on the picture.
        """
        exposures.check_number_of_draws(draws, images)
        camera = self.cameras[0]
        plain = len(self.cameras) == 1 and not camera.finishes and self.strength > 0
        plain = plain and (images.shape[1] == 1 or exposures.are_bands(images.shape[1], self.mono))
        plain = plain and not (camera.spec.colour and self.mono is None)
        if not plain or self._pixels_per_pixel(camera, images) > 1:
            return None
        exposure = self._exposure(camera, draws, images)
        return exposure.by_tables(images, None, white) if exposure.fused else None

    def _picture(self, camera: Camera, light: Tensor, draws: Mapping[str, Tensor], encoded: bool) -> Tensor:
        """The encoded picture that a camera makes of light, in one exposure of one plane, or of a sensor for each band.

        A monochrome sensor sees the luminance Y, whose noise is added to every channel: out_c = cut(take(Y) + (c - Y)). Equal
        channels stay equal; differences between channels are kept and get no noise.
        """
        scale = self._pixels_per_pixel(camera, light)
        exposure = self._exposure(camera, draws, light)
        colour = camera.colour_path(self.origin or (0, 0)) if self.mono is None else None
        mono = colour is None and not exposures.are_bands(light.shape[1], self.mono)
        gray = mono and exposures.is_gray(light)
        seen = light[:, :1] if gray else exposures.luminance(light) if mono else light
        noisy = exposure.of_light(seen, colour, scale)
        if gray:
            noisy = noisy.expand(light.shape).contiguous()
        elif mono:
            noisy = (noisy + (light - seen)).clamp(0, 1)
        elif colour is not None and light.shape[1] == 1:
            noisy = exposures.luminance(noisy)
        noisy = exposures.linear_to_srgb(noisy) if encoded else noisy
        return exposure.finish(noisy) if camera.finishes else noisy

    def _exposure(self, camera: Camera, draws: Mapping[str, Tensor], light: Tensor) -> exposures.Exposure:
        may_be_fast, known = self._may_be_fast(light), camera.arrays()
        changed = {path: value for path, value in draws.items() if path in known}
        for path, value in self._given().items():
            if (count := value.numel()) not in (1, len(light)):
                problem = f"has {count} values for {len(light)} images"
                raise InputError(problem, field=path, expected="one number, or one for each image")
            if path in known:  # of a population some cameras may lack an effect
                changed[path] = value
        return exposures.Exposure(camera, draws, changed, light.device, may_be_fast, self)

    def _given(self) -> dict[str, Tensor]:
        """The replacements of camera parameters by path."""
        return self._values | {path: getattr(self, name) for path, name in self._names.items()}

    def _pixels_per_pixel(self, camera: Camera, light: Tensor) -> int:
        if self.resolution == "network":
            return 1
        rows, columns = camera.resolution
        return max(1, round(max(rows / light.shape[2], columns / light.shape[3])))

    def _may_be_fast(self, light: Tensor) -> bool:
        if not self.fast or torch.compiler.is_compiling() or light.device.type not in ("cpu", "cuda"):
            return False
        if fast.kernel() is None:
            return False
        if not torch.is_grad_enabled():
            return True
        return not (light.requires_grad or any(value.requires_grad for value in self._given().values()))

    def described(self) -> str:
        """Cameras, transfer function, seed, and the options that are not at their defaults, as in a call."""
        words = [repr(camera.name) for camera in self.cameras[:3]]
        if len(self.cameras) > 3:
            words = [f"{len(self.cameras)} cameras"]
        words += [f"transfer={self.transfer!r}", f"seed={self.seed}"]
        defaults = inspect.signature(SensorNoise).parameters
        further = ("gain_db", "exposure", "strength", "full_scale_photons", "origin", "fast")
        for name in ("fixed_pattern", "black_level", "resolution", "mono", *further):
            value = getattr(self, name)
            if value != defaults[name].default:
                a_range = name in ("gain_db", "exposure")
                value = value[0] if a_range and value[0] == value[-1] else value
                words.append(f"{name}={value!r}")
        if given := self._given():
            words.append(f"values of {', '.join(given)}")
        return ", ".join(words)

    extra_repr = described


def _keys(number: int, source: torch.Generator | None) -> Tensor:
    return torch.randint(-(2**63), 2**63 - 1, (number,), dtype=torch.int64, generator=source)


def _rank() -> int:
    """Rank of this process in a distributed training, 0 outside; workers inherit it."""
    if distributed.is_available() and distributed.is_initialized():
        return distributed.get_rank()
    word = os.environ.get("RANK", "")
    return int(word) if word.isascii() and word.isdigit() else 0  # some launchers export it empty, or a name


def _population(camera: Source | Sequence[Source]) -> tuple[Camera, ...]:
    several = camera if isinstance(camera, Sequence) and not isinstance(camera, str) else [camera]
    if not (cameras := tuple(Camera.load(one) for one in several)):
        raise InputError("the population is empty", field="camera", expected="one camera or more")
    return cameras
