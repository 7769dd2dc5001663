"""Standardised residuals and the robust Gauss-Newton step; arrays only."""

import numpy as np

OUTLIER = 3.0  # standard deviations beyond which residuals are weighted down (Cauchy weights)

LIKELIHOOD = OUTLIER**2 / 2  # log likelihood of a `misfit` of 1, where residuals are small


def standardised(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    return np.divide(residual, scale, out=np.zeros_like(residual), where=scale > 0)


def drawn_to_zero(mean: np.ndarray, squared_error: np.ndarray) -> np.ndarray:
    """Means over simulations, shrunk to 0 by their standard error."""
    noise = np.divide(squared_error, mean**2, out=np.ones_like(mean), where=mean != 0)
    return mean * np.maximum(1 - noise, 0)


def shrunk(samples: np.ndarray) -> np.ndarray:
    """Correlation matrix of (R, n) samples of mean 0, shrunk towards the identity.

    The shrinkage minimises the expected error: J. Schaefer and K. Strimmer, Stat. Appl. Genet. Mol. Biol. 4 (2005) 32.
    """
    count = len(samples)
    spread = np.sqrt((samples**2).mean(0))
    unit = np.divide(samples, spread, out=np.zeros_like(samples), where=spread > 0)
    correlation = unit.T @ unit / count
    variance = ((unit**2).T @ unit**2 / count - correlation**2) / count
    np.fill_diagonal(variance, 0)
    np.fill_diagonal(correlation, 0)
    amount = float(np.clip(variance.sum() / max((correlation**2).sum(), 1e-12), 0.05, 1))
    return (1 - amount) * correlation + np.eye(samples.shape[1])


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
    """The robust step of the coordinates that reduces the residuals.

    Statistics that stay beyond `OUTLIER` standard deviations, as a missing effect causes them, are weighted down, so that the
    camera's parameters do not absorb them.

    Args:
        residuals: (n, statistics), measured minus modelled, of n sets at once.
        slopes: (statistics, coordinates).
        scale: (statistics,), standard deviations.
        priors: (coordinates,), standard deviations.
        offset: (coordinates,), distance of the coordinates from the centres of the priors.
        damping: of Levenberg and Marquardt; a positive value shortens the step.

    Returns: (n, coordinates).
    """
    if slopes.shape[1] == 0:
        return np.zeros((len(residuals), 0))
    used = scale > 0
    # In units of the priors, which are comparable.
    design = slopes[used] / scale[used, None] * priors
    z = residuals[:, used] / scale[used]
    ridge = np.eye(len(priors))
    steps = np.zeros((len(z), design.shape[1]))
    for _ in range(iterations):
        left = np.abs(z - steps @ design.T)
        # If most statistics deviate the parameters are wrong; if few do, something else is missing.
        limit = np.maximum(OUTLIER, OUTLIER * np.median(left, axis=1, keepdims=True))
        weights = 1 / (1 + (left / limit) ** 2)
        normal = np.stack([(design * w[:, None]).T @ design for w in weights]) + ridge
        diagonal = np.einsum("nii->ni", normal)
        diagonal *= 1 + damping + 1e-12  # the last for numbers that these frames answer alike
        pull = (weights * z) @ design - offset / priors
        steps = np.linalg.solve(normal, pull[:, :, None])[:, :, 0]
    return steps * priors


def misfit(residual: np.ndarray, scale: np.ndarray) -> float:
    """The objective function of the robust fit."""
    return float(np.log1p((standardised(residual, scale) / OUTLIER) ** 2).sum())
