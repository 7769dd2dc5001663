"""Light of images: the channels that hold it, photons from images and irradiances, sRGB, and the plane of a monochrome sensor."""

import torch
from torch import Tensor

from visaug.core.errors import InputError

MOST_COLOURS = 3  # red, green and blue; what has more channels of light has bands


def light_channels(channels: int, mono: bool | None, alpha: bool = False) -> int:
    """Number of leading channels that hold light; the others, alpha, get no noise.

    Args:
        channels: 1 is gray and 3 colour; 2 and 4 are these with alpha. More are bands of a multispectral image.
        mono: False makes every channel a band, with a sensor of its own.
        alpha: the last of 2 or 4 channels is known to be alpha, whatever `mono`.

    Raises:
        InputError: more than four channels with mono=True.
    """
    if channels > MOST_COLOURS + 1 and mono:
        problem = f"has {channels} channels, which one sensor cannot give"
        expected = "mono=False, for a sensor of its own for each band"
        raise InputError(problem, field="images", expected=expected)
    return channels - 1 if channels in (2, 4) and (alpha or mono is not False) else channels


def are_bands(channels: int, mono: bool | None) -> bool:
    """Whether each of these channels of light has a sensor of its own."""
    return mono is False or channels > MOST_COLOURS


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
