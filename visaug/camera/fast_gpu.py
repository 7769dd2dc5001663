"""The base chain as one expression of torch operators without tables, for `torch.compile` to fuse into one kernel on a GPU.

Law, order and expansion are those of `fast_kernel.py`; every part is drawn on its own here, as arithmetic costs a GPU
little. Tested on a CPU, where eager torch runs it; no GPU has run it yet.
"""

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from visaug.camera.scale import Scale, gain_of
from visaug.core.sampling import Stream
from visaug.core.sampling.philox import MASK, mix
from visaug.core.sampling.tukey_lambda import standard_deviation

if TYPE_CHECKING:
    from visaug.camera.camera import Camera

STEP, OTHER = 0x9E3779B97F4A7C15 - 2**64, 0xD1B54A32D192ED03 - 2**64
LARGE_MEAN = 16.0
TERMS = 52  # of the Poisson sum: P(N > 52) is below 1e-11 at a mean of 16


def noisy(
    images: Tensor, n: Mapping[str, Tensor], gain: Tensor, offset: Tensor, keys: Tensor, r0: int, c0: int
) -> Tensor:
    """Images as the camera takes them, (B, C, H, W) float32 in [0, 1].

    Args:
        images: (B, C, H, W) float32.
        n: `electrons` of the value 1, `dark_e`, `prnu_pixel`, `gaussian_e`, `read_scale_e` (Tukey-lambda's scale, not
            its standard deviation), `read_shape`, `dn_per_e`, `black_level_dn`, `less_dn`, `per_dn`, `full_well_e`, `max_dn`;
            (B, 1, 1, 1) each.
        gain, offset: of rows, columns and kept maps, fractions and electrons; broadcast against the images.
        keys: (B,) int64 of the temporal noise.
        r0, c0: row and column of the sensor at which the images begin.
    """
    _, channels, rows, columns = images.shape
    place = {"dtype": torch.int64, "device": images.device}
    channel = torch.arange(channels, **place).view(1, -1, 1, 1)
    row = torch.arange(r0, r0 + rows, **place).view(1, 1, -1, 1)
    column = torch.arange(c0, c0 + columns, **place)
    seeds = mix(mix(keys.view(-1, 1, 1, 1) + channel * STEP) + row) + column * STEP
    one, two = mix(seeds), mix(seeds ^ OTHER)
    radius = torch.sqrt(-2 * torch.log(_unit(one)))  # Box and Muller's two normals
    angle = (2 * math.pi) * _unit(one >> 32)
    w, z = radius * torch.cos(angle), radius * torch.sin(angle)
    light = (images * n["electrons"] * (1 + gain)).clamp_min(0)
    m = light + n["dark_e"]
    many = torch.floor(_count(m.clamp_min(LARGE_MEAN), light * n["prnu_pixel"], w) + 0.5)
    few = _few((light * (1 + n["prnu_pixel"] * w)).clamp_min(0) + n["dark_e"], _unit(two >> 32))
    count = torch.minimum(torch.where(m < LARGE_MEAN, few, many).clamp_min(0), n["full_well_e"])
    e = count + n["gaussian_e"] * z + offset + n["read_scale_e"] * _tukey(two, n["read_shape"])
    dn = torch.minimum(torch.round(e * n["dn_per_e"] + n["black_level_dn"]).clamp_min(0), n["max_dn"])
    return ((dn - n["less_dn"]) * n["per_dn"]).clamp(0, 1)


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
    for i in range(1, TERMS + 1):
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
    camera: "Camera",
    images: Tensor,
    scale: Scale,
    values: Mapping[str, np.ndarray],
    keys: Tensor,
    pattern_keys: Tensor,
    kept: bool = False,
    origin: tuple[int, int] = (0, 0),
    expression: Callable[..., Tensor] | None = None,
) -> Tensor:
    """As `fast.take`, on the images' device; `expression` is `noisy` itself or, where left out, compiled."""

    def on_device(value: np.ndarray) -> Tensor:
        return torch.as_tensor(value, dtype=torch.float32).view(-1, 1, 1, 1).to(images.device)

    v = {path: on_device(value) for path, value in values.items()}
    shape, sigma = values["read_noise.shape"], values["read_noise.sigma_e"]
    unit = sigma if camera.spec.read_noise.meaning == "scale" else sigma / standard_deviation(shape)
    heat = torch.exp(v["dark_current.b_per_c"] * camera.spec.dark_current.exponent(v["temperature_c"]))
    none, gain = torch.zeros_like(v["exposure_s"]), gain_of(camera, v)
    numbers = {
        "electrons": on_device(scale.electrons),
        "dark_e": v["exposure_s"] * v["dark_current.a_e_per_s"] * heat,
        "prnu_pixel": none if kept else v["prnu.pixel"],
        "gaussian_e": torch.hypot(none if kept else v["dsnu.pixel_e"], v["read_noise.after_gain_dn"] * gain),
        "read_scale_e": on_device(unit),
        "read_shape": v["read_noise.shape"],
        "dn_per_e": 1 / gain,
        "black_level_dn": v["black_level_dn"],
        "less_dn": on_device(scale.less_dn),
        "per_dn": on_device(scale.per_dn),
        "full_well_e": v["full_well_e"],
        "max_dn": none + (2**camera.bit_depth - 1),
    }
    rows, columns = images.shape[2:]
    window = (range(origin[0], origin[0] + rows), range(origin[1], origin[1] + columns))
    stream = Stream(keys, pattern_keys, images.shape[1], window, images.device)
    gain, offset = _pattern(stream, "prnu", "", v, kept), _pattern(stream, "dsnu", "_e", v, kept)
    for effect in camera.sensor_effects:
        vary = {"row_noise": "row", "column_noise": "column"}[effect]
        offset = offset + v[f"{effect}.sigma_e"] * stream.fork(effect).normal(vary)
    return (expression or compiled())(images, numbers, gain, offset, keys.to(images.device), *origin)


def _pattern(stream: Stream, effect: str, unit: str, v: Mapping[str, Tensor], kept: bool) -> Tensor:
    """Rows and columns, and pixels where they are kept, of a fixed pattern: the exact chain's own numbers."""
    fixed = stream.fork(effect).fixed
    parts = ("row", "column", "pixel") if kept else ("row", "column")
    return torch.stack(
        torch.broadcast_tensors(
            *(v[f"{effect}.{part}{unit}"] * fixed.fork(part).normal(part) for part in parts)
        )
    ).sum(0)
