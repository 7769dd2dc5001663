"""Random numbers and grids that several effects need."""

from __future__ import annotations

import numpy as np


def poisson(rng: np.random.Generator, mean: np.ndarray) -> np.ndarray:
    """Whole electrons of a mean, which counts as zero where it is negative."""
    return rng.poisson(np.maximum(mean, 0)).astype(float)


def wander(rng: np.random.Generator, length: int, tau: float) -> np.ndarray:
    """An Ornstein-Uhlenbeck series of unit standard deviation with a memory of `tau` steps."""
    keeps = np.exp(-1 / tau)
    series = np.empty(length)
    series[0] = rng.normal()
    for i in range(1, length):
        series[i] = keeps * series[i - 1] + (1 - keeps * keeps) ** 0.5 * rng.normal()
    return series


def grid(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Row and column number of every pixel."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    return y, x


def radius(reach: int) -> np.ndarray:
    """Distance from the centre of a square kernel of 2 `reach` + 1 pixels."""
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(float)
    return np.hypot(y, x)
