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
from visaug.camera.scale import Scale
from visaug.core.sampling import Stream

pytest.importorskip("numba")

ALARM = 1e-5


def camera(**changes) -> Camera:
    content = {
        "resolution": [64, 64],
        "gain_e_per_dn": 0.5,
        "black_level_dn": 600,
        "read_noise": {"sigma_e": 2.0, "shape": -0.2},
        **changes,
    }
    return Camera.load(content)


def plain(cam: Camera, electrons: float) -> Scale:
    """So many electrons for the value 1; DN come out as a share of the converter's range."""
    return Scale(np.array([electrons]), np.zeros(1), np.array([1 / (2**cam.bit_depth - 1)]))


def shoot(cam: Camera, level: float, shape: tuple[int, int] = (1024, 1024), seed: int = 1) -> np.ndarray:
    """DN of an evenly lit image at `level`, in photo-electrons."""
    image = torch.full((1, 1, *shape), level / 30000.0)
    values = {path: np.array([value]) for path, value in cam.values().items()}
    keys = torch.tensor([seed * 7919]), torch.tensor([seed * 104729])
    out = fast.take(cam, image, plain(cam, 30000.0), values, *keys)
    return (out.double() * (2**cam.bit_depth - 1)).round().numpy().astype(int).ravel()


@cache
def added_noise(sigma: float, shape: float, gaussian: float) -> tuple[np.ndarray, np.ndarray]:
    """Distribution function of Tukey-lambda plus Gaussian noise, in electrons."""
    p = np.unique(np.concatenate([0.5 ** np.arange(34, 2, -0.05), np.linspace(0.125, 0.5, 400)]))
    q = sigma * stats.tukeylambda.ppf(p, shape) / stats.tukeylambda.std(shape)
    q, p = np.concatenate([q, -q[-2::-1]]), np.concatenate([p, 1 - p[-2::-1]])
    if gaussian == 0:
        return q, p
    noise = np.linspace(-190, 190, 12_001)
    cdf = np.zeros_like(noise)
    for value, part in zip((q[1:] + q[:-1]) / 2, np.diff(p)):
        cdf += part * special.ndtr((noise - value) / gaussian)
    return noise, cdf


def law(cam: Camera, level: float) -> tuple[int, np.ndarray]:
    """First DN and probabilities of DN, by summing over counts and integrating over gains and read noise."""
    spec = cam.spec
    dark = (
        spec.exposure_s
        * spec.dark_current.a_e_per_s
        * math.exp(spec.dark_current.b_per_c * spec.temperature_c)
    )
    z, weights = np.polynomial.hermite_e.hermegauss(60)
    means = np.maximum(level * (1 + spec.prnu.pixel * z), 0) + dark
    width = math.sqrt(level + dark + (spec.prnu.pixel * level) ** 2)
    counts = np.arange(max(0, int(level + dark - 9 * width - 20)), int(level + dark + 9 * width + 25))
    pmf = (weights / weights.sum()) @ stats.poisson.pmf(counts, means[:, None])
    well = spec.full_well_e or np.inf
    noise, cdf = added_noise(spec.read_noise.sigma_e, spec.read_noise.shape, spec.dsnu.pixel_e)
    least = math.floor((min(counts[0], well) - 190) / spec.gain_e_per_dn + spec.black_level_dn)
    most = math.ceil((min(counts[-1], well) + 190) / spec.gain_e_per_dn + spec.black_level_dn)
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


def quantiles_beyond(first: int, probabilities: np.ndarray, p: float) -> tuple[int, float, int, float]:
    """The DN beyond which at most p of either tail lies, and how much does."""
    cdf = np.cumsum(probabilities)
    low = int(np.searchsorted(cdf, p)) - 1
    high = int(np.searchsorted(-(1 - cdf), -p))
    return first + low, float(cdf[low]), first + high, float(1 - cdf[high])


@pytest.mark.parametrize("level", [0.0, 10.0, 60.0, 3000.0])
@pytest.mark.parametrize("p", [1e-4, 1e-5, 1e-6])
def test_tails(level, p):
    cam = camera(dsnu={"pixel_e": 1.1}, prnu={"pixel": 0.006}, read_noise={"sigma_e": 2.37, "shape": -0.23})
    first, probabilities = law(cam, level)
    low, below, high, above = quantiles_beyond(first, probabilities, p)
    drawn = shoot(cam, level, (2048, 4096), seed=3)
    for count, expected in (((drawn <= low).sum(), below), ((drawn > high).sum(), above)):
        assert stats.poisson.cdf(count, expected * drawn.size) > ALARM
        assert stats.poisson.sf(count - 1, expected * drawn.size) > ALARM


@pytest.mark.parametrize("level", [3700.0, 3990.0, 4300.0, 6000.0])
def test_full_well(level):
    cam = camera(full_well_e=4000.0, dsnu={"pixel_e": 1.1}, prnu={"pixel": 0.006})
    assert chi_square(shoot(cam, level), *law(cam, level)) > ALARM


@pytest.mark.parametrize("level", [0.0, 30.0, 3000.0])
def test_moments_are_the_exact_chains(level):
    cam = camera(
        prnu={"column": 0.01, "row": 0.02, "pixel": 0.006},
        dsnu={"column_e": 1.0, "row_e": 2.0, "pixel_e": 1.1},
        effects=[{"name": "row_noise", "sigma_e": 1.5}, {"name": "column_noise", "sigma_e": 0.7}],
    )
    shape = (64, 1, 64, 64)
    stream = Stream(range(64), range(100, 164), 1, (range(64), range(64)))
    exact = cam.expose(torch.full(shape, level), stream).double()
    values = {path: np.array([value]) for path, value in cam.values().items()}
    image, keys = torch.full(shape, level / 5000), torch.arange(64)
    quick = fast.take(cam, image, plain(cam, 5000.0), values, keys, keys + 100)
    quick = quick.double() * 65535
    # Row and column parts are the same fixed patterns in both; the rest differs by its own noise alone.
    for axis in (2, 3):
        difference = exact.mean(axis) - quick.mean(axis)
        assert difference.abs().max() < 6 * (exact - quick).std() / 8 + 6 * 2**0.5 * 1.5 / 0.5
    error = 6 * (2 / exact.numel()) ** 0.5
    assert abs((exact.mean() - quick.mean()) / (exact - quick).std()) < 6 * (2 / 64**2) ** 0.5
    temporal = [x - x.mean(2, keepdim=True) - x.mean(3, keepdim=True) for x in (exact, quick)]
    assert (temporal[1].var() / temporal[0].var()).item() == pytest.approx(1, abs=4 * error)


def test_rows_and_threads_do_not_change_a_pixel():
    cam = camera(dsnu={"pixel_e": 1.1}, prnu={"pixel": 0.006})
    values = {path: np.array([value]) for path, value in cam.values().items()}
    images = torch.rand(3, 2, 80, 90)
    images[1, :, :40] = 0  # rows of small means take the other way through the loop
    images[2, :, ::3, ::7] = 0
    keys = torch.arange(3) + 5
    before = torch.get_num_threads()
    taken = []
    for threads in (1, 2, 3):
        torch.set_num_threads(threads)
        taken.append(fast.take(cam, images, plain(cam, 9000.0), values, keys, keys + 9))
    torch.set_num_threads(before)
    assert torch.equal(taken[0], taken[1])
    assert torch.equal(taken[0], taken[2])
    crop = fast.take(cam, images[1:2], plain(cam, 9000.0), values, keys[1:2], keys[1:2] + 9)
    assert torch.equal(crop, taken[0][1:2])


def test_comb_is_the_characteristic_function():
    u = (np.arange(400_000) + 0.5) / 400_000
    q = stats.tukeylambda.ppf(u, -0.2) / stats.tukeylambda.std(-0.2)
    for sigma, gaussian in ((0.2, 0.0), (0.5, 0.1), (1.5, 0.2)):
        expected = 2 * abs(np.cos(2 * np.pi * sigma * q).mean()) * np.exp(-2 * (np.pi * gaussian) ** 2)
        found = fast.comb(sigma, -0.2, gaussian)
        assert found == pytest.approx(expected, abs=1e-3)


CASES = {
    "together": {"dsnu": {"pixel_e": 1.1}, "prnu": {"pixel": 0.006}},
    "no patterns": {},
    "nearly noiseless": {"read_noise": {"sigma_e": 0.1, "shape": 0.14}},
    "comb through offsets": {
        "read_noise": {"sigma_e": 0.1, "shape": -0.2},
        "dsnu": {"pixel_e": 0.15},
        "prnu": {"pixel": 0.02},
    },
    "coarse converter": {"gain_e_per_dn": 3.0, "dsnu": {"pixel_e": 0.8}},
    "wide gains": {"prnu": {"pixel": 0.05}, "dsnu": {"pixel_e": 1.0}},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("level", [0.0, 0.3, 4.0, 24.0, 26.0, 300.0, 6000.0])
def test_law_of_a_level(case, level):
    cam = camera(dark_current={"a_e_per_s": 3.0, "b_per_c": 0.1}, **CASES[case])
    assert chi_square(shoot(cam, level), *law(cam, level)) > ALARM


@pytest.mark.parametrize("read_e", [0.3, 2.0])
@pytest.mark.parametrize("sigma", [0.9, 1.2, 1.5, 3.0])
def test_law_of_a_faint_mean_beside_gaussian_offsets(sigma, read_e):
    """A mean just below the largest that is drawn together with the offsets, where the expansion has to carry most."""
    cam = camera(dsnu={"pixel_e": sigma}, read_noise={"sigma_e": read_e, "shape": 0.14})
    values = {path: np.array([value]) for path, value in cam.values().items()}
    numbers = fast._numbers(cam, 1, plain(cam, 1.0), values, False)
    level = 0.95 * float(numbers[0, fast.kernel().Number.FAINT_E])
    assert level > 0
    assert chi_square(shoot(cam, level, (2048, 2048)), *law(cam, level)) > ALARM


@pytest.mark.parametrize("level", [18.0, 23.7, 24.8, 26.0])
@pytest.mark.parametrize("prnu", [0.05, 0.1])
def test_gains_of_pixels_near_the_end_of_the_poisson_table(level, prnu):
    """Whole electrons show and every pixel has a gain, so a mean below 25 e- may become one of 40."""
    cam = camera(prnu={"pixel": prnu}, dsnu={"pixel_e": 0.25}, gain_e_per_dn=0.02,
                 read_noise={"sigma_e": 0.3, "shape": 0.14})  # fmt: skip
    assert chi_square(shoot(cam, level), *law(cam, level)) > ALARM


def test_the_place_decides_a_pixels_number():
    cam = camera(dsnu={"pixel_e": 1.3}, prnu={"pixel": 0.007})
    values = {path: np.array([value]) for path, value in cam.values().items()}
    image, keys = torch.rand(1, 1, 9, 40), (torch.tensor([5]), torch.tensor([6]))
    image[..., 5, 7] = 0.001  # a mean that is drawn on its own
    whole = fast.take(cam, image, plain(cam, 9000.0), values, *keys)
    for row, column in ((0, 3), (2, 8)):
        part = fast.take(
            cam, image[..., row:, column:], plain(cam, 9000.0), values, *keys, origin=(row, column)
        )
        assert torch.equal(part, whole[..., row:, column:])


def test_neighbours_and_rows_are_independent():
    cam = camera(dsnu={"pixel_e": 1.3}, prnu={"pixel": 0.007})
    drawn = torch.from_numpy(shoot(cam, 2700.0).reshape(1024, 1024)).double()
    drawn = (drawn - drawn.mean()) / drawn.std()
    for pair in ((drawn[:, 1:], drawn[:, :-1]), (drawn[:, 2:], drawn[:, :-2]), (drawn[1:], drawn[:-1])):
        assert abs((pair[0] * pair[1]).mean().item()) < 4.5 / pair[0].numel() ** 0.5
        squares = ((pair[0] ** 2 - 1) * (pair[1] ** 2 - 1)).mean().item()
        assert abs(squares) < 4.5 * 2.1 / pair[0].numel() ** 0.5


@pytest.mark.parametrize("level", [0.0, 7.0, 40.0, 3990.0])
def test_parts_on_their_own_are_the_exact_chains_numbers(level):
    """Without pixel offsets there is no short cut: image and frame agree in every pixel, but for rounding near a half."""
    cam = camera(
        prnu={"pixel": 0.006, "row": 0.01},
        dsnu={"column_e": 2.0},
        full_well_e=4000.0,
        read_noise={"sigma_e": 2.0, "shape": -0.2, "after_gain_dn": 0.0},
    )
    stream = Stream([5, 6], [7, 8], 1, (range(3, 67), range(6, 86)))
    exact = cam.expose(torch.full((2, 1, 64, 80), level), stream)
    values = {path: np.array([value]) for path, value in cam.values().items()}
    image, keys = torch.full((2, 1, 64, 80), level / 5000), (torch.tensor([5, 6]), torch.tensor([7, 8]))
    quick = fast.take(cam, image, plain(cam, 5000.0), values, *keys, origin=(3, 6)) * 65535
    apart = (exact - quick.round()).abs()
    assert apart.max() <= 1
    assert (apart > 0).double().mean() < 1e-3
