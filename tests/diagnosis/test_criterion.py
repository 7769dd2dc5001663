"""The evidence of an effect that is the cause, of one that is not, and of noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.diagnosis.synthetic import ALL, FIND, PLAIN, WITH, pair, shifted, state
from visaug.diagnosis import criterion
from visaug.diagnosis.criterion import ODDS, Evidence, between, evidence, log_odds
from visaug.diagnosis.fitting.parameters import Coordinate
from visaug.diagnosis.fitting.robust import adjust

EFFECT = shifted(5, 4.0)  # 60 of 300 statistics
HIT = EFFECT != 0
DRAWS = 50


def drawn(truth, shift, parameters: int = 1, **further) -> list[Evidence]:
    return [evidence(*pair(seed, truth, shift, **further), parameters) for seed in range(DRAWS)]


@pytest.mark.parametrize("size", [2.0, 4.0, 40.0])
def test_the_cause_is_accepted_and_has_the_evidence_of_its_own_sets(size):
    """All but one in 50. The share differs from 1 by the noise of 60 residuals, at most 0.3 in the median draw."""
    shift = size / 4 * EFFECT
    found = drawn(shift, shift)
    assert sum(e.accepts for e in found) >= DRAWS - 1
    shares = np.array([e.share for e in found])
    assert abs(np.median(shares) - 1) < 0.1
    assert np.median(np.abs(shares - 1)) < 0.3


def test_evidence_of_simulated_sets_has_the_law_of_that_of_the_measurement():
    """Ranks of the measurement among its simulated sets are uniform: of 50 draws, 17 to 33 are in the lower half.

    False alarms: 2 % for exactly uniform ranks. The seeds are fixed.
    """
    ranks = [np.mean(e.of_sets <= e.found + e.confirmed) for e in drawn(EFFECT, EFFECT)]
    assert 17 <= np.count_nonzero(np.array(ranks) < 0.5) <= 33


def test_an_effect_that_shifts_some_of_the_deviating_statistics_and_others_is_refused():
    """Two of three of its shifts are there. Its score is large; it has a third of the evidence that it would have as the cause."""
    truth = np.where(np.arange(ALL) // 5 % 3 < 2, EFFECT, 0.0)
    found = drawn(truth, EFFECT)
    assert all(e.score > 5 * criterion.ODDS for e in found)
    assert np.median([e.share for e in found]) < criterion.SHARE
    assert sum(e.accepts for e in found) <= 5


@pytest.mark.parametrize("size", [1.0, 4.0, 40.0])
def test_an_effect_with_wrong_signs_is_refused(size):
    """It shifts the same statistics by as much, half of them the wrong way.

    Where that makes large residuals larger it costs no more than the logarithm of 2 each, and the odds can be large. It has
    less than half of the evidence that it would have as the cause.
    """
    right = size / 4 * EFFECT
    wrong = np.where(np.arange(ALL) // 10 % 2, right, -right)
    found = drawn(right, wrong)
    assert not any(e.accepts for e in found)
    assert np.median([e.share for e in found]) < 0.5


def fitted_to_noise(seed: int) -> Evidence:
    """The evidence of an effect whose strength is fitted to the noise of the discovery frames."""
    (before, _), along = pair(seed, 0.0, 0.0), np.ones(FIND) / np.sqrt(FIND)
    strength = float(along @ before.find.residual)
    shift = np.append(strength * along, np.zeros(ALL - FIND))
    return evidence(*pair(seed, 0.0, shift), 1)


def test_noise_is_accepted_as_rarely_as_its_odds_say():
    """One strength gains chi-squared / 2 with one degree of freedom, and costs 1: log odds above 3 have a probability of 0.5 %.

    False alarms: 1e-3 for more than 5 of 200.
    """
    found = [fitted_to_noise(seed) for seed in range(200)]
    assert sum(e.accepts for e in found) <= 5
    assert sum(e.odds > 0 for e in found) >= 10  # of 200 a fifth gain more than 1


def test_a_shift_that_is_not_there_is_refused():
    assert not any(e.accepts for e in drawn(0.0, EFFECT))


def test_each_parameter_costs_half_the_logarithm_of_the_number_of_shifted_statistics():
    costs = [evidence(*pair(0, EFFECT, EFFECT), parameters).cost for parameters in (0, 1, 4)]
    one = 0.5 * np.log(np.count_nonzero(HIT))
    np.testing.assert_allclose(costs, [0, one, 4 * one])
    single = np.where(np.arange(ALL) == 0, 8.0, 0.0)
    assert evidence(*pair(0, single, single), 3).cost == 3  # at least 1 each


def test_an_effect_of_many_costs_their_logarithm():
    one, many = (evidence(*pair(0, EFFECT, EFFECT), 1, effects) for effects in (1, 30))
    assert many.cost - one.cost == pytest.approx(np.log(30))
    assert one.odds - many.odds == pytest.approx(np.log(30))
    assert one.score - many.score == pytest.approx(np.log(30))


@pytest.mark.parametrize(("slope", "share"), [(1e3, 1.0), (0.0, 0.0)])
def test_a_parameter_that_the_frames_do_not_determine_costs_nothing(slope, share):
    """As the temperature coefficient of hot pixels in frames of one temperature."""
    before, after = pair(0, EFFECT, EFFECT)
    sets = after.fitted.reference
    told = state(sets.whole.mean + after.fitted.whole_residual, sets.whole.sets, slope=slope * EFFECT).fitted
    one = evidence(before, before.with_effect("row_noise", told), 2)
    none = evidence(before, after, 1).cost
    assert one.cost == pytest.approx((1 + share) * none, rel=1e-3)


def normal(mean: float, deviation: float, count: int = 200) -> np.ndarray:
    """Normal samples with exactly this mean and standard deviation."""
    samples = stats.norm.ppf((np.arange(count) + 0.5) / count)
    return mean + deviation * samples / samples.std(ddof=1)


def test_odds_are_those_of_the_distributions_of_the_ratio():
    """Two normal distributions of one width s at +m and -m have log odds of 2 m x / s^2."""
    for x in (-10.0, 0.0, 5.0, 20.0):
        assert log_odds(x, normal(20, 8), normal(-20, 8)) == pytest.approx(2 * 20 * x / 64, abs=1e-6)


def test_more_evidence_for_an_effect_is_none_against_it():
    """Also where its own distribution is the narrower one."""
    own, other = normal(50, 10), normal(-50, 40)
    odds = [log_odds(x, own, other) for x in (20.0, 40.0, 50.0, 100.0, 1000.0)]
    assert odds == sorted(odds)
    assert odds[-1] == odds[-2] == odds[-3]


def test_an_effect_whose_sets_have_no_more_evidence_than_others_has_no_odds():
    """A refit that left nothing of it: its sets have a ratio of 0, and sets without it gain by the fit of noise."""
    gained = stats.chi2.ppf((np.arange(200) + 0.5) / 200, 1) / 2
    assert log_odds(0.0, np.zeros(120), gained) == 0.0
    assert not Evidence(0.0, 0.0, 4.4, np.zeros(120), gained, 0.0, np.zeros(120)).accepts


@pytest.mark.parametrize("freedom", [1, 2, 6])
def test_the_tail_of_a_chi_squared_distribution_is_not_taken_as_normal(freedom):
    """The log density at eight standard deviations is within 3 of the exact one. A normal distribution is wrong by more than 10."""
    samples = stats.chi2.ppf((np.arange(200) + 0.5) / 200, freedom)
    far = freedom + 8 * np.sqrt(2 * freedom)
    density = log_odds(far, normal(far, 1.0), samples) - stats.norm.logpdf(0)
    assert -density == pytest.approx(stats.chi2.logpdf(far, freedom), abs=3)
    assert stats.norm.logpdf(8) - np.log(np.sqrt(2 * freedom)) < -density - 10


COPIES = np.where(
    np.arange(ALL) % 10 == 0, 1.0, 0.0
)  # statistics that share one random number: a fixed pattern


def patterned(seed: int, size: float) -> tuple[float, Evidence]:
    """A pattern of unit variance in 30 statistics of all frames, and an effect that shifts exactly these, fitted by its strength.

    Returns how large the pattern is in the measurement, and the evidence of the effect.
    """
    rng = np.random.default_rng(seed)

    def drawn(count: int) -> np.ndarray:
        return 0.3 * rng.standard_normal((count, ALL)) + COPIES * rng.standard_normal((count, 1))

    plain, (measured,) = drawn(PLAIN), drawn(1)
    measured = measured + size * COPIES
    strength = float(measured @ COPIES / COPIES.sum())
    before = state(measured, plain)
    after = state(measured, plain[:WITH] + strength * COPIES, slope=COPIES).fitted
    return strength, evidence(before, before.with_effect("row_noise", after), 1, 30)


@pytest.mark.parametrize("draws", [50, pytest.param(150, marks=pytest.mark.slow)])
def test_a_pattern_that_is_fixed_by_chance_is_not_an_effect(draws):
    """It is the same in all 30 statistics, on discovery and hold-out frames: a score of hundreds, and odds near z^2 / 2.

    Of 150 draws none is accepted: 3 % would have odds above 3 and a cost of 5 by the normal distribution alone, and with these
    none of 150 would be accepted with a probability of 1 %, of 50 with 22 %.
    """
    found = [patterned(seed, 0.0) for seed in range(draws)]
    assert not any(e.accepts for _, e in found)
    scores = [e.score for z, e in found if abs(z) > 2]
    assert np.median(scores) > 10 * ODDS
    assert all(e.odds + e.cost < 0.5 * z**2 + 5 for z, e in found)


def test_an_effect_far_beyond_the_chance_of_such_a_pattern_is_accepted():
    assert sum(patterned(seed, 8.0)[1].accepts for seed in range(DRAWS)) >= DRAWS - 1


@pytest.mark.parametrize(
    ("found", "of_sets", "accepts"),
    [
        (10.0, normal(10, 1), True),
        (10.0, normal(18, 5), True),
        (10.0, normal(19, 2), False),  # falls short
        (10.0, np.append(np.repeat(9.0, 30), normal(100, 1, 170)), True),  # of its sets 15 % have less
        (10.0, np.append(np.repeat(9.0, 10), normal(100, 1, 190)), False),
    ],
)
def test_odds_and_reach_must_both_hold(found, of_sets, accepts):
    away = normal(-100, 1)
    reach = (found, of_sets)
    assert Evidence(found, 0.0, 0.0, of_sets, away, *reach).accepts is accepts
    assert not Evidence(found, 0.0, 0.0, of_sets, of_sets, *reach).accepts  # as probable without the effect
    assert not Evidence(found, 0.0, 1e5, of_sets, away, *reach).accepts


def test_the_cause_has_the_odds_against_another_effect():
    """Both shift 60 statistics, of which 30 are the same. Odds of the reverse pair are the opposite."""
    one, other = shifted(5, 1.5), shifted(10, 1.5) + np.roll(shifted(10, 1.5), 3)
    for cause, rival in ((one, other), (other, one)):
        odds, back = [], []
        for seed in range(DRAWS):
            (before, right), (_, wrong) = pair(seed, cause, cause), pair(seed, cause, rival)
            odds.append(between(before, right, wrong))
            back.append(between(before, wrong, right))
        assert sum(o > 0 for o in odds) >= DRAWS - 1
        np.testing.assert_allclose(odds, -np.array(back), rtol=1e-3)


def test_sets_that_differ_in_a_strength_are_no_evidence_against_a_rival_that_fits_it():
    """The cause's strength differs from set to set by 30 standard errors, the rival has it as a parameter: the same law.

    Without the fit of the rival to these sets all odds are below -1. With it some 30 of 50 are above; fewer than 20 have a
    probability of 1e-3.
    """
    shift = shifted(5, 1.5)
    along = shift / np.linalg.norm(shift)
    odds = []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        plain, strengths = rng.standard_normal((PLAIN, ALL)), 30 * rng.standard_normal(WITH + 1)
        measured = rng.standard_normal(ALL) + shift + strengths[0] * along
        before = state(measured, plain)
        varying = state(measured, plain[:WITH] + shift + np.outer(strengths[1:], along)).fitted
        fitted = state(measured, plain[:WITH] + (along @ measured) * along, slope=along).fitted
        odds.append(between(before, *(before.with_effect("row_noise", one) for one in (varying, fitted))))
    assert np.count_nonzero(np.array(odds) > -1) >= 20


def test_a_ratio_that_no_effect_predicts_is_no_evidence_for_the_one_whose_sets_differ_more():
    """A cause outside both takes from each statistic of the right effect a sixth of its shift.

    The rival shifts a third of these statistics, by a strength that differs from set to set. The ratio lies nearer to its sets,
    in their standard deviations, although the right effect explains far more.
    """
    right, part = shifted(5, 30.0), np.where(np.arange(ALL) < ALL // 3, shifted(5, 30.0), 0.0)
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        plain = rng.standard_normal((PLAIN, ALL))
        measured = rng.standard_normal(ALL) + right * 5 / 6
        before = state(measured, plain)
        exact = state(measured, plain[:WITH] + right).fitted
        varying = state(measured, plain[:WITH] + rng.normal(1, 1, (WITH, 1)) * part).fitted
        one, other = (before.with_effect("row_noise", fitted) for fitted in (exact, varying))
        assert between(before, one, other) > ODDS
        assert between(before, other, one) == pytest.approx(-between(before, one, other))


def test_outliers_that_the_effect_hardly_shifts_do_not_change_the_decision():
    """A further effect shifts other statistics by 100, which this effect shifts by 0.5 the wrong way.

    A normal density would refuse it.
    """
    other = shifted(5, 100.0)
    elsewhere = np.roll(other, 2)
    shift = EFFECT - 0.005 * elsewhere
    alone, beside = drawn(EFFECT, EFFECT), drawn(EFFECT + elsewhere, shift)
    assert sum(e.accepts for e in alone) >= DRAWS - 1
    assert sum(e.accepts for e in beside) >= DRAWS - 1
    odds = [np.median([e.odds for e in found]) for found in (alone, beside)]
    assert abs(odds[1] / odds[0] - 1) < 0.1
    assert 0.5 * 100 * np.count_nonzero(elsewhere) > 5 * odds[0]  # what a normal density would have cost


def test_one_statistic_alone_is_not_worth_more_than_the_logarithm_of_its_size():
    """The residual of one statistic, 1000 standard deviations, limits the evidence of an effect that removes it."""
    single = np.where(np.arange(ALL) == 3, 1000.0, 0.0)
    found = evidence(*pair(1, single, single), 1)
    assert found.accepts
    assert found.found < 12


def test_few_sets_and_many_give_the_same_evidence():
    """The noise of simulated means and standard deviations adds no likelihood: the same within 10 % in the median."""
    common, apart = (drawn(EFFECT, EFFECT, are_common=c) for c in (True, False))
    medians = [np.median([e.found + e.confirmed for e in found]) for found in (common, apart)]
    assert WITH < PLAIN
    assert abs(medians[1] / medians[0] - 1) < 0.1


def test_an_effect_that_changes_no_standard_deviation_gains_nothing_by_their_noise():
    """Sets with common random numbers and no shift: the two numbers of sets alone make standard deviations differ."""
    assert all(abs(e.found + e.confirmed) < 0.01 for e in drawn(0.0, 0.0))


def test_an_effect_of_pure_scatter_is_accepted_where_it_is_and_refused_where_it_is_not():
    """It multiplies the standard deviation of 60 statistics by 3. The residuals of a camera without it are too small."""
    extra = np.where(HIT, np.sqrt(8.0), 0.0)
    there = drawn(0.0, 0.0, true_scatter=extra, scatter=extra)
    absent = drawn(0.0, 0.0, scatter=extra)
    assert sum(e.accepts for e in there) >= DRAWS - 1
    assert not any(e.accepts for e in absent)


PART, REST = (np.where(np.arange(ALL) % 10 < n, 1.0, 0.0) for n in (2, 4))
RARELY = np.roll(shifted(15, 30.0), 1)  # 20 statistics that the effect does not shift otherwise


def in_few(seed: int, hit: float = 0.0) -> Evidence:
    """Of an effect that shifts 20 statistics by 30 in a fifth of all specimens only, beside those that it shifts in each.

    Args:
        hit: share of these shifts that the measured specimen has.
    """
    rng = np.random.default_rng(seed)
    plain, own = (rng.standard_normal((PLAIN, ALL)) for _ in range(2))
    own = own[:WITH] + EFFECT + RARELY * (rng.random((WITH, ALL)) < 0.2)
    measured = rng.standard_normal(ALL) + EFFECT + hit * RARELY
    before = state(measured, plain)
    return evidence(before, before.with_effect("row_noise", state(measured, own).fitted), 1)


def test_a_specimen_without_a_rare_shift_is_no_evidence_against_the_effect(monkeypatch):
    """As missing codes among the few codes of dark frames. One normal law of 12 standard deviations costs log 12 for each."""
    assert sum(in_few(seed).accepts for seed in range(DRAWS)) >= DRAWS - 1
    assert sum(in_few(seed, 1.0).accepts for seed in range(DRAWS)) >= DRAWS - 1
    few = np.median([in_few(seed).found + in_few(seed).confirmed for seed in range(10)])
    monkeypatch.setattr(criterion, "rare", lambda *_: None)
    one_law = np.median([in_few(seed).found + in_few(seed).confirmed for seed in range(10)])
    assert few - one_law == pytest.approx(20 * np.log(12 * 0.8), rel=0.2)


def test_sets_without_the_effect_are_fitted_with_their_own_standard_deviations():
    """The effect adds variance to most of what determines the camera's parameter, at the strength of its sets and not at 0.

    With their standard deviations the refit would lose more than 5; there the strength gains half a chi-squared at most.
    """
    rng = np.random.default_rng(0)
    plain, own = (rng.standard_normal((n, ALL)) for n in (PLAIN, WITH))
    where = (REST > 0) & (np.arange(ALL) % 50 > 3)
    measured = rng.standard_normal(ALL)
    before = state(measured, plain, slope=REST)
    after = state(measured, own + 30 * where * rng.standard_normal(own.shape), slope=REST).fitted
    of_strength = Coordinate("row_noise.rows", False, 0.1, 1e3)
    samples = {
        use: replace(sample, slopes=np.column_stack([sample.slopes, shift]))
        for use, shift in (("find", EFFECT[:FIND]), ("confirm", EFFECT[FIND:]), ("whole", EFFECT))
        for sample in [getattr(after.reference, use)]
    }
    both = replace(after.reference, coordinates=(*after.reference.coordinates, of_strength), **samples)
    found = evidence(before, before.with_effect("row_noise", replace(after, reference=both)), 1)
    assert -1 < found.of_null.mean() < 1


def refitted(measured: np.ndarray, sets: np.ndarray):
    """A camera with one parameter that shifts `REST`, fitted to the measurement."""
    begun = state(measured, sets, slope=REST).fitted
    reference = begun.reference
    (step,) = adjust(begun.residual[None], reference.slopes, reference.scale, reference.priors)
    return state(measured - step[0] * REST, sets, slope=REST)


def wandering(seed: int) -> Evidence:
    """Of an effect that moves `PART` by one random number, of which the camera without it absorbs a part by its parameter."""
    rng = np.random.default_rng(seed)
    plain, number = rng.standard_normal((PLAIN, ALL)), 6 * rng.standard_normal(WITH + 1)
    measured = rng.standard_normal(ALL) + number[0] * PART
    before = refitted(measured, plain)
    after = refitted(measured, plain[:WITH] + np.outer(number[1:], PART)).fitted
    return evidence(before, before.with_effect("row_noise", after), 0)


def test_sets_with_an_effect_are_fitted_by_the_camera_without_it_as_the_measurement_is():
    """Ranks of the measurement among its simulated sets are uniform: of 50 draws, 17 to 33 are in the lower half.

    False alarms: 1.5 %. Without the fit the camera without the effect would explain less of these sets than of the measurement.
    """
    found = [wandering(seed) for seed in range(DRAWS)]
    ranks = [np.mean(e.of_sets <= e.found + e.confirmed) for e in found]
    assert 17 <= np.count_nonzero(np.array(ranks) < 0.5) <= 33


def test_evidence_is_decided_where_halves_of_all_its_sets_decide_alike():
    """Sets in turn with little and with much evidence: the halves differ, in the ratio or in the joint ratio."""
    away, mixed = normal(-100, 1), np.tile([9.0, 100.0], 100)
    assert Evidence(10.0, 0.0, 0.0, normal(10, 1), away, 10.0, normal(10, 1)).is_decided
    assert not Evidence(10.0, 0.0, 0.0, normal(10, 1), away, 10.0, mixed).is_decided
    assert not Evidence(10.0, 0.0, 0.0, mixed, away, 10.0, normal(10, 1)).is_decided


DRIFT = [np.where(np.arange(ALL) % 10 == n, 1.0, 0.0) for n in (1, 2, 3)]  # a frame each, of 30 statistics


def drifting(seed: int, numbers: float) -> Evidence:
    """Of an effect that shifts statistics, and others of three frames by one random number each, measured with these numbers."""
    rng = np.random.default_rng(seed)
    plain = rng.standard_normal((PLAIN, ALL))
    before = state(rng.standard_normal(ALL) + EFFECT + numbers * sum(DRIFT), plain)
    drifts = 30 * rng.standard_normal((WITH, 3)) @ np.array(DRIFT)
    after = state(before.fitted.whole_residual + plain.mean(0), plain[:WITH] + EFFECT + drifts).fitted
    return evidence(before, before.with_effect("light_drift", after), 0)


def test_a_frame_that_drew_little_of_a_drift_counts_once_and_not_for_each_of_its_statistics():
    """Where three frames drew nothing, their 90 statistics take most of the ratio, of which the other 60 hold their part."""
    found = [drifting(seed, 0.0) for seed in range(10)]
    assert all(e.accepts for e in found)
    assert np.median([e.found + e.confirmed for e in found]) < criterion.SHARE * np.median(found[0].of_sets)
    assert all(drifting(seed, 30.0).accepts for seed in range(10))


def test_of_statistics_that_follow_one_random_number_each_has_its_share_of_the_weight():
    """A tenth of the statistics of each use are copies of one number. The others have a weight of 1, less what chance takes."""
    rng = np.random.default_rng(0)
    plain = rng.standard_normal((PLAIN, ALL))
    copies = 1e3 * DRIFT[0] * rng.standard_normal((WITH, 1))
    before = state(rng.standard_normal(ALL), plain)
    after = before.with_effect("light_drift", state(rng.standard_normal(ALL), plain[:WITH] + copies).fitted)
    for ratio, use in zip(criterion._ratios(before, after), (slice(FIND), slice(FIND, ALL)), strict=True):
        of_copies = DRIFT[0][use] > 0
        np.testing.assert_allclose(ratio.weights[of_copies], 1 / of_copies.sum(), rtol=0.1)
        assert np.median(ratio.weights[~of_copies]) > 0.8


def test_what_an_effect_predicts_exactly_counts():
    """Every 50th statistic is 40 below without scatter, as of lost bits, and the rival leaves two standard deviations of it.

    The rival has the evidence of these statistics as far as it explains them, so without theirs it would be preferred.
    """
    places = np.arange(ALL) % 50 == 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        plain, measured = rng.standard_normal((PLAIN, ALL)), rng.standard_normal(ALL)
        measured[places] = -40.0
        exact, rival = plain[:WITH].copy(), plain[:WITH].copy()
        exact[:, places] = -40.0
        rival[:, places] -= 38.0
        before = state(measured, plain)
        one, other = (
            before.with_effect("row_noise", state(measured, sets).fitted) for sets in (exact, rival)
        )
        assert evidence(before, one, 0).accepts
        assert between(before, one, other) > ODDS
