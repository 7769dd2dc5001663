"""What an effect changes in the simulated means and standard deviations."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.synthetic import ALL, FIND, PLAIN, WITH, pair, shifted, uses
from visaug.diagnosis.criterion import evidence
from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.uses import Use, scales, shifts
from visaug.diagnosis.state import tolerance

SHIFT = np.full(ALL, 0.8)


def test_common_random_numbers_lower_the_error_of_a_shift():
    """Sets that differ by an exact shift show it exactly, although their numbers differ and their means are noisy.

    Independent sets have the error of two means, within 15 % for 200 statistics (3 standard deviations).
    """
    common = shifts(*uses(pair(0, 0.0, SHIFT))) - 0.8
    apart = shifts(*uses(pair(0, 0.0, SHIFT, are_common=False))) - 0.8
    error = np.sqrt(1 / PLAIN + 1 / WITH)
    assert np.abs(common).max() < 1e-9
    assert abs(np.sqrt(np.mean(apart**2)) / error - 1) < 0.15


@pytest.mark.parametrize("counts", [(200, 30), (60, 120), (30, 200)])
def test_further_sets_of_either_camera_are_no_shift(counts):
    """The mean of 60 sets differs from that of 120 by 0.09 standard deviations in each of 300 statistics, which is noise."""
    assert np.abs(shifts(*uses(pair(0, 0.0, 0.0, counts=counts)))).max() < 1e-9
    np.testing.assert_allclose(shifts(*uses(pair(0, 0.0, SHIFT, counts=counts))), SHIFT[:FIND], atol=1e-9)


def test_fewer_sets_without_an_effect_are_no_evidence_for_it():
    """Equal cameras of 60 and 120 sets, and a measurement like them: without a shift the ratio of their likelihoods is 1."""
    found = evidence(*pair(5, 0.0, 0.0, counts=(60, 120)), 1)
    assert found.found + found.confirmed == pytest.approx(0, abs=1e-6)


def test_a_little_scatter_leaves_most_of_what_common_random_numbers_gain():
    """Scatter of 0.3 leaves an error of 0.3 / sqrt(120), a quarter of that of independent sets."""
    common = shifts(*uses(pair(1, 0.0, SHIFT, scatter=0.3))) - 0.8
    assert np.sqrt(np.mean(common**2)) < 1.3 * 0.3 / np.sqrt(WITH)


def test_a_shift_within_its_noise_is_zero():
    """Independent sets of two equal cameras: 68 % of the differences are within a standard error.

    False alarms: less than 1e-3 per bound, for 200 independent statistics.
    """
    found = shifts(*uses(pair(2, 0.0, 0.0, are_common=False)))
    assert 0.57 < np.mean(found == 0) < 0.79
    large = shifts(*uses(pair(2, 0.0, 20.0, are_common=False)))
    assert np.abs(large - 20.0).max() < 0.5  # a large one is not shrunk


def test_sets_of_a_measurement_do_not_matter_to_a_shift():
    """The measured residual is in both states and cancels."""
    one, other = (shifts(*uses(pair(3, truth, SHIFT))) for truth in (0.0, 50.0))
    np.testing.assert_allclose(one, other, atol=1e-9)


def use(scale: np.ndarray, sets: int) -> Use:
    """A use of the frames with these standard deviations, known from so many sets."""
    null = SimpleNamespace(scale=scale, scale_of=lambda _: scale)
    count = len(scale)
    return Use(np.zeros(count), np.zeros((sets, count)), null, np.zeros(count))  # pyrefly: ignore[bad-argument-type]


def test_standard_deviations_within_their_noise_are_pooled():
    """Three standard errors of the logarithm of a ratio are 0.27 for 120 sets."""
    one = np.ones(4)
    plain, own = scales(use(one, 200), use(np.array([1.2, 1.35, 2.0, 0.5]), 120))
    pooled = np.sqrt((200 + 120 * 1.2**2) / 320)
    np.testing.assert_allclose(plain, [pooled, 1, 1, 1])
    np.testing.assert_allclose(own, [pooled, 1.35, 2, 0.5])


def test_few_sets_pool_what_many_keep_apart():
    one, other = np.ones(1), np.full(1, 1.35)
    for sets, are_pooled in ((120, False), (30, True)):
        plain, own = scales(use(one, 200), use(other, sets))
        assert bool(plain[0] == own[0]) is are_pooled


def test_a_rare_event_in_further_sets_is_not_caused_by_the_effect():
    """One pixel in set 80, of the same camera: in none of 60 sets, and in one of 120."""
    rare = np.zeros((120, 1))
    rare[80] = 5.0
    nulls = [Null(rare[:count], np.full(1, 0.1), np.zeros((1, 0)), np.ones(0)) for count in (60, 120)]
    fewer, more = (Use(np.zeros(1), null.residuals, null, np.zeros(1)) for null in nulls)
    assert nulls[1].scale > 4 * nulls[0].scale
    for before, after in ((fewer, more), (more, fewer)):
        plain, own = scales(before, after)
        assert plain == own


def test_a_statistic_that_is_constant_in_one_camera_has_no_standard_deviation():
    plain, own = scales(use(np.array([0.0, 1.0, 0.0]), 200), use(np.array([1.0, 0.0, 0.0]), 120))
    assert not plain.any()
    assert not own.any()


def test_equal_cameras_have_equal_standard_deviations_in_simulated_sets():
    """At three standard errors 0.3 % of the pairs would be kept apart: of 200 pairs more than 5 in one draw of 4000.

    A factor of 2 is found in all.
    """
    plain, own = scales(*uses(pair(4, 0.0, 0.0, are_common=False)))
    assert np.count_nonzero(plain != own) <= 5
    plain, own = scales(*uses(pair(4, 0.0, 0.0, scatter=np.sqrt(3.0))))
    assert np.count_nonzero(plain != own) == FIND
    np.testing.assert_allclose(np.median(own / plain), 2, rtol=0.05)


def test_tolerance_is_added_to_the_standard_deviations():
    null = Null(
        np.array([[1.0, 0.0], [-1.0, 0.0]]) / np.sqrt(2), np.array([0.5, 0.0]), np.zeros((2, 0)), np.ones(0)
    )
    one = Use(np.array([10.0, 10.0]), np.zeros((2, 2)), null, np.array([3.0, 3.0]))
    np.testing.assert_allclose(one.scale, [np.sqrt(10), 0])
    np.testing.assert_allclose(one.z, [np.sqrt(10), 0])  # a constant statistic is no evidence


def test_an_accepted_effect_leaves_a_tolerance_of_what_it_explains():
    """A tenth of each residual that it removes; nothing where it removes none."""
    shift = shifted(3, 50.0)
    before, after = pair(5, shift, shift)
    for use_before, use_after in (
        (before.find, after.find),
        (before.confirm, after.confirm),
        (before.whole, after.whole),
    ):
        explained = np.maximum(np.abs(use_before.residual) - np.abs(use_after.residual), 0)
        np.testing.assert_allclose(use_after.allowance, FORM * explained)
        assert use_after.allowance.max() > 4
    again = after.with_effect("smear", after.fitted)  # it explains nothing
    np.testing.assert_allclose(again.find.allowance, after.find.allowance)
    assert evidence(before, after, 1).accepts


def test_the_tolerance_holds_in_the_whole_view_that_an_effect_changes():
    """A tenth of the root mean square there, in standard deviations, where it explains less of a statistic itself."""
    explained, scale = np.array([60.0, 0.0, 0.0, 0.0, 4.0, 5.0]), np.array([2.0, 1.0, 3.0, 0.0, 1.0, 0.0])
    found = tolerance(explained, scale, np.array([0, 0, 0, 0, 1, 2]))
    square = 30.0**2 / 3  # the fourth statistic is constant
    np.testing.assert_allclose(found, [6.0, 0.1 * square**0.5, 0.3 * square**0.5, 0.0, 0.4, 0.5])


def test_a_camera_is_adequate_if_its_largest_residual_is_as_in_simulated_sets():
    """With the tolerance of an effect's form a small share of what it explains is no deviation."""
    shift = shifted(3, 50.0)
    before, after = pair(6, shift, shift)
    assert not before.is_adequate
    assert after.is_adequate
    _, form = pair(6, 1.1 * shift, shift)  # 5 standard deviations stay, as many as the tolerance
    assert form.is_adequate
    _, other = pair(6, 1.5 * shift, shift)
    assert not other.is_adequate
