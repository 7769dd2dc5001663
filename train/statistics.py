"""Intervals of paired differences that hold for few training seeds.

Two things vary: how training went (seeds) and which images were tested. The differences of the seeds on the same images
give the first, a bootstrap over images of the mean over seeds the second:

    variance of the mean = s^2 / n + v,

with s^2 the sample variance of the n seeds' differences and v the bootstrap's variance. The interval is Student's t with
the degrees of freedom of Welch and Satterthwaite (F. E. Satterthwaite, Biometrics Bulletin 2 (1946) 110), n - 1 for the
first part and the number of images less 1 for the second: where training dominates, 2 for three seeds (t = 4.3), not the
infinitely many that a percentile of three numbers pretends. With one seed the first part is unknown and the interval
covers the choice of images alone.
"""

import numpy as np
from scipy.stats import t as student


def paired_interval(
    differences: np.ndarray, image_variance: np.ndarray, images: int, level: float = 0.95
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the interval of the mean difference, (measures) each.

    Args:
        differences: of each seed, (seeds, measures), each over all images.
        image_variance: of their mean over seeds by the choice of images, (measures); NaN where it is not known.
        images: how many there are.
        level: of the interval.
    """
    seeds = len(differences)
    mean = differences.mean(axis=0)
    known = np.isfinite(image_variance)
    between_images = np.where(known, image_variance, 0.0)
    between_seeds = differences.var(axis=0, ddof=1) / seeds if seeds > 1 else np.zeros_like(mean)
    variance = between_seeds + between_images
    # Satterthwaite: the square of the sum over the sum of squares, each over its own degrees of freedom.
    lost = between_seeds**2 / max(seeds - 1, 1) + between_images**2 / max(images - 1, 1)
    freedom = np.divide(variance**2, lost, out=np.full_like(mean, np.inf), where=lost > 0)
    reach = student.ppf((1 + level) / 2, freedom) * np.sqrt(variance)
    if seeds == 1:
        reach = np.where(known, reach, np.nan)
    return mean - reach, mean + reach
