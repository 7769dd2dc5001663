"""From ordinary pictures, of which nothing is known: noise against level, and noise of rows and columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from visaug.characterization.findings import Findings
from visaug.frames import FrameSet

_BLOCK = 16
_CELL = 4
_LEVELS = 8
_LEAST = 12  # blocks for one point of the curve
_DRAWS = 400
_LIVELY = 1.45  # five standard deviations above the lower quartile for 253 degrees of freedom
_PICTURE_NEEDS = {
    "gain_e_per_dn": "flats at several levels: a picture's noise may be that of its processing",
    "quantum_efficiency": "flats with known photons per pixel",
    "read_noise.sigma_e": "two or more bias frames, and the gain",
    "dsnu.pixel_e": "several frames of one scene: one picture does not part fixed pattern from noise",
    "prnu.pixel": "several flats: one picture does not part fixed pattern from noise",
    "dark_current.a_e_per_s": "dark frames at several exposures and temperatures",
    "full_well_e": "flats beyond saturation",
}


@dataclass(frozen=True)
class Blocks:
    """Flat blocks of pictures: level, residual variance, row and column mean squares, number of the
    picture.
    """

    level: np.ndarray
    variance: np.ndarray
    row: np.ndarray
    column: np.ndarray
    picture: np.ndarray

    def pick(self, which: np.ndarray) -> Blocks:
        return Blocks(
            *(getattr(self, name)[which] for name in ("level", "variance", "row", "column", "picture"))
        )


def noise_of_pictures(found: Findings, frames: FrameSet, seed: int) -> None:
    """Noise-level function and row and column noise of the flat regions of all pictures together."""
    for name, needs in _PICTURE_NEEDS.items():
        found.miss(name, needs)
    parts = [flat_blocks(frames, i) for i in range(len(frames))]
    blocks = Blocks(*(np.concatenate([getattr(p, n) for p in parts]) for n in Blocks.__dataclass_fields__))
    blocks = blocks.pick(_calm(blocks)) if blocks.level.size else blocks
    if blocks.level.size < _LEAST:
        found.miss(
            "image.noise_dn", f"{_LEAST} or more flat regions of {_BLOCK} x {_BLOCK} pixels that do not clip"
        )
        found.warn("no_flat_regions: the pictures contain hardly any regions without structure")
        return
    source = f"{blocks.level.size} flat regions in {len(frames)} pictures"
    rng = np.random.default_rng(seed)
    draws = [rng.integers(0, blocks.level.size, blocks.level.size) for _ in range(_DRAWS)]

    def add(name: str, unit: str, figure) -> None:
        spread = np.array([figure(blocks.pick(d)) for d in draws])
        found.add(name, (figure(blocks), *np.quantile(spread, [0.025, 0.975])), unit, source)

    add("image.noise_dn", "DN", lambda b: float(np.sqrt(np.median(b.variance))))
    add("image.row_noise_dn", "DN", lambda b: _shared(b.row, b.variance))
    add("image.column_noise_dn", "DN", lambda b: _shared(b.column, b.variance))
    _noise_level(found, blocks, draws, source)
    found.warn(
        "pictures_alone: noise and fixed pattern are not separated, nor the noise of the camera from the effect of "
        "processing (compression, sharpening, tone curve)"
    )


def _calm(blocks: Blocks) -> np.ndarray:
    """Blocks no livelier than the calmer ones of their level: fine texture passes for noise but for that."""
    order = np.argsort(blocks.level)
    variance = blocks.variance[order]
    reach = max(len(order) // 20, 8)
    calm = np.zeros(len(order), bool)
    for k in range(len(order)):
        near = variance[max(k - reach, 0) : k + reach + 1]
        calm[order[k]] = variance[k] <= _LIVELY * np.quantile(near, 0.25)
    return calm


def _shared(mean_square: np.ndarray, variance: np.ndarray) -> float:
    """Noise common to the pixels of a line of a block."""
    return float(np.sqrt(max((mean_square.mean() - variance.mean()) / _BLOCK, 0.0)))


def _noise_level(found: Findings, blocks: Blocks, draws: list[np.ndarray], source: str) -> None:
    """Variance against level in bins of equal count, and a straight line through them."""
    bins = min(_LEVELS, blocks.level.size // _LEAST)
    edges = np.unique(np.quantile(blocks.level, np.linspace(0, 1, bins + 1)))
    which = np.clip(np.searchsorted(edges, blocks.level, side="right") - 1, 0, max(len(edges) - 2, 0))
    filled = [k for k in range(max(len(edges) - 1, 1)) if (which == k).sum() >= 3]
    noise = np.array([np.sqrt(blocks.variance[which == k].mean()) for k in filled])
    error = np.array([blocks.variance[which == k].std() / np.sqrt((which == k).sum()) for k in filled]) / (
        2 * noise
    )
    found.curves["noise_level"] = {
        "level_dn": np.array([blocks.level[which == k].mean() for k in filled]),
        "noise_dn": noise,
        "error_dn": error,
    }
    if np.ptp(blocks.level) < 4 * np.sqrt(np.median(blocks.variance)):
        found.miss("image.noise_slope_dn", "flat regions at different levels")
        return

    def line(b: Blocks) -> np.ndarray:
        weights = 1 / np.maximum(np.interp(b.level, np.sort(blocks.level), _running(blocks)), 1e-6)
        return np.polyfit(b.level, b.variance, 1, w=weights)

    value = line(blocks)
    spread = np.array([line(blocks.pick(d)) for d in draws])
    low, high = np.quantile(spread, [0.025, 0.975], axis=0)
    found.add("image.noise_slope_dn", (value[0], low[0], high[0]), "DN", f"variance against level, {source}")
    found.add("image.noise_floor_dn2", (value[1], low[1], high[1]), "DN^2", f"variance at level 0, {source}")


def _running(blocks: Blocks) -> np.ndarray:
    ordered = blocks.variance[np.argsort(blocks.level)]
    window = max(len(ordered) // 10, 3)
    padded = np.pad(ordered, window // 2, mode="edge")
    return np.convolve(padded, np.ones(window) / window, mode="same")[
        window // 2 : window // 2 + len(ordered)
    ]


def flat_blocks(frames: FrameSet, i: int) -> Blocks:
    """Blocks of picture `i` that hold noise and no structure.

    A plane is taken out of each block. Structure shows in the means of its cells, which vary more than the
    pixels' variance explains (F test at 1 %), or in outlying variance; clipped blocks say nothing.
    """
    frame = frames.read(i).astype(np.float64)
    top = frame.max() if frames.bit_depth is None else (1 << frames.bit_depth) - 1
    rows, columns = (n // _BLOCK * _BLOCK for n in frame.shape)
    blocks = frame[:rows, :columns].reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK)
    blocks = blocks.transpose(0, 2, 1, 3).reshape(-1, _BLOCK, _BLOCK)
    blocks = blocks[(blocks.min((1, 2)) > 0) & (blocks.max((1, 2)) < top)]
    if not len(blocks):
        return Blocks(*(np.zeros(0) for _ in range(5)))
    level = blocks.mean((1, 2))
    residual = blocks - level[:, None, None]
    ramp = np.arange(_BLOCK) - (_BLOCK - 1) / 2
    scale = _BLOCK * (ramp**2).sum()
    for axis in (ramp[:, None], ramp[None]):
        residual -= (residual * axis).sum((1, 2))[:, None, None] / scale * axis
    n = _BLOCK * _BLOCK
    variance = (residual**2).sum((1, 2)) / (n - 3)
    cells = residual.reshape(-1, _BLOCK // _CELL, _CELL, _BLOCK // _CELL, _CELL).mean((2, 4))
    between = _CELL**2 * (cells**2).sum((1, 2)) / ((_BLOCK // _CELL) ** 2 - 3)
    limit = stats.f.ppf(0.99, (_BLOCK // _CELL) ** 2 - 3, n - 19)
    flat = (variance > 0) & (between < limit * np.maximum(variance, 1e-12))
    row = _BLOCK * (residual.mean(2) ** 2).sum(1) / (_BLOCK - 2)
    column = _BLOCK * (residual.mean(1) ** 2).sum(1) / (_BLOCK - 2)
    picture = np.full(len(level), float(i))
    return Blocks(level, variance, row, column, picture).pick(flat)
