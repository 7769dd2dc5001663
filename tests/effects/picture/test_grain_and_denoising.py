"""Grain and denoisers against SciPy."""

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve1d, median_filter


@pytest.mark.parametrize("level", [0.2, 0.5])
def test_grain_has_the_variance_of_a_coin_and_the_covariance_of_its_size(run_effect, level):
    """Covariance exp(-d^2 / 4 size^2) of Gaussian grains; 5 standard errors of 40 frames of some 60 x 60 / 4 pi grains."""
    frames = torch.full((40, 1, 60, 60), level)
    out = run_effect("film_grain", frames, sigma=0.04, size_px=1.2)[:, 0].double().numpy() - level
    expected = 4 * 0.04**2 * level * (1 - level)
    assert out.var() == pytest.approx(expected, rel=0.06)
    for d in (1, 2, 3):
        for pair in ((out[:, d:], out[:, :-d]), (out[..., d:], out[..., :-d])):
            assert (pair[0] * pair[1]).mean() / expected == pytest.approx(
                np.exp(-(d**2) / (4 * 1.2**2)), abs=0.06
            )


def test_white_and_black_have_no_grain(run_effect):
    for level in (0.0, 1.0):
        out = run_effect("film_grain", torch.full((1, 1, 20, 20), level), sigma=0.1)
        assert float((out - level).abs().max()) < 1e-3


def test_median_is_scipys(run_effect):
    image = torch.rand(1, 1, 30, 41, generator=torch.Generator().manual_seed(1))
    out = run_effect("denoising", image, amount=1.0)[0, 0].numpy()
    assert np.array_equal(out, median_filter(image[0, 0].numpy(), 3, mode="nearest"))


def test_starlets_are_shrunk(run_effect):
    """Two scales of the starlet transform by SciPy: coefficients below the threshold are gone, larger ones reduced by it."""
    image = torch.rand(1, 1, 64, 64, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    out = run_effect("denoising", image, amount=1.0, filter="wavelet", threshold=0.2)[0, 0].numpy()
    kernel = np.array([1, 4, 6, 4, 1]) / 16
    planes = [image[0, 0].numpy()]
    for step in (1, 2):
        wide = np.zeros(4 * step + 1)
        wide[::step] = kernel
        planes.append(convolve1d(convolve1d(planes[-1], wide, 0, mode="nearest"), wide, 1, mode="nearest"))
    shrunk = planes[2]
    for scale, threshold in ((0, 0.2), (1, 0.04)):
        w = planes[scale] - planes[scale + 1]
        shrunk = shrunk + np.sign(w) * np.maximum(np.abs(w) - threshold, 0)
    assert out == pytest.approx(shrunk, abs=1e-6)
    assert out.var() < 0.5 * image.var().item()
