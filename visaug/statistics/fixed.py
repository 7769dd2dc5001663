"""Compiled sums of the fixed pattern and of profiles: one call in place of many small ones on arrays.

None of these calls a loop of `kernels` that sums in free order: how such a loop rounds inside another one depends on whether the
compiler or the cache on disk gave it, and so would the numbers.
"""

import math

import numpy as np
from numba import njit

from visaug.statistics.kernels import EXACT


@njit(**EXACT)
def centre(image):
    """Takes the mean off an image (H, W) float32 in place."""
    height, width = image.shape
    total = 0.0
    for r in range(height):
        line = 0.0
        for c in range(width):
            line += image[r, c]
        total += line
    mean = np.float32(total / (height * width))
    for r in range(height):
        for c in range(width):
            image[r, c] -= mean


@njit(**EXACT)
def block_offsets(sums, rows, columns, row_edges, column_edges):
    """From sums over blocks of an image to what the means of the blocks differ from those of their rows and columns, in place.

    Args:
        rows, columns: means of the lines of the image.
        row_edges, column_edges: of the blocks.
    """
    for a in range(sums.shape[0]):
        high = row_edges[a + 1] - row_edges[a]
        down = rows[row_edges[a] : row_edges[a + 1]].sum() / high
        for b in range(sums.shape[1]):
            wide = column_edges[b + 1] - column_edges[b]
            across = columns[column_edges[b] : column_edges[b + 1]].sum() / wide
            sums[a, b] = sums[a, b] / (high * wide) - (down + across)


@njit(**EXACT)
def profile_numbers(profile, cubics, reach, out):
    """Numbers of a profile (L,), L > 1: its variance about its cubic; the slope from its middle to its end; its largest step; its
    second half less its first; its odd lines less its even ones.

    Args:
        cubics: (L, n) orthonormal polynomials.
        reach: lines on either side of a step.
        out: (5,) is filled.
    """
    length, square = profile.size, 0.0
    if length < 2:
        out[:] = np.nan
        return
    fit = np.zeros(cubics.shape[1])
    for k in range(fit.size):
        for i in range(length):
            fit[k] += cubics[i, k] * profile[i]
    along, norm = 0.0, 0.0
    first, second, even, odd = 0.0, 0.0, 0.0, 0.0
    total = np.zeros(length + 1)
    for i in range(length):
        x, left = profile[i], profile[i]
        for k in range(fit.size):
            left -= cubics[i, k] * fit[k]
        square += left * left
        place = 2.0 * i / (length - 1) - 1
        along += place * x
        norm += place * place
        if i < length // 2:
            first += x
        else:
            second += x
        if i % 2:
            odd += x
        else:
            even += x
        total[i + 1] = total[i] + x
    largest = 0.0
    for i in range(reach, length - reach + 1):
        largest = max(largest, abs(total[i + reach] - 2 * total[i] + total[i - reach]))
    out[0] = square / length
    out[1] = along / norm
    out[2] = largest / reach
    out[3] = second / (length - length // 2) - first / (length // 2)
    out[4] = odd / (length // 2) - even / (length - length // 2)


@njit(**EXACT)
def mean_power(waves, out):
    """Adds to out (K - 1,) the mean over profiles of the squared sizes of waves (n, K), without the first of each."""
    for i in range(waves.shape[0]):
        for k in range(out.size):
            x = waves[i, k + 1]
            out[k] += (x.real * x.real + x.imag * x.imag) / waves.shape[0]


@njit(**EXACT)
def peak_frequency(spectrum):
    """Of the highest bin, drawn towards its neighbours by their power: anywhere in white noise, sharp for a banding."""
    length, top = spectrum.size, np.argmax(spectrum)
    weight, place = 0.0, 0.0
    for k in range(max(0, top - 1), min(length, top + 2)):  # pyrefly: ignore[bad-argument-type]
        weight += spectrum[k]
        place += (k + 1) * spectrum[k]
    return place / max(weight, 1e-12) / (2 * length)


@njit(**EXACT)
def band_numbers(spectrum, edges, least, out):
    """Logarithms of a spectrum (K,) and where its peak is.

    Args:
        edges: (n + 1,) of the bands.
        least: is added before each logarithm.
        out: (n + 3,) means over bands, the peak over the median, its frequency in cycles per line, the last over the median.
    """
    bands, length = edges.size - 1, spectrum.size
    for b in range(bands):
        total = 0.0
        for k in range(edges[b], edges[b + 1]):
            total += spectrum[k]
        out[b] = math.log(total / (edges[b + 1] - edges[b]) + least)
    order = np.sort(spectrum)
    middle = (order[(length - 1) // 2] + order[length // 2]) / 2 + least
    top = np.argmax(spectrum)
    out[bands] = math.log(spectrum[top] / middle + least)
    out[bands + 1] = peak_frequency(spectrum)
    out[bands + 2] = math.log(spectrum[-1] / middle + least)


@njit(**EXACT)
def mean_square_about(lines):
    """Mean square of profiles (n, L) about the mean of each."""
    count, length = lines.shape
    square = 0.0
    for i in range(count):
        mean = 0.0
        for k in range(length):
            mean += lines[i, k]
        mean /= length
        for k in range(length):
            square += (lines[i, k] - mean) ** 2
    return square / (count * length)
