"""The generator and quantiles of `philox.py` and `distributions.py` as numba loops for the CPU.

They are some hundred times as fast as eager torch operators: each step runs over a row of pixels and has no branch, so that the
processor takes many pixels at once; logarithm and exponential are float32 polynomials for the same reason. Everything falls
back on torch where numba cannot be imported.
"""

import hashlib
import math
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import config, njit, types
from numba.extending import intrinsic

f32, f64, i32, u32, u64 = np.float32, np.float64, np.int32, np.uint32, np.uint64
MOST_MEAN, SMALL_MEAN = f32(1e20), f32(25)  # as in distributions.py
PER_BIT = f32(2.0**-32)
ZERO, HALF, ONE, TWO = f32(0), f32(0.5), f32(1), f32(2)
THIRD, SIXTH, PER_36, PER_72 = f32(1 / 3), f32(1 / 6), f32(1 / 36), f32(1 / 72)
GILES_0, GILES_2, GILES_4 = f32(-8 / 405), f32(7 / 810), f32(1 / 270)
LOG_2_PER_EXPONENT, PER_LOG_2 = f32(math.log(2) * 2.0**-23), f32(1 / math.log(2))
LOG_2_HIGH, LOG_2_LOW = f32(0.693359375), f32(-2.12194440e-4)  # their sum is log 2; the first has few digits

settings: Any = config  # numba's own
OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "no_cfunc_wrapper": True,
    "error_model": "numpy",
    "fastmath": {"contract", "nsz"},
}


@cache
def _folder() -> str:
    text = hashlib.blake2b(Path(__file__).read_bytes(), digest_size=8).hexdigest()
    own = Path(__file__).parent / "__pycache__"
    usable = own if os.access(own.parent, os.W_OK) else Path.home() / ".cache" / "visaug"
    return str(Path(settings.CACHE_DIR or usable) / f"kernels-{text}")


def compiled(function: Callable[..., Any]) -> Any:
    """The function compiled when it is first called, and kept on disk.

    numba recompiles a function when the text of its own file changes. Other files take functions and constants from this one,
    so the folder is named after its text: such files may import nothing else of visaug.
    """
    before, settings.CACHE_DIR = settings.CACHE_DIR, _folder()
    try:
        return njit(**OPTIONS)(function)
    finally:
        settings.CACHE_DIR = before


def part(function: Callable[..., Any]) -> Any:
    """A function that compiled ones alone call: neither kept on its own nor callable from Python, which halves its compilation."""
    options: dict[str, Any] = {"cache": False, "no_cpython_wrapper": True}
    return njit(**OPTIONS | options)(function)


@intrinsic
def float_bits(_typing, _number):
    """The bits of a float32."""

    def generate(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(32))

    return types.int32(types.float32), generate


@intrinsic
def as_float(_typing, _number):
    """The float32 of these bits."""

    def generate(_context, builder, _signature, arguments):
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), generate


@intrinsic
def scramble(_typing, _word, _shift, _factor, _more):
    """(word ^ (word >> shift)) factor + more, of 32 bits each. numba itself would count with 64, at a quarter of the speed."""

    def generate(_context, builder, _signature, arguments):
        word, shift, factor, more = arguments
        mixed = builder.xor(word, builder.lshr(word, shift))
        return builder.add(builder.mul(mixed, factor), more)

    return types.uint32(types.uint32, types.uint32, types.uint32, types.uint32), generate


@njit(inline="always")
def log(x):
    """Natural logarithm of a positive float32, within 1e-7 of it or of 1 (Cephes, logf)."""
    bits = float_bits(x)  # pyrefly: ignore[missing-argument]
    # times 2^23, so that the rest lies within a factor sqrt(2) of 1
    exponent = i32(bits - i32(0x3F3504F3)) & i32(-(2**23))
    t = as_float(i32(bits - i32(exponent))) - ONE  # pyrefly: ignore[missing-argument]
    p = f32(7.0376836292e-2) * t + f32(-1.1514610310e-1)
    p = ((p * t + f32(1.1676998740e-1)) * t + f32(-1.2420140846e-1)) * t + f32(1.4249322787e-1)
    p = ((p * t + f32(-1.6668057665e-1)) * t + f32(2.0000714765e-1)) * t + f32(-2.4999993993e-1)
    p = p * t + f32(3.3333331174e-1)
    return t + (t * t) * (t * p - HALF) + f32(i32(exponent)) * LOG_2_PER_EXPONENT


@njit(inline="always")
def expm1(x):
    """exp(x) - 1 of a float32 from -80 to 80, within 2e-7 of it or of exp(x) (Cephes, expf)."""
    n = np.floor(x * PER_LOG_2 + HALF)
    r = x - n * LOG_2_HIGH - n * LOG_2_LOW
    p = (f32(1.9875691500e-4) * r + f32(1.3981999507e-3)) * r + f32(8.3334519073e-3)
    p = ((p * r + f32(4.1665795894e-2)) * r + f32(1.6666665459e-1)) * r + f32(5.0000001201e-1)
    power = as_float((i32(n) + i32(127)) << i32(23))  # pyrefly: ignore[missing-argument]
    return power * (r * r * p + r) + (power - ONE)


@njit(inline="always")
def tail(word):
    """Probability of the nearer tail, in (0, 1/2], of 32 random bits; it is the upper one where the first bit is set."""
    nearer = i32(word) ^ (i32(word) >> i32(31))
    return (f32(nearer) + HALF) * PER_BIT


@njit(inline="always")
def sided(word, lower):
    """A quantile in the lower tail, or its mirror image where the first bit is set."""
    return -lower if i32(word) < i32(0) else lower


@njit(inline="always")
def normal(word):
    """Standard normal quantile, Wichura's AS 241 (PPND7, relative error 1e-7)."""
    p = tail(word)
    q = HALF - p
    near = q <= f32(0.425)
    a = f32(0.180625) - q * q
    b = math.sqrt(-log(p)) - f32(1.6)
    top_a = ((f32(59.109374720) * a + f32(159.29113202)) * a + f32(50.434271938)) * a + f32(3.3871327179)
    low_a = ((f32(67.187563600) * a + f32(78.757757664)) * a + f32(17.895169469)) * a + ONE
    top_b = ((f32(0.17023821103) * b + f32(1.3067284816)) * b + f32(2.7568153900)) * b + f32(1.4234372777)
    low_b = (f32(0.12021132975) * b + f32(0.73700164250)) * b + ONE
    return sided(word, -(q * top_a if near else top_b) / (low_a if near else low_b))


@njit(inline="always")
def tukey(word, shape, factor):
    """Tukey-lambda quantile times a scale; factor: scale / shape, and a shape of 0 is to be given as 1e-6."""
    p = tail(word)
    return sided(word, factor * (expm1(shape * log(p)) - expm1(shape * log(ONE - p))))


@njit(inline="always")
def mix(x):
    """The same as in philox.py, of one number."""
    x = (x ^ (x >> u64(30))) * u64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> u64(27))) * u64(0x94D049BB133111EB)
    return x ^ (x >> u64(31))


@njit(inline="always")
def _philox(first, row, channel, key, out):
    """Philox-4x32-10 for the counters (first + i, row, channel, 0): word j of counter i in out[j, i]."""
    m0, m1 = u64(0xD2511F53), u64(0xCD9E8D57)
    mask, half = u64(0xFFFFFFFF), u64(32)
    a, b, c, d = out[0], out[1], out[2], out[3]
    for i in range(a.size):
        c0, c1, c2, c3 = u64(first + i), u64(row), u64(channel), u64(0)
        k0, k1 = key & mask, key >> half
        for _ in range(10):
            p0, p1 = c0 * m0, c2 * m1
            c0, c1, c2, c3 = (p1 >> half) ^ c1 ^ k0, p1 & mask, (p0 >> half) ^ c3 ^ k1, p0 & mask
            k0 = (k0 + u64(0x9E3779B9)) & mask
            k1 = (k1 + u64(0xBB67AE85)) & mask
        a[i], b[i], c[i], d[i] = u32(c0), u32(c1), u32(c2), u32(c3)


@part
def words_of_rows(key, channel, row, first, rows, width, words):
    """32 random bits for each pixel of a window that begins at `row` and column `first`; the counter is the place on the sensor.

    They are written to `words`, (rows width + 3,) uint32; the last three mean nothing.
    """
    before = first % 4  # pixels to the left that share the first counter
    blocks = (before + width + 3) // 4
    lanes = np.empty((4, blocks), np.uint32)
    for r in range(rows):
        _philox(first // 4, row + r, channel, key, lanes)
        start = r * width - before
        for j in range(before, 4):
            words[start + j] = lanes[j, 0]
        for i in range(1, blocks):  # the last may write over the row's end: the next row follows
            for j in range(4):
                words[start + 4 * i + j] = lanes[j, i]


@part
def normals(words, out):
    for i in range(out.size):
        out[i] = normal(words[i])


@part
def tukeys(words, shape, scale, out):
    """Tukey-lambda numbers times a scale."""
    shape = f32(1e-6) if abs(shape) < f32(1e-6) else shape
    factor = scale / shape
    for i in range(out.size):
        out[i] = tukey(words[i], shape, factor)


@part
def _many(mean, words, out):
    """Poisson counts of means from SMALL_MEAN on: Giles' expansion (see distributions.py)."""
    normals(words, out)
    for i in range(out.size):
        m, w = min(max(mean[i], SMALL_MEAN), MOST_MEAN), out[i]
        root, w2 = math.sqrt(m), w * w
        inverse, whole = ONE / root, np.floor(m)
        x = root * w + (THIRD + w2 * SIXTH) - w * (PER_36 + w2 * PER_72) * inverse
        x += (GILES_0 + w2 * (GILES_2 + w2 * GILES_4)) * inverse * inverse
        # apart, so that a large mean does not round the rest
        out[i] = max(ZERO, whole + np.floor((m - whole) + x))


@njit(inline="always")
def _exp(x):
    """exp(x) of a float64 from -25 to 0."""
    r = x * (1 / 64)
    p = 1.0
    for k in (12.0, 11.0, 10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0):
        p = 1.0 + r * (1 / k) * p
    for _ in range(6):
        p = p * p
    return p


@part
def _few(mean, words, term, total, u, out):
    """Poisson counts of means up to SMALL_MEAN, by summing the distribution function; float64 keeps the upper tail."""
    for i in range(out.size):
        p = f64(tail(words[i]))
        u[i] = 1.0 - p if i32(words[i]) < i32(0) else p
        term[i] = _exp(-f64(max(mean[i], ZERO)))
        total[i], out[i] = term[i], ZERO
    left, n = 1, 0
    while left > 0 and n < 128:
        n += 1
        left, per_n = 0, 1.0 / n
        for i in range(out.size):
            beyond = u[i] > total[i]
            left += i32(beyond)
            out[i] += f32(beyond)
            term[i] *= f64(mean[i]) * per_n
            total[i] += term[i]


@njit(inline="always")
def room_of(width):
    """What `counts` needs for its small means."""
    return np.empty(width, np.uint32), np.empty((2, width), np.float32), np.empty((3, width))


@part
def counts(mean, words, room, out):
    """Poisson counts of a row of pixels; room: of `room_of`."""
    small, lit = i32(0), i32(0)
    for i in range(out.size):
        small += i32(not mean[i] >= SMALL_MEAN)
        lit += i32(mean[i] > ZERO)
    if small < out.size:
        _many(mean, words, out)
    elif lit == 0:
        out[:] = ZERO
        return
    if small == 0:
        return
    own, floats, sums = room
    n = 0
    for i in range(out.size):
        if not mean[i] >= SMALL_MEAN:
            own[n], floats[0, n] = words[i], mean[i] if mean[i] > ZERO else ZERO
            n += 1
    _few(floats[0, :n], own[:n], sums[0, :n], sums[1, :n], sums[2, :n], floats[1, :n])
    n = 0
    for i in range(out.size):
        if not mean[i] >= SMALL_MEAN:
            out[i] = floats[1, n]
            n += 1


@compiled
def forked(keys, names):
    """The keys of `Stream.fork` for one name after another, (B,) uint64."""
    out = np.empty(len(keys), np.uint64)
    for i in range(len(keys)):
        key = keys[i]
        for name in names:
            key = mix(key ^ name)
        out[i] = key
    return out


@njit(inline="always")
def rows_at_once(width):
    """Rows of a width that are worked on together: few enough to stay in the processor's cache, many enough for long loops."""
    return max(1, 2048 // width)


@part
def _blocks(shape):
    """Image, channel, first and last row of the blocks of a batch, (N, 4)."""
    batch, channels, rows, width = shape
    step = rows_at_once(width)
    per_plane = (rows + step - 1) // step
    out = np.empty((batch * channels * per_plane, 4), np.int64)
    for i in range(len(out)):
        plane, r = i // per_plane, i % per_plane * step
        out[i] = plane // channels, plane % channels, r, min(rows, r + step)
    return out


@compiled
def fill_bits(keys, r0, c0, out):
    """32 random bits for each pixel of windows (B, C, H, W) that begin at a row and a column of the sensor."""
    width = out.shape[3]
    words = np.empty(rows_at_once(width) * width + 3, np.uint32)
    for b, channel, r, end in _blocks(out.shape):
        words_of_rows(keys[b], channel, r0 + r, c0, end - r, width, words)
        out[b, channel, r:end] = words[: (end - r) * width].reshape(end - r, width)


@compiled
def fill_normal(keys, r0, c0, out):
    width = out.shape[3]
    words = np.empty(rows_at_once(width) * width + 3, np.uint32)
    for b, channel, r, end in _blocks(out.shape):
        words_of_rows(keys[b], channel, r0 + r, c0, end - r, width, words)
        normals(words, out[b, channel, r:end].reshape(-1))


@compiled
def fill_tukey(keys, r0, c0, shapes, scales, out):
    width = out.shape[3]
    words = np.empty(rows_at_once(width) * width + 3, np.uint32)
    for b, channel, r, end in _blocks(out.shape):
        words_of_rows(keys[b], channel, r0 + r, c0, end - r, width, words)
        tukeys(words, f32(shapes[b]), f32(scales[b]), out[b, channel, r:end].reshape(-1))


@compiled
def fill_poisson(keys, r0, c0, mean, out):
    width = out.shape[3]
    size = rows_at_once(width) * width
    words, room = np.empty(size + 3, np.uint32), room_of(size)
    for b, channel, r, end in _blocks(out.shape):
        words_of_rows(keys[b], channel, r0 + r, c0, end - r, width, words)
        own = np.ascontiguousarray(mean[b, channel, r:end]).reshape(-1)
        counts(own, words, room, out[b, channel, r:end].reshape(-1))
