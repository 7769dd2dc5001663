"""Philox-4x32-10, the counter-based generator of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (SC'11).

A number is a pure function of (key, counter). Here the counter is the place on the sensor, so the same camera always has the
same fixed pattern, a crop of the sensor gets the crop of the pattern, and a batch equals its images one by one, on every device.
Two implementations of the same function: torch operators (any device, `torch.compile`) and numba in `kernels.py` (CPU).
"""

import torch
from torch import Tensor

MASK = 0xFFFFFFFF


def philox(counter: tuple[Tensor, Tensor, Tensor, Tensor], key: tuple[Tensor, Tensor]) -> tuple[Tensor, ...]:
    """Four words of 32 random bits for each counter; all are broadcastable int64 tensors that hold unsigned 32-bit words."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    m0, m1 = 0xD2511F53, 0xCD9E8D57
    w0, w1 = 0x9E3779B9, 0xBB67AE85
    for _ in range(10):
        p0 = c0 * m0  # an unsigned 64-bit product; int64 wraps to the same bits
        p1 = c2 * m1
        c0, c1, c2, c3 = ((p1 >> 32) & MASK) ^ c1 ^ k0, p1 & MASK, ((p0 >> 32) & MASK) ^ c3 ^ k1, p0 & MASK
        k0 = (k0 + w0) & MASK
        k1 = (k1 + w1) & MASK
    return c0, c1, c2, c3


def sensor_bits(keys: Tensor, channels: int, rows: range, columns: range) -> Tensor:
    """32 random bits for each pixel of a window of the sensor, (B, C, H, W) int64 in [0, 2^32); `keys` (B,) int64, one an image.

    Four neighbours in a row share one counter.
    """
    device = keys.device
    first = columns.start // 4
    blocks = torch.arange(first, (columns.stop + 3) // 4, device=device).view(1, 1, 1, -1)
    row = torch.arange(rows.start, rows.stop, device=device).view(1, 1, -1, 1)
    channel = torch.arange(channels, device=device).view(1, -1, 1, 1)
    key = ((keys & MASK).view(-1, 1, 1, 1), ((keys >> 32) & MASK).view(-1, 1, 1, 1))
    words = philox((blocks, row, channel, torch.zeros_like(row)), key)
    shape = (keys.numel(), channels, len(rows), blocks.numel())
    interleaved = torch.stack([word.expand(shape) for word in words], dim=-1).flatten(-2)
    offset = columns.start - 4 * first
    return interleaved[..., offset : offset + len(columns)]


def mix(keys: Tensor) -> Tensor:
    """Another 64-bit key for each int64 key, one to one: the finaliser of SplitMix64, variant 13 of D. Stafford."""
    x = keys ^ _shift(keys, 30)
    x = x * (0xBF58476D1CE4E5B9 - 2**64)
    x = x ^ _shift(x, 27)
    x = x * (0x94D049BB133111EB - 2**64)
    return x ^ _shift(x, 31)


def _shift(x: Tensor, bits: int) -> Tensor:
    """To the right without the sign."""
    return (x >> bits) & (2 ** (64 - bits) - 1)
