import numpy as np
import pytest
from scipy import special, stats

from visaug.characterization import characterize, tukey
from visaug.characterization.moments import measure
from visaug.characterization.read_noise import _bin_probabilities, fit
from visaug.core.intervals import t_quantile
from visaug.core.sampling import tukey_lambda
from visaug.frames import FrameRecord, FrameSet


@pytest.mark.parametrize("shape", [-0.35, -0.1, 0.0, 0.14, 0.4])
def test_tables_agree_with_scipy(shape):
    law, table = stats.tukeylambda(shape), tukey.standard(shape)
    assert tukey_lambda.standard_deviation(shape) == pytest.approx(law.std(), rel=1e-6)
    x = np.linspace(-6, 6, 41)
    expected = law.cdf(x * law.std())
    np.testing.assert_allclose(np.interp(x, table.x, table.distribution), expected, atol=5e-5)
    u = (np.arange(100_000) + 0.5) / 100_000
    for t in (0.3, 1.0, 2.5):
        assert table.phi(np.array([t]))[0] == pytest.approx(
            np.cos(t * law.ppf(u) / law.std()).mean(), abs=1e-4
        )


def bias_frames(n, sigma_dn, shape, seed, row_noise_dn=0.0, size=(60, 80)):
    rng = np.random.default_rng(seed)
    u = rng.random((n, *size))
    noise = sigma_dn * stats.tukeylambda.ppf(u, shape) / stats.tukeylambda(shape).std()
    noise += rng.normal(0, row_noise_dn, (n, size[0], 1))
    frames = np.rint(2000 + rng.normal(0, 4, size) + noise).astype(np.uint16)
    return FrameSet.from_arrays([FrameRecord(i, f"{i}", "bias") for i in range(n)], frames)


def fitted(frames):
    return fit(frames, range(len(frames)), measure(frames, frames.groups()[0]))


@pytest.mark.parametrize(("n", "sigma", "shape"), [(2, 3.0, -0.2), (3, 1.0, 0.14), (16, 13.0, -0.23)])
def test_sigma_and_shape_come_back_with_honest_errors(n, sigma, shape):
    """8 sets: the mean of 8 standard scores beyond 1.4 by chance once in 13,000."""
    fits = [fitted(bias_frames(n, sigma, shape, seed)) for seed in range(8)]
    scores = np.array(
        [[(f.sigma_dn - sigma) / f.sigma_error, (f.shape - shape) / f.shape_error] for f in fits]
    )
    assert np.abs(scores.mean(0)).max() < 1.4
    assert scores.std(0).max() < 2.2
    assert fits[0].sigma_error < 0.05 * sigma


def test_noise_of_rows_is_kept_out_of_the_pixels_noise():
    """Off by more than 5 standard errors by chance less than once in 100,000."""
    found = fitted(bias_frames(8, 6.0, 0.0, 1, row_noise_dn=3.0))
    assert abs(found.sigma_dn - 6.0) < 5 * found.sigma_error
    assert abs(found.shape) < 5 * found.shape_error


def test_normal_noise_is_told_from_heavy_tails():
    for shape, normal in ((0.14, True), (-0.2, False)):
        found = fitted(bias_frames(4, 5.0, shape, 2))
        near = abs(found.shape - tukey.GAUSSIAN_SHAPE) <= t_quantile(found.df) * found.shape_error
        assert near == normal


def test_residuals_of_many_frames_have_the_tails_of_one_draw():
    """Against quadrature, up to 25 standard deviations, where 13 million pixels hold one or two.

    The other frames' share in a residual, a hundredth of its variance or less, is normal enough.
    """
    n, sigma, shape, width, half = 200, 25.0, -0.23, 3.125, 320
    logit = np.linspace(-45, 45, 20_001)
    u, v = special.expit(logit), special.expit(-logit)
    own = tukey_lambda.quantile(u, v, shape) / tukey_lambda.standard_deviation(shape) * sigma * (1 - 1 / n)
    others = np.sqrt((sigma**2 + 1 / 12) * (n - 1) / n**2 + (1 - 1 / n) ** 2 / 12)
    bins = np.array([0, 8, 16, 32, 64, 128, 200])
    upper, lower = ((bins[:, None] + side) * width - own for side in (0.5, -0.5))
    expected = (special.ndtr(upper / others) - special.ndtr(lower / others)) @ (u * v) * (logit[1] - logit[0])
    found = _bin_probabilities(sigma, shape, n, width, half, 0.0)[half + bins]
    np.testing.assert_allclose(found, expected, rtol=2e-3)


@pytest.mark.parametrize("spread", [0.0, 0.25])
def test_interval_of_the_spread_over_pixels_covers_it(spread):
    """60 cameras with 8 bias frames: of 95 % intervals 10 or more miss once in 1,000 such runs (binomial)."""
    missed = 0
    for seed in range(60):
        rng = np.random.default_rng([83, seed])
        sigma_dn = 4 * np.exp(spread * rng.standard_normal((32, 40)))
        frames = [np.rint(200 + sigma_dn * rng.standard_normal((32, 40))) for _ in range(8)]
        records = [FrameRecord(i, f"{i}", "bias", 0.0, 20.0) for i in range(8)]
        found = characterize(FrameSet.from_arrays(records, np.array(frames, np.uint16), bit_depth=12))
        e = found["read_noise.spread"]
        assert e.low >= 0
        missed += not e.low <= np.log(sigma_dn).std() <= e.high
    assert missed < 10
