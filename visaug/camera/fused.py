"""Runs of base effects as one compiled loop on a CPU: the random numbers and values of the effects one by one, but for rounding."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from visaug.camera.loops import in_kernel, kernel
from visaug.core.sampling import Stream, derive_key
from visaug.core.sampling.stream import kernels
from visaug.core.sampling.tukey_lambda import standard_deviation
from visaug.effects import Context, Effect
from visaug.effects.effect import Values

FUSED = {
    "quantum_efficiency", "prnu", "dark_current", "photon_shot_noise", "saturation", "dsnu", "read_noise", "system_gain",
    "quantization",
}  # fmt: skip
STREAMS = {  # of temporal noise, by column of the kernel's table of keys
    "SHOT": ("photon_shot_noise",),
    "READ": ("read_noise",),
    "AFTER_GAIN": ("read_noise", "after gain"),
    "TOGETHER": ("together",),
    "ROW_NOISE": ("row_noise",),
    "COLUMN_NOISE": ("column_noise",),
}
PATTERNS = {
    "PRNU": ("prnu", "pixel"),
    "DSNU": ("dsnu", "pixel"),
    "PRNU_ROW": ("prnu", "row"),
    "DSNU_ROW": ("dsnu", "row"),
    "PRNU_COLUMN": ("prnu", "column"),
    "DSNU_COLUMN": ("dsnu", "column"),
}


def keys_of(frames: np.ndarray, cameras: np.ndarray) -> np.ndarray:
    """The kernel's table of keys, (B, KEYS), from those of frames, (B,) uint64, and of cameras, (B,) or (1,)."""
    out = np.empty((len(frames), kernel().KEYS), np.uint64)
    kernel().key_table(frames, cameras, *_fork_names(), out)
    return out


@cache
def _fork_names() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Names, their number, and whether the pattern is fixed, by column of the table of keys."""
    count = kernel().KEYS
    names, depth = np.zeros((count, 2), np.uint64), np.zeros(count, np.int64)
    fixed = np.zeros(count, np.int64)
    for column, parts in (STREAMS | PATTERNS).items():
        place = kernel().Key[column]
        depth[place], fixed[place] = len(parts), column in PATTERNS
        names[place, : len(parts)] = [derive_key(part) for part in parts]
    return names, depth, fixed


@cache
def neutral() -> np.ndarray:
    """The kernel's row of numbers for no effect at all, (1, NUMBERS) float32."""
    k, n = kernel().Number, np.zeros((1, kernel().NUMBERS), np.float32)
    n[:, [k.ELECTRONS, k.E_PER_DN, k.PER_DN]] = 1
    n[:, [k.LEAST_E, k.LEAST_OUT]] = -np.inf
    n[:, [k.FULL_WELL_E, k.MAX_DN, k.MOST_OUT]] = np.inf
    n[:, k.LIMIT_E] = -1
    return n


class Drawn(NamedTuple):
    """What is drawn for images before their pixels.

    Attributes:
        numbers: by column of `fast_kernel`, (B, NUMBERS) float32.
        keys: of the streams, (B, KEYS) uint64.
        rows, columns: gains and offsets (electrons) of lines, (2, sets C, H) and (2, sets C, W) float32; sets is B or 1.
        maps: gain and offset (electrons) of pixels that are kept, (C, H, W) float32, or None.
    """

    numbers: np.ndarray
    keys: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    maps: tuple[Tensor | None, Tensor | None]


def runs(
    effects: Sequence[Effect], signal: Tensor, values: Mapping[str, Tensor], context: Context
) -> Iterator[list[Effect]]:
    """The effects in order, those together that one loop can take."""
    able = _able(signal, values, context)
    run: list[Effect] = []
    for effect in effects:
        measured = effect.name == "read_noise" and effect.name in context.maps
        fuses = able and effect.name in FUSED and not measured
        if run and not (fuses and run[-1].name in FUSED):
            yield run
            run = []
        run.append(effect)
        if not fuses:
            yield run
            run = []
    if run:
        yield run


def _able(signal: Tensor, values: Mapping[str, Tensor], context: Context) -> bool:
    if torch.compiler.is_compiling() or signal.device.type != "cpu" or signal.dtype != torch.float32:
        return False
    if context.reading != "physical" or kernel() is None or kernels is None:
        return False
    return not torch.is_grad_enabled() or not any(x.requires_grad for x in (signal, *values.values()))


def expose(run: Mapping[str, Values], signal: Tensor, stream: Stream, context: Context) -> Tensor:
    """The signal after the effects of a run.

    Args:
        run: parameters of the effects by their names.
        signal: (B, C, H, W) float32 on the CPU.
        stream: of the chain, not of a single effect.
    """
    batch, channels, height, width = signal.shape
    maps = [_pattern(name, run, signal, stream, context) for name in ("prnu", "dsnu")]
    lines = [np.zeros((channels, size), np.float32) for size in (height, height, width, width)]
    source, out = signal.contiguous(), torch.empty(signal.shape)
    keys = keys_of(stream.keys, stream.keys)  # patterns are not drawn: they are in the maps
    origin = stream.window[0].start, stream.window[1].start
    in_kernel(source, out, _numbers(run, batch, context), keys, lines, maps, origin)
    return out


def _pattern(
    name: str, run: Mapping[str, Values], signal: Tensor, stream: Stream, context: Context
) -> np.ndarray:
    """The pattern of every pixel, (C or B C, H, W) float32; (C, H, 0) where there is none."""
    channels, height, width = signal.shape[1:]
    if name not in run:
        return np.zeros((channels, height, 0), np.float32)
    pattern = context.measured_map(name, signal)
    if pattern is None:
        unit = "_e" if name == "dsnu" else ""
        parts = (getattr(run[name], part + unit) for part in ("column", "row", "pixel"))
        pattern = stream.fork(name).fixed.pattern(*parts)
    full = pattern.float().expand(-1, channels, height, width).contiguous()
    return full.numpy().reshape(-1, height, width)


def _numbers(run: Mapping[str, Values], batch: int, context: Context) -> np.ndarray:
    k, n = kernel().Number, neutral().repeat(batch, 0)

    def put(column: int, value: Any) -> None:
        n[:, column] = np.asarray(value, np.float32).reshape(-1)

    if "quantum_efficiency" in run:
        put(k.ELECTRONS, run["quantum_efficiency"].value)
    if "prnu" in run:
        n[:, k.LEAST_E] = 0
    if "dark_current" in run:
        put(k.DARK_E, context.dark_current_e)
    if "photon_shot_noise" in run:
        n[:, k.COUNTED] = 1
    if "saturation" in run:
        put(k.FULL_WELL_E, run["saturation"].full_well_e)
    if "read_noise" in run:
        p = run["read_noise"]
        shape, sigma = (x.double().numpy() for x in (p.shape, p.sigma_e))
        put(k.READ_SHAPE, shape)
        put(k.READ_SCALE_E, sigma if p.meaning == "scale" else sigma / standard_deviation(shape))
        put(k.AFTER_GAIN_E, p.after_gain_dn * context.gain_e_per_dn)
    if "system_gain" in run:
        put(k.E_PER_DN, context.gain_e_per_dn)
        put(k.BLACK_DN, context.black_level_dn)
    if "quantization" in run:
        n[:, k.MAX_DN] = context.max_dn
    return n
