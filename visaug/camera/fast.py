"""The base chain on images: the law of `Camera.expose`, without gradients, on a CPU or a GPU.

Row and column patterns are the exact chain's own numbers, and so are pixel patterns that are kept; so is everything else where
`fast_kernel` draws each part on its own.
"""

import logging
import math
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from scipy.special import expit, ndtr
from torch import Tensor

from visaug.camera import fast_gpu, fused, loops
from visaug.camera.scale import Scale, gain_of
from visaug.core.sampling import Stream
from visaug.core.sampling.tukey_lambda import quantile, standard_deviation

if TYPE_CHECKING:
    from visaug.camera.camera import Camera

Values = Mapping[str, np.ndarray]
SHIFTS = ("row_noise", "column_noise")  # further effects that only shift rows or columns
PATTERNS = ("prnu.row", "dsnu.row_e", "prnu.column", "dsnu.column_e")
VISIBLE_COMB = 2e-4


def suits(camera: "Camera", values: Values) -> bool:
    """Whether the fast path has this camera's law at these values, (B,) or (1,) each."""
    if camera.spec.reading != "physical" or camera.sensor_maps:
        return False
    if not set(camera.sensor_effects) <= set(SHIFTS):
        return False
    # beyond, the exact chain is taken
    return not (gain_of(camera, values) * 2**camera.bit_depth > loops.kernel().MOST_E).any()


def take(
    camera: "Camera",
    images: Tensor,
    scale: Scale,
    values: Values,
    keys: Tensor,
    pattern_keys: Tensor,
    kept: bool = False,
    origin: tuple[int, int] = (0, 0),
    white: int = 0,
) -> Tensor:
    """Images as the camera takes them.

    Args:
        images: (B, C, H, W) float32 in [0, 1], linear in light; on a CPU also whole numbers, uint8 or uint16.
        scale: from image values to electrons and from DN to image values, arrays (B,) or (1,).
        values: every number of the camera by path, (B,) or (1,).
        keys: (B,) int64 of the temporal noise.
        pattern_keys: (B,) int64: patterns of each image; where `kept`, (1,): patterns of one camera.
        origin: row and column of the sensor at which the images begin.
        white: the whole number that is the image value 1; 0 for float32.

    Returns:
        (B, C, H, W) of the images' type, float32 in [0, 1].
    """
    if kept and len(images) > 1 and any(values[path].size > 1 for path in ("prnu.pixel", "dsnu.pixel_e")):
        parts = []  # one map serves a batch: here each image has its own
        for k in range(len(images)):
            of_image = {path: value[k : k + 1] if value.size > 1 else value for path, value in values.items()}
            own_scale = Scale(*(x[k : k + 1] if np.size(x) > 1 else x for x in scale))
            one = images[k : k + 1], own_scale, of_image, keys[k : k + 1]
            parts.append(take(camera, *one, pattern_keys, kept, origin, white))
        return torch.cat(parts)
    channels, height, _ = images.shape[1:]
    own = drawn(camera, images.shape, scale, values, keys, pattern_keys, kept, origin)
    if images.device.type != "cpu":
        return fast_gpu.take(images, own, keys, origin)
    none = np.zeros((channels, height, 0), np.float32)
    maps = [none if of is None else of.numpy() for of in own.maps]
    out = torch.empty(images.shape, dtype=images.dtype)
    loops.in_kernel(
        images.contiguous(), out, own.numbers, own.keys, [*own.rows, *own.columns], maps, origin, white
    )
    return out


def drawn(
    camera: "Camera",
    shape: Sequence[int],
    scale: Scale,
    values: Values,
    keys: Tensor,
    pattern_keys: Tensor,
    kept: bool,
    origin: tuple[int, int],
) -> fused.Drawn:
    """What `take` draws for images of a shape (B, C, H, W), whose arguments these are, before their pixels."""
    batch, channels, height, width = shape
    frames, cameras = (np.ascontiguousarray(own.numpy()).view(np.uint64) for own in (keys, pattern_keys))
    table = fused.keys_of(frames, cameras)
    numbers = _numbers(camera, batch, scale, values, kept)
    shared = kept and not camera.sensor_effects and all(values[path].size == 1 for path in PATTERNS)
    sets = 1 if shared else batch
    window = (range(origin[0], origin[0] + height), range(origin[1], origin[1] + width))
    rows = _line_patterns(numbers, table, sets, channels, False, window[0])
    columns = _line_patterns(numbers, table, sets, channels, True, window[1])

    def kept_map(path: str) -> Tensor | None:
        sigma = float(values[path][0]) if kept else 0.0
        effect = path.partition(".")[0]
        return _kept_map(int(pattern_keys[0]), effect, sigma, channels, window) if sigma else None

    return fused.Drawn(numbers, table, rows, columns, (kept_map("prnu.pixel"), kept_map("dsnu.pixel_e")))


def _line_patterns(
    numbers: np.ndarray, keys: np.ndarray, sets: int, channels: int, by_column: bool, window: range
) -> np.ndarray:
    """Gains and offsets of the rows, or columns, of a window, (2, sets C, size) float32; other arguments as the kernel's."""
    size = len(window)
    out = np.zeros((2, sets * channels, size), np.float32)
    words, w = np.empty(size + 3, np.uint32), np.empty(size, np.float32)
    loops.kernel().line_patterns(numbers, keys, sets, channels, by_column, window.start, words, w, out)
    return out


@lru_cache(maxsize=4)
def _kept_map(key: int, effect: str, sigma: float, channels: int, window: tuple[range, range]) -> Tensor:
    """The pixel part of a camera's pattern, (C, H, W) float32: the exact chain's own."""
    keys = torch.tensor([key])
    fixed = Stream(keys, keys, channels, window).fork(effect).fixed
    return (sigma * fixed.fork("pixel").normal("pixel"))[0]


def _numbers(camera: "Camera", batch: int, scale: Scale, values: Values, kept: bool) -> np.ndarray:
    """The kernel's table, one row an image."""
    k, n, most_e = loops.kernel().Number, fused.neutral().repeat(batch, 0), loops.kernel().MOST_E
    sigma, shape = values["read_noise.sigma_e"], values["read_noise.shape"]
    deviation = standard_deviation(shape)
    own_scale = camera.spec.read_noise.meaning == "scale"
    heat = np.exp(values["dark_current.b_per_c"] * camera.spec.dark_current.exponent(values["temperature_c"]))
    gain = gain_of(camera, values)
    n[:, k.ELECTRONS], n[:, k.LESS_DN], n[:, k.PER_DN] = scale
    n[:, k.LEAST_E], n[:, k.COUNTED], n[:, k.LEAST_OUT], n[:, k.MOST_OUT] = 0, 1, 0, 1
    n[:, k.DARK_E] = np.minimum(values["exposure_s"] * values["dark_current.a_e_per_s"] * heat, most_e)
    n[:, k.FULL_WELL_E] = values["full_well_e"]
    n[:, k.READ_SCALE_E], n[:, k.READ_SHAPE] = sigma if own_scale else sigma / deviation, shape
    if not kept:
        n[:, k.CORE :] = read_curves(n[:, k.READ_SCALE_E], shape)
    n[:, k.AFTER_GAIN_E] = values["read_noise.after_gain_dn"] * gain
    n[:, k.E_PER_DN], n[:, k.BLACK_DN] = gain, values["black_level_dn"]
    n[:, k.MAX_DN] = 2**camera.bit_depth - 1
    for place, vary in ((k.ROW_DEVIATIONS, "row"), (k.COLUMN_DEVIATIONS, "column")):
        n[:, place], n[:, place + 1] = values[f"prnu.{vary}"], values[f"dsnu.{vary}_e"]
        if f"{vary}_noise" in camera.sensor_effects:
            n[:, place + 2] = values[f"{vary}_noise.sigma_e"]
    if not kept:
        n[:, k.PRNU_PIXEL], n[:, k.DSNU_PIXEL_E] = values["prnu.pixel"], values["dsnu.pixel_e"]
        _set_short_cut(n, shape, np.asarray(deviation, np.float32))
    return n


@cache
def _nodes() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where read noise is interpolated: normal numbers in either part and their tails; from values to coefficients."""
    k = loops.kernel()
    places = np.cos(np.pi * (np.arange(k.TERMS) + 0.5) / k.TERMS)
    to_far, to_farthest = float(k.FAR) ** 2, float(k.FARTHEST) ** 2
    squares = np.stack([to_far, to_farthest - to_far])[:, None] * (places + 1) / 2
    z = np.sqrt(squares + np.array([[0.0], [to_far]]))
    return z, ndtr(-z), ndtr(z), np.linalg.inv(np.vander(places, increasing=True)).T


def read_curves(scale: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Tukey-lambda quantiles at a normal number z, as the kernel has them: (B, 2 TERMS).

    The first half interpolates scale Q(Phi(z)) / z as a polynomial of z^2, the second log Q(Phi(z)) in the far tail.
    """
    z, lower, upper, to_coefficients = _nodes()
    safe = np.where(np.abs(shape) < 1e-6, 1e-6, shape)[:, None, None]
    q = (upper**safe - lower**safe) / safe
    core, beyond = scale[:, None] * (q[:, 0] / z[0]), np.log(q[:, 1])
    return np.concatenate(np.broadcast_arrays(core @ to_coefficients, beyond @ to_coefficients), -1)


def _set_short_cut(n: np.ndarray, shape: np.ndarray, deviation: np.ndarray) -> None:
    """Which pixels may draw their count together with Gaussian offsets: not where the full well is near or whole electrons
    would show.
    """
    loops.kernel().short_cut(n, deviation)
    k = loops.kernel().Number
    gaussian = np.hypot(n[:, k.DSNU_PIXEL_E], n[:, k.AFTER_GAIN_E])
    for i in np.flatnonzero((gaussian > 0) & (gaussian < 1)):
        read_e = float(n[i, k.READ_SCALE_E] * deviation[i % len(deviation)])
        if comb(read_e, float(shape[i % len(shape)]), float(gaussian[i])) > VISIBLE_COMB:
            n[i, k.LIMIT_E] = -1


def comb(sigma_e: float, shape: float, gaussian_e: float) -> float:
    """How much of the electrons' being whole numbers is left in the density after read noise: relative, 0 to 2.

    That is twice the characteristic function of the added noise at one cycle an electron.

    Args:
        sigma_e, shape: of Tukey-lambda read noise; gaussian_e: of further Gaussian noise.
    """
    left = 2 * math.exp(-2 * (math.pi * gaussian_e) ** 2)
    if left < VISIBLE_COMB:
        return left
    logit = np.linspace(-24, 24, 481)  # evenly in the logit of the probability, the steps suit both tails
    u, v = expit(logit), expit(-logit)
    phase = 2 * math.pi * sigma_e * quantile(u, v, shape) / standard_deviation(shape)
    return left * abs(float(np.sum(np.cos(phase) * u * v) * (logit[1] - logit[0])))


def kernel():
    """The compiled loop's module, or None where numba cannot be imported; says so before it is compiled."""
    module = loops.kernel()
    if module is not None:
        _announce()
    return module


@lru_cache(maxsize=1)
def _announce() -> None:
    folder = Path(str(loops.kernel().expose.stats.cache_path))
    if not any(folder.glob("fast_kernel.expose-*.nbi")):
        message = "compiling the fast sensor chain: once, about 9 s; kept in %s"
        logging.getLogger("visaug").warning(message, folder)
