"""The base chain as one fused loop for the CPU: photons in, image out, nothing of an image's size in between.

Law and order are those of the exact chain. A pixel takes one 64-bit random number: half of it is the read noise by a
table of quantiles, half is everything else by a Cornish-Fisher expansion of the count's quantile about the normal's:
a Poisson count whose mean has a Gaussian gain (PRNU) has the cumulants m + v, m + 3v, m + 7v with v = (K m)^2.
M. Giles' inverse of the Poisson distribution function is the case v = 0. Pixels that this does not fit - small means,
full wells, electrons whose being whole numbers shows through the read noise - draw each part on its own.
"""

import math

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from visaug.camera.coarse import NORMAL_BITS, RARE_BITS, TUKEY_BITS
from visaug.camera.tables import FIRST, FRACTION_BITS, LARGE_MEAN, MEANS_PER_ROOT, SIDE
from visaug.core.sampling.kernels import mix

# (numba keeps compiled code by the date of this file alone: touch it after a change to the constants of tables.py or to `mix`.)

# Columns of the table of numbers, one row an image.
ELECTRONS = 0  # mean electrons of the image's value 1
DARK_E = 1
PRNU_PIXEL = 2  # drawn anew for each pixel; 0 where a map is kept
GAUSSIAN_E = 3  # offsets drawn anew for each pixel: DSNU, where no map is kept, and noise after the gain
READ_SIGMA_E = 4
DN_PER_E = 5
OFFSET_DN = 6  # black level
LESS_DN = 7  # the DN that becomes 0
FULL_WELL_E = 8
LIMIT_E = 9  # means above it draw each part on its own: they may meet the full well
MAX_DN = 10
LATTICE = (
    11  # 1: the count is a whole number and meets the full well; 0: Gaussian parts are drawn together with it
)
FAINT_E = (
    12  # means up to it are so small beside the pixel offsets that they too are drawn together with these
)
PER_DN = 13  # image value of one DN
COARSE = 14  # 1: numbers of 14 and 12 bits do for pixels that are drawn together, see coarse.py
NUMBERS = 15

f32, i32, u32, u64 = np.float32, np.int32, np.uint32, np.uint64
PER_BIT, HALF_BIT = f32(2.0**-32), f32(2.0**-33)
LARGE, PER_ROOT = f32(LARGE_MEAN), f32(MEANS_PER_ROOT)
ZERO, HALF, ONE, TWO, THREE, FIVE, SEVEN = (f32(n) for n in (0, 0.5, 1, 2, 3, 5, 7))
SIXTH, PER_24, PER_36, PER_1024 = f32(1 / 6), f32(1 / 24), f32(1 / 36), f32(1 / 1024)
GILES_0, GILES_2, GILES_4 = f32(-8 / 405), f32(7 / 810), f32(1 / 270)
STEP, OTHER = u64(0x9E3779B97F4A7C15), u64(0xD1B54A32D192ED03)
EDGE, TWO_EDGES = u32(1 << (32 - RARE_BITS)), u32(2 << (32 - RARE_BITS))
# streams of their own beside that of single pixels
PAIRS, TAILS = u64(0xA0761D6478BD642F), u64(0xE7037ED1A0B428DB)
FRACTION, THRESHOLD = u32((1 << FRACTION_BITS) - 1), i32((1 << (FRACTION_BITS + 1)) - 1)

_options = {
    "nogil": True,
    "error_model": "numpy",
    "cache": True,
    "fastmath": {"contract", "arcp", "nsz", "reassoc", "afn"},
}


@intrinsic
def _float_bits(_typing, _number):
    """The bits of a float32."""

    def generate(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(32))

    return types.uint32(types.float32), generate


@intrinsic
def _as_float(_typing, _number):
    """The float32 of these bits."""

    def generate(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), generate


@intrinsic
def _zeros(_typing, _number):
    """How many bits below the lowest one that is set."""

    def generate(_context, builder, _signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


@njit(**_options)
def _bits(key, columns, one, other):
    """Two words of 32 random bits for each column of the sensor."""
    for x in range(columns.size):
        bits = mix(key + u64(columns[x]) * STEP)
        one[x], other[x] = u32(bits), u32(bits >> u64(32))


@njit(**_options)
def _pair_bits(key, first, words):
    """A word of 32 random bits for each of two neighbours, from column 2 `first` on."""
    for i in range(words.size):
        words[i] = mix(key + u64(first + i) * STEP)


@njit(**_options)
def _coarse(words, normal, tukey, w, t, rare):
    """A number of either law for each pixel; `rare` says which of them lie in an outermost cell: 1 and 2."""
    for x in range(w.size):
        w[x] = normal[words[x] >> u32(32 - NORMAL_BITS)]
    for x in range(t.size):
        t[x] = tukey[words[x] & u32((1 << TUKEY_BITS) - 1)]
    for x in range(w.size):
        of_normal = u32(words[x] + EDGE) < TWO_EDGES  # wraps: the first and the last cells
        of_tukey = u32(u32(words[x] << u32(32 - TUKEY_BITS)) + EDGE) < TWO_EDGES
        rare[x] = np.uint8(of_normal) | (np.uint8(of_tukey) << np.uint8(1))


@njit(**_options)
def _tail(table, bits):
    """The quantile of a probability below 2^-RARE_BITS, at full precision."""
    p = max((f32(bits) + HALF) * f32(2.0 ** -(32 + RARE_BITS)), f32(2.0**-33))
    place = _float_bits(p)  # pyright: ignore[reportCallIssue]
    node = (place >> u32(FRACTION_BITS)) - u32(FIRST)
    return table[node, 0] + table[node, 1] * f32(i32(place & FRACTION))


@njit(**_options)
def _redraw_rare(key, first, rare, words, normal, tukey, w, t):
    """Numbers from the outermost cells, drawn anew within them: the law is a mixture, and its tails are exact."""
    eights = rare.view(np.uint64)
    for i in range(eights.size):
        left = eights[i]
        while left != u64(0):
            bit = _zeros(left)  # pyright: ignore[reportCallIssue]
            left &= left - u64(1)
            x = 8 * i + np.int64(bit >> u64(3))
            bits = mix(key + u64(first + x) * STEP)
            if bit & u64(1) == 0:
                value = _tail(normal, u32(bits))
                w[x] = value if words[x] >> u32(31) == 0 else -value
            else:
                value = _tail(tukey, u32(bits >> u64(32)))
                t[x] = value if (words[x] >> u32(TUKEY_BITS - 1)) & u32(1) == 0 else -value


@njit(**_options)
def _draw_coarse(key, first, pairs, rare, coarse, tukey_coarse, normal, tukey, w, t):
    """Both numbers of a row's pixels, from column `first` of the sensor on."""
    odd, width = first & 1, w.size
    used = pairs[: (width + odd + 1) // 2]
    _pair_bits(mix(key ^ PAIRS), first >> 1, used)
    words = used.view(np.uint32)[odd : odd + width]
    _coarse(words, coarse, tukey_coarse, w, t, rare[:width])
    _redraw_rare(mix(key ^ TAILS), first, rare[: (width + 7) // 8 * 8], words, normal, tukey, w, t)


@njit(**_options)
def _coarsened(table, out):
    """Quantiles at the middle of equally likely cells, from a table as in tables.py."""
    half = out.size // 2
    for i in range(half):
        p = (f32(i) + HALF) * f32(0.5) / f32(half)
        place = _float_bits(p)  # pyright: ignore[reportCallIssue]
        node = (place >> u32(FRACTION_BITS)) - u32(FIRST)
        value = table[node, 0] + table[node, 1] * f32(i32(place & FRACTION))
        out[i], out[out.size - 1 - i] = value, -value


@njit(**_options)
def _more_bits(seeds, one, other):
    """Two further words for each pixel, `seeds` being what `_bits` mixed."""
    for x in range(seeds.size):
        bits = mix(seeds[x] ^ OTHER)
        one[x], other[x] = u32(bits), u32(bits >> u64(32))


@njit(**_options)
def _places(bits, nodes, fractions):
    """Node of a table and fraction to the next one; see tables.py."""
    for x in range(bits.size):
        p = f32(i32(bits[x] & u32(0x7FFFFFFF))) * PER_BIT + HALF_BIT
        place = _float_bits(p)  # pyright: ignore[reportCallIssue]
        side = (bits[x] >> u32(31)) * u32(SIDE)
        nodes[x] = u32((place >> u32(FRACTION_BITS)) - u32(FIRST) + side)
        fractions[x] = f32(i32(place & FRACTION))


@njit(**_options)
def _look_up(table, nodes, fractions, out):
    for x in range(nodes.size):
        out[x] = table[nodes[x], 0] + table[nodes[x], 1] * fractions[x]


@njit(**_options)
def _light(source, one, gain, electrons, light):
    """Mean photo-electrons of each pixel; the least and the largest of them."""
    # bits of floats that are not negative order as the floats do; NaN comes last
    least, most = i32(0x7FFFFFFF), i32(0)
    for x in range(source.size):
        light[x] = max(source[x] * (electrons * (one + gain[x])), ZERO)
        bits = i32(_float_bits(light[x]))  # pyright: ignore[reportCallIssue]
        least, most = min(least, bits), max(most, bits)
    return _as_float(least), _as_float(most)  # pyright: ignore[reportCallIssue]


@njit(**_options)
def _count_apart(light, dark, faint, limit):
    """How many means are small, and how many of any size need their parts drawn apart."""
    small, apart = i32(0), i32(0)
    for x in range(light.size):
        m = light[x] + dark
        small += i32((m > faint) & (m < LARGE))
        apart += i32(_is_apart(m, faint, limit))
    return small, apart


@njit(inline="always")
def _is_apart(m, faint, limit):
    return (m > faint) & (m < LARGE) | (m > limit)


@njit(inline="always")
def _all_together(least, most, faint, limit):
    """Whether no mean between these is drawn apart."""
    return (least >= LARGE or most <= faint) and most <= limit


@njit(inline="always")
def _count(m, v, added, w, lattice):
    """Quantile of a count of mean m and variance m + v (+ added Gaussian variance) at the normal's quantile w."""
    variance = m + v + added
    s = math.sqrt(variance)
    r = ONE / s
    r2 = r * r
    w2 = w * w
    skew = (m + THREE * v) * r2
    curve = (m + SEVEN * v) * r2 * (w2 - THREE) - lattice
    bend = skew * skew * (TWO * w2 - FIVE)
    x = m + s * w + skew * (w2 - ONE) * SIXTH + r * w * (curve * PER_24 - bend * PER_36)
    return x + m * r2 * r2 * (GILES_0 + w2 * (GILES_2 + w2 * GILES_4))


@njit(**_options)
def _together(light, w, t, row_offset, offset, n, out):
    """Values in [0, 1] of pixels whose count and fixed patterns make one draw."""
    dark, prnu, sigma, added = n[DARK_E], n[PRNU_PIXEL], n[READ_SIGMA_E], n[GAUSSIAN_E] * n[GAUSSIAN_E]
    scale, black, top, less, per_dn = (
        n[DN_PER_E],
        n[OFFSET_DN] + HALF,
        n[MAX_DN],
        n[LESS_DN],
        n[PER_DN],
    )
    lattice, well = n[LATTICE], n[FULL_WELL_E] if n[LATTICE] > ZERO else f32(np.inf)
    for x in range(light.size):
        v = light[x] * prnu
        count = _count(light[x] + dark, v * v, added, w[x], lattice)
        count = min(np.floor(count + HALF), well) if lattice > ZERO else count
        e = count + (row_offset + offset[x]) + sigma * t[x]
        dn = min(max(np.floor(e * scale + black), ZERO), top)
        out[x] = min(max((dn - less) * per_dn, ZERO), ONE)


@njit(**_options)
def _entries(poisson, light, k, nodes, spare_bits, dark, prnu, places, entries):
    """The entry of the Poisson table for each pixel; a mean between two rows takes either, at random."""
    last = i32(poisson.size // (2 * SIDE) - 2)
    for x in range(nodes.size):
        mean = max(light[x] * (ONE + prnu * k[x]), ZERO) + dark
        row = min(i32(math.sqrt(mean) * PER_ROOT), last)
        low, high = f32(row * row), f32((row + i32(1)) * (row + i32(1)))
        spare = (f32(i32(spare_bits[x] & u32(1023))) + HALF) * PER_1024
        row += i32(mean * (PER_ROOT * PER_ROOT) - low > spare * (high - low))
        places[x] = u32(row * i32(2 * SIDE)) + nodes[x]
    for x in range(nodes.size):
        entries[x] = poisson[places[x]]


@njit(**_options)
def _apart(light, w, t, z, offset, nodes, fractions, entries, n, prnu, out):
    """Values in [0, 1] of pixels whose count is drawn as a whole number, on its own."""
    dark, sigma, well, deviation = n[DARK_E], n[READ_SIGMA_E], n[FULL_WELL_E], n[GAUSSIAN_E]
    hidden = n[PRNU_PIXEL] - prnu  # small means whose gain is not in the count have it in the Gaussian part
    scale, black, top, less, per_dn = (
        n[DN_PER_E],
        n[OFFSET_DN] + HALF,
        n[MAX_DN],
        n[LESS_DN],
        n[PER_DN],
    )
    for x in range(light.size):
        m = light[x] + dark
        v = light[x] * n[PRNU_PIXEL]
        many = np.floor(_count(max(m, LARGE), v * v, ZERO, w[x], ONE) + HALF)
        further = i32(fractions[x] > f32(entries[x] & THRESHOLD))
        few = f32((entries[x] >> i32(FRACTION_BITS + 1)) + (further if nodes[x] < u32(SIDE) else -further))
        more = light[x] * hidden if m < LARGE else ZERO
        count = min(max(few if m < LARGE else many, ZERO), well)
        e = count + math.sqrt(deviation * deviation + more * more) * z[x] + offset[x] + sigma * t[x]
        dn = min(max(np.floor(e * scale + black), ZERO), top)
        out[x] = min(max((dn - less) * per_dn, ZERO), ONE)


@njit(**_options)
def _take_apart(light, dark, faint, limit, apart, out):
    """Puts the values drawn apart where they belong."""
    for x in range(light.size):
        out[x] = apart[x] if _is_apart(light[x] + dark, faint, limit) else out[x]


@njit(**_options)
def _sum(one, row, maps, out):
    """One number of the row, one of each column, one of each pixel where a map is kept."""
    for x in range(out.size):
        out[x] = one + row[x]
    if maps.size:
        for x in range(out.size):
            out[x] += maps[x]


@njit(**_options)
def _draw_apart(seeds, light, w, t, offset, nodes, fractions, n, normal, poisson, words, floats, out):
    """`_apart` with the further random numbers that it takes; all arrays of pixels have one length."""
    size = seeds.size
    one, other, places, entries = (
        words[0, :size],
        words[1, :size],
        words[2, :size],
        words[3, :size].view(np.int32),
    )
    c, fraction, z, k = words[4, :size], floats[0, :size], floats[1, :size], floats[2, :size]
    prnu = n[PRNU_PIXEL] if n[LIMIT_E] < ZERO else ZERO
    z[:], k[:] = ZERO, ZERO
    _more_bits(seeds, one, other)
    if n[GAUSSIAN_E] > ZERO or n[PRNU_PIXEL] > ZERO:
        _places(one, c, fraction)
        _look_up(normal, c, fraction, z)
    if prnu > ZERO:
        _places(other, c, fraction)
        _look_up(normal, c, fraction, k)
    _entries(poisson, light, k, nodes, other, n[DARK_E], prnu, places, entries)
    _apart(light, w, t, z, offset, nodes, fractions, entries, n, prnu, out)


@njit(**_options)
def _draw_packed(count, seeds, nodes, floats, to, n, normal, poisson, words, more_floats, out):
    """The pixels that were put aside."""
    result = floats[5, :count]
    _draw_apart(
        seeds[:count], floats[0, :count], floats[1, :count], floats[2, :count], floats[3, :count], nodes[:count],
        floats[4, :count], n, normal, poisson, words, more_floats, result,
    )  # fmt: skip
    for j in range(count):
        out[to[j]] = result[j]


@njit(**_options)
def expose(
    images, out, first_row, last_row, channels, keys, numbers, row_gain, row_offset, column_gain, column_offset,
    gain_map, offset_map, coarse, normal, tukey, poisson, origin,
):  # fmt: skip
    """Rows [first_row, last_row) of all planes of a batch, one after another.

    Args:
        images, out: (B C, H, W) float32, in [0, 1].
        channels: C.
        keys: (B,) uint64, of the temporal noise.
        numbers: (B, NUMBERS) float32.
        row_gain, row_offset: (B C or C, H) float32, fractions and electrons; column_...: the same by columns.
        gain_map, offset_map: (C, H, W) float32, kept for all images; (C, H, 0) where nothing is kept.
        coarse: the normal's table of coarse.py; normal: (2 SIDE, 2); tukey: (B or 1, 2 SIDE, 2); poisson: flat.
        origin: row and column of the sensor at which the images begin.
    """
    _, height, width = images.shape
    flat = out.reshape(-1)
    columns = np.arange(origin[1], origin[1] + width).astype(np.int32)
    room = width + 1024
    words, floats = np.empty((10, room), np.uint32), np.empty((18, room), np.float32)
    pairs, rare = np.empty(room // 2 + 1, np.uint64), np.zeros(room // 8 * 8, np.uint8)
    tukey_coarse, tukey_image = np.empty(1 << TUKEY_BITS, np.float32), -1
    one, other, a, b = words[0, :width], words[1, :width], words[2, :width], words[3, :width]
    fa, fb, w, t = floats[0, :width], floats[1, :width], floats[2, :width], floats[3, :width]
    gains, offsets, light, result = floats[4, :width], floats[5, :width], floats[6, :width], floats[7, :width]
    aside, aside_a, packed, aside_image = 0, words[4], floats[8:14], 0
    seeds, to = np.empty(room, np.uint64), np.empty(room, np.int64)
    row_seeds = np.empty(width, np.uint64)
    w[:] = ZERO
    for number in range(first_row, last_row):
        plane, y = number // height, number % height
        image, channel = plane // channels, plane % channels
        own = plane if len(row_gain) > channels else channel  # patterns drawn for each image, or kept
        of_image = image if len(tukey) > 1 else 0
        if aside > 0 and (image != aside_image or aside + width > room):
            _draw_packed(
                aside, seeds, aside_a, packed, to, numbers[aside_image], normal, poisson, words[5:], floats[14:], flat
            )  # fmt: skip
            aside = 0
        n, source, target = numbers[image], images[plane, y], out[plane, y]
        key = mix(mix(keys[image] + u64(channel) * STEP) + u64(y + origin[0]))
        gain, offset = column_gain[own], column_offset[own]
        gain_1, offset_1 = row_gain[own, y], row_offset[own, y]
        if gain_map.size:
            _sum(gain_1, gain, gain_map[channel, y], gains)
            gain, gain_1 = gains, ZERO
        if offset_map.size:
            _sum(offset_1, offset, offset_map[channel, y], offsets)
            offset, offset_1 = offsets, ZERO
        least, most = _light(source, ONE + gain_1, gain, n[ELECTRONS], light)  # pyright: ignore[reportGeneralTypeIssues]
        small, apart = 0, 0
        if not _all_together(least + n[DARK_E], most + n[DARK_E], n[FAINT_E], n[LIMIT_E]):
            small, apart = _count_apart(light, n[DARK_E], n[FAINT_E], n[LIMIT_E])
        if n[COARSE] > ZERO and apart < width:
            if of_image != tukey_image:
                _coarsened(tukey[of_image], tukey_coarse)
                tukey_image = of_image
            _draw_coarse(key, origin[1], pairs, rare, coarse, tukey_coarse, normal, tukey[of_image], w, t)
            _together(light, w, t, offset_1, offset, n, target)
            if apart == 0:
                continue
        _bits(key, columns, one, other)
        _places(one, a, fa)
        _places(other, b, fb)
        _look_up(tukey[of_image], b, fb, t)
        if small < width:
            _look_up(normal, a, fa, w)
        if n[COARSE] == ZERO and apart < width:
            _together(light, w, t, offset_1, offset, n, target)
        if apart == 0:
            continue
        _sum(offset_1, offset, offset[:0], offsets)
        offset = offsets
        if apart > width // 8:
            for x in range(width):
                row_seeds[x] = key + u64(columns[x]) * STEP
            _draw_apart(
                row_seeds, light, w, t, offset, a, fa, n, normal, poisson, words[5:], floats[14:],
                target if apart == width else result,
            )  # fmt: skip
            if apart < width:
                _take_apart(light, n[DARK_E], n[FAINT_E], n[LIMIT_E], result, target)
            continue
        aside_image = image
        for x in range(width):  # put aside, so that their further steps run over long arrays too
            if _is_apart(light[x] + n[DARK_E], n[FAINT_E], n[LIMIT_E]):
                seeds[aside] = key + u64(columns[x]) * STEP
                to[aside], aside_a[aside] = number * width + x, a[x]
                packed[0, aside], packed[1, aside], packed[2, aside] = light[x], w[x], t[x]
                packed[3, aside], packed[4, aside] = offset[x], fa[x]
                aside += 1
    if aside > 0:
        _draw_packed(
            aside, seeds, aside_a, packed, to, numbers[aside_image], normal, poisson, words[5:], floats[14:], flat
        )  # fmt: skip
