"""Random numbers of a few bits for the fast path, where their being discrete cannot be seen.

The normal that a pixel's count follows takes one of 2^NORMAL_BITS equally likely values, its read noise one of
2^TUKEY_BITS; each is the quantile at the middle of its cell. A number beyond the quantiles of 2^-RARE_BITS is drawn anew
within that tail with 32 bits, so the tails are those of the full tables. What remains is a comb of values, and each of the
two laws hides the other's: noise of characteristic function c leaves a comb of period d the relative amplitude
2 |c(2 pi / d)|. The widest cells lie where the tail begins and hold 2^-RARE_BITS of the pixels each side, so an
amplitude r there adds about 2^-RARE_BITS r^2 to chi-square for each pixel: 0.1 to that of a million at r = 0.7 %.

A logistic law (Tukey-lambda of shape 0) leaves 44 x exp(-10.9 x) of a comb of period d = sigma / x, 0.08 % at x = 1; a
Gaussian 2 exp(-2 (pi x)^2), 0.01 % at x = 0.7.
"""

from functools import cache

import numpy as np
from scipy.special import ndtri

from visaug.camera import tables

NORMAL_BITS, TUKEY_BITS, RARE_BITS = 14, 12, 9
HIDES_NORMAL, HIDES_TUKEY = 1.0, 0.7  # least standard deviation of what hides a comb, in its widest period


@cache
def normal_table() -> np.ndarray:
    """Quantiles of the standard normal at the middle of each cell, (2^NORMAL_BITS,) float32."""
    cells = 2**NORMAL_BITS
    return ndtri((np.arange(cells) + 0.5) / cells).astype(np.float32)


def suffices(
    deviation_e: np.ndarray, gaussian_e: np.ndarray, sigma_e: np.ndarray, tukey: np.ndarray
) -> np.ndarray:
    """Whether numbers of so few bits have the law.

    Args:
        deviation_e: largest standard deviation of a count together with its Gaussian parts.
        gaussian_e: that of the Gaussian parts alone.
        sigma_e: that of read noise. (B,) or (1,) each, in electrons.
        tukey: tables of read noise of standard deviation 1, (B or 1, 2 SIDE, 2), see tables.py.
    """
    of_count = deviation_e * _widest(tables.normal_table(), NORMAL_BITS)
    of_read_noise = sigma_e * _widest(tukey, TUKEY_BITS)
    return (sigma_e >= HIDES_NORMAL * of_count) & (gaussian_e >= HIDES_TUKEY * of_read_noise)


def _widest(table: np.ndarray, bits: int) -> np.ndarray:
    """Width of the cell of 2^-bits where the tail begins."""
    node = ((127 - RARE_BITS) << tables.SUB) - tables.FIRST
    return table[..., node, 1] * 2.0 ** (23 + RARE_BITS - bits)
