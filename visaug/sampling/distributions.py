"""Quantile functions in torch: a number of the wanted law from 32 random bits, differentiable in the law's parameters."""

import math

import torch
from torch import Tensor

SMALL_MEAN = 25.0  # below it the Poisson quantile is summed exactly, above it Giles' expansion has both far tails right

MOST_MEAN = (
    1e20  # of a Poisson count; a larger mean counts as this one. No converter's range is left above it
)

ZETA_3 = 1.2020569031595943  # Apery's constant


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


def tukey_standard_deviation(shape: Tensor) -> Tensor:
    """Standard deviation of Tukey's lambda distribution of scale 1; finite for shape > -0.5.

    var = 2/L^2 [1/(1 + 2L) - Gamma(L + 1)^2 / Gamma(2L + 2)]; near L = 0, where the logistic's is pi^2/3, a straight line.
    Source: Joiner and Rosenblatt, J. Am. Stat. Assoc. 66 (1971) 394.
    """
    shape = shape.double()
    near = shape.abs() < 1e-4
    safe = torch.where(near, torch.full_like(shape, 1e-4), shape)
    ratio = torch.exp(2 * torch.lgamma(safe + 1) - torch.lgamma(2 * safe + 2))
    variance = 2 / safe**2 * (1 / (1 + 2 * safe) - ratio)
    line = math.pi**2 / 3 - (2 * math.pi**2 / 3 + 4 * ZETA_3) * shape
    return torch.sqrt(torch.where(near, line, variance))


def tukey_lambda(bits: Tensor, shape: Tensor) -> Tensor:
    """Tukey-lambda of scale 1 by its quantile function Q(u) = (u^L - (1-u)^L) / L, float32."""
    p, side = tail(bits)
    shape = shape.double()
    near = shape.abs() < 1e-6
    safe = torch.where(near, torch.full_like(shape, 1e-6), shape)
    upper, lower = torch.log1p(-p), torch.log(p)
    quantile = (torch.exp(safe * upper) - torch.exp(safe * lower)) / safe
    line = upper - lower + shape / 2 * (upper**2 - lower**2)
    return (side * torch.where(near, line, quantile)).float()


def poisson(mean: Tensor, bits: Tensor) -> Tensor:
    """Poisson count by its quantile function, float32, in the shape of `mean`.

    A mean above MOST_MEAN counts as that.
    Below SMALL_MEAN the distribution function is summed. Above it, the expansion Q_N2 of M. Giles, "Approximation of the
    inverse Poisson cumulative distribution function", ACM TOMS 42 (2016) 7, eq. 2.8, rounded down.
    """
    rate = mean.double().clamp(0, MOST_MEAN)
    p, side = tail(bits)
    u = torch.where(side < 0, p, 1 - p)
    small = rate.clamp_max(SMALL_MEAN)
    term = torch.exp(-small)
    total, count = term, torch.zeros_like(small)
    for n in range(1, 84):
        count = count + (u > total)
        term = term * (small / n)
        total = total + term
    w = -side * torch.special.ndtri(p)
    large = rate.clamp_min(SMALL_MEAN)
    root = large.sqrt()
    x = large + root * w + (1 / 3 + w**2 / 6) - (w / 36 + w**3 / 72) / root
    x = x + (-8 / 405 + w**2 * (7 / 810 + w**2 / 270)) / large
    return torch.where(rate < SMALL_MEAN, count, x.floor().clamp_min(0)).float()
