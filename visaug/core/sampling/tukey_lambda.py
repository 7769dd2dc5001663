"""Tukey's lambda distribution: quantile function and standard deviation, in NumPy and in torch.

With scale 1 the quantile function is Q(u) = (u^L - (1 - u)^L) / L. The distribution is logistic at shape L = 0, close to normal at
0.14, and its variance 2/L^2 [1/(1 + 2L) - Gamma(L + 1)^2 / Gamma(2L + 2)] is finite for L > -0.5.
Source: Joiner and Rosenblatt, J. Am. Stat. Assoc. 66 (1971) 394.
"""

import math
from typing import overload

import numpy as np
import torch
from scipy.special import gammaln
from torch import Tensor

GAUSSIAN_SHAPE = 0.14  # nearest to a normal law by the correlation of quantiles
NEAR_ZERO = 1e-4  # below it the variance loses digits to cancellation; its tangent at 0 is then exact to 1e-7
VARIANCE_AT_ZERO = math.pi**2 / 3
SLOPE_AT_ZERO = -(2 * math.pi**2 / 3 + 4 * 1.2020569031595943)  # with Apery's constant, zeta(3)


@overload
def standard_deviation(shape: float) -> float: ...
@overload
def standard_deviation(shape: np.ndarray) -> np.ndarray: ...
def standard_deviation(shape):
    """Standard deviation at scale 1, for shapes above -0.5.

    >>> round(standard_deviation(0.0), 4)  # of the logistic distribution, pi / sqrt(3)
    1.8138
    """
    shapes = np.asarray(shape, np.float64)
    near = np.abs(shapes) < NEAR_ZERO
    safe = np.where(near, NEAR_ZERO, shapes)
    ratio = np.exp(2 * gammaln(safe + 1) - gammaln(2 * safe + 2))
    variance = 2 / safe**2 * (1 / (1 + 2 * safe) - ratio)
    deviation = np.sqrt(np.where(near, VARIANCE_AT_ZERO + SLOPE_AT_ZERO * shapes, variance))
    return deviation if isinstance(shape, np.ndarray) else float(deviation)


def quantile(u: np.ndarray, v: np.ndarray, shape: float) -> np.ndarray:
    """Quantile at scale 1 of probability `u`, with `v` = 1 - u given apart so that both tails are exact."""
    if abs(shape) < 1e-6:
        return np.log(u) - np.log(v)
    return (u**shape - v**shape) / shape


def standard_deviation_tensor(shape: Tensor) -> Tensor:
    """`standard_deviation` in torch, float64 and differentiable in the shape."""
    shape = shape.double()
    near = shape.abs() < NEAR_ZERO
    safe = torch.where(near, torch.full_like(shape, NEAR_ZERO), shape)
    ratio = torch.exp(2 * torch.lgamma(safe + 1) - torch.lgamma(2 * safe + 2))
    variance = 2 / safe**2 * (1 / (1 + 2 * safe) - ratio)
    return torch.sqrt(torch.where(near, VARIANCE_AT_ZERO + SLOPE_AT_ZERO * shape, variance))


def quantile_of_tail(p: Tensor, side: Tensor, shape: Tensor) -> Tensor:
    """Quantile at scale 1, float32, of the probability `p` of the nearer tail and its `side` (-1 or 1), both float64."""
    shape = shape.double()
    near = shape.abs() < 1e-6
    safe = torch.where(near, torch.full_like(shape, 1e-6), shape)
    upper, lower = torch.log1p(-p), torch.log(p)
    far = (torch.exp(safe * upper) - torch.exp(safe * lower)) / safe
    line = upper - lower + shape / 2 * (upper**2 - lower**2)
    return (side * torch.where(near, line, far)).float()
