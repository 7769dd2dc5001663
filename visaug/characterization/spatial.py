"""Patterns of the response that are no white pattern of pixels: mosaics of any period, structured light."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from visaug.characterization.nonuniformity import surface, two_way

if TYPE_CHECKING:
    from visaug.statistics.findings import Findings


def tile(pattern: np.ndarray) -> np.ndarray | None:
    """(H, W) mean response of each place of a mosaic of 4 x 4 or 6 x 6, 1 on average; None where there is none."""
    height, width = pattern.shape
    best, least = None, float(np.var(pattern))
    periods = (4, 6)  # quad Bayer; Fujifilm's X-Trans
    plain = 0.02  # of the response: colours differ by more than the pixels of one colour do
    for period in periods:
        if min(height, width) < 4 * period:
            continue
        places = _places(pattern, period)
        whole = np.tile(places, (height // period + 1, width // period + 1))[:height, :width]
        # Rows and columns of a period alone are no colours: parity or taps.
        crossed = places - places.mean(1, keepdims=True) - places.mean(0) + places.mean()
        left = float(np.var(pattern - whole))
        if math.sqrt(float((crossed**2).mean())) > plain * places.mean() and left < 0.9 * least:
            best, least = whole / whole.mean(), left
    return best


def _places(pattern: np.ndarray, period: int) -> np.ndarray:
    return np.array(
        [[np.median(pattern[r::period, c::period]) for c in range(period)] for r in range(period)]
    )


def structured(pattern: np.ndarray) -> tuple[float, float]:
    """Variance of the means of 8 x 8 blocks, rows, columns and a smooth surface taken out: its probability among white
    pixels, and what exceeds these as a share of the variance of the pixels.

    Light that is uneven (dust, a lens that falls off faster than by the square of the distance) makes blocks differ.
    """
    block = 8  # pixels, the side of the blocks over which structure is looked for
    height, width = (n // block for n in pattern.shape)
    if min(height, width) < 4:
        return 1.0, 0.0
    values = pattern[: height * block, : width * block]
    _, _, residual, _ = two_way(values - surface(values))
    blocks = residual.reshape(height, block, width, block).mean((1, 3))
    df = (height - 1) * (width - 1) - 1
    pixel_df = (residual.shape[0] - 1) * (residual.shape[1] - 1) - 1
    ratio = float((blocks**2).sum()) / df * block**2 / (float((residual**2).sum()) / pixel_df)
    return float(stats.f.sf(ratio, df, pixel_df)), (ratio - 1) / block**2


def check_structure(pattern: np.ndarray, found: Findings) -> None:
    """Warns of light, or of a response, with structure that counts as PRNU."""
    chance, share = structured(pattern)
    structure = 0.003  # probability that white pixels show structure
    matters = 0.02  # of the pixels' variance, which makes PRNU 1 % too high
    if chance < structure and share > matters:
        found.warn(
            "structured_light: the response varies from one part of the frame to another beyond a smooth "
            "surface (dust, a lens that falls off steeply, an uneven source), which counts as PRNU",
            spoils=("prnu.*", "emva.prnu_fraction", "emva4.prnu_*", "emva4_corrected.prnu_*"),
        )
