"""The colour path as compiled loops for the CPU: the numbers of `visaug.camera.colour`, which has the law."""

from typing import Any

import numpy as np
from numba import njit

f32 = np.float32
_options: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "cache": True,
    "fastmath": {"contract", "nsz", "reassoc"},
}


@njit(**_options)
def mosaic(images, plane, filters, inverse, first_row, last_row):
    """Rows [first_row, last_row) of all planes, one after another.

    Args:
        images: (B, C, H, W) float32, C 1 or 3; plane: (B, H, W) float32, written.
        filters: (2, 2) which of the three lies where; inverse: (3, 3) float32, from the picture to the light of each filter.
    """
    channels, height, width = images.shape[1:]
    for number in range(first_row, last_row):
        image, y = number // height, number % height
        red, green, blue = (
            images[image, 0, y],
            images[image, channels // 2, y],
            images[image, channels - 1, y],
        )
        out = plane[image, y]
        for parity in range(min(2, width)):
            a = inverse[filters[y % 2, parity]]
            first, second, third = a[0], a[1], a[2]
            for x in range(parity, width, 2):
                out[x] = max(first * red[x] + second * green[x] + third * blue[x], f32(0))


@njit(**_options)
def balance(plane, filters, gains, first_row, last_row):
    """White balance of the plane, in place, and its clip at 1."""
    height, width = plane.shape[1:]
    for number in range(first_row, last_row):
        row = plane[number // height, number % height]
        for parity in range(min(2, width)):
            gain = gains[filters[number % height % 2, parity]]
            for x in range(parity, width, 2):
                row[x] = min(row[x] * gain, f32(1))


@njit(**_options)
def _mirrored(place, size):
    place = abs(place)
    return 2 * (size - 1) - place if place >= size else place


@njit(**_options)
def _widened(row, out):
    """A row with two mirrored pixels at each end."""
    width = row.size
    out[2 : width + 2] = row
    out[0], out[1], out[width + 2], out[width + 3] = row[2], row[1], row[width - 2], row[width - 3]


@njit(**_options)
def develop(plane, out, weights, first_row, last_row):
    """Pictures (B, 3, H, W) of balanced planes (B, H, W); weights (2, 2, 3, 6) float32."""
    height, width = plane.shape[1:]
    lines = np.empty((5, width + 4), np.float32)
    even = np.empty(width, np.float32)
    even[0::2], even[1::2] = f32(1), f32(0)
    for number in range(first_row, last_row):
        image, y = number // height, number % height
        for k in range(5):
            _widened(plane[image, _mirrored(y + k - 2, height)], lines[k])
        for channel in range(3):
            _channel(
                lines, even, weights[y % 2, 0, channel], weights[y % 2, 1, channel], out[image, channel, y]
            )


@njit(**_options)
def _channel(lines, even, a, b, out):
    """One row of a channel; weights `a` at even columns, `b` at odd ones."""
    p, q, r, s, t = lines[0], lines[1], lines[2], lines[3], lines[4]
    b0, b1, b2, b3, b4, b5 = b[0], b[1], b[2], b[3], b[4], b[5]
    d0, d1, d2, d3, d4, d5 = a[0] - b0, a[1] - b1, a[2] - b2, a[3] - b3, a[4] - b4, a[5] - b5
    for x in range(out.size):
        e = even[x]
        value = (b0 + e * d0) * r[x + 2]
        value += (b1 + e * d1) * (r[x + 1] + r[x + 3])
        value += (b2 + e * d2) * (q[x + 2] + s[x + 2])
        value += (b3 + e * d3) * (q[x + 1] + q[x + 3] + s[x + 1] + s[x + 3])
        value += (b4 + e * d4) * (r[x] + r[x + 4])
        value += (b5 + e * d5) * (p[x + 2] + t[x + 2])
        out[x] = min(max(value, f32(0)), f32(1))
