"""Residuals in standard deviations, and the robust step that takes them away. Arrays only: no camera, no frames."""

import numpy as np

OUTLIER = 3.0  # residuals beyond so many standard deviations lose their pull on the fit (Cauchy weights)


def standardised(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0)


def drawn_to_zero(mean: np.ndarray, squared_error: np.ndarray) -> np.ndarray:
    """Means over simulations, less of each as it is no more than its standard error."""
    noise = np.divide(squared_error, mean**2, out=np.ones_like(mean), where=mean != 0)
    return mean * np.maximum(1 - noise, 0)


def p_value(largest: float, null: np.ndarray) -> float:
    """p = (1 + #{max|r*| >= max|r|}) / (R + 1)."""
    return float((1 + np.count_nonzero(null >= largest)) / (len(null) + 1))


def adjust(
    residuals: np.ndarray,
    slopes: np.ndarray,
    scale: np.ndarray,
    priors: np.ndarray,
    offset: np.ndarray | float = 0.0,
    damping: float = 0.0,
    iterations: int = 12,
) -> np.ndarray:
    """The step of the coordinates that best takes residuals away, robustly.

    Args:
        residuals: (n, statistics), measured less modelled, of n sets at once.
        slopes: (statistics, coordinates).
        scale: (statistics,), standard deviations.
        priors: (coordinates,), standard deviations.
        offset: (coordinates,), how far the coordinates already are from where the priors are centred.
        damping: Marquardt's: above 0 the step shrinks, most where the statistics say least.

    Returns:
        (n, coordinates). Statistics that stay beyond `OUTLIER` standard deviations, as a missing effect makes them, are
        weighted down, so that the camera is not bent to explain them.
    """
    if slopes.shape[1] == 0:
        return np.zeros((len(residuals), 0))
    used = scale > 0
    # in units of the priors: none but equal units can be compared
    design = slopes[used] / scale[used, None] * priors
    z = residuals[:, used] / scale[used]
    ridge = np.eye(len(priors))
    steps = np.zeros((len(z), design.shape[1]))
    for _ in range(iterations):
        left = np.abs(z - steps @ design.T)
        # where most statistics are off it is the camera's numbers that are; where few are, it is something else
        limit = np.maximum(OUTLIER, OUTLIER * np.median(left, axis=1, keepdims=True))
        weights = 1 / (1 + (left / limit) ** 2)
        normal = np.stack([(design * w[:, None]).T @ design for w in weights]) + ridge
        diagonal = np.einsum("nii->ni", normal)
        diagonal *= 1 + damping + 1e-12  # the last for numbers that these frames answer alike
        pull = (weights * z) @ design - offset / priors
        steps = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
    return steps * priors


def misfit(residual: np.ndarray, scale: np.ndarray) -> float:
    """What the robust fit lowers."""
    return float(np.log1p((standardised(residual, scale) / OUTLIER) ** 2).sum())
