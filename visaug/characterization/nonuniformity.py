"""Fixed patterns split into row, column and pixel parts, with intervals for the camera's own parameters; and patterns of the
response that are no white pattern of pixels: mosaics of any period, structured light.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from visaug.characterization.moments import GroupMoments
from visaug.core.constants import MAD
from visaug.core.intervals import Interval, variance_combination
from visaug.statistics.findings import Findings
from visaug.statistics.kernels import median_of

PARTS = ("row", "column", "pixel")


@dataclass(frozen=True)
class Parts:
    """Variances of the parts of a fixed pattern, each with its interval, and pixels left out as defects."""

    row: Interval
    column: Interval
    pixel: Interval
    total: Interval
    defects: int


def parts(pattern: np.ndarray, noise: Sequence[tuple[float, GroupMoments]], detrend: bool = False) -> Parts:
    """Row, column and pixel variance of a map, the temporal noise that is left in it taken off.
    Two-way analysis of variance: with rows R, columns C and pixels P independent, the mean squares expect
    W s_R^2 + s_P^2, H s_C^2 + s_P^2 and s_P^2, each plus its own share of the temporal noise.
    `pattern`: (H, W) map.
    `noise`: what is left of temporal noise: (factor, moments), the variance of a frame's noise times factor.
    `detrend`: take out a surface of second order first (light falls off smoothly; a pattern is white).
    """
    height, width = pattern.shape
    row_df, column_df, lost = height - 1, width - 1, 0
    values = pattern.astype(np.float64)
    if detrend and min(height, width) > 8:
        values = values - surface(values)
        row_df, column_df, lost = row_df - 2, column_df - 2, 1
    rows, columns, residual, defects = two_way(values)
    pixel_df = max((height - 1) * (width - 1) - lost - defects, 1)
    ms_pixel = float((residual**2).sum()) / pixel_df
    ms_row = width * float((rows**2).sum()) / max(row_df, 1)
    ms_column = height * float((columns**2).sum()) / max(column_df, 1)
    terms: dict[str, list[tuple[float, float, float]]] = {
        "row": [(1.0, ms_row, max(row_df, 1))],
        "column": [(1.0, ms_column, max(column_df, 1))],
        "pixel": [(1.0, ms_pixel, pixel_df)],
    }
    for factor, m in noise:
        if m.temporal is None:
            continue
        t = m.temporal
        # The parts' mean squares hold more than the pixel noise only where rows or columns flicker.
        terms["row"].append((-factor, max(t.row, t.pixel), t.row_df))
        terms["column"].append((-factor, max(t.column, t.pixel), t.column_df))
        terms["pixel"].append((-factor, t.pixel, t.pixel_df))

    def scaled(which: str, factor: float) -> list[tuple[float, float, float]]:
        return [(c * factor, ms, df) for c, ms, df in terms[which]]

    pixel_again = scaled("pixel", 1.0 - 1.0 / width - 1.0 / height)
    return Parts(
        row=variance_combination(scaled("row", 1 / width) + scaled("pixel", -1 / width)),
        column=variance_combination(scaled("column", 1 / height) + scaled("pixel", -1 / height)),
        pixel=variance_combination(terms["pixel"]),
        total=variance_combination(scaled("row", 1 / width) + scaled("column", 1 / height) + pixel_again),
        defects=defects,
    )


def two_way(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Row effects (H,), column effects (W,), residual map with defects set to 0, and their number."""
    filled = values
    for _ in range(3):
        mean = filled.mean()
        rows, columns = filled.mean(1) - mean, filled.mean(0) - mean
        fitted = mean + rows[:, None] + columns[None]
        residual = values - fitted
        spread = MAD * median_of(np.abs(residual - median_of(residual)))
        bad = np.abs(residual) > 8.0 * max(spread, 1e-12)  # defects, no sample of a normal pattern
        if not bad.any() or bad.mean() > 0.05:
            bad[:] = False
            break
        filled = np.where(bad, fitted, values)
    return rows, columns, np.where(bad, 0.0, residual), int(bad.sum())


def surface(values: np.ndarray) -> np.ndarray:
    """Least-squares surface of second order without its mean, (H, W)."""
    r = np.linspace(-1, 1, values.shape[0])[:, None] * np.ones((1, values.shape[1]))
    c = np.linspace(-1, 1, values.shape[1])[None] * np.ones((values.shape[0], 1))
    basis = np.stack([np.ones_like(r), r, c, r * r, c * c, r * c]).reshape(6, -1)
    weights, *_ = np.linalg.lstsq(basis @ basis.T, basis @ values.reshape(-1), rcond=None)
    weights[0] = 0
    return (weights @ basis).reshape(values.shape)


def release_4(measured: GroupMoments, noise: tuple[float, float, float] | None = None) -> dict[str, float]:
    """Spatial variances of a stack by EMVA 1288 release 4, DN^2 (may be negative).
    `noise`: temporal variance that is left in the mean of the pixels, of the column means and of the row means; by default
    that of white noise, as the standard has it.
    """
    height, width = measured.shape
    # The standard divides by the number of rows or columns; with noise as measured the estimate is unbiased instead.
    lost = 0 if noise is None else 1
    white = float(measured.row_variances.mean()) / measured.n
    of_pixels, of_columns, of_rows = noise or (white, white / height, white / width)
    total = measured.spatial_variance - of_pixels
    columns = float(measured.column_means.var(ddof=lost)) - of_columns
    rows = float(measured.row_means.var(ddof=lost)) - of_rows
    size = height * width
    rest = size - height - width
    return {
        "total": total,
        "column": (size - height) / rest * columns - width / rest * (total - rows),
        "row": (size - width) / rest * rows - height / rest * (total - columns),
        "pixel": size / rest * (total - columns - rows),
    }


def not_white(m: GroupMoments) -> list[str]:
    """``row`` and ``column`` where these share temporal noise: the standard's split takes it to be white."""
    t = m.temporal
    if t is None or t.pixel <= 0:
        return []
    lines, false_alarms = (("row", t.row, t.row_df), ("column", t.column, t.column_df)), 1e-3
    return [name for name, square, df in lines if stats.f.sf(square / t.pixel, df, t.pixel_df) < false_alarms]


def corrected_split(m: GroupMoments) -> dict[str, float]:
    """Release 4's spatial variances with the temporal variance that rows and columns have, DN^2.
    The standard takes off sigma^2 / (L M) from the variance of column means and sigma^2 / (L N) from that of row
    means, as for white noise. Here the variance of these means over the frames is measured, the frame's own mean
    taken out, and divided by L: right for any noise that is independent from frame to frame.
    """

    def noise(means: np.ndarray) -> float:
        steady = means - means.mean(1, keepdims=True)
        return float(steady.var(axis=0, ddof=1).mean()) / m.n

    return release_4(m, (m.variance / m.n, noise(m.columns_by_frame), noise(m.rows_by_frame)))


def tile(pattern: np.ndarray) -> np.ndarray | None:
    """(H, W) mean response of each place of a mosaic of 4 x 4 or 6 x 6, 1 on average; None where there is none."""
    height, width = pattern.shape
    best, least = None, float(np.var(pattern))
    plain = 0.02  # of the response: colours differ by more than the pixels of one colour do
    for period in (4, 6):  # quad Bayer; Fujifilm's X-Trans
        if min(height, width) < 4 * period:
            continue
        phases = [[pattern[r::period, c::period] for c in range(period)] for r in range(period)]
        places = np.array([[np.median(phase) for phase in row] for row in phases])
        whole = np.tile(places, (height // period + 1, width // period + 1))[:height, :width]
        # Rows and columns of a period alone are no colours: parity or taps.
        crossed = places - places.mean(1, keepdims=True) - places.mean(0) + places.mean()
        left = float(np.var(pattern - whole))
        if math.sqrt(float((crossed**2).mean())) > plain * places.mean() and left < 0.9 * least:
            best, least = whole / whole.mean(), left
    return best


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
    if chance < 0.003 and share > 0.02:  # of the pixels' variance, which makes PRNU 1 % too high
        found.warn(
            "structured_light: the response varies from one part of the frame to another beyond a smooth "
            "surface (dust, a lens that falls off steeply, an uneven source), which counts as PRNU",
            spoils=("prnu.*", "emva.prnu_fraction", "emva4.prnu_*", "emva4_corrected.prnu_*"),
        )
