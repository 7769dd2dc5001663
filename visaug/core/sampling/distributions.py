"""Quantile functions in torch: a number of the wanted law from 32 random bits, differentiable in the law's parameters."""

import torch
from torch import Tensor

from visaug.core.sampling.tukey_lambda import quantile_of_tail

# of a Poisson count; a larger mean counts as this one. No converter's range is left above it
MOST_MEAN = 1e20


def tail(bits: Tensor) -> tuple[Tensor, Tensor]:
    """Probability of the nearer tail, in (0, 0.5], and its side (-1 or 1), from int64 bits in [0, 2^32), as float64."""
    upper = bits >= 2**31
    p = (torch.where(upper, 2**32 - 1 - bits, bits).double() + 0.5) * 2.0**-32
    return p, torch.where(upper, 1.0, -1.0).double()


def uniform(bits: Tensor) -> Tensor:
    """Uniform in (0, 1), float32: 24 bits, so that neither end is ever met."""
    return ((bits >> 8).float() + 0.5) * 2.0**-24


def normal(bits: Tensor) -> Tensor:
    """Standard normal, float32, tails to 6.2 standard deviations."""
    p, side = tail(bits)
    return (-side * torch.special.ndtri(p)).float()


def tukey_lambda(bits: Tensor, shape: Tensor) -> Tensor:
    """Tukey-lambda of scale 1, float32; see `visaug.core.sampling.tukey_lambda`."""
    return quantile_of_tail(*tail(bits), shape)


def poisson(mean: Tensor, bits: Tensor) -> Tensor:
    """Poisson count by its quantile function, float32, in the shape of `mean`.

    A mean above MOST_MEAN counts as that. Below small_mean the distribution function is summed. Above it, the expansion Q_N2 of M.
    Giles, "Approximation of the inverse Poisson cumulative distribution function", ACM TOMS 42 (2016) 7, eq. 2.8, rounded down.
    """
    rate = mean.double().clamp(0, MOST_MEAN)
    p, side = tail(bits)
    u = torch.where(side < 0, p, 1 - p)
    small_mean = 25.0  # below it the Poisson quantile is summed exactly, above it Giles' expansion has both far tails right
    small = rate.clamp_max(small_mean)
    term = torch.exp(-small)
    total, count = term, torch.zeros_like(small)
    for n in range(1, 84):
        count = count + (u > total)
        term = term * (small / n)
        total = total + term
    w = -side * torch.special.ndtri(p)
    large = rate.clamp_min(small_mean)
    root = large.sqrt()
    x = large + root * w + (1 / 3 + w**2 / 6) - (w / 36 + w**3 / 72) / root
    x = x + (-8 / 405 + w**2 * (7 / 810 + w**2 / 270)) / large
    return torch.where(rate < small_mean, count, x.floor().clamp_min(0)).float()
