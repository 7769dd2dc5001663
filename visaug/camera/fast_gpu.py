"""The base chain as one expression of torch operators without tables, for `torch.compile` to fuse into one kernel on a GPU.

Law, order and expansion are those of `fast_kernel.py`; every part is drawn on its own here, as arithmetic costs a GPU
little. Tests run it on a CPU with eager torch, and compiled on a GPU (`scripts/gpu_check`).
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import torch
from torch import Tensor

from visaug.camera.fused import Drawn
from visaug.core.sampling.philox import MASK, mix

STEP = 0x9E3779B97F4A7C15 - 2**64
LARGE_MEAN = 16.0


def noisy(
    images: Tensor,
    table: Tensor,
    rows: Tensor,
    columns: Tensor,
    maps: tuple[Tensor, Tensor],
    keys: Tensor,
    r0: int,
    c0: int,
) -> Tensor:
    """Images as the camera takes them, (B, C, H, W) float32 in [0, 1].

    Args:
        images: (B, C, H, W) float32.
        table: numbers by column of `fast_kernel`, (B, NUMBERS).
        rows, columns: gains and offsets (electrons) of lines, (2, B or 1, C, H, 1) and (2, B or 1, C, 1, W).
        maps: gain and offset (electrons) of pixels that are kept, (C, H, W) or 0.
        keys: (B,) int64 of the temporal noise.
        r0, c0: row and column of the sensor at which the images begin.
    """
    from visaug.camera.fast_kernel import Number as k  # not before it is needed: it imports numba

    # Indices are `.value`: torch.compile takes no member of an enumeration.
    n = table[:, :, None, None, None].unbind(1)
    gain, offset = (rows[i] + columns[i] + maps[i] for i in range(2))
    _, channels, height, width = images.shape
    place = {"dtype": torch.int64, "device": images.device}
    channel = torch.arange(channels, **place).view(1, -1, 1, 1)
    row = torch.arange(r0, r0 + height, **place).view(1, 1, -1, 1)
    column = torch.arange(c0, c0 + width, **place)
    seeds = mix(mix(keys.view(-1, 1, 1, 1) + channel * STEP) + row) + column * STEP
    one = mix(seeds)
    two = mix(seeds ^ (0xD1B54A32D192ED03 - 2**64))  # any bits tell the second from the first
    radius = torch.sqrt(-2 * torch.log(_unit(one)))  # Box and Muller's two normals
    angle = (2 * math.pi) * _unit(one >> 32)
    w, z = radius * torch.cos(angle), radius * torch.sin(angle)
    light = (images * n[k.ELECTRONS.value] * (1 + gain)).clamp_min(0)
    m = light + n[k.DARK_E.value]
    many = torch.floor(_count(m.clamp_min(LARGE_MEAN), light * n[k.PRNU_PIXEL.value], w) + 0.5)
    few = _few((light * (1 + n[k.PRNU_PIXEL.value] * w)).clamp_min(0) + n[k.DARK_E.value], _unit(two >> 32))
    count = torch.minimum(torch.where(m < LARGE_MEAN, few, many).clamp_min(0), n[k.FULL_WELL_E.value])
    e = count + torch.hypot(n[k.DSNU_PIXEL_E.value], n[k.AFTER_GAIN_E.value]) * z + offset
    e = e + n[k.READ_SCALE_E.value] * _tukey(two, n[k.READ_SHAPE.value])
    dn = torch.round(e / n[k.E_PER_DN.value] + n[k.BLACK_DN.value]).clamp_min(0)
    dn = torch.minimum(dn, n[k.MAX_DN.value])
    return ((dn - n[k.LESS_DN.value]) * n[k.PER_DN.value]).clamp(0, 1)


def _unit(bits: Tensor) -> Tensor:
    """Uniform in (0, 1], float32, from the lower 32 bits; small values keep their precision."""
    return ((bits & MASK).float() + 0.5) * 2.0**-32


def _count(m: Tensor, deviation: Tensor, w: Tensor) -> Tensor:
    v = deviation * deviation
    s = torch.sqrt(m + v)
    r = 1 / s
    r2, w2 = r * r, w * w
    skew = (m + 3 * v) * r2
    curve = (m + 7 * v) * r2 * (w2 - 3) - 1
    bend = skew * skew * (2 * w2 - 5)
    x = m + s * w + skew * (w2 - 1) / 6 + r * w * (curve / 24 - bend / 36)
    return x + m * r2 * r2 * (-8 / 405 + w2 * (7 / 810 + w2 / 270))


def _few(mean: Tensor, u: Tensor) -> Tensor:
    """Poisson quantile by summing, for means up to a little over LARGE_MEAN."""
    term = torch.exp(-mean)
    left, count = u - term, torch.zeros_like(u)
    for i in range(1, 53):  # P(N > 52) is below 1e-11 at a mean of 16
        count = count + (left > 0)
        term = term * (mean / i)
        left = left - term
    return count


def _tukey(bits: Tensor, shape: Tensor) -> Tensor:
    """Tukey-lambda of scale 1."""
    p = ((bits & 0x7FFFFFFF).float() + 0.5) * 2.0**-32
    safe = torch.where(shape.abs() < 1e-4, 1e-4, shape)
    quantile = (torch.exp(safe * torch.log(p)) - torch.exp(safe * torch.log1p(-p))) / safe
    return torch.where((bits & 0x80000000) == 0, quantile, -quantile)


@cache
def compiled() -> Callable[..., Tensor]:
    return torch.compile(noisy, dynamic=True)


def take(
    images: Tensor,
    drawn: Drawn,
    keys: Tensor,
    origin: tuple[int, int],
    expression: Callable[..., Tensor] | None = None,
) -> Tensor:
    """As `fast.take`, which draws for the images; `expression` is `noisy` itself or, where left out, compiled.

    What is small is computed on the CPU and crosses in one copy: each copy and each operator costs a GPU's queue as much time
    as the noise of an image.
    """
    (_, channels, height, width), device = images.shape, images.device
    shapes = (drawn.numbers.shape, (2, -1, channels, height, 1), (2, -1, channels, 1, width))
    parts = [
        part.astype(np.float32, copy=False).ravel() for part in (drawn.numbers, drawn.rows, drawn.columns)
    ]
    crossed = torch.from_numpy(np.concatenate(parts)).to(device).split([part.size for part in parts])
    tables = [part.view(shape) for part, shape in zip(crossed, shapes, strict=True)]
    none = torch.zeros((), device=device)
    maps = tuple(none if of is None else of.to(device) for of in drawn.maps)
    return (expression or compiled())(images, *tables, maps, keys.to(device), *origin)
