"""Intervals of paired differences that hold for few training seeds.

Two things vary: how training went (seeds) and which images were tested. The differences of the seeds on the same images
give the first, a bootstrap over images of the mean over seeds the second:

    variance of the mean = s^2 / n + v,

with s^2 the sample variance of the n seeds' differences and v the bootstrap's variance. The interval is Student's t with
the degrees of freedom of Welch and Satterthwaite (F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110), n - 1 for the
first part and the number of images less 1 for the second: where training dominates, 2 for three seeds (t = 4.3), not the
infinitely many that a percentile of three numbers pretends. With one seed the first part is unknown and the interval
covers the choice of images alone.

Each interval is one comparison's. A study makes many: `holm` corrects for their number.
"""

import numpy as np
from scipy.stats import t as student


def image_variance(resampled: np.ndarray) -> np.ndarray:
    """The variance by the choice of images, (measures), of (resamples, measures); NaN with fewer than two resamples."""
    return np.full(resampled.shape[1:], np.nan) if len(resampled) < 2 else resampled.var(axis=0, ddof=1)


def paired_interval(
    differences: np.ndarray, image_variance: np.ndarray, images: int
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the 95 % interval of the mean difference, (measures) each.

    Args:
        differences: of each seed, (seeds, measures), each over all images.
        image_variance: of their mean over seeds by the choice of images, (measures); NaN where it is not known.
    """
    mean, error, freedom = _mean_and_error(differences, image_variance, images)
    reach = student.ppf(0.975, freedom) * error
    return mean - reach, mean + reach


def paired_p_value(differences: np.ndarray, image_variance: np.ndarray, images: int) -> np.ndarray:
    """The two-sided p-value (measures) of no difference, valid far out in the tails that many comparisons need.

    Student's t with the fewest degrees of freedom, those of the seeds. Satterthwaite's, which the interval takes, are too many
    there: among hundreds of differences of three seeds some have seeds that agree by chance.
    """
    mean, error, _ = _mean_and_error(differences, image_variance, images)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(mean == 0, np.where(np.isnan(error), np.nan, 0), np.abs(mean) / error)
    return 2 * student.sf(ratio, (len(differences) if len(differences) > 1 else images) - 1)


def holm(p_values: np.ndarray) -> np.ndarray:
    """p-values (N) corrected for N comparisons (S. Holm, Scandinavian Journal of Statistics 6 (1979) 65).

    Where all differences are 0, the chance that any of them falls below a level is at most that level, however they depend on
    each other. NaN stays and counts as a comparison.
    """
    order = np.argsort(p_values)  # NaN last
    scaled = np.asarray(p_values)[order] * np.arange(len(order), 0, -1)
    corrected = np.empty(len(order))
    corrected[order] = np.minimum(np.maximum.accumulate(scaled), 1)
    return corrected


def share_interval(
    gains: np.ndarray, oracle: np.ndarray, by_images: np.ndarray, images: int
) -> tuple[float, float] | None:
    """The 95 % interval of mean gain over mean oracle's gain, after E. C. Fieller (J. R. Stat. Soc. B 16 (1954) 175).

    It holds the shares s at which gain - s oracle, whose interval `paired_interval` gives, does not differ from 0.

    Args:
        gains, oracle: of each seed, (seeds).
        by_images: (resamples, 2), both means over seeds on resampled images.

    Returns:
        Its ends; None where it is not bounded, for the oracle's gain does not differ from 0, or is a loss.
    """
    shares = np.linspace(-10, 10, 4001)  # that are tried: steps of half a percent
    left = gains[:, None] - shares * oracle[:, None]
    moved = by_images[:, :1] - shares * by_images[:, 1:]
    low, high = paired_interval(left, image_variance(moved), images)
    inside = np.flatnonzero((low <= 0) & (high >= 0))
    if oracle.mean() <= 0 or not len(inside) or inside[0] == 0 or inside[-1] == len(shares) - 1:
        return None
    return float(shares[inside[0]]), float(shares[inside[-1]])


def sign(low: float, high: float) -> int:
    """1 or -1 where an interval leaves out 0, else 0."""
    return int(low > 0) - int(high < 0)


def _mean_and_error(
    differences: np.ndarray, image_variance: np.ndarray, images: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean difference, its standard error (NaN where it is not known), and degrees of freedom."""
    seeds = len(differences)
    mean = differences.mean(axis=0)
    known = np.isfinite(image_variance)
    between_images = np.where(known, image_variance, 0.0)
    between_seeds = differences.var(axis=0, ddof=1) / seeds if seeds > 1 else np.zeros_like(mean)
    variance = between_seeds + between_images
    # Satterthwaite: the square of the sum over the sum of squares, each over its own degrees of freedom.
    lost = between_seeds**2 / max(seeds - 1, 1) + between_images**2 / max(images - 1, 1)
    freedom = np.divide(variance**2, lost, out=np.full_like(mean, np.inf), where=lost > 0)
    error = np.sqrt(variance)
    return mean, np.where(known, error, np.nan) if seeds == 1 else error, freedom
