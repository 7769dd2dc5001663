"""The base chain's fast path on a CPU: the law of `Camera.expose`, other random numbers, no gradients.

Row and column patterns are the exact chain's own numbers, and so are pixel patterns that are kept.
"""

import logging
from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from visaug.camera import coarse, tables
from visaug.camera.scale import Scale, gain_of
from visaug.camera.threads import in_threads
from visaug.core.sampling import Stream, derive_key
from visaug.core.sampling.stream import kernels
from visaug.core.sampling.tukey_lambda import standard_deviation

if TYPE_CHECKING:
    from visaug.camera.camera import Camera

Values = Mapping[str, np.ndarray]
SHIFTS = {"row_noise": "row", "column_noise": "column"}  # further effects that only shift rows or columns
VISIBLE_COMB = 2e-4
MOST_E = (
    1e18  # electrons of which float32 still holds the squares; with more than that the exact chain is taken
)
FAINT_SKEWNESS, FAINT_FIFTH = 0.1, 0.025


def suits(camera: "Camera", values: Values, kept: bool) -> bool:
    """Whether the fast path has this camera's law at these values, (B,) or (1,) each.

    `kept`: fixed patterns are one camera's; then their pixel parts must not differ from image to image.
    """
    if camera.spec.reading != "physical" or camera.sensor_maps:
        return False
    if not set(camera.sensor_effects) <= set(SHIFTS):
        return False
    if (gain_of(camera, values) * 2**camera.bit_depth > MOST_E).any():
        return False
    pixel = values["prnu.pixel"]
    if kept:
        return pixel.size == values["dsnu.pixel_e"].size == 1
    return bool((pixel <= tables.WIDEST_PRNU).all())


def take(
    camera: "Camera",
    images: Tensor,
    scale: Scale,
    values: Values,
    keys: Tensor,
    pattern_keys: Tensor,
    kept: bool = False,
    origin: tuple[int, int] = (0, 0),
) -> Tensor:
    """Images as the camera takes them.

    Args:
        images: (B, C, H, W) float32 on the CPU, in [0, 1], linear in light.
        scale: from image values to electrons and from DN to image values, arrays (B,) or (1,).
        values: every number of the camera by path, (B,) or (1,).
        keys: (B,) int64 of the temporal noise.
        pattern_keys: (B,) int64: patterns of each image; where `kept`, (1,): patterns of one camera.
        origin: row and column of the sensor at which the images begin.

    Returns:
        (B, C, H, W) float32 in [0, 1].
    """
    batch, channels, height, width = images.shape
    window = (range(origin[0], origin[0] + height), range(origin[1], origin[1] + width))
    frames, cameras = (np.ascontiguousarray(k.numpy()).view(np.uint64) for k in (keys, pattern_keys))
    lines = [
        _lines(cameras, ("prnu", "row"), "row", values["prnu.row"], channels, window),
        _lines(cameras, ("dsnu", "row"), "row", values["dsnu.row_e"], channels, window),
        _lines(cameras, ("prnu", "column"), "column", values["prnu.column"], channels, window),
        _lines(cameras, ("dsnu", "column"), "column", values["dsnu.column_e"], channels, window),
    ]
    for effect in camera.sensor_effects:
        vary = SHIFTS[effect]
        place = 1 if vary == "row" else 3
        sigma = values[f"{effect}.sigma_e"]
        lines[place] = lines[place] + _lines(frames, (effect,), vary, sigma, channels, window)
    sets = max(len(line) for line in lines)
    lines = [(x if len(x) == sets else np.repeat(x, sets, 0)).reshape(-1, x.shape[2]) for x in lines]
    maps = [np.zeros((channels, height, 0), np.float32)] * 2
    if kept:
        for i, path in enumerate(("prnu.pixel", "dsnu.pixel_e")):
            if sigma := float(values[path][0]):
                maps[i] = _kept_map(int(pattern_keys[0]), path.partition(".")[0], sigma, channels, window)
    numbers = _numbers(camera, batch, scale, values, kept)
    tukey = _tukey_tables(values["read_noise.shape"])
    numbers[:, kernel().COARSE] = _coarse(numbers, tukey)
    source = images.detach().contiguous()
    out = torch.empty_like(source)
    arguments = (
        channels,
        frames,
        numbers,
        *lines,
        *maps,
        coarse.normal_table(),
        tables.normal_table(),
        tukey,
        tables.poisson_table().reshape(-1),
        origin,
    )
    source_rows, out_rows = (x.numpy().reshape(-1, height, width) for x in (source, out))
    expose = kernel().expose
    in_threads(
        lambda first, last: expose(source_rows, out_rows, first, last, *arguments), batch * channels * height
    )
    return out


def _lines(
    keys: np.ndarray,
    names: tuple[str, ...],
    vary: str,
    sigma: np.ndarray,
    channels: int,
    window: tuple[range, range],
) -> np.ndarray:
    """A number for each row or column, (1 or B, C, rows or columns) float32: those of the exact chain's streams."""
    rows, columns = (window[0], range(1)) if vary == "row" else (range(1), window[1])
    if not sigma.any():
        return np.zeros((1, channels, len(rows) * len(columns)), np.float32)
    normal = np.empty((len(keys), channels, len(rows), len(columns)), np.float32)
    kernels.fill_normal(kernels.forked(keys, _fork_names(names)), rows.start, columns.start, normal)
    return sigma.astype(np.float32)[:, None, None] * normal.reshape(len(keys), channels, -1)


@cache
def _fork_names(names: tuple[str, ...]) -> np.ndarray:
    return np.array([derive_key(name) for name in names], np.uint64)


@lru_cache(maxsize=4)
def _kept_map(key: int, effect: str, sigma: float, channels: int, window: tuple[range, range]) -> np.ndarray:
    """The pixel part of a camera's pattern, (C, H, W) float32: the exact chain's own."""
    keys = torch.tensor([key])
    fixed = Stream(keys, keys, channels, window).fork(effect).fixed
    return (sigma * fixed.fork("pixel").normal("pixel"))[0].numpy()


def _tukey_tables(shapes: np.ndarray) -> np.ndarray:
    if shapes.size == 1:
        return _tukey_table(float(shapes[0]))
    return tables.tukey_tables(shapes)


@lru_cache(maxsize=16)
def _tukey_table(shape: float) -> np.ndarray:
    return tables.tukey_tables(np.array([shape]))


def _numbers(camera: "Camera", batch: int, scale: Scale, values: Values, kept: bool) -> np.ndarray:
    """The kernel's table, one row an image."""
    k = kernel()
    n = np.zeros((batch, k.NUMBERS), np.float32)
    sigma, shape = values["read_noise.sigma_e"], values["read_noise.shape"]
    if camera.spec.read_noise.meaning == "scale":
        sigma = sigma * standard_deviation(shape)
    heat = np.exp(values["dark_current.b_per_c"] * values["temperature_c"])
    dark_e = values["exposure_s"] * values["dark_current.a_e_per_s"] * heat
    well = values["full_well_e"]
    gain = gain_of(camera, values)
    prnu, dsnu = (0.0, 0.0) if kept else (values["prnu.pixel"], values["dsnu.pixel_e"])
    gaussian_e = np.hypot(
        dsnu, values["read_noise.after_gain_dn"] * gain
    )  # Gaussian offsets, drawn anew, are one
    n[:, k.ELECTRONS], n[:, k.LESS_DN], n[:, k.PER_DN] = scale
    n[:, k.DARK_E] = np.minimum(dark_e, MOST_E)
    n[:, k.PRNU_PIXEL], n[:, k.GAUSSIAN_E] = prnu, gaussian_e
    n[:, k.READ_SIGMA_E] = sigma
    n[:, k.DN_PER_E] = 1 / gain
    n[:, k.OFFSET_DN] = values["black_level_dn"]
    n[:, k.FULL_WELL_E] = well
    n[:, k.MAX_DN] = 2**camera.bit_depth - 1
    # Where pixel offsets are Gaussian and drawn anew, they share the count's draw unless it is near the full well
    # or its whole numbers would show.
    gaussian = n[:, k.GAUSSIAN_E]
    n[:, k.LATTICE] = gaussian == 0
    finite = np.minimum(well, 1e9)
    below = finite - 6 * np.sqrt(finite + (finite * prnu) ** 2)
    n[:, k.LIMIT_E] = np.where((gaussian == 0) | np.isinf(well), np.inf, np.maximum(below, 0))
    # A faint count that shares the draw adds the skewness m / (m + sigma^2)^(3/2); up to 0.1 the expansion has it, and
    # of the fifth cumulant, which it has not, read noise must hide most.
    wide = gaussian.astype(np.float64)
    hidden = FAINT_FIFTH * np.hypot(wide, n[:, k.READ_SIGMA_E]) ** 5
    faint = np.minimum(np.minimum(FAINT_SKEWNESS * wide**3, hidden), MOST_E)
    n[:, k.FAINT_E] = np.where(gaussian > 0, faint, -1)
    few = np.flatnonzero((gaussian > 0) & (gaussian < 1))
    if few.size:
        wide_sigma, wide_shape = (np.broadcast_to(x, batch)[few] for x in (sigma, shape))
        visible = few[tables.comb(wide_sigma, wide_shape, gaussian[few]) > VISIBLE_COMB]
        n[visible, k.LIMIT_E] = n[visible, k.FAINT_E] = -1
    return n


def _coarse(n: np.ndarray, tukey: np.ndarray) -> np.ndarray:
    """Whether numbers of few bits do for each image's pixels up to the value 1."""
    k = kernel()
    most = n[:, k.ELECTRONS]
    gaussian = n[:, k.GAUSSIAN_E]
    deviation = np.sqrt(most + n[:, k.DARK_E] + (most * n[:, k.PRNU_PIXEL]) ** 2 + gaussian**2)
    enough = coarse.suffices(deviation, gaussian, n[:, k.READ_SIGMA_E], tukey)
    return enough & (n[:, k.LATTICE] == 0)


@cache
def kernel() -> Any:
    """The compiled loop's module, or None where numba cannot be imported."""
    try:
        from visaug.camera import fast_kernel
    except ImportError:
        return None
    folder = Path(str(fast_kernel.expose.stats.cache_path))
    if not any(folder.glob("fast_kernel.expose-*.nbi")):
        message = "compiling the fast sensor chain: once, about 10 s; kept in %s"
        logging.getLogger("visaug").warning(message, folder)
    return fast_kernel
