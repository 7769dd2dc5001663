"""Random numbers by name: each purpose of each frame has a stream of its own.

Two simulations that differ in one effect then share every other random number, so their difference is the
effect.
"""

from __future__ import annotations

import zlib

import numpy as np
from scipy.special import gammaln


def stream(seed: int, *purpose: str | int) -> np.random.Generator:
    """Return the generator that belongs to a purpose; the same arguments give the same numbers."""
    words = [zlib.crc32(str(word).encode()) for word in purpose]
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence([seed, *words])))


def tukey_lambda_std(lam: float) -> float:
    """Standard deviation of Q(u) = (u^lam - (1-u)^lam) / lam (Joiner & Rosenblatt 1971); lam > -1/2."""
    if abs(lam) < 1e-6:
        return float(np.pi / np.sqrt(3))
    beta = np.exp(2 * gammaln(lam + 1) - gammaln(2 * lam + 2))
    return float(np.sqrt(2 / lam**2 * (1 / (2 * lam + 1) - beta)))


def tukey_lambda(rng: np.random.Generator, lam: float, sigma: float, shape: tuple[int, ...]) -> np.ndarray:
    """Draw Tukey-lambda noise whose standard deviation, not whose scale, is sigma."""
    u = np.clip(rng.random(shape), 1e-12, 1 - 1e-12)
    if abs(lam) < 1e-6:
        draw = np.log(u / (1 - u))
    else:
        draw = (u**lam - (1 - u) ** lam) / lam
    return draw * (sigma / tukey_lambda_std(lam))


def coloured(rng: np.random.Generator, length: int, exponent: float) -> np.ndarray:
    """Draw a series with power spectrum f^-exponent, unit standard deviation, no mean."""
    frequency = np.fft.rfftfreq(length)
    amplitude = np.zeros_like(frequency)
    amplitude[1:] = frequency[1:] ** (-exponent / 2)
    spectrum = amplitude * (rng.standard_normal(frequency.size) + 1j * rng.standard_normal(frequency.size))
    series = np.fft.irfft(spectrum, length)
    expected = np.sqrt(4 * np.sum(amplitude**2)) / length
    return series / expected
