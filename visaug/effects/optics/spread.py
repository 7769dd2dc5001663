"""Light spread over its surroundings: a near blur by convolution, what reaches far by the cosine transform."""

import math
from functools import lru_cache, wraps
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor

from visaug.effects.effect import Values, is_surely

PROFILES = ("gaussian", "exponential", "power_law")


def gaussian_blur(signal: Tensor, sigma_rows: Tensor, sigma_columns: Tensor) -> Tensor:
    """Convolves (B, C, H, W) with a Gaussian along both axes, collected by pixels; the image goes on beyond its edge.

    A pixel takes in all light that falls on it, so a weight is the integral of the Gaussian over the pixel and not its value
    in the middle, which would lose spots narrower than a pixel; the blur's variance is sigma^2 + 1/12 px^2 for wide ones.

    Args:
        sigma_rows, sigma_columns: standard deviations in px, (B, 1, 1, 1); where 0 the image is left as it is.
    """
    signal = _convolve(signal, _gaussian(sigma_rows).transpose(-1, -2))
    return _convolve(signal, _gaussian(sigma_columns))


def once_for_equals(apply):
    """Makes `apply` of an effect without random numbers compute consecutive equal images once, as flats of one level are."""

    @wraps(apply)
    def applied(self, signal, p, stream, context):
        numbers = [value for value in vars(p).values() if isinstance(value, Tensor)]
        has_gradient = any(value.requires_grad for value in (signal, *numbers))
        if has_gradient or signal.is_cuda or torch.compiler.is_compiling():
            return apply(self, signal, p, stream, context)
        if not all(bool((value == value[:1]).all()) for value in numbers):
            return apply(self, signal, p, stream, context)
        new = torch.tensor([True, *(not torch.equal(one, other) for one, other in pairwise(signal))])
        if bool(new.all()):
            return apply(self, signal, p, stream, context)
        first = {k: value[:1] if isinstance(value, Tensor) else value for k, value in vars(p).items()}
        return apply(self, signal[new], Values(**first), stream, context)[new.cumsum(0) - 1]

    return applied


def convolve(light: Tensor, kernel: Tensor) -> Tensor:
    """Light, (B, C, H, W) and never negative, convolved with a kernel of each image, (B, 1, K, K), K odd; the image goes on beyond
    its edge.

    By Fourier transform, whose time does not grow with the kernel; the rounding that leaves some light negative is taken off.
    """
    rows, columns = light.shape[-2:]
    reach = kernel.shape[-1] // 2
    padded = F.pad(light, (reach, reach, reach, reach), mode="replicate")
    size = padded.shape[-2:]
    product = torch.fft.rfft2(padded) * torch.fft.rfft2(kernel.to(light.dtype), s=size)
    full = torch.fft.irfft2(product, s=size)
    return full[..., 2 * reach : 2 * reach + rows, 2 * reach : 2 * reach + columns].clamp_min(0)


def pixels_around(reach: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Places of the pixels of a kernel, along the rows (1, 1, 1, K) and down the columns (1, 1, K, 1), px from its middle."""
    away = torch.arange(-reach, reach + 1, device=like.device, dtype=like.dtype)
    return away.view(1, 1, 1, -1), away.view(1, 1, -1, 1)


def _gaussian(sigma: Tensor) -> Tensor:
    """Kernels (B, 1, 1, K), each cut at its own width: an image does not depend on others of its batch."""
    truncate = 4.0  # standard deviations at which a Gaussian kernel is truncated
    own_reach = (truncate * sigma.detach() + 1).floor()
    reach = int(own_reach.max())
    away = torch.arange(-reach, reach + 1, device=sigma.device, dtype=sigma.dtype).view(1, 1, 1, -1).abs()
    scale = math.sqrt(2) * sigma.clamp_min(1e-3)
    tails = torch.special.erfc((away - 0.5) / scale) - torch.special.erfc((away + 0.5) / scale)
    weight = tails * (away <= own_reach)
    return weight / weight.sum(-1, keepdim=True)


def _convolve(signal: Tensor, kernel: Tensor) -> Tensor:
    batch, channels, rows, columns = signal.shape
    high, wide = kernel.shape[-2] // 2, kernel.shape[-1] // 2
    padded = F.pad(signal, (wide, wide, high, high), mode="replicate")
    kernel = kernel.to(signal.dtype).expand(batch, -1, -1, -1).repeat_interleave(channels, 0)
    flat = padded.reshape(1, batch * channels, rows + 2 * high, columns + 2 * wide)
    return F.conv2d(flat, kernel, groups=batch * channels).view_as(signal)


def halo(signal: Tensor, width_px: Tensor, profile: str, surround: Tensor) -> Tensor:
    """All light of (B, C, H, W) spread by a kernel without end.

    Beyond the frame the light is that of its mirror image times `surround`. With 1 as much light enters as leaves, so that the
    total is kept and a flat stays flat; with 0 the surround is black. Cosines are the mirrored frame's own modes.

    Profiles, of unit volume, with their transfer functions of the frequency f in cycles/px:
        gaussian     exp(-r^2 / 2w^2) / (2 pi w^2)       exp(-2 (pi w f)^2)
        exponential  exp(-r / w) / (2 pi w^2)            (1 + (2 pi w f)^2)^(-3/2)
        power_law    w / (2 pi (r^2 + w^2)^(3/2))        exp(-2 pi w f)
    """
    f_rows, f_columns = frequencies(signal)
    scaled = 2 * math.pi * width_px * (f_rows**2 + f_columns**2).sqrt()
    if profile == "gaussian":
        transfer = torch.exp(-(scaled**2) / 2)
    elif profile == "exponential":
        transfer = (1 + scaled**2) ** -1.5
    else:
        transfer = torch.exp(-scaled)
    mirrored = filtered(signal, transfer)
    if is_surely(surround, 1.0):
        return mirrored
    return surround * mirrored + (1 - surround) * _own_halo(signal, width_px, profile)


def _own_halo(signal: Tensor, width_px: Tensor, profile: str) -> Tensor:
    """The same with a black surround: a Fourier transform of twice the size, over which no light returns."""
    rows, columns = signal.shape[-2:]

    def away(count: int) -> Tensor:  # squared distance from the first pixel, the nearest way round
        along = torch.arange(2 * count, device=signal.device, dtype=signal.dtype)
        return torch.minimum(along, 2 * count - along) ** 2

    r2 = away(rows).view(1, 1, -1, 1) + away(columns)
    if profile == "gaussian":
        kernel = torch.exp(-r2 / (2 * width_px**2)) / (2 * math.pi * width_px**2)
    elif profile == "exponential":
        kernel = torch.exp(-r2.sqrt() / width_px) / (2 * math.pi * width_px**2)
    else:
        kernel = width_px / (2 * math.pi * (r2 + width_px**2) ** 1.5)
    size = (2 * rows, 2 * columns)
    product = torch.fft.rfft2(signal, s=size) * torch.fft.rfft2(kernel)
    return torch.fft.irfft2(product, s=size)[..., :rows, :columns].clamp_min(0)


def frequencies(signal: Tensor) -> tuple[Tensor, Tensor]:
    """Of the mirrored frame's modes, in cycles/px: down the columns (1, 1, H, 1), along the rows (1, 1, 1, W)."""
    rows, columns = signal.shape[-2:]
    like = {"device": signal.device, "dtype": signal.dtype}
    f_rows = torch.arange(rows, **like).view(1, 1, -1, 1) / (2 * rows)
    return f_rows, torch.arange(columns, **like).view(1, 1, 1, -1) / (2 * columns)


def filtered(signal: Tensor, transfer: Tensor) -> Tensor:
    """(B, C, H, W) with each mode of the mirrored frame multiplied by `transfer`, (B, 1, H, W)."""
    down, across = (cosines(n, signal.dtype, str(signal.device)) for n in signal.shape[-2:])
    return down.T @ ((down @ signal @ across.T) * transfer) @ across


@lru_cache(maxsize=16)
def cosines(size: int, dtype: torch.dtype, device: str) -> Tensor:
    """The orthonormal cosine transform (DCT-II) as a matrix: at these sizes faster than an FFT."""
    mode = torch.arange(size, dtype=torch.float64).view(-1, 1)
    place = torch.arange(size, dtype=torch.float64).view(1, -1) + 0.5
    matrix = torch.cos(math.pi / size * mode * place) * math.sqrt(2 / size)
    matrix[0] /= math.sqrt(2)
    return matrix.to(device=device, dtype=dtype)
