"""The passes over pixels, as compiled loops that let go of Python's lock.

Temporal noise is written nowhere: each pass makes a row of it from the frames, which stay whole numbers, and the means.
Rows are summed in float32 and added up in float64, so that sums agree with float64 to about 1e-6.
"""

from typing import Any

import numpy as np
from numba import njit

EXACT: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {**EXACT, "fastmath": {"reassoc", "contract", "arcp", "nsz"}}

LAGS = ((0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (2, 0))  # rows and columns between two pixels of `scatter`
FAR_LAGS = ((0, 4), (0, 12), (4, 0))
_LOW_BITS = 18  # of a float32 that are not counted: exponent and five bits of the mantissa are
# rows that are held: the largest of those distances, and one
_RING = 1 + max(rows for rows, _ in LAGS + FAR_LAGS)


@njit(**EXACT)
def add_up(frames, total, rows, columns):
    """Sums of frames (n, H, W) over frames, columns and rows: adds to total (H, W), rows (n, H) and columns (n, W)."""
    for i in range(frames.shape[0]):
        for r in range(frames.shape[1]):
            line = rows[i, r]
            for c in range(frames.shape[2]):
                x = frames[i, r, c]
                total[r, c] += x
                columns[i, c] += x
                line += x
            rows[i, r] = line


@njit(**EXACT)
def count_codes(frames, counts):
    """Adds to counts (2, codes): two tables, as a code that comes twice running would wait for itself in one."""
    for i in range(frames.shape[0]):
        for r in range(frames.shape[1]):
            for c in range(0, frames.shape[2] - 1, 2):
                counts[0, frames[i, r, c]] += 1
                counts[1, frames[i, r, c + 1]] += 1
            if frames.shape[2] % 2:
                counts[0, frames[i, r, -1]] += 1


@njit(inline="always")
def _noise_row(frames, i, r, mean, row, columns, out):
    """Pixel part of the temporal noise in one row: without the mean of its row, (n, H), and of each column, (n, W)."""
    off = row[i, r]
    for c in range(out.size):
        out[c] = np.float32(frames[i, r, c]) - mean[r, c] - columns[i, c] - off


@njit(inline="always")
def _product(a, b, lag):
    total = np.float32(0)
    for c in range(a.size - lag):
        total += a[c] * b[c + lag]
    return total


@njit(**_fast)
def scatter(frames, mean, rows, columns, far, products, halves, squares):
    """Sums of products of the noise of pixels with that of others, over all frames and pixels.

    Args:
        frames: (n, H, W).
        mean: (H, W) float32.
        rows, columns: (n, H) and (n, W) float32, what is taken off each row and column.
        far: whether `FAR_LAGS` are wanted.
        products: (9,) float64, of `LAGS` and `FAR_LAGS`; added to.
        halves: (4,) float64, of squares in the left, right, upper and lower half; added to.
        squares: (H, W) float32, of squares over frames, added to; (0, 0) where not wanted.
    """
    height, width = mean.shape
    middle = width // 2
    ring = np.empty((_RING, width), np.float32)
    for i in range(frames.shape[0]):
        for r in range(height):
            z = ring[r % _RING]
            _noise_row(frames, i, r, mean, rows, columns, z)
            left = _product(z[:middle], z[:middle], 0)
            right = _product(z[middle:], z[middle:], 0)
            whole = np.float64(left) + np.float64(right)
            halves[0] += left
            halves[1] += right
            halves[2 if r < height // 2 else 3] += whole
            products[0] += whole
            products[1] += _product(z, z, 1)
            products[4] += _product(z, z, 2)
            if r >= 1:
                before = ring[(r - 1) % _RING]
                products[2] += _product(before, z, 0)
                products[3] += _product(before, z, 1)
            if r >= 2:
                products[5] += _product(ring[(r - 2) % _RING], z, 0)
            if far:
                products[6] += _product(z, z, 4)
                products[7] += _product(z, z, 12)
                if r >= 4:
                    products[8] += _product(ring[(r - 4) % _RING], z, 0)
            if squares.size:
                for c in range(width):
                    squares[r, c] += z[c] * z[c]


@njit(**_fast)
def noise_sizes(frames, mean, rows, columns, out):
    """Absolute noise of every second row and third column, out (n, (H + 1) // 2, (W + 2) // 3) float32."""
    for i in range(frames.shape[0]):
        for r in range(out.shape[1]):
            for c in range(out.shape[2]):
                x = np.float32(frames[i, 2 * r, 3 * c])
                out[i, r, c] = abs(x - mean[2 * r, 3 * c] - columns[i, 3 * c] - rows[i, 2 * r])


@njit(**_fast)
def tails(frames, mean, rows, columns, scale, spread, sums, counts, often):
    """What lies far out in the noise.

    Args:
        frames, mean, rows, columns: as of `scatter`.
        scale, spread: robust and plain standard deviation of the noise, in its unit.
        sums: (2,) float64 of sizes, and of cubes of noise over `spread`, limited to 3 either way; added to.
        counts: (7,) int64, noise beyond 3, 5, 8, 20 scales, above and below 8 of them, and neighbours that are both
            above; added to.
        often: (H, W) uint16, frames in which a pixel is beyond 3.5 scales; added to.
    """
    height, width = mean.shape
    ring = np.empty((2, width), np.float32)
    l3, l5, l8 = np.float32(3 * scale), np.float32(5 * scale), np.float32(8 * scale)
    l20, recurs = np.float32(20 * scale), np.float32(3.5 * scale)
    limit, unit = np.float32(3), np.float32(1 / spread)
    for i in range(frames.shape[0]):
        above_before = False
        for r in range(height):
            z = ring[r % 2]
            _noise_row(frames, i, r, mean, rows, columns, z)
            size, cubes = np.float32(0), np.float32(0)
            beyond3 = np.int32(0)
            for c in range(width):
                x = z[c]
                a = abs(x)
                size += a
                near = min(max(x * unit, -limit), limit)
                cubes += near * near * near
                beyond3 += np.int32(a > l3)
            sums[0] += size
            sums[1] += cubes
            counts[0] += beyond3
            above = False
            if beyond3:
                for c in range(width):
                    a = abs(z[c])
                    if a > recurs:
                        often[r, c] += np.uint16(1)
                    if a > l5:
                        counts[1] += 1
                        if a > l8:
                            counts[2] += 1
                            counts[3] += a > l20
                            counts[4] += z[c] > 0
                            counts[5] += z[c] < 0
                            above |= z[c] > 0
            if above:
                before = ring[(r - 1) % 2]
                for c in range(width):
                    if z[c] > l8:
                        counts[6] += c > 0 and z[c - 1] > l8
                        counts[6] += above_before and before[c] > l8
            above_before = above


@njit(**_fast)
def limited_squares(frames, mean, rows, columns, limit, out):
    """Adds the squares of the noise over frames to out (H, W) float32; beyond the limit it counts as the limit."""
    height, width = mean.shape
    z = np.empty(width, np.float32)
    limit = np.float32(limit)
    for i in range(frames.shape[0]):
        for r in range(height):
            _noise_row(frames, i, r, mean, rows, columns, z)
            for c in range(width):
                near = min(max(z[c], -limit), limit)
                out[r, c] += near * near


@njit(**EXACT)
def median_of_sizes(values):
    """Median of float32 numbers that are not negative: their bits are in the same order, so that leading digits are counted."""
    bits = values.view(np.uint32)
    if bits.size == 0:
        return np.nan
    counts = np.zeros(1 << (32 - _LOW_BITS), np.int32)
    for k in range(bits.size):
        counts[bits[k] >> np.uint32(_LOW_BITS)] += 1
    rank, first = (bits.size - 1) // 2, 0
    while rank >= counts[first]:
        rank -= counts[first]
        first += 1
    last = first
    while bits.size % 2 == 0 and rank + 1 >= counts[first] and (last == first or counts[last] == 0):
        last += 1
    near = np.empty(counts[first : last + 1].sum() + 1, np.uint32)
    n = 0
    for k in range(bits.size):  # without a branch, which half of the numbers would take
        digit = bits[k] >> np.uint32(_LOW_BITS)
        near[n] = bits[k]
        n += np.int64(digit >= first) & np.int64(digit <= last)
    near = near[:n]
    near.sort()
    ordered = near.view(np.float32)
    return (np.float64(ordered[rank]) + np.float64(ordered[rank + 1 - bits.size % 2])) / 2


@njit(**EXACT)
def _count_of(counts, rank):
    """Place in a table of counts of the number of a rank, and its rank among those that are counted there."""
    place = 0
    while rank >= counts[place]:
        rank -= counts[place]
        place += 1
    return place, rank


@njit(inline="always")
def _in_order(bits):
    """The bits of a float32 as a whole number that is in the order of the numbers."""
    return ~bits if bits >> np.uint32(31) else bits | np.uint32(0x80000000)


@njit(**EXACT)
def _lower_half(bits, upper, counts):
    """Of numbers whose upper 16 bits in order are `upper`, counts of the lower 16."""
    counts[:] = 0
    for k in range(bits.size):
        x = _in_order(bits[k])
        if x >> np.uint32(16) == upper:
            counts[x & np.uint32(0xFFFF)] += 1


@njit(**EXACT)
def median(values):
    """`np.median` of float32 numbers (n,), to the bit: 16 leading bits are counted, then the other 16."""
    bits, nan = values.view(np.uint32), np.float32(np.nan)
    counts, middle = np.zeros(1 << 16, np.int64), np.empty(2, np.uint32)
    for k in range(bits.size):
        if bits[k] & np.uint32(0x7FFFFFFF) > np.uint32(0x7F800000):
            return nan
        counts[_in_order(bits[k]) >> np.uint32(16)] += 1
    if bits.size == 0:
        return nan
    upper, rank = _count_of(counts, (bits.size - 1) // 2)
    next_upper, next_rank = _count_of(counts, bits.size // 2)
    _lower_half(bits, upper, counts)
    middle[0] = (upper << 16) + _count_of(counts, rank)[0]
    if next_upper != upper:
        _lower_half(bits, next_upper, counts)
    middle[1] = (next_upper << 16) + _count_of(counts, next_rank)[0]
    for k in range(2):
        middle[k] = middle[k] ^ np.uint32(0x80000000) if middle[k] >> np.uint32(31) else ~middle[k]
    ordered = middle.view(np.float32)
    return (ordered[0] + ordered[1]) / np.float32(2)


def median_of(values: np.ndarray) -> Any:
    """`np.median` of all values of an array, in a fifth of the time where they are float32."""
    return np.float32(median(values.ravel())) if values.dtype == np.float32 else np.median(values)


@njit(**EXACT)
def rank_values(frame, before, n, first, second, which, least, next_least):
    """Takes frame n of several into the greatest two and the least two values of every pixel, all (H, W).

    `which` is the frame of the greatest. Returns the sum of the sizes of `frame - before`.
    """
    total = 0.0
    for r in range(frame.shape[0]):
        for c in range(frame.shape[1]):
            x = frame[r, c]
            total += abs(x - before[r, c])
            if x > first[r, c]:
                second[r, c], first[r, c], which[r, c] = first[r, c], x, n
            else:
                second[r, c] = max(second[r, c], x)
            if x < least[r, c]:
                next_least[r, c], least[r, c] = least[r, c], x
            else:
                next_least[r, c] = min(next_least[r, c], x)
    return total


@njit(inline="always")
def _middle(image, r, c):
    """Mean of the middle two of a pixel's four neighbours; beyond an edge, of one that does not count already."""
    height, width = image.shape
    a = image[r - 1, c] if r > 0 else image[min(2, height - 1), c]
    b = image[r + 1, c] if r < height - 1 else image[max(height - 3, 0), c]
    d = image[r, c - 1] if c > 0 else image[r, min(2, width - 1)]
    e = image[r, c + 1] if c < width - 1 else image[r, max(width - 3, 0)]
    low, high = min(min(a, b), min(d, e)), max(max(a, b), max(d, e))
    return (((a + b) + (d + e)) - high - low) / np.float32(2)


@njit(**EXACT)
def apart(image, step, out):
    """Distance of every `step`-th pixel from the middle of its neighbours."""
    width = image.shape[1]
    r, c = 0, 0
    for k in range(out.size):
        out[k] = abs(image[r, c] - _middle(image, r, c))
        c += step
        while c >= width:
            r, c = r + 1, c - width


@njit(**EXACT)
def without_apart(image, limit, out):
    """The image with the middle of its neighbours for each pixel that is further from it than `limit`."""
    height, width = image.shape
    limit = np.float32(limit)
    for r in range(height):
        inner = 0 < r < height - 1 and width > 2
        if inner:
            for c in range(1, width - 1):
                a, b, d, e = image[r - 1, c], image[r + 1, c], image[r, c - 1], image[r, c + 1]
                low, high = min(min(a, b), min(d, e)), max(max(a, b), max(d, e))
                middle = (((a + b) + (d + e)) - high - low) / np.float32(2)
                x = image[r, c]
                out[r, c] = middle if abs(x - middle) > limit else x
        for c in range(0, width, width - 1) if inner else range(width):
            x, middle = image[r, c], _middle(image, r, c)
            out[r, c] = middle if abs(x - middle) > limit else x


@njit(**_fast)
def block_sums(image, row_edges, column_edges, out):
    """Sums of an image (H, W) float32 over blocks, (rows, columns) float64."""
    for a in range(out.shape[0]):
        for r in range(row_edges[a], row_edges[a + 1]):
            for b in range(out.shape[1]):
                total = np.float32(0)
                for c in range(column_edges[b], column_edges[b + 1]):
                    total += image[r, c]
                out[a, b] += total


@njit(**_fast)
def line_means(image):
    """Means of rows (H,) and of columns (W,), float64."""
    height, width = image.shape
    rows, columns = np.zeros(height), np.zeros(width)
    for r in range(height):
        total = 0.0
        for c in range(width):
            total += image[r, c]
            columns[c] += image[r, c]
        rows[r] = total / width
    return rows, columns / height


@njit(**_fast)
def pixel_part(image, rows, columns, slow, row_edges, column_edges, out):
    """Image less the means of its rows and columns and of blocks; the mean of what is left is taken off too."""
    height, width = image.shape
    total = 0.0
    for a in range(slow.shape[0]):
        for r in range(row_edges[a], row_edges[a + 1]):
            for b in range(slow.shape[1]):
                off = rows[r] + slow[a, b]
                part = np.float32(0)
                for c in range(column_edges[b], column_edges[b + 1]):
                    out[r, c] = image[r, c] - columns[c] - off
                    part += out[r, c]
                total += part
    mean = np.float32(total / (height * width))
    for r in range(height):
        for c in range(width):
            out[r, c] -= mean


@njit(**_fast)
def far_pixels(image, scale, counts):
    """Sum of cubes of pixels over `scale`, limited to 4 either way; and the pixels beyond.

    Args:
        image: (H, W) float32.
        counts: (6,) int64: above 4, 7, 15, 50 scales, below 7 and 15 of them; added to.
    """
    height, width = image.shape
    limit, unit, total = np.float32(4), np.float32(1 / scale), 0.0
    for r in range(height):
        cubes = np.float32(0)
        beyond = np.int32(0)
        for c in range(width):
            x = image[r, c] * unit
            near = min(max(x, -limit), limit)
            cubes += near * near * near
            beyond += np.int32(abs(x) > limit)
        total += cubes
        if beyond:
            for c in range(width):
                x = image[r, c] * unit
                if x > limit:
                    counts[0] += 1
                    counts[1] += x > 7
                    counts[2] += x > 15
                    counts[3] += x > 50
                counts[4] += x < -7
                counts[5] += x < -15
    return total


@njit(**EXACT)
def response(frame, before, dark):
    """Sums over pixels of (frame - dark) times (before - its mean), and of the square of the latter.

    `dark` is (0, 0) where nothing is taken off.
    """
    height, width = frame.shape
    x_mean, y_mean = 0.0, 0.0
    for r in range(height):
        for c in range(width):
            x_mean += before[r, c]
            y_mean += frame[r, c]
    x_mean /= height * width
    y_mean /= height * width
    both, square = 0.0, 0.0
    for r in range(height):
        for c in range(width):
            x = before[r, c] - x_mean
            y = frame[r, c] - y_mean
            if dark.size:
                y -= dark[r, c]
            both += x * y
            square += x * x
    return both, square
