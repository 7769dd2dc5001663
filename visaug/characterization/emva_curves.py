"""Arrays of the plots of EMVA 1288's data sheet, release 4.0 Linear."""

import math

import numpy as np
from scipy import ndimage, stats

from visaug.characterization.groups import FlatLevel
from visaug.characterization.moments import GroupMoments
from visaug.core.constants import MAD
from visaug.statistics.kernels import median_of

HIGH_PASS = 5  # the standard's box of 5 x 5


def high_pass(values: np.ndarray) -> np.ndarray:
    """A map less its mean over 5 x 5 pixels, without the borders that lack neighbours; scaled so that a white
    pattern keeps its variance (the box takes 1/25 of it).
    """
    smooth = ndimage.uniform_filter(values, HIGH_PASS, mode="nearest")
    return (values - smooth)[2:-2, 2:-2] / math.sqrt(1 - 1 / HIGH_PASS**2)


def sweep_curves(
    levels: tuple[FlatLevel, ...], saturation: int | None, last: int, darks: list[GroupMoments]
) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of the plots against exposure: photons, means and variances of bright and dark frames."""
    return {
        "emva4_sweep": {
            "photons": np.array([math.nan if v.photons is None else v.photons for v in levels], float),
            "mean_dn": np.array([v.flat.mean for v in levels]),
            "dark_mean_dn": np.array([v.dark.mean for v in levels]),
            "variance_dn2": np.array([v.flat.variance for v in levels]),
            "dark_variance_dn2": np.array([v.dark.variance for v in levels]),
            "saturation": np.array([-1 if saturation is None else saturation]),
            "last_fitted": np.array([last]),
        },
        "emva4_dark": {
            "exposure_s": np.array([m.group.exposure_s for m in darks]),
            "mean_dn": np.array([m.mean for m in darks]),
            "variance_dn2": np.array([m.variance for m in darks]),
        },
    }


def pattern_curves(values: np.ndarray, noise: float) -> dict[str, np.ndarray]:
    """Arrays of the plots of one map: spectrograms, profiles and histograms along rows and columns.
    `values`: (H, W) map in the plot's unit (e- or %).
    `noise`: variance of the temporal noise that is left in the map, in its unit squared.
    """
    curves: dict[str, np.ndarray] = {"noise": np.array([math.sqrt(max(noise, 0.0))])}
    for name, lines in (("horizontal", values), ("vertical", values.T)):
        power = (np.abs(np.fft.rfft(lines - lines.mean(), axis=1)) ** 2).mean(0) / lines.shape[1]
        curves[f"{name}_frequency"] = np.fft.rfftfreq(lines.shape[1])
        curves[f"{name}_amplitude"] = np.sqrt(power)
        curves[f"{name}_mean"] = lines.mean(0)
        curves[f"{name}_middle"] = lines[lines.shape[0] // 2]
        curves[f"{name}_least"], curves[f"{name}_most"] = lines.min(0), lines.max(0)
    centred, bins = values - values.mean(), 256
    counts, edges = np.histogram(centred, bins)
    curves["deviation"], curves["count"] = 0.5 * (edges[1:] + edges[:-1]), counts
    density = stats.norm.pdf(curves["deviation"], scale=max(centred.std(), 1e-12))
    curves["normal"] = centred.size * (edges[1] - edges[0]) * density
    size = np.sort(np.abs(centred), axis=None)
    chosen = np.unique(np.linspace(0, size.size - 1, bins).astype(int))
    tail = np.arange(max(size.size - bins, 0), size.size)  # the largest few one by one
    at = np.union1d(chosen, tail)
    curves["beyond"], curves["percent_beyond"] = size[at], 100 * (size.size - at) / size.size
    return curves


def defect_counts(values: np.ndarray) -> dict[str, np.ndarray]:
    """Pixels farther from the mean than so many robust standard deviations, and how many a normal pattern has."""
    sigmas = (4.0, 5.0, 6.0, 8.0)
    centred = values - median_of(values)
    spread = MAD * median_of(np.abs(centred))
    return {
        "sigma": np.array(sigmas),
        "limit": np.array(sigmas) * spread,
        "above": np.array([np.count_nonzero(centred > s * spread) for s in sigmas]),
        "below": np.array([np.count_nonzero(centred < -s * spread) for s in sigmas]),
        "normal": np.array([2 * stats.norm.sf(s) * values.size for s in sigmas]),
        "pixels": np.array([values.size]),
    }
