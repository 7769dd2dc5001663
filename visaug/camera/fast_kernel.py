"""The base chain as one fused loop for the CPU: signal in, signal or image out, nothing of an image's size in between.

Law, order and random numbers are those of the effects one by one. Where pixel offsets are drawn anew for every image, a pixel
takes a short cut if it can: one normal quantile gives count, gain and offsets together, by a Cornish-Fisher expansion of the
count's quantile. A Poisson count whose mean has a Gaussian gain (PRNU) has the cumulants m + v, m + 3v, m + 7v with
v = (K m)^2. Pixels that this does not fit - small means, full wells, electrons whose being whole numbers shows through the
read noise - draw each part on its own.
"""

import math
from enum import IntEnum

import numpy as np
from numba import njit

from visaug.core.sampling.kernels import (
    HALF,
    ONE,
    SIXTH,
    SMALL_MEAN,
    ZERO,
    as_float,
    compiled,
    counts,
    f32,
    f64,
    float_bits,
    i32,
    log,
    mix,
    normals,
    part,
    rows_at_once,
    scramble,
    tukeys,
    u32,
    u64,
    words_of_rows,
)

TERMS = 8  # coefficients of a polynomial


class Number(IntEnum):
    """Columns of the table of numbers, one row an image. What a run of effects leaves out is neutral.

    Compiled functions index by `.value`: older versions of numba take no member of an enumeration as an index.
    """

    ELECTRONS = 0  # mean electrons of the signal 1
    LEAST_E = 1  # 0 behind the light's pattern, which leaves no negative light; else -inf
    DARK_E = 2
    COUNTED = 3  # 1: the mean becomes a Poisson count
    FULL_WELL_E = 4
    READ_SCALE_E = 5  # of Tukey's lambda, not its standard deviation
    READ_SHAPE = 6
    AFTER_GAIN_E = 7  # Gaussian noise behind the gain, as electrons
    E_PER_DN = 8
    BLACK_DN = 9
    MAX_DN = 10  # inf: not rounded
    LESS_DN = 11  # out = clip((DN - less_dn) per_dn)
    PER_DN = 12
    LEAST_OUT = 13
    MOST_OUT = 14
    PRNU_PIXEL = 15  # drawn anew for each image; 0 where a map is kept
    DSNU_PIXEL_E = 16  # the same
    FAINT_E = 17  # means up to it are so small beside the pixel offsets that they take the short cut
    LIMIT_E = 18  # means above it may meet the full well and draw each part on its own; below 0: all do
    ROW_DEVIATIONS = 19  # three: of PRNU, of DSNU, of the noise of each exposure
    COLUMN_DEVIATIONS = 22  # the same three
    CORE = 25  # TERMS coefficients of read noise at a normal number z up to FAR: e / z as a polynomial of z^2
    BEYOND = CORE + TERMS  # the same of log e


NUMBERS = Number.BEYOND + TERMS


class Key(IntEnum):
    """Columns of the table of keys: the streams of the effects, that of the short cut, and those of rows and columns."""

    SHOT = 0
    READ = 1
    AFTER_GAIN = 2
    PRNU = 3
    DSNU = 4
    TOGETHER = 5
    PRNU_ROW = 6
    DSNU_ROW = 7
    ROW_NOISE = 8
    PRNU_COLUMN = 9
    DSNU_COLUMN = 10
    COLUMN_NOISE = 11


KEYS = len(Key)

MOST_E = 1e18  # electrons of which float32 still holds the squares
# A faint count that shares the draw adds the skewness m / (m + sigma^2)^(3/2); up to 0.1 the expansion has it, and of the
# fifth cumulant, which it has not, read noise must hide most.
FAINT_SKEWNESS, FAINT_FIFTH = 0.1, 0.025
WIDEST_PRNU = 0.1  # of pixels drawn anew; beyond it the expansion of the count's quantile is not exact
AT_ONCE = 64  # pixels
STEP = u64(0x9E3779B97F4A7C15)
THREE, SEVEN = f32(3), f32(7)
PER_24, PER_18, FIVE_PER_36 = f32(1 / 24), f32(1 / 18), f32(5 / 36)
PER_HALF_WORD = f32(2.0**-31)
FAR, FARTHEST = f32(3.7), f32(6.7)  # beyond FAR are 2e-4 of all normal numbers, beyond FARTHEST none
# sin(x pi/2) / x and cos(x pi/2) as polynomials of x^2 up to 1, within 1e-7: interpolated at Chebyshev's places.
SIN = (
    f32(1.570796320e00),
    f32(-6.459637604e-01),
    f32(7.968992260e-02),
    f32(-4.674150669e-03),
    f32(1.516751178e-04),
)
COS = (
    f32(9.999999998e-01), f32(-1.233700534e+00), f32(2.536693225e-01), f32(-2.086268755e-02), f32(9.177238821e-04),
    f32(-2.382453550e-05),
)  # fmt: skip
GILES_0, GILES_2, GILES_4 = f32(-8 / 405), f32(7 / 810), f32(1 / 270)
TO_WHOLE = f32(1.5 * 2**23)  # to add and subtract it rounds to a whole number, halves to even, up to 2^22


def scratch(width):
    """What `expose` overwrites, for images of a width."""
    size = rows_at_once.py_func(width) * width  # pyrefly: ignore[missing-attribute]
    return np.empty((10, size), np.float32), np.empty((3, size + 3), np.uint32), np.empty((3, size))


@compiled
def key_table(frames, cameras, names, depth, fixed, out):
    """The keys of streams.

    Args:
        frames: (B,) uint64, keys of the temporal noise; cameras: (B,) or (1,), of the fixed patterns.
        names: (KEYS, 2) uint64, by which a stream is forked; depth: how many of the two count; fixed: 1 for a fixed pattern.
        out: (B, KEYS) uint64, written.
    """
    for i in range(len(frames)):
        for j in range(KEYS):
            key = cameras[min(i, len(cameras) - 1)] if fixed[j] else frames[i]
            for name in names[j, : depth[j]]:
                key = mix(key ^ name)
            out[i, j] = key


@compiled
def line_patterns(numbers, keys, sets, channels, by_column, first, words, w, out):
    """Adds gains and offsets of rows, or of columns.

    Args:
        numbers: (B, NUMBERS); keys: (B, KEYS).
        sets: B, or 1 where all images share theirs.
        first: row, or column, of the sensor.
        words, w: (size + 3,) uint32 and (size,) float32, overwritten.
        out: (2, sets C, size) float32.
    """
    streams = Key.PRNU_COLUMN if by_column else Key.PRNU_ROW
    deviations = Number.COLUMN_DEVIATIONS if by_column else Number.ROW_DEVIATIONS
    none, one = np.int64(0), np.int64(1)
    place = (none, first, one, w.size) if by_column else (first, none, w.size, one)
    for i in range(sets):
        for kind in range(3):
            sigma = numbers[i, deviations + kind]
            if sigma == ZERO:
                continue
            for channel in range(channels):
                words_of_rows(keys[i, streams + kind], channel, *place, words)
                normals(words, w)
                _add_scaled(sigma, w, out[min(kind, 1), i * channels + channel])


@compiled
def short_cut(numbers, deviation):
    """Sets FAINT_E and LIMIT_E, from the other numbers and the standard deviation of Tukey's lambda of scale 1, (B or 1,)."""
    for i in range(len(numbers)):
        n = numbers[i]
        gaussian = math.hypot(f64(n[Number.DSNU_PIXEL_E.value]), f64(n[Number.AFTER_GAIN_E.value]))
        read_e = f64(n[Number.READ_SCALE_E.value] * deviation[min(i, len(deviation) - 1)])
        well, prnu = f64(n[Number.FULL_WELL_E.value]), n[Number.PRNU_PIXEL.value]
        if gaussian == 0 or prnu > WIDEST_PRNU:
            n[Number.LIMIT_E.value] = -1
        elif math.isinf(well):
            n[Number.LIMIT_E.value] = np.inf
        else:
            finite = min(well, 1e9)
            n[Number.LIMIT_E.value] = max(finite - 6 * math.sqrt(finite + (finite * f64(prnu)) ** 2), 0.0)
        hidden = FAINT_FIFTH * math.hypot(gaussian, read_e) ** 5
        n[Number.FAINT_E.value] = min(FAINT_SKEWNESS * gaussian**3, hidden, MOST_E)


@njit(inline="always")
def _values(source, white, out):
    """Image values of whole numbers, of which `white` is 1; those of floats, where it is 0, as they are."""
    if white > ZERO:
        for x in range(out.size):
            out[x] = f32(source[x]) / white
    else:
        for x in range(out.size):
            out[x] = source[x]


@part
def _sum(by_row, by_column, by_pixel, out):
    """One number of each row, one of each column, and one of each pixel where there are any."""
    width = by_column.size
    for r in range(by_row.size):
        for x in range(width):
            out[r * width + x] = by_row[r] + by_column[x]
    if by_pixel.size:
        for i in range(out.size):
            out[i] += by_pixel[i]


@njit(inline="always")
def _light(source, electrons, gains, least, light):
    for x in range(light.size):
        light[x] = max(source[x] * electrons * (ONE + gains[x]), least)


@njit(inline="always")
def _is_apart(m, faint, limit):
    return (m > faint) & (m < SMALL_MEAN) | (m > limit)


@part
def _count_apart(light, dark, faint, limit):
    apart = i32(0)
    for x in range(light.size):
        apart += i32(_is_apart(light[x] + dark, faint, limit))
    return apart


@part
def _two_words(key, place, one, other):
    """Twice 32 random bits for each pixel of a window: its column, mixed with three words of its row's key.

    The factors and shifts are those of C. Wellons' triple32.
    """
    channel, row, first, rows, width = place
    for r in range(rows):
        of_row = mix(mix(key + u64(channel) * STEP) + u64(row + r))
        a, b, c = u32(of_row), u32(of_row >> u64(32)), u32(mix(of_row + STEP))
        to, also = one[r * width : (r + 1) * width], other[r * width : (r + 1) * width]
        for x in range(width):
            word = scramble(u32(first + x), u32(31), u32(0x9E3779B9), a)  # pyrefly: ignore[missing-argument]
            word = scramble(word, u32(17), u32(0xED5AD4BB), b)  # pyrefly: ignore[missing-argument]
            word = scramble(word, u32(11), u32(0xAC4C1B51), u32(0))  # pyrefly: ignore[missing-argument]
            to[x] = u32(word ^ (word >> u32(15)))
            word = scramble(word, u32(15), u32(0x31848BAB), c)  # pyrefly: ignore[missing-argument]
            also[x] = u32(word ^ (word >> u32(14)))


@part
def _two_normals(one, other, w, z):
    """Two independent normal numbers from two words: the radius, and an angle, of Box and Muller."""
    for x in range(w.size):
        radius = math.sqrt(f32(-2) * log((f32(i32(one[x] >> u32(1))) + HALF) * PER_HALF_WORD))
        half = f32(i32(other[x])) * PER_HALF_WORD  # of the right angle, either way
        h2 = half * half
        sine = SIN[0] + h2 * (SIN[1] + h2 * (SIN[2] + h2 * (SIN[3] + h2 * SIN[4])))
        cosine = COS[0] + h2 * (COS[1] + h2 * (COS[2] + h2 * (COS[3] + h2 * (COS[4] + h2 * COS[5]))))
        z[x] = radius * half * sine
        side = i32(one[x] << u32(31))  # the other half of the circle
        w[x] = as_float(float_bits(radius * cosine) ^ side)  # pyrefly: ignore[missing-argument]


@part
def _read_noise(z, n, e):
    """Electrons of read noise at normal numbers z."""
    first = Number.CORE.value
    c = n[first : first + TERMS]
    c0, c1, c2, c3, c4, c5, c6, c7 = c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7]
    far = i32(0)
    for x in range(e.size):
        t = z[x] * z[x]
        s = t * (f32(2) / (FAR * FAR)) - ONE
        e[x] = z[x] * (c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * (c5 + s * (c6 + s * c7)))))))
        far += i32(t > FAR * FAR)
    if far == 0:
        return
    for x in range(e.size):
        t = z[x] * z[x]
        if t > FAR * FAR:
            s = (t - FAR * FAR) * (f32(2) / (FARTHEST * FARTHEST - FAR * FAR)) - ONE
            value = ZERO
            for k in range(TERMS):
                value = value * s + n[Number.BEYOND.value + TERMS - 1 - k]
            e[x] = n[Number.READ_SCALE_E.value] * math.copysign(math.exp(value), z[x])


@part
def _add_quantiles(light, w, n, e):
    """Adds quantiles of count, gain and Gaussian offsets at normal quantiles w."""
    dark, prnu = n[Number.DARK_E.value], n[Number.PRNU_PIXEL.value]
    dsnu_e, after_gain_e = n[Number.DSNU_PIXEL_E.value], n[Number.AFTER_GAIN_E.value]
    added = dsnu_e * dsnu_e + after_gain_e * after_gain_e
    for x in range(e.size):
        m, v = light[x] + dark, (light[x] * prnu) * (light[x] * prnu)
        s = math.sqrt(m + v + added)
        r = ONE / s
        r2, w2 = r * r, w[x] * w[x]
        skew = (m + THREE * v) * r2
        bend = (m + SEVEN * v) * r2 * PER_24 * (w2 - THREE) - skew * skew * (PER_18 * w2 - FIVE_PER_36)
        even = m + skew * SIXTH * (w2 - ONE) + m * r2 * r2 * (GILES_0 + w2 * (GILES_2 + w2 * GILES_4))
        e[x] += even + w[x] * (s + r * bend)


@njit(inline="always")
def _add_scaled(scale, w, out):
    for x in range(out.size):
        out[x] += scale * w[x]


@njit(inline="always")
def _added(a, b, most, out):
    for x in range(out.size):
        out[x] = min(a[x], most) + b[x]


@part
def _add_normals(key, place, scale, words, w, out):
    if scale > ZERO:
        words_of_rows(key, *place, words)
        normals(words, w)
        _add_scaled(scale, w, out)


@njit(inline="always")
def _apart(source, n, keys, place, gains, offsets, words, room, mean, w, e):
    """Electrons of a window, each part on its own."""
    _add_normals(keys[Key.PRNU.value], place, n[Number.PRNU_PIXEL.value], words, w, gains)
    _add_normals(keys[Key.DSNU.value], place, n[Number.DSNU_PIXEL_E.value], words, w, offsets)
    _light(source, n[Number.ELECTRONS.value], gains, n[Number.LEAST_E.value], mean)
    for x in range(mean.size):
        mean[x] += n[Number.DARK_E.value]
    if n[Number.COUNTED.value] > ZERO:
        words_of_rows(keys[Key.SHOT.value], *place, words)
        counts(mean, words, room, w)
        _added(w, offsets, n[Number.FULL_WELL_E.value], e)
    else:
        _added(mean, offsets, n[Number.FULL_WELL_E.value], e)
    if n[Number.READ_SCALE_E.value] > ZERO:
        words_of_rows(keys[Key.READ.value], *place, words)
        tukeys(words, n[Number.READ_SHAPE.value], n[Number.READ_SCALE_E.value], w)
        _add_scaled(ONE, w, e)
    _add_normals(keys[Key.AFTER_GAIN.value], place, n[Number.AFTER_GAIN_E.value], words, w, e)


@njit(inline="always")
def _together(light, n, keys, place, offsets, one, other, w, z, e):
    """Electrons of a window, count and pixel offsets as one."""
    _two_words(keys[Key.TOGETHER.value], place, one, other)
    _two_normals(one, other, w, z)
    _read_noise(z, n, e)
    _add_scaled(ONE, offsets, e)
    _add_quantiles(light, w, n, e)


@njit(inline="always")
def _replace(source, n, keys, place, gains, offsets, light, words, room, mean, w, result, e):
    """Draws each part on its own: everywhere, or where that has to be, for AT_ONCE pixels of a row together."""
    channel, row, first, rows, width = place
    dark, faint, limit = n[Number.DARK_E.value], n[Number.FAINT_E.value], n[Number.LIMIT_E.value]
    whole = limit < ZERO
    high, wide = (rows, width) if whole else (np.int64(1), np.int64(AT_ONCE))
    for r in range(0, rows, high):
        for x in range(0, width, wide):
            size = high * min(wide, width - x)
            a = r * width + x
            b = a + size
            if not whole and _count_apart(light[a:b], dark, faint, limit) == 0:
                continue
            here = (channel, row + r, first + x, high, size // high)
            to = e[a:b] if whole else result[:size]
            _apart(
                source[a:b], n, keys, here, gains[a:b], offsets[a:b], words, room, mean[:size], w[:size], to
            )
            if not whole:
                for i in range(a, b):
                    if _is_apart(light[i] + dark, faint, limit):
                        e[i] = to[i - a]


@part
def _convert(e, source, n, white, out):
    """Electrons to DN, and DN to the values that are wanted; what is missing in the source stays missing."""
    e_per_dn, black, top = n[Number.E_PER_DN.value], n[Number.BLACK_DN.value], n[Number.MAX_DN.value]
    less, per_dn = n[Number.LESS_DN.value], n[Number.PER_DN.value]
    least, most = n[Number.LEAST_OUT.value], n[Number.MOST_OUT.value]
    if white > ZERO:
        for x in range(out.size):
            dn = (min(max(e[x] / e_per_dn + black, ZERO), top) + TO_WHOLE) - TO_WHOLE
            out[x] = i32((min(max((dn - less) * per_dn, least), most) * white + TO_WHOLE) - TO_WHOLE)
    elif top < f32(np.inf):
        for x in range(out.size):
            dn = (min(max(e[x] / e_per_dn + black, ZERO), top) + TO_WHOLE) - TO_WHOLE
            value = min(max((dn - less) * per_dn, least), most)
            out[x] = value if source[x] == source[x] else source[x]
    else:
        for x in range(out.size):
            out[x] = e[x] / e_per_dn + black


@compiled
def expose(
    source, out, sizes, first_row, last_row, channels, numbers, keys, row_gain, row_offset, column_gain, column_offset,
    gain_maps, offset_maps, origin, white, floats, words, sums,
):  # fmt: skip
    """Rows [first_row, last_row) of all planes of a batch, one after another.

    Args:
        source, out: (B C H W,) float32, or whole numbers of which `white` is the image value 1; 0 for float32.
        sizes: H and W.
        channels: C.
        numbers: (B, NUMBERS) float32; keys: (B, KEYS) uint64.
        row_gain, row_offset: (B C H or C H,) float32, fractions and electrons.
        column_gain, column_offset: (B C or C, W) float32.
        gain_maps, offset_maps: (B C H W or C H W,) float32; empty where there is none.
        origin: row and column of the sensor at which the images begin.
        floats, words, sums: of `scratch`.
    """
    height, width = sizes
    at_once = floats.shape[1] // width
    one, other, room = words[0], words[1], (words[2], floats[8:], sums)
    number = first_row
    while number < last_row:
        plane, y = number // height, number % height
        rows = min(at_once, height - y, last_row - number)
        image, channel = plane // channels, plane % channels
        of_camera = channel * height + y  # patterns of each image, or of one camera
        n, place = numbers[image], (channel, y + origin[0], origin[1], rows, width)
        pixels = rows * width
        seen, gains, offsets, light = (
            floats[0, :pixels],
            floats[1, :pixels],
            floats[2, :pixels],
            floats[3, :pixels],
        )
        w, z, e = floats[4, :pixels], floats[5, :pixels], floats[6, :pixels]
        row, own = (number, plane) if len(column_gain) > channels else (of_camera, channel)
        gain_at = (number if gain_maps.size > channels * height * width else of_camera) * width
        offset_at = (number if offset_maps.size > channels * height * width else of_camera) * width
        _sum(row_gain[row : row + rows], column_gain[own], gain_maps[gain_at : gain_at + pixels], gains)
        _sum(
            row_offset[row : row + rows],
            column_offset[own],
            offset_maps[offset_at : offset_at + pixels],
            offsets,
        )
        start = number * width
        _values(source[start : start + pixels], white, seen)
        faint, limit = n[Number.FAINT_E.value], n[Number.LIMIT_E.value]
        whole = limit < ZERO
        if not whole:
            _light(seen, n[Number.ELECTRONS.value], gains, n[Number.LEAST_E.value], light)
            _together(light, n, keys[image], place, offsets, one, other, w, z, e)
        if whole or _count_apart(light, n[Number.DARK_E.value], faint, limit) > 0:
            _replace(seen, n, keys[image], place, gains, offsets, light, one, room, z, w, floats[7], e)
        _convert(e, seen, n, white, out[start : start + pixels])
        number += rows
