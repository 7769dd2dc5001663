"""The fast path's law against one computed with SciPy, level by level, and against the exact chain.

False alarms: every chi-square and Poisson test here fails by chance with a probability of 1e-5 at most.
"""

import math
from functools import cache

import numpy as np
import pytest
import torch
from scipy import special, stats

from visaug.camera import Camera, fast

pytest.importorskip("numba")

ALARM = 1e-5


def camera(**changes) -> Camera:
    content = {
        "resolution": [64, 64],
        "gain_e_per_dn": 0.5,
        "black_level_dn": 400,
        "read_noise": {"sigma_e": 2.0, "shape": -0.2},
        **changes,
    }
    return Camera.load(content)


def shoot(cam: Camera, level: float, shape: tuple[int, int] = (1024, 1024), seed: int = 1) -> np.ndarray:
    """DN of an evenly lit image at `level`, in photo-electrons."""
    image = torch.full((1, 1, *shape), level / 30000.0)
    values = {path: np.array([value]) for path, value in cam.values().items()}
    keys = torch.tensor([seed * 7919]), torch.tensor([seed * 104729])
    out = fast.take(cam, image, np.array([30000.0]), values, *keys, subtract_black_level=False)
    return (out.double() * (2**cam.bit_depth - 1)).round().numpy().astype(int).ravel()


@cache
def added_noise(sigma: float, shape: float, gaussian: float) -> tuple[np.ndarray, np.ndarray]:
    """Distribution function of Tukey-lambda plus Gaussian noise, in electrons."""
    p = np.unique(np.concatenate([0.5 ** np.arange(34, 2, -0.05), np.linspace(0.125, 0.5, 400)]))
    q = sigma * stats.tukeylambda.ppf(p, shape) / stats.tukeylambda.std(shape)
    q, p = np.concatenate([q, -q[-2::-1]]), np.concatenate([p, 1 - p[-2::-1]])
    if gaussian == 0:
        return q, p
    noise = np.linspace(-80, 80, 8001)
    cdf = np.zeros_like(noise)
    for value, part in zip((q[1:] + q[:-1]) / 2, np.diff(p)):
        cdf += part * special.ndtr((noise - value) / gaussian)
    return noise, cdf


def law(cam: Camera, level: float) -> tuple[int, np.ndarray]:
    """First DN and probabilities of DN, by summing over counts and integrating over gains and read noise."""
    spec = cam.spec
    dark = spec.exposure_s * spec.dark_current.a_e_per_s * math.exp(
        spec.dark_current.b_per_c * spec.temperature_c
    )
    z, weights = np.polynomial.hermite_e.hermegauss(60)
    means = np.maximum(level * (1 + spec.prnu.pixel * z), 0) + dark
    width = math.sqrt(level + dark + (spec.prnu.pixel * level) ** 2)
    counts = np.arange(max(0, int(level + dark - 9 * width - 20)), int(level + dark + 9 * width + 25))
    pmf = (weights / weights.sum()) @ stats.poisson.pmf(counts, means[:, None])
    well = spec.full_well_e or np.inf
    noise, cdf = added_noise(spec.read_noise.sigma_e, spec.read_noise.shape, spec.dsnu.pixel_e)
    least = math.floor((counts[0] - 60) / spec.gain_e_per_dn + spec.black_level_dn)
    most = math.ceil((min(counts[-1], well) + 60) / spec.gain_e_per_dn + spec.black_level_dn)
    dn = np.arange(max(least, 0), most)
    boundary = (dn + 0.5 - spec.black_level_dn) * spec.gain_e_per_dn
    electrons = np.minimum(counts, well)
    values, where = np.unique(electrons, return_inverse=True)
    pmf = np.bincount(where, pmf)
    below = np.interp(boundary[:, None] - values, noise, cdf) @ pmf
    return int(dn[0]), np.diff(below, prepend=0.0)


def chi_square(drawn: np.ndarray, first: int, probabilities: np.ndarray) -> float:
    """The p-value, neighbours with fewer than 20 expected taken together."""
    counts = np.bincount(np.clip(drawn - first, 0, len(probabilities) - 1), minlength=len(probabilities))
    expected = probabilities * len(drawn)
    bins = np.floor(np.cumsum(expected) / 20).astype(int)
    observed, wanted = np.bincount(bins, counts), np.bincount(bins, expected)
    keep = wanted > 5
    return stats.chisquare(observed[keep], wanted[keep] * observed[keep].sum() / wanted[keep].sum()).pvalue


CASES = {
    "together": {"dsnu": {"pixel_e": 1.1}, "prnu": {"pixel": 0.006}},
    "no patterns": {},
    "nearly noiseless": {"read_noise": {"sigma_e": 0.1, "shape": 0.14}},
    "comb through offsets": {"read_noise": {"sigma_e": 0.1, "shape": -0.2}, "dsnu": {"pixel_e": 0.15}, "prnu": {"pixel": 0.02}},
    "coarse converter": {"gain_e_per_dn": 3.0, "dsnu": {"pixel_e": 0.8}},
    "wide gains": {"prnu": {"pixel": 0.05}, "dsnu": {"pixel_e": 1.0}},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("level", [0.0, 0.3, 4.0, 24.0, 26.0, 300.0, 6000.0])
def test_law_of_a_level(case, level):
    cam = camera(dark_current={"a_e_per_s": 3.0, "b_per_c": 0.1}, **CASES[case])
    assert chi_square(shoot(cam, level), *law(cam, level)) > ALARM
