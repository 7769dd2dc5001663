"""Tukey's lambda distribution on a grid: density and characteristic function at standard deviation 1."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from visaug.core.intervals import Interval
from visaug.core.sampling.tukey_lambda import GAUSSIAN_SHAPE, quantile, standard_deviation
from visaug.effects.readout.read_noise import LEAST_SHAPE

SHAPE_BOUNDS = (LEAST_SHAPE, 0.6)
_STEP = 1 / 64
_REACH = 128.0


@dataclass(frozen=True)
class Standard:
    """The distribution at standard deviation 1: `x` grid, distribution function there, characteristic function."""

    x: np.ndarray
    distribution: np.ndarray
    characteristic: CubicSpline

    def phi(self, t: np.ndarray) -> np.ndarray:
        """Characteristic function (real, the law is symmetric) at angular frequencies t."""
        t = np.abs(t)
        return np.where(t < self.characteristic.x[-1], self.characteristic(t), 0.0)


def law(shape: float) -> Standard:
    """Tables for a shape, rounded so that neighbours share them; for nan those of the normal law."""
    return _normal() if math.isnan(shape) else standard(round(float(shape), 5))


@lru_cache(maxsize=1)
def _normal() -> Standard:
    x = np.arange(-_REACH, _REACH, _STEP)
    nodes = np.linspace(0.0, 12.0, 4001)
    return Standard(x, ndtr(x), CubicSpline(nodes, np.exp(-0.5 * nodes**2)))


def hold_both_gaussians(interval: Interval) -> Interval:
    """Interval of a shape that holds every shape that stands for a normal law, if it holds one of them.
    No Tukey-lambda law is normal; which is nearest depends on the criterion: 0.1345 by likelihood, 0.14 by the
    correlation of quantiles.
    """
    value, low, high = interval
    likeliest_gaussian = 0.1345  # the same by likelihood
    if low > GAUSSIAN_SHAPE or high < likeliest_gaussian:
        return interval
    return value, min(low, likeliest_gaussian), max(high, GAUSSIAN_SHAPE)


@lru_cache(maxsize=256)
def standard(shape: float) -> Standard:
    """Tables for one shape."""
    logit = np.concatenate([np.linspace(-60, -8, 400, endpoint=False), np.linspace(-8, 8, 1601),
                            np.linspace(8, 60, 401)[1:]])  # fmt: skip
    u, v = 1 / (1 + np.exp(-logit)), 1 / (1 + np.exp(logit))
    q = quantile(u, v, shape) / standard_deviation(shape)
    x = np.arange(-_REACH, _REACH, _STEP)
    tail = np.minimum(u, v)
    # Tails are straight in logarithms: interpolate the smaller tail there.
    keep = np.concatenate([[True], np.diff(q) > 0])
    log_tail = np.interp(-np.abs(x), q[keep & (q <= 0)], np.log(tail[keep & (q <= 0)]), left=-700.0)
    lower = np.exp(log_tail)
    distribution = np.where(x <= 0, lower, 1 - lower)
    # So is the density there. A straight line in place of it is half a percent too high, which hundreds of frames tell.
    density = np.maximum(1 / (u ** (shape - 1) + v ** (shape - 1)), 1e-300)
    log_density = np.log(density * standard_deviation(shape))
    density = np.exp(np.interp(x, q[keep], log_density[keep], left=-700.0, right=-700.0))
    density /= density.sum() * _STEP
    finer = 4  # nodes of the characteristic function: its powers of n show every kink of a coarser spline
    padded = np.zeros(finer * x.size)
    padded[: x.size] = density
    spectrum = np.fft.rfft(np.roll(padded, -x.size // 2)).real * _STEP
    nodes = np.arange(spectrum.size) * 2 * np.pi / (2 * _REACH * finer)
    return Standard(x, distribution, CubicSpline(nodes, spectrum))
