"""Standardised residuals and the robust Gauss-Newton step; arrays only."""

import numpy as np

OUTLIER = 3.0  # standard deviations beyond which residuals are weighted down (Cauchy weights)

SUBTRACTED = 0.5  # largest share of the information about any combination of coordinates that is taken for noise of slopes

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
    noise: np.ndarray | None = None,
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
        noise: (coordinates,) squared standard error of each slope in standard deviations, summed over the statistics. A least
            squares step by noisy slopes is too short (regression dilution); the moments of the noise are subtracted (W. A.
            Fuller, Measurement Error Models, 1987, section 2.2), so that one step goes as far as repeated steps would.

    Returns: (n, coordinates).
    """
    if slopes.shape[1] == 0:
        return np.zeros((len(residuals), 0))
    used = scale > 0
    # In units of the priors, which are comparable.
    design = slopes[used] / scale[used, None] * priors
    z = residuals[:, used] / scale[used]
    ridge = np.eye(len(priors))
    steps, weights, normal = np.zeros((len(z), design.shape[1])), np.ones_like(z), ridge[None]
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
    if noise is not None:
        steps = _lengthened(steps, normal, weights.mean(1, keepdims=True) * noise * priors**2)
    return steps * priors


def _lengthened(steps: np.ndarray, normal: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Steps (n, coordinates) by normal matrices without the noise (n, coordinates) that their diagonals contain.

    At most `SUBTRACTED` of the information in any direction is subtracted.
    """
    root = np.sqrt(noise)
    share = np.linalg.eigvalsh(root[:, :, None] * np.linalg.inv(normal) * root[:, None, :]).max(1)
    less = noise * np.minimum(1.0, SUBTRACTED / np.maximum(share, 1e-12))[:, None]
    true = normal - less[:, :, None] * np.eye(normal.shape[1])
    return np.linalg.solve(true, normal @ steps[:, :, None])[:, :, 0]


def misfit(residual: np.ndarray, scale: np.ndarray) -> float:
    """The objective function of the robust fit."""
    return float(np.log1p((standardised(residual, scale) / OUTLIER) ** 2).sum())


def added_by_noise(residual: np.ndarray, scale: np.ndarray, noise: np.ndarray) -> float:
    """What noise of residuals adds to the expected value of their `misfit`, to second order.

    Where it is not subtracted, a fit keeps near the camera at which all simulations are known.

    Args:
        noise: (statistics,) its variance.
    """
    squares = (standardised(residual, scale) / OUTLIER) ** 2
    share = np.divide(noise, (OUTLIER * scale) ** 2, out=np.zeros_like(squares), where=scale > 0)
    return float((share * (1 - squares) / (1 + squares) ** 2).sum())
