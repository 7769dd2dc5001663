"""Laws of the random numbers against SciPy, in both implementations.

Goodness of fit is asked at p > 1e-4; with about 60 such tests on fixed seeds, a correct program would fail
one of them, once and for all, with probability 0.6 %.
"""

import numpy as np
import pytest
import torch
from scipy import stats

from visaug.core.sampling import Stream, distributions, tukey_lambda
from visaug.core.sampling import stream as stream_module

MEANS = [0.01, 0.5, 5.0, 9.99, 10.0, 50.0, 1e3, 5e4]
SHAPES = [-0.4, -0.23, -0.1, 0.0, 0.14, 0.5, 1.0]


@pytest.fixture(params=["numba", "torch"])
def path(request, monkeypatch):
    """Runs a test through the loops and through the torch operators."""
    if request.param == "torch":
        monkeypatch.setattr(stream_module, "kernels", None)
    return request.param


def stream(seed: int = 0, rows: int = 200, columns: int = 1000) -> Stream:
    return Stream([seed], [seed], 1, (range(rows), range(columns)))


def probabilities(one: Stream) -> np.ndarray:
    return (one._bits("pixel").numpy().astype(np.float64) + 0.5) / 2**32


@pytest.mark.parametrize("mean", MEANS)
def test_poisson_counts(path, mean):
    one = stream(1)
    counts = one.poisson(torch.full((1, 1, 200, 1000), mean)).numpy().ravel()
    assert np.array_equal(counts, counts.round())
    assert counts.min() >= 0
    law = stats.poisson(mean)
    # Bins of about equal probability, at most 60, each expecting 25 counts or more.
    edges = np.unique(law.ppf(np.linspace(0, 1, 61)[1:-1]))
    edges = edges[(law.sf(edges) * counts.size > 25)]
    expected = np.diff(np.concatenate([[0], law.cdf(edges), [1]])) * counts.size
    observed = np.bincount(np.searchsorted(edges, counts, side="left"), minlength=len(expected))
    assert len(expected) >= 2
    assert stats.chisquare(observed, expected).pvalue > 1e-4


@pytest.mark.parametrize("mean", MEANS)
def test_poisson_is_the_quantile(path, mean):
    """The count is SciPy's quantile of the same random number, but for rare rounding beside an integer."""
    one = stream(2, 40, 1000)
    counts = one.poisson(torch.full((1, 1, 40, 1000), mean)).numpy().ravel()
    exact = stats.poisson(mean).ppf(probabilities(one).ravel())
    assert np.abs(counts - exact).max() <= 1
    assert np.mean(counts != exact) < 1e-3


def test_poisson_of_nothing(path):
    mean = torch.tensor([0.0, -1.0]).reshape(1, 1, 1, 2)
    assert torch.equal(stream(0, 1, 2).poisson(mean), torch.zeros(1, 1, 1, 2))


@pytest.mark.parametrize("mean", [0.001, 0.05, 1.0, 9.0, 12.0, 300.0])
def test_poisson_gradient_is_unbiased(mean):
    """E[dN/dm] = d E[N]/dm = 1 and, where the denominator is not held, E[2 N dN/dm] = d E[N^2]/dm = 2 m + 1.

    Within 5 standard errors: false alarm 6e-7 each.
    """
    m = torch.full((1, 1, 200, 1000), mean, requires_grad=True)
    counts = stream(3).poisson(m)
    (slope,) = torch.autograd.grad(counts.sum(), m)
    for sample, expected in ((slope, 1.0), (2 * counts.detach() * slope, 2 * mean + 1)):
        if expected != 1.0 and mean < 0.01:
            continue
        values = sample.double()
        assert abs(values.mean() - expected) < 5 * values.std() / values.numel() ** 0.5 + 1e-6


@pytest.mark.parametrize("shape", SHAPES)
def test_tukey_lambda_law(path, shape):
    drawn = stream(4, 200, 1000).tukey_lambda(shape).double().numpy().ravel()
    law = stats.tukeylambda(shape)
    assert stats.kstest(drawn * law.std(), law.cdf).pvalue > 1e-4


@pytest.mark.parametrize("shape", SHAPES)
def test_tukey_lambda_quantiles_and_tails(path, shape):
    """Every number is SciPy's quantile of its random bits, over the standard deviation, down to 1e-6."""
    one = stream(5, 2000, 1000)
    drawn = one.tukey_lambda(shape).double().numpy().ravel()
    u = probabilities(one).ravel()
    deep = np.flatnonzero((u < 2e-5) | (u > 1 - 2e-5))
    assert u.min() < 1e-6
    assert u.max() > 1 - 1e-6
    body = np.arange(0, u.size, 997)
    law = stats.tukeylambda(shape)
    for chosen in (deep, body):
        exact = law.ppf(u[chosen]) / law.std()
        assert np.allclose(drawn[chosen], exact, rtol=2e-5, atol=2e-4)


@pytest.mark.parametrize("shape", [*SHAPES, -0.45, 1e-5, -1e-5])
def test_tukey_lambda_standard_deviation(shape):
    found = tukey_lambda.standard_deviation_tensor(torch.tensor(shape))
    assert float(found) == pytest.approx(stats.tukeylambda.std(shape), rel=1e-6)


def test_tukey_lambda_gradient_in_its_shape():
    """Against central differences at the same random numbers."""
    one = stream(6, 20, 20)

    def value(shape):
        return one.tukey_lambda(shape).double()

    for at in (-0.3, 0.0, 0.05, 0.14, 0.6):
        shape = torch.tensor(at, dtype=torch.float64, requires_grad=True)
        (slope,) = torch.autograd.grad((value(shape) ** 3).sum(), shape)
        step = torch.tensor(1e-3, dtype=torch.float64)
        up, down = ((value((shape + s).detach().requires_grad_()) ** 3).sum() for s in (step, -step))
        assert float(slope) == pytest.approx(float((up - down).detach() / (2 * step)), rel=2e-3)


def test_normal_law(path):
    one = stream(7, 1000, 1000)
    drawn = one.normal().double().numpy().ravel()
    assert stats.kstest(drawn, stats.norm.cdf).pvalue > 1e-4
    assert np.allclose(drawn, stats.norm.ppf(probabilities(one).ravel()), rtol=2e-6, atol=2e-6)
    assert np.abs(drawn).max() > 4.5


def test_uniform_law(path):
    drawn = stream(8).uniform().double().numpy().ravel()
    assert drawn.min() > 0
    assert drawn.max() < 1
    assert stats.kstest(drawn, stats.uniform.cdf).pvalue > 1e-4


@pytest.mark.parametrize("vary", ["pixel", "row", "column", "frame"])
def test_crop_of_the_sensor_is_a_crop_of_the_numbers(path, vary):
    whole = Stream([1, 2], [5, 5], 2, (range(40), range(50)))
    rows, columns = range(7, 31), range(13, 42)
    crop = whole.over(rows, columns)
    sliced = {
        "pixel": whole.normal("pixel")[..., 7:31, 13:42],
        "row": whole.normal("row")[..., 7:31, :],
        "column": whole.normal("column")[..., 13:42],
        "frame": whole.normal("frame"),
    }
    assert torch.equal(crop.normal(vary), sliced[vary])


def test_numbers_of_a_batch_are_those_of_its_images(path):
    window = (range(9), range(10))
    batch = Stream([1, 2], [5, 6], 3, window)
    for i, (key, camera) in enumerate([(1, 5), (2, 6)]):
        single = Stream([key], [camera], 3, window)
        assert torch.equal(batch.tukey_lambda(-0.2)[i], single.tukey_lambda(-0.2)[0])
        assert torch.equal(batch.fork("x").fixed.normal()[i], single.fork("x").fixed.normal()[0])


def test_fixed_numbers_belong_to_the_camera():
    window = (range(9), range(10))
    first, again, other = (Stream([i], [c], 1, window).fixed.normal() for i, c in ((1, 5), (2, 5), (2, 6)))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_a_count_depends_on_its_own_mean_alone(path):
    """Not on its neighbour's, whose root an even field shares."""
    levels = [50.0, 20.0, 20.0, 9.0, 50.0]
    mixed = torch.tensor(levels).repeat(200).expand(1, 1, 200, 1000)
    counts = stream(4).poisson(mixed)
    for place, level in enumerate(levels):
        even = stream(4).poisson(torch.full((1, 1, 200, 1000), level))
        assert torch.equal(counts[..., place::5], even[..., place::5])


@pytest.mark.parametrize("mean", [9.5, 12.0, 17.0, 24.0, 26.0, 60.0])
def test_poisson_quantiles_far_in_both_tails(mean):
    """Against SciPy's, at tails down to 2^-33: never more than one count apart, and equal up to a mean of 25."""
    bits = torch.tensor(
        [0, 1, 7, 60, 900, 40_000, 3_000_000, 2**31 - 1, 2**31, 2**32 - 500, 2**32 - 3, 2**32 - 1]
    )
    u = (bits.double().numpy() + 0.5) / 2**32
    found = distributions.poisson(torch.full((len(bits),), mean), bits).numpy()
    expected = stats.poisson.ppf(u, mean)
    if mean < 25:
        np.testing.assert_array_equal(found, expected)
    else:
        assert abs(found - expected).max() <= 1
