"""Compiled passes over frames against plain NumPy in float64."""

import numpy as np
import pytest

from visaug.frames import FrameRecord, FrameSet
from visaug.statistics import FrameData, Stacks, fingerprint_values
from visaug.statistics.kernels import median, median_of_sizes
from visaug.statistics.reduction import block_means, edges, without_lone_pixels
from visaug.statistics.stack import LAGS, Noise, Stack


def some_frames(count: int, shape=(37, 46), dtype=np.uint16) -> np.ndarray:
    """Frames with a fixed pattern, shifting rows and columns, heavy tails and a pair of pixels that jump together."""
    rng = np.random.default_rng(count)
    frames = 1000 + rng.normal(0, 5, shape) + 4 * rng.standard_t(3, (count, *shape))
    frames += rng.normal(0, 2, (count, shape[0], 1)) + rng.normal(0, 1, (count, 1, shape[1]))
    frames[:, 7, 8:10] += 90 * (np.arange(count) % 3 == 0)[:, None]
    return np.round(frames).astype(dtype)


def noise_of(frames: np.ndarray) -> np.ndarray:
    """Pixel part of the temporal noise, its definition."""
    x = frames.astype(np.float64)
    noise = (x - x.mean(0)) * np.sqrt(len(x) / (len(x) - 1))
    return (
        noise
        - noise.mean(2, keepdims=True)
        - noise.mean(1, keepdims=True)
        + noise.mean((1, 2), keepdims=True)
    )


def of_stack(frames: np.ndarray) -> Noise:
    return Noise([Stack(frames)])


def of_two(frames: np.ndarray) -> Noise:
    """The same frames as two stacks, every third in the second."""
    second = np.arange(len(frames)) % 3 == 2
    order = np.argsort(np.concatenate([np.flatnonzero(~second), np.flatnonzero(second)]))
    return Noise([Stack(frames[~second]), Stack(frames[second])], order)


@pytest.mark.parametrize("make", [of_stack, of_two])
@pytest.mark.parametrize("count", [3, 4, 9])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_noise(make, count, dtype):
    frames = some_frames(count, dtype=dtype)
    found, noise = make(frames), noise_of(frames)
    height, width = noise.shape[1:]
    variance = (noise**2).mean()
    np.testing.assert_allclose(found.mean, frames.mean(0, dtype=float), rtol=1e-6)
    np.testing.assert_allclose(found.frame_means, frames.mean((1, 2), dtype=float), rtol=1e-9)
    assert found.variance == pytest.approx(variance, rel=1e-5)
    assert found.correlations.keys() >= {(0, 1), (1, 0), (1, 1)}
    for (r, c), value in found.correlations.items():
        product = noise[:, : height - r, : width - c] * noise[:, r:, c:]
        assert value == pytest.approx(product.mean() / variance, abs=1e-5), (r, c)
    halves = (
        noise[:, :, : width // 2],
        noise[:, :, width // 2 :],
        noise[:, : height // 2],
        noise[:, height // 2 :],
    )
    np.testing.assert_allclose(found.halves, [(half**2).mean() for half in halves], rtol=1e-5)
    np.testing.assert_allclose(found.pixel_ratios, (noise**2).mean(0) / variance, rtol=1e-5, atol=1e-4)
    whole = frames - frames.mean(0, dtype=float)
    np.testing.assert_allclose(found.rows, found.bessel * whole.mean(2), atol=1e-6)
    np.testing.assert_allclose(found.columns, found.bessel * whole.mean(1), atol=1e-6)
    size = np.abs(noise)
    scale = 1.4826 * np.median(size[:, ::2, ::3])
    assert found.scale == pytest.approx(scale, rel=5e-5)
    tails = found.tails
    assert tails.mean_size == pytest.approx(size.mean(), rel=1e-5)
    near = np.clip(noise / np.sqrt(variance), -3, 3)
    assert tails.skewness == pytest.approx((near**3).mean(), abs=1e-5)
    assert tails.beyond == tuple(np.count_nonzero(size > limit * scale) for limit in (3, 5, 8, 20))
    up = noise > 8 * scale
    assert (tails.up, tails.down) == (np.count_nonzero(up), np.count_nonzero(noise < -8 * scale))
    assert tails.up > 0
    touching = np.count_nonzero(up[:, :, 1:] & up[:, :, :-1]) + np.count_nonzero(up[:, 1:] & up[:, :-1])
    assert tails.touching == touching > 0
    assert tails.recurring == np.count_nonzero((size > 3.5 * scale).sum(0) >= 3)
    limited = np.minimum(size, 4 * np.sqrt(variance)) ** 2
    np.testing.assert_allclose(found.limited_squares(4.0), limited.mean(0), rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(found.codes, np.bincount(frames.ravel().astype(int)))
    if dtype == np.uint16:
        np.testing.assert_array_equal(found.frames, frames)


def test_touching_pixels_below_each_other():
    frames = some_frames(6)
    frames[2, 20:22, 30] += 900
    alone = some_frames(6)
    assert of_stack(frames).tails.touching == of_stack(alone).tails.touching + 1


def test_fixed_pattern():
    """Rows, columns, blocks of 16 pixels and what is left, of a pattern with one dead pixel."""
    frames = some_frames(9, (40, 56))
    frames[:, 11, 13] = 0
    records = [FrameRecord(i, f"{i}", "bias", 0.0, 20.0) for i in range(9)]
    g = FrameData(FrameSet.from_arrays(records, frames, bit_depth=14)).bias
    assert g is not None
    pattern = frames.mean(0, dtype=float)
    pattern -= pattern.mean()
    np.testing.assert_allclose(g.pattern, pattern, atol=1e-3)
    calm = without_lone_pixels(pattern.astype(np.float32)).astype(float)
    assert calm[11, 13] == pytest.approx(
        np.sort(pattern[[10, 12, 11, 11], [13, 13, 12, 14]])[1:3].mean(), abs=1e-3
    )
    calm -= calm.mean()
    lines = calm.mean(1)[:, None] + calm.mean(0)
    left = pattern - lines
    cut = [edges(n, n // 16) for n in pattern.shape]
    for a, b in zip(cut[0], cut[0][1:], strict=False):
        for c, d in zip(cut[1], cut[1][1:], strict=False):
            left[a:b, c:d] -= (calm - lines)[a:b, c:d].mean()
    left -= left.mean()
    np.testing.assert_allclose(g.pattern_pixels, left, atol=2e-3)
    assert g.pattern_variance == pytest.approx((left**2).mean(), rel=1e-4)
    assert g.pattern_scale == pytest.approx(1.4826 * np.median(np.abs(left.ravel()[::4])), rel=1e-3)
    assert g.pattern_correlations.keys() >= {(0, 1), (1, 0), (1, 1)}
    for (r, c), value in g.pattern_correlations.items():
        if c < 12:
            product = left[: 40 - r, : 56 - c] * left[r:, c:]
            assert value == pytest.approx(product.mean() / (left**2).mean(), abs=1e-4)


def test_block_means():
    image = np.random.default_rng(1).normal(size=(23, 31)).astype(np.float32)
    rows, columns = edges(23, 3), edges(31, 4)
    means = block_means(image, rows, columns)
    for (a, b), value in np.ndenumerate(means):
        block = image[rows[a] : rows[a + 1], columns[b] : columns[b + 1]]
        assert value == pytest.approx(block.mean(dtype=float), abs=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 8, 101, 5000])
def test_median(count):
    rng = np.random.default_rng(count)
    for values in (rng.normal(size=count), rng.integers(0, 3, count), rng.exponential(size=count) ** 5):
        sizes = np.abs(values).astype(np.float32)
        assert median_of_sizes(sizes) == np.median(sizes.astype(float))


def test_two_uses_give_the_third_without_another_pass():
    """Of frames that find and frames that confirm, all frames have the statistics that they have by themselves."""
    records = [FrameRecord(i, f"{i}", "bias", 0.0, 20.0) for i in range(12)]
    frames = FrameSet.from_arrays(records, some_frames(12), bit_depth=14)
    confirm = range(2, 12, 3)
    find = [i for i in range(12) if i not in confirm]
    (alone,) = fingerprint_values(frames)
    *_, shared = fingerprint_values(frames, [find, confirm, range(12)])
    np.testing.assert_allclose(shared, alone, rtol=1e-4, atol=1e-4)
    assert shared.size == alone.size > 50
    stacks = Stacks(frames)
    for use in (find, confirm, range(12)):
        FrameData(frames, use, stacks=stacks).groups[0].noise.variance  # noqa: B018
    assert sorted(map(len, stacks._known)) == [4, 8]
    assert set(LAGS) == set(stacks.noise(tuple(range(12))).correlations)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 1000, 1001])
def test_a_median_is_numpys_to_the_bit(count):
    rng = np.random.default_rng(count)
    wide = 1e20 * rng.standard_cauchy(count)
    ends = np.where(rng.random(count) < 0.5, np.inf, rng.normal(size=count))
    for values in (
        rng.normal(size=count),
        rng.integers(-3, 3, count),
        rng.integers(900, 1100, count),
        wide,
        ends,
    ):
        numbers = values.astype(np.float32)
        assert median(numbers) == np.median(numbers)
    numbers[0] = np.nan
    assert np.isnan(median(numbers))
