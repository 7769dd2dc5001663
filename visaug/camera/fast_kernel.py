"""The base chain as one fused loop for the CPU: signal in, signal or image out, nothing of an image's size in between.

Law, order and random numbers are those of the effects one by one. Where pixel offsets are drawn anew for every image, a pixel
takes a short cut if it can: one normal quantile gives count, gain and offsets together, by a Cornish-Fisher expansion of the
count's quantile. A Poisson count whose mean has a Gaussian gain (PRNU) has the cumulants m + v, m + 3v, m + 7v with
v = (K m)^2. Pixels that this does not fit - small means, full wells, electrons whose being whole numbers shows through the
read noise - draw each part on its own.
"""

import math

import numpy as np
from numba import njit

from visaug.core.sampling.kernels import (
    ONE,
    OPTIONS,
    SIXTH,
    SMALL_MEAN,
    ZERO,
    counts,
    f32,
    i32,
    mix,
    normals,
    room_of,
    tukeys,
    u32,
    u64,
    words_of_row,
)

# Columns of the table of numbers, one row an image. What a run of effects leaves out is neutral.
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
LESS_DN, PER_DN, LEAST_OUT, MOST_OUT = 11, 12, 13, 14  # out = clip((DN - less_dn) per_dn)
PRNU_PIXEL, DSNU_PIXEL_E = 15, 16  # drawn anew for each image; 0 where a map is kept
FAINT_E = 17  # means up to it are so small beside the pixel offsets that they take the short cut
LIMIT_E = 18  # means above it may meet the full well and draw each part on its own; below 0: all do
NUMBERS = 19

# Columns of the table of keys: the streams of the effects, and that of the short cut.
SHOT, READ, AFTER_GAIN, PRNU, DSNU, TOGETHER = 0, 1, 2, 3, 4, 5
KEYS = 6

STEP = u64(0x9E3779B97F4A7C15)
TWO, THREE, FIVE, SEVEN = f32(2), f32(3), f32(5), f32(7)
PER_24, PER_36 = f32(1 / 24), f32(1 / 36)
GILES_0, GILES_2, GILES_4 = f32(-8 / 405), f32(7 / 810), f32(1 / 270)
TO_WHOLE = f32(1.5 * 2**23)  # to add and subtract it rounds to a whole number, halves to even, up to 2^22


@njit(**OPTIONS)
def _sum(one, row, pixels, out):
    """One number of the row, one of each column, one of each pixel where there are any."""
    for x in range(out.size):
        out[x] = one + row[x]
    if pixels.size:
        for x in range(out.size):
            out[x] += pixels[x]


@njit(**OPTIONS)
def _light(source, electrons, gains, least, light):
    for x in range(light.size):
        light[x] = max(source[x] * electrons * (ONE + gains[x]), least)


@njit(inline="always")
def _is_apart(m, faint, limit):
    return (m > faint) & (m < SMALL_MEAN) | (m > limit)


@njit(**OPTIONS)
def _count_apart(light, dark, faint, limit):
    apart = i32(0)
    for x in range(light.size):
        apart += i32(_is_apart(light[x] + dark, faint, limit))
    return apart


@njit(**OPTIONS)
def _two_words(key, first, one, other):
    """Twice 32 random bits for each column of the sensor."""
    for x in range(one.size):
        bits = mix(key + u64(first + x) * STEP)
        one[x], other[x] = u32(bits), u32(bits >> u64(32))


@njit(**OPTIONS)
def _add_quantiles(light, w, n, e):
    """Adds quantiles of count, gain and Gaussian offsets at normal quantiles w."""
    dark, prnu = n[DARK_E], n[PRNU_PIXEL]
    added = n[DSNU_PIXEL_E] * n[DSNU_PIXEL_E] + n[AFTER_GAIN_E] * n[AFTER_GAIN_E]
    for x in range(e.size):
        m, v = light[x] + dark, (light[x] * prnu) * (light[x] * prnu)
        s = math.sqrt(m + v + added)
        r = ONE / s
        r2, w2 = r * r, w[x] * w[x]
        skew = (m + THREE * v) * r2
        curve = (m + SEVEN * v) * r2 * (w2 - THREE)
        bend = skew * skew * (TWO * w2 - FIVE)
        count = m + s * w[x] + skew * (w2 - ONE) * SIXTH + r * w[x] * (curve * PER_24 - bend * PER_36)
        e[x] += count + m * r2 * r2 * (GILES_0 + w2 * (GILES_2 + w2 * GILES_4))


@njit(**OPTIONS)
def _add_scaled(scale, w, out):
    for x in range(out.size):
        out[x] += scale * w[x]


@njit(**OPTIONS)
def _added(a, b, most, out):
    for x in range(out.size):
        out[x] = min(a[x], most) + b[x]


@njit(**OPTIONS)
def _add_normals(key, channel, row, first, scale, words, w, out):
    if scale > ZERO:
        words_of_row(key, channel, row, first, words)
        normals(words[first % 4 : first % 4 + out.size], w)
        _add_scaled(scale, w, out)


@njit(**OPTIONS)
def _apart(source, n, keys, place, gains, offsets, words, room, light, w, e):
    """Electrons of a row, each part on its own."""
    channel, row, first = place
    own = words[first % 4 : first % 4 + e.size]
    _add_normals(keys[PRNU], channel, row, first, n[PRNU_PIXEL], words, w, gains)
    _add_normals(keys[DSNU], channel, row, first, n[DSNU_PIXEL_E], words, w, offsets)
    _light(source, n[ELECTRONS], gains, n[LEAST_E], light)
    for x in range(light.size):
        light[x] += n[DARK_E]
    if n[COUNTED] > ZERO:
        words_of_row(keys[SHOT], channel, row, first, words)
        counts(light, own, room, w)
        _added(w, offsets, n[FULL_WELL_E], e)
    else:
        _added(light, offsets, n[FULL_WELL_E], e)
    if n[READ_SCALE_E] > ZERO:
        words_of_row(keys[READ], channel, row, first, words)
        tukeys(own, n[READ_SHAPE], n[READ_SCALE_E], w)
        _add_scaled(ONE, w, e)
    _add_normals(keys[AFTER_GAIN], channel, row, first, n[AFTER_GAIN_E], words, w, e)


@njit(**OPTIONS)
def _together(light, n, keys, place, offsets, one, other, w, e):
    """Electrons of a row, count and pixel offsets as one."""
    channel, row, first = place
    _two_words(mix(mix(keys[TOGETHER] + u64(channel) * STEP) + u64(row)), first, one, other)
    tukeys(other, n[READ_SHAPE], n[READ_SCALE_E], e)
    _add_scaled(ONE, offsets, e)
    normals(one, w)
    _add_quantiles(light, w, n, e)


@njit(**OPTIONS)
def _convert(e, source, n, out):
    """Electrons to DN, and DN to the values that are wanted; what is missing in the source stays missing."""
    e_per_dn, black, top = n[E_PER_DN], n[BLACK_DN], n[MAX_DN]
    less, per_dn, least, most = n[LESS_DN], n[PER_DN], n[LEAST_OUT], n[MOST_OUT]
    if top < f32(np.inf):
        for x in range(out.size):
            dn = (min(max(e[x] / e_per_dn + black, ZERO), top) + TO_WHOLE) - TO_WHOLE
            value = min(max((dn - less) * per_dn, least), most)
            out[x] = value if source[x] == source[x] else source[x]
    else:
        for x in range(out.size):
            out[x] = e[x] / e_per_dn + black


@njit(**OPTIONS)
def expose(
    source, out, first_row, last_row, channels, numbers, keys, row_gain, row_offset, column_gain, column_offset,
    gain_map, offset_map, origin,
):  # fmt: skip
    """Rows [first_row, last_row) of all planes of a batch, one after another.

    Args:
        source, out: (B C, H, W) float32.
        channels: C.
        numbers: (B, NUMBERS) float32; keys: (B, KEYS) uint64.
        row_gain, row_offset: (B C or C, H) float32, fractions and electrons; column_...: the same by columns.
        gain_map, offset_map: (B C or C, H, W) float32; (C, H, 0) where there is none.
        origin: row and column of the sensor at which the images begin.
    """
    _, height, width = source.shape
    words, room = np.empty((origin[1] % 4 + width + 3) // 4 * 4, np.uint32), room_of(width)
    one, other = np.empty(width, np.uint32), np.empty(width, np.uint32)
    floats = np.empty((7, width), np.float32)
    gains, offsets, light, mean, w, e, result = (
        floats[0],
        floats[1],
        floats[2],
        floats[3],
        floats[4],
        floats[5],
        floats[6],
    )
    for number in range(first_row, last_row):
        plane, y = number // height, number % height
        image, channel = plane // channels, plane % channels
        own = plane if len(row_gain) > channels else channel  # patterns of each image, or of one camera
        n, place = numbers[image], (channel, y + origin[0], origin[1])
        gain_row = gain_map[plane if len(gain_map) > channels else channel, y]
        offset_row = offset_map[plane if len(offset_map) > channels else channel, y]
        _sum(row_gain[own, y], column_gain[own], gain_row, gains)
        _sum(row_offset[own, y], column_offset[own], offset_row, offsets)
        apart = width
        if n[LIMIT_E] >= ZERO:
            _light(source[plane, y], n[ELECTRONS], gains, n[LEAST_E], light)
            apart = _count_apart(light, n[DARK_E], n[FAINT_E], n[LIMIT_E])
        if apart < width:
            _together(light, n, keys[image], place, offsets, one, other, w, e)
        if apart > 0:
            _apart(source[plane, y], n, keys[image], place, gains, offsets, words, room, mean, w, result)
            for x in range(width):
                is_apart = apart == width or _is_apart(light[x] + n[DARK_E], n[FAINT_E], n[LIMIT_E])
                e[x] = result[x] if is_apart else e[x]
        _convert(e, source[plane, y], n, out[plane, y])
