"""Intervals of paired differences: SciPy's where there is one, and their coverage with three seeds."""

import numpy as np
import pytest
from scipy import stats

from visaug_train.statistics import image_variance, paired_interval, share_interval


def test_without_variance_of_images_it_is_students_t():
    values = np.array([[0.02], [0.05], [-0.01], [0.03]])
    low, high = paired_interval(values, np.zeros(1), 100)
    reference = stats.ttest_1samp(values[:, 0], 0).confidence_interval(0.95)
    assert (low[0], high[0]) == pytest.approx((reference.low, reference.high))


def test_one_seed_covers_the_images_alone():
    low, high = paired_interval(np.array([[0.1]]), np.array([0.02**2]), 51)
    assert high[0] - 0.1 == pytest.approx(0.02 * stats.t.ppf(0.975, 50))
    assert low[0] == pytest.approx(0.2 - high[0])
    assert np.isnan(paired_interval(np.array([[0.1]]), np.array([np.nan]), 51)[0]).all()


@pytest.mark.parametrize(("by_seed", "by_image"), [(0.05, 0.1), (0.05, 1.0), (0.0, 0.5)])
def test_it_covers_the_truth_as_often_as_it_says(by_seed, by_image):
    """Three seeds on the same 60 images. Of 4000 studies 95 % should be covered; Satterthwaite's approximation may be
    a little off, so 93.5 % are demanded: right coverage fails that with a probability below 1e-4.
    """
    rng = np.random.default_rng(12)
    covered, studies, images = 0, 4000, 60
    for _ in range(studies):
        each = by_image * rng.standard_normal(images) + 0.2 * rng.standard_normal((3, images))
        each = each + by_seed * rng.standard_normal((3, 1)) + 0.3
        variance = each.mean(axis=0).var(ddof=1) / images
        low, high = paired_interval(each.mean(axis=1, keepdims=True), np.array([variance]), images)
        covered += bool(low[0] <= 0.3 <= high[0])
    assert covered / studies > 0.935


@pytest.mark.parametrize("resamples", [0, 1])
@pytest.mark.filterwarnings("error")
def test_fewer_than_two_resamples_tell_nothing_of_the_images(resamples):
    """With several seeds the interval is then theirs alone, with one there is none."""
    resampled, gains, oracle = (
        np.ones((resamples, 2)),
        np.array([0.1, 0.11, 0.09]),
        np.array([0.2, 0.21, 0.2]),
    )
    assert np.isnan(image_variance(resampled)).all()
    low, high = share_interval(gains, oracle, resampled, 50)
    assert low < 0.5 < high
    assert share_interval(gains[:1], oracle[:1], resampled, 50) is None
