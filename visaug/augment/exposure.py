"""One exposure of a batch of images by one camera: the images and their channels of light, numbers, scale and random numbers,
and both implementations of the chain; photons from images and irradiances.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from visaug.augment.draws import SHARED
from visaug.camera import Camera, fast
from visaug.camera.colour import ColourPath
from visaug.camera.loops import ends
from visaug.camera.scale import at_strength, scale_of
from visaug.core.errors import InputError
from visaug.core.sampling import Stream

if TYPE_CHECKING:
    from visaug.augment.sensor_noise import SensorNoise

MOST_COLOURS = 3  # red, green and blue; what has more channels of light has bands
MOST = 1.5  # image value: beyond, the image is of another scale; between 1 and it, it is cut by the sensor


def check_images(images: Any) -> Tensor:
    """A batch of images (B, C, H, W) of floating-point values in about [0, 1].

    Raises:
        InputError: no tensor, another number of axes, whole numbers, channels last, no pixels, or values below -0.5 or
            above 1.5, as an image of 0..255 has them. A NaN is no error.
    """
    if not isinstance(images, Tensor):
        expected = "a tensor (B, C, H, W); for PIL and NumPy images use visaug.augment.ImageNoise"
        raise InputError(f"is a {type(images).__name__}", field="images", expected=expected)
    shape = tuple(images.shape)
    if images.ndim != 4:
        raise InputError(f"has shape {shape}", field="images", expected="(B, C, H, W)")
    if not images.dtype.is_floating_point:
        expected = "floating point in [0, 1]: divide by the largest value of the type (255 for uint8)"
        raise InputError(f"has type {images.dtype}", field="images", expected=expected)
    check_pixels(shape)
    return images


def check_pixels(shape: Sequence[int]) -> None:
    """Raises InputError where images of a shape (..., C, H, W), or (H, W), have no pixels, or their channels last."""
    if len(shape) > 2 and shape[-3] > MOST_COLOURS + 1 and shape[-1] in (1, 3, 4):
        problem = f"has shape {tuple(shape)}, channels last"
        raise InputError(problem, field="images", expected="(..., C, H, W): image.movedim(-1, -3)")
    if 0 in shape[-3:]:
        raise InputError(f"has shape {tuple(shape)}, no pixels", field="images", expected="one pixel or more")


def check_number_of_draws(draws: Mapping[str, Tensor], images: Tensor) -> None:
    """Refuses draws of another number of images than these, (B, C, H, W)."""
    if len(draws["keys"]) != len(images):
        problem = f"are of {len(draws['keys'])} images"
        raise InputError(problem, field="draws", expected=f"draw({len(images)}), one for each")


def check_values(images: Tensor) -> None:
    """Refuses values of another scale than [0, 1]; see `check_images`.

    What they look like is said: normalised, high dynamic range, or whole numbers of 8, 12 or 16 bit.
    """
    if images.numel() == 0 or torch.compiler.is_compiling():
        return
    # An image that goes below the second, with more than this share of its values below 0, has had its mean subtracted:
    # resampling and a subtracted black level go less far, or in fewer pixels.
    least, normalized, normalized_share = -0.5, -0.05, 0.25
    low, high = ends(images.detach())  # a missing value must not hide the scale of the others
    if high <= MOST and low >= normalized:
        return
    there = images.detach()[~images.isnan()].float()
    negative = float((there < 0).float().mean())
    bright_share = 0.25  # of values above white: more is no highlight but another scale
    if low < least or negative > normalized_share:
        advice = "put the noise before Normalize, or undo it"
    elif high <= MOST:
        return  # dips below black, as a resampled image has them: the sensor cuts them
    elif float((there > 1).float().mean()) < bright_share:
        advice = "scale a high-dynamic-range image so that white is 1, or clamp its highlights with images.clamp(0, 1)"
    else:
        advice = "divide an image of 8 bit by 255, one of 16 bit by 65535, an HDR image by its value of white"
    share = f", {100 * negative:.0f} % below 0" if negative else ""
    problem = f"holds values from {low:g} to {high:g}{share}"
    raise InputError(problem, field="images", expected=f"values in [0, 1]: {advice}")


def light_channels(channels: int, mono: bool | None, alpha: bool = False) -> int:
    """Number of leading channels that hold light; the others, alpha, get no noise.

    Args:
        channels: 1 is gray and 3 colour; 2 and 4 are these with alpha. More are bands of a multispectral image.
        mono: False makes every channel a band, with a sensor of its own.
        alpha: the last of 2 or 4 channels is known to be alpha, whatever `mono`.
    """
    if channels > MOST_COLOURS + 1 and mono:
        problem = f"has {channels} channels, which one sensor cannot give"
        expected = "mono=False, for a sensor of its own for each band"
        raise InputError(problem, field="images", expected=expected)
    return channels - 1 if channels in (2, 4) and (alpha or mono is not False) else channels


def are_bands(channels: int, mono: bool | None) -> bool:
    """Whether each of these channels of light has a sensor of its own."""
    return mono is False or channels > MOST_COLOURS


def srgb_to_linear(image: Tensor) -> Tensor:
    """sRGB values in [0, 1] to values linear in light. Source: IEC 61966-2-1."""
    bent = ((image.clamp_min(0.04045) + 0.055) / 1.055) ** 2.4
    return torch.where(image <= 0.04045, image / 12.92, bent)


def linear_to_srgb(image: Tensor) -> Tensor:
    """Values linear in light, in [0, 1], to sRGB. Source: IEC 61966-2-1."""
    bent = 1.055 * image.clamp_min(0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(image <= 0.0031308, image * 12.92, bent)


def is_gray(light: Tensor) -> bool:
    """Whether all channels are known to be equal."""
    if light.shape[1] == 1 or torch.compiler.is_compiling():
        return light.shape[1] == 1
    return torch.equal(light, light[:, :1].expand_as(light))


def luminance(light: Tensor) -> Tensor:
    """The plane that a monochrome sensor sees, (B, 1, H, W), of linear light (B, C, H, W).

    Y = 0.2126 R + 0.7152 G + 0.0722 B for three channels, else their mean; exactly the image where all are equal.
    """
    first = light[:, :1]
    if light.shape[1] == 3:
        red, green, blue = light.split(1, 1)
        # Shares of linear red and blue: ITU-R BT.709, the primaries of sRGB.
        return green + 0.2126 * (red - green) + 0.0722 * (blue - green)
    return first + (light - first).mean(1, keepdim=True)


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
        if full_scale is not None:
            full_scale /= noise.strength**2  # as all charge before the readout
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


def irradiance_to_photons(
    irradiance_w_per_m2: Tensor | float,
    wavelength_m: Tensor | float,
    pixel_area_m2: Tensor | float,
    exposure_s: Tensor | float,
) -> Tensor | float:
    """Mean photons that hit a pixel during the exposure, mu_p = A E t lambda / (h c).

    Args:
        irradiance_w_per_m2: E on the sensor's surface, >= 0; any shape that broadcasts.
        wavelength_m: of quasi-monochromatic light, e.g. 525e-9.
        pixel_area_m2: geometric area of the pixel, gaps included: EMVA 1288 counts the fill factor to the QE.
        exposure_s: seconds.

    Source: EMVA 1288 release 4 Linear, eq. 3: 50.34 A[um^2] t[ms] lambda[um] E[uW/cm^2].
    """
    planck_j_s = 6.62607015e-34
    light_speed_m_per_s = 299_792_458.0
    photon_energy_j = planck_j_s * light_speed_m_per_s / wavelength_m
    return irradiance_w_per_m2 * pixel_area_m2 * exposure_s / photon_energy_j


def image_to_photons(
    image: Tensor, max_dn: float, gain_e_per_dn: Tensor, quantum_efficiency: Tensor
) -> Tensor:
    """Mean photons per pixel of which a camera without offset would make this image, mu_p = I max_dn G / QE.

    Whatever the gain and the quantum efficiency, the mean of the camera's image is then `image` again.

    Args:
        image: (B, C, H, W), linear in light, in [0, 1] of the converter's range.
        max_dn: 2^bits - 1.
        gain_e_per_dn: of the camera, e-/DN, (B, 1, 1, 1) or a scalar.
        quantum_efficiency: of the camera, (B, 1, 1, 1) or a scalar.

    Source: the paper, eq. 7.
    """
    return image * (max_dn * gain_e_per_dn / quantum_efficiency)
