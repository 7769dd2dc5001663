"""Quantile functions as tables for the fast path: one look-up and one multiplication for a number of the wanted law.

A table is over 32 random bits: one for the side of the median, 31 for the probability p of the nearer tail, in (0, 1/2].
Its nodes lie evenly within each octave of p, so both tails keep their precision down to p = 2^-33, and between nodes a
straight line is within 1e-4 of a heavy-tailed quantile. The place of p is read off its bits as a float32.
"""

import math
from functools import cache

import numpy as np
from scipy.special import ndtri, pdtr, pdtrc

from visaug.core.sampling.tukey_lambda import standard_deviation

SUB = 5  # 2^5 nodes an octave
FRACTION_BITS = 23 - SUB
FIRST = (127 - 33) << SUB  # the place of 2^-33, the least p
SIDE = (32 << SUB) + 1  # nodes of one side, the last one at p = 1/2
LARGE_MEAN = 25.0  # from here on the Poisson's expansion is within 1e-5 of its distribution function
WIDEST_PRNU = 0.1  # of pixels drawn anew; beyond it the expansion of the count's quantile is not exact
LARGEST_TABLED_MEAN = LARGE_MEAN * (
    1 + 6.3 * WIDEST_PRNU
)  # where a pixel's gain makes a mean below LARGE_MEAN larger
MEANS_PER_ROOT = (
    128  # rows of the Poisson table lie evenly in sqrt(mean): a mixture of two has 1e-4 more variance
)


@cache
def nodes() -> np.ndarray:
    """Probabilities of the nearer tail at the nodes, (SIDE + 1,) float64, from 2^-33 to 1/2 and one beyond."""
    bits = (np.arange(SIDE + 1) + FIRST).astype(np.uint32) << FRACTION_BITS
    return bits.view(np.float32).astype(np.float64)


def both_sides(lower: np.ndarray) -> np.ndarray:
    """A table of a law symmetric about 0 from its quantiles Q(p) at the nodes up to 1/2.

    Args:
        lower: (..., SIDE) float64.

    Returns:
        (..., 2 SIDE, 2) float32: value at the node and rise per unit of the fraction; below the median, then above.
    """
    side = lower.shape[-1]
    table = np.empty((*lower.shape[:-1], 2 * side, 2), np.float32)
    table[..., :side, 0] = lower
    table[..., : side - 1, 1] = (lower[..., 1:] - lower[..., :-1]) * 2.0**-FRACTION_BITS
    table[..., side - 1, 1] = 0
    np.negative(table[..., :side, :], out=table[..., side:, :])
    return table


@cache
def normal_table() -> np.ndarray:
    """Of the standard normal, (2 SIDE, 2) float32."""
    return both_sides(ndtri(nodes()[:SIDE]))


def tukey_tables(shapes: np.ndarray) -> np.ndarray:
    """Of Tukey's lambda of standard deviation 1, (N, 2 SIDE, 2) float32, for N shapes."""
    shapes = shapes.astype(np.float64)[:, None]
    shapes = np.where(np.abs(shapes) < 1e-4, 1e-4, shapes)  # a relative error of 1e-4 in the far tails
    near, far = _logarithms()
    return both_sides((np.exp(shapes * near) - np.exp(shapes * far)) / (shapes * standard_deviation(shapes)))


@cache
def _logarithms() -> tuple[np.ndarray, np.ndarray]:
    """Of the probability of the nearer tail, at the nodes up to 1/2, and of its complement."""
    p = nodes()[:SIDE]
    return np.log(p), np.log1p(-p)


@cache
def poisson_table() -> np.ndarray:
    """Of the Poisson law for means up to LARGEST_TABLED_MEAN, (rows, 2 SIDE) int32.

    The mean of row j is (j / MEANS_PER_ROOT)^2. Between two nodes a count changes at most once, so an entry is the count
    at the first node (upper bits) and the fraction beyond which it is one more (below the median) or one less (above).
    """
    p = nodes()
    least, width = p[:-1], np.diff(p)
    rows = math.ceil(math.sqrt(LARGEST_TABLED_MEAN) * MEANS_PER_ROOT) + 2
    means = (np.arange(rows) / MEANS_PER_ROOT) ** 2
    table = np.empty((rows, 2, SIDE), np.int32)
    counts = np.arange(128.0)
    for row, mean in zip(table, means):
        # Below: the least count whose distribution function reaches p; it changes where p passes that value.
        levels = pdtr(counts, mean)
        first = np.searchsorted(levels, least)
        row[0] = _packed(first, (levels[first] - least) / width)
        # Above: the least count whose upper tail is at most p; as p grows it falls by one at the tail before it.
        tails = pdtrc(counts, mean)
        first = len(counts) - np.searchsorted(tails[::-1], least, side="right")
        before = np.where(first > 0, tails[np.maximum(first - 1, 0)], 1.0)
        row[1] = _packed(first, (before - least) / width)
    return table.reshape(rows, 2 * SIDE)


def _packed(count: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    steps = np.clip(np.round(fraction * 2**FRACTION_BITS), 0, 2**FRACTION_BITS).astype(np.int32)
    return (count.astype(np.int32) << (FRACTION_BITS + 1)) | steps


def comb(sigma_e: np.ndarray, shapes: np.ndarray, gaussian_e: np.ndarray) -> np.ndarray:
    """How much of the electrons' being whole numbers is left in the density after read noise: relative, 0 to 2.

    That is twice the characteristic function of the added noise at one cycle an electron.

    Args:
        sigma_e, shapes: of Tukey-lambda read noise; gaussian_e: of further Gaussian noise; (N,) each.
    """
    left = 2 * np.exp(-2 * (math.pi * gaussian_e) ** 2)
    for i in np.flatnonzero(left > 1e-4):
        value, rise = tukey_tables(shapes[i : i + 1])[0, :SIDE].T.astype(np.float64) * sigma_e[i]
        half = math.pi * rise * 2**FRACTION_BITS  # of the phase's change from node to node
        middle = np.cos(2 * math.pi * value + half) * np.sinc(half / math.pi)
        left[i] *= abs(2 * np.sum((middle * np.diff(nodes()))[:-1]))
    return left
