"""Laws, signatures and rivals: which candidate matches what is left."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import erfc

from tests.diagnosis import states
from visaug import Camera
from visaug.diagnosis.candidates import refinement, selection
from visaug.diagnosis.candidates.matches import NEAR_ENOUGH, Match, best_of_each, matches
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.candidates.selection import first_matches
from visaug.diagnosis.candidates.signatures import Signatures, is_random, own_variance
from visaug.diagnosis.candidates.trials import Trial, beside_words, effect_trials, form_trials
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import Metric, law, scatter_along
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.robust import shrunk
from visaug.effects import catalogue


def test_shrinkage_keeps_strong_correlations_and_drops_chance():
    rng = np.random.default_rng(1)
    base = rng.normal(size=(300, 40))
    base[:, 1] = base[:, 0]
    correlation = shrunk(base)
    assert correlation[0, 1] > 5 * np.abs(correlation[2:, 2:] - np.eye(38)).max() or correlation[0, 1] > 0.4
    assert np.linalg.eigvalsh(correlation).min() > 0
    np.testing.assert_allclose(np.diag(correlation), 1)


def test_scatter_tells_how_far_a_law_is_wrong_about_new_sets():
    """300 statistics of 100 sets that share five modes: how far the law of these sets is wrong about new ones."""
    rng = np.random.default_rng(6)
    modes = rng.normal(size=(5, 300))

    def sets(count: int) -> np.ndarray:
        return rng.normal(size=(count, 300)) + 0.5 * rng.normal(size=(count, 5)) @ modes

    null = Null(sets(100), np.full(300, 1e-9), np.zeros((300, 1)), np.ones(1))
    nothing = np.zeros(300)
    m = law(null, nothing)
    ways = np.vstack([modes, nothing])
    told = scatter_along(null, nothing, ways)
    white = m.white(modes)
    new = ((m.white(sets(1000)) @ white.T) ** 2).mean(0) / (white**2).sum(1)
    assert new.min() > 2
    np.testing.assert_allclose(told[:5], new, rtol=0.4)
    assert told[5] == 1


def test_a_law_widened_in_a_few_statistics_is_the_law_of_the_wider_covariance():
    rng = np.random.default_rng(7)
    mixing = rng.normal(size=(40, 40)) / 6 + np.eye(40)
    m = Metric(np.arange(50) < 40, rng.uniform(0.5, 2, 40), mixing @ mixing.T)
    residual, variance = rng.normal(size=50) * 5, np.where(np.arange(50) % 7 == 0, 30.0, 0.0)
    expected = m.widened(variance).log_likelihood(residual)
    assert m.widened_log_likelihood(residual, variance) == pytest.approx(expected, rel=1e-9)
    assert expected > m.log_likelihood(residual) + 1


def standing(residual: np.ndarray) -> Fitted:
    """What is left of a camera whose statistics are independent, in standard deviations."""
    count = len(residual)
    null = np.random.default_rng(3).normal(size=(400, count))
    scale = np.ones(count)
    reference = SimpleNamespace(null=Null(null, scale, np.zeros((count, 1)), np.ones(1)), null_scale=scale)
    return Fitted(reference, None, residual, np.zeros(count), residual)  # pyrefly: ignore[bad-argument-type]


def a_trial(path: str, looked: bool = False) -> Trial:
    return Trial(path.split(".")[0], ((path, 0.1),), looked=looked)


def test_an_effect_of_one_statistic_is_tried_beside_one_of_many():
    """A pattern in the longest dark, fourteen deviations off, beside a seam that a little of everything resembles."""
    one, many = np.zeros(60), np.zeros(60)
    one[0], many[10:40] = 14.0, 1.4
    tried = (a_trial("dark_current_nonuniformity.spread"), a_trial("tap_mismatch.gain"))
    signs = Signatures(tried, np.array([one, many]), np.zeros((2, 60)))
    _, chosen = first_matches(signs, standing(one + many), frozenset(), 0.0)
    assert [m.trial.effect for m in chosen] == ["tap_mismatch", "dark_current_nonuniformity"]


def test_what_was_seen_in_the_frames_takes_no_effects_place():
    """A step that chance made in the columns resembles them best; charge in every frame is what moves the skewness."""
    one, many = np.zeros(60), np.zeros(60)
    one[0], many[10:40] = 4.5, 1.4
    tried = (a_trial("clock_induced_charge.mean_e"), a_trial("tap_mismatch.gain", looked=True))
    signs = Signatures(tried, np.array([one, many]), np.zeros((2, 60)))
    _, chosen = first_matches(signs, standing(one + many), frozenset(), 0.0)
    assert [m.trial.effect for m in chosen] == ["tap_mismatch", "clock_induced_charge"]


def test_an_effect_is_tried_for_what_its_best_trial_gains_though_it_starts_from_another(monkeypatch):
    """The banding that was looked for gains 12.6, of the 1/f noise the strong trial a fifth of it, the weak one a little less."""
    nothing = np.zeros(60)

    def match(path: str, gain: float, scale: float) -> Match:
        return Match(a_trial(path), gain, scale, nothing)

    strong, weak = match("flicker_noise.sigma_e", 2.6, 0.03), match("flicker_noise.sigma_e", 2.4, 0.5)
    tried = [
        match("periodic_banding.amplitude_e", 12.6, 0.7),
        strong,
        weak,
        match("row_noise.sigma_e", 2.4, 0.5),
    ]
    monkeypatch.setattr(selection, "matches", lambda *_, **__: tried)
    _, chosen = first_matches(
        Signatures((), nothing[None], nothing[None]), standing(nothing), frozenset(), 0.0
    )
    assert chosen == [tried[0], weak]


def test_rare_events_are_tried_where_something_stands_far_out():
    """A single track is two hundred deviations off in one statistic: with its form left wide open it gains next to nothing."""
    track, glow = np.zeros(60), np.zeros(60)
    track[:3], glow[10:40] = 200.0, 1.4
    signs = Signatures(
        (a_trial("cosmic_rays.rate_per_mpx_s"), a_trial("amplifier_glow.rate_e_per_s")),
        np.array([track, glow]),
        np.array([track**2, np.zeros(60)]),
    )
    _, chosen = first_matches(signs, standing(0.7 * track + glow), frozenset(), 0.0)
    assert [m.trial.effect for m in chosen] == ["amplifier_glow", "cosmic_rays"]


SHAPE = np.r_[np.linspace(1, 3, 40), np.zeros(20)]


def saturating(by: float) -> Signatures:
    """A vignetting that shifts forty statistics, and by `by` deviations one that saturates at the trial's strength alone."""
    flat = np.where(np.arange(60) == 50, by, 0.0)
    return Signatures((a_trial("vignetting.corner_loss"),), (4 * SHAPE + flat)[None], np.zeros((1, 60)))


@pytest.mark.parametrize(
    ("by", "forgiving", "scale"), [(0, False, 2.5), (0, True, 2.5), (500, False, 0.0), (500, True, 1.6)]
)
def test_a_flat_that_saturates_at_one_strength_alone_does_not_hide_an_effect(by, forgiving, scale):
    """The forty shift by 2.5 times the trial's. A forgiving match takes the nearest scale of a list, 1.6."""
    (found,) = matches(saturating(by), standing(10 * SHAPE), forgiving=forgiving)
    assert found.scale == pytest.approx(scale, rel=0.02, abs=0.01)
    assert bool(found.gain > 40) == (scale > 1)


def test_what_a_saturating_flat_hides_is_tried_beside_the_other_candidates():
    """With its forgiving matches, from which a nearer strength follows."""
    signs, seam = saturating(500.0), a_trial("tap_mismatch.gain")
    half = np.where(np.arange(60) < 20, 10 * SHAPE, 0.0)
    both = Signatures((*signs.trials, seam), np.vstack([signs.values, half]), np.zeros((2, 60)))
    tried, chosen = first_matches(both, standing(10 * SHAPE), frozenset(), 0.0)
    assert [m.trial.effect for m in chosen] == ["tap_mismatch", "vignetting"]
    assert {m.trial.effect: m.scale for m in tried}["vignetting"] == 1.6


def test_an_effect_that_moves_other_statistics_than_those_that_deviate_gains_nothing():
    """Each of ten that it moves by 30 deviations, and that did not move, speaks against it, also where much is forgiven."""
    left, elsewhere = np.zeros(60), np.zeros(60)
    left[:10], elsewhere[:10], elsewhere[20:30] = 4.0, 4.0, 30.0
    signs = Signatures((a_trial("row_noise.sigma_e"),), elsewhere[None], np.zeros((1, 60)))
    (found,) = matches(signs, standing(left), forgiving=True)
    assert found.gain < 2


def test_the_least_scaled_of_an_effects_good_trials_is_where_it_starts():
    nothing = np.zeros(3)

    def match(sigma: float, gain: float, scale: float) -> Match:
        return Match(Trial("point_spread", (("point_spread.sigma_px", sigma),)), gain, scale, nothing)

    wide, near, poor = match(0.6, 10.0, 0.001), match(0.12, 9.0, 2.0), match(0.3, 5.0, 1.0)
    other = Match(Trial("blooming", (("blooming.share", 0.1),)), 9.5, 0.3, nothing)
    assert best_of_each([wide, other, near, poor]) == [other, near]


def refined(effect: str, camera: Camera, gain: float, cost: float) -> Refined:
    return Refined(effect, camera, (), np.zeros(0), gain, np.full(4, 20.0), np.zeros(4), cost)


def test_of_two_fits_the_better_keeps_the_other_words_that_gain_nearly_as_much(stated):
    def fit(word: str, gain: float) -> Refined:
        return refined("missing_codes", stated.with_effect("missing_codes", pattern=word), gain, 1.0)

    even, random = fit("even", 218.0), fit("random", 186.0)
    for best in (selection.better(even, random), selection.better(random, even)):
        assert (best.words, best.gain) == (even.words, 218.0)
        assert best.otherwise is random
        assert selection.better(best, fit("even", 100.0)).otherwise is random
        turned = selection.better(best, fit("random", 300.0))
        assert turned.words == random.words
        assert turned.otherwise is not None
        assert turned.otherwise.gain == 218.0
    assert selection.better(even, fit("random", 100.0)).otherwise is None  # far behind
    assert selection.better(even, fit("even", 200.0)).otherwise is None


def test_of_two_fits_the_better_keeps_other_values_that_were_read_from_the_frames(stated):
    def fit(share: float, gain: float, looked: bool) -> Refined:
        camera = stated.with_effect("dead_pixels", density=share, level=0.1)
        return replace(refined("dead_pixels", camera, gain, 1.0), looked=looked)

    plain = fit(0.0005, 218.0, looked=False)
    for values, gain, kept in ((0.001, 186.0, True), (0.001, 100.0, False), (0.00055, 186.0, False)):
        read = fit(values, gain, looked=True)
        for best in (selection.better(plain, read), selection.better(read, plain)):
            assert best.gain == 218.0
            assert (best.otherwise is read) is kept
    assert (
        selection.better(plain, fit(0.001, 186.0, looked=False)).otherwise is None
    )  # not read from the frames


def test_other_words_are_tried_first_with_the_numbers_that_were_found(stated, monkeypatch):
    found = stated.with_effect("vignetting", corner_loss=0.17, power=1.8)
    begun: list[dict] = []

    def refine(lab, fitted, match, *_, **__):
        begun.append(dict(match.trial.values))
        return refined("vignetting", found, 50.0, 2.0)

    monkeypatch.setattr(selection, "refine", refine)

    def match(**values) -> Match:
        named = tuple((f"vignetting.{key}", value) for key, value in values.items())
        return Match(Trial("vignetting", named), 9.0, 1.0, np.zeros(4))

    others = [match(corner_loss=0.3, power=4.0), match(corner_loss=0.3, law="cos4")]
    best = refined("vignetting", found, 60.0, 2.0)
    fitted = states.leaving([100, 80, 60, 0], stated).fitted
    assert selection.from_other_starts(None, fitted, best, others, lambda *_: None, 0.0) is best  # pyrefly: ignore[bad-argument-type]
    first, second = begun
    assert (first["vignetting.law"], first["vignetting.corner_loss"]) == ("cos4", pytest.approx(0.17))
    assert second == {"vignetting.corner_loss": 0.3, "vignetting.power": 4.0}


@pytest.mark.parametrize("gain", [55.0, 30.0])
def test_where_nothing_is_left_other_words_are_tried_once_and_no_other_numbers(stated, monkeypatch, gain):
    """They may fit as well or better: a power fits a field of cos^4 within the noise, with a wrong loss in the corners."""
    found = stated.with_effect("vignetting", corner_loss=0.17, power=1.8)
    natural = refined("vignetting", stated.with_effect("vignetting", corner_loss=0.2, law="cos4"), gain, 2.0)
    begun: list[tuple[dict, float]] = []

    def refine(lab, fitted, match, *_, least, **__):
        begun.append((dict(match.trial.values), least))
        return natural

    monkeypatch.setattr(selection, "refine", refine)

    def match(**values) -> Match:
        named = tuple((f"vignetting.{key}", value) for key, value in values.items())
        return Match(Trial("vignetting", named), 9.0, 1.0, np.zeros(4))

    others = [match(corner_loss=0.3, power=4.0), *(match(corner_loss=x, law="cos4") for x in (0.3, 0.08))]
    best = replace(refined("vignetting", found, 60.0, 2.0), residual=np.zeros(4))
    fitted = states.leaving([100, 80, 60, 0], stated).fitted
    kept = selection.from_other_starts(None, fitted, best, others, lambda *_: None, 0.0)  # pyrefly: ignore[bad-argument-type]
    ((start, least),) = begun  # both trials with cos4 begin with the numbers that were found
    assert (start["vignetting.law"], start["vignetting.corner_loss"]) == ("cos4", pytest.approx(0.17))
    assert least == pytest.approx((1 - selection.ALIKE) * 60.0)
    assert kept.words == best.words
    assert (kept.otherwise is natural) is (gain > least)


def test_effects_are_tried_at_the_strength_that_deviating_statistics_ask_for(stated):
    """A vignetting of 8 % moves a flat out of saturation, which one of a tenth of it does not: no other trial would be like it."""
    fitted = states.leaving([10.0, 8.0, -6.0, 0.5, 0.0], stated).fitted

    def trial(path, value, *more):
        return Trial(path.split(".")[0], ((path, value), *more))

    rows = [
        (trial("vignetting.corner_loss", 0.08), [100, 80, -60, 0, 8000]),
        # fits less well
        (trial("vignetting.corner_loss", 0.08, ("vignetting.law", "cos4")), [100, 60, -60, 0, 8000]),
        (trial("row_parity.offset_e", 0.3), [-40, -32, 24, 500, 0]),  # of either sign
        (trial("smear.transfer_s", 1e-5), [-40, -32, 24, 0, 0]),  # against the deviations
        (trial("image_lag.share", 0.01), [0, 3, 3, 300, 0]),  # would explain little
        (trial("column_noise.sigma_e", 1.0), [9, 7, -5, 0, 0]),  # needs no other strength
        (trial("point_spread.sigma_px", 0.2), [1, 1, -1, 0, 0]),  # a stronger one
        (trial("blooming.share", 0.1), [100, 80, -60, 0, 0]),  # left out
    ]
    signs = Signatures(tuple(t for t, _ in rows), np.array([z for _, z in rows], float), np.zeros((8, 5)))
    loss, offset = selection.asked(signs, fitted, frozenset({"blooming"}))
    assert (loss.effect, loss.by_name) == ("vignetting", {"corner_loss": pytest.approx(0.008)})
    assert (offset.effect, offset.by_name) == ("row_parity", {"offset_e": pytest.approx(-0.075)})
    nothing = states.leaving([1.0, -2.0, 0.0, 0.0, 0.0], stated).fitted
    assert selection.asked(signs, nothing, frozenset()) == []


def test_the_numbers_of_an_earlier_step_are_a_start_if_they_are_of_the_same_words(stated):
    """Bands fitted before a flare was there: where they lie has not changed since."""
    found = refined("vignetting", stated.with_effect("vignetting", corner_loss=0.17, power=1.8), 50.0, 2.0)
    fitted = states.leaving([100, 80, 60, 0], stated).fitted

    def match(**values) -> Match:
        named = tuple((f"vignetting.{key}", value) for key, value in values.items())
        return Match(Trial("vignetting", named), 9.0, 1.0, np.zeros(4))

    (start,) = selection._as_earlier(fitted, match(corner_loss=0.3, power=4.0), found)
    expected = {"vignetting.corner_loss": 0.17, "vignetting.power": 1.8}
    assert {key: start.values()[key] for key in expected} == pytest.approx(expected)
    assert selection._as_earlier(fitted, match(corner_loss=0.3, law="cos4"), found) == []
    assert selection._as_earlier(fitted, match(corner_loss=0.3), None) == []


def test_a_number_that_was_zero_is_no_start_where_it_is_refined_as_a_logarithm(stated):
    """Banding found with a pure sine, tried again with a second harmonic: every coordinate can be read at the start."""
    trial = stated.with_effect("periodic_banding", amplitude_e=1.0, period_rows=20.0, second_harmonic=0.5)
    values = tuple((path, v) for path, v in trial.values().items() if path.startswith("periodic_banding."))
    pure = trial.replace({"periodic_banding.second_harmonic": 0.0, "periodic_banding.amplitude_e": 7.0})
    fitted = Fitted(None, stated, *np.zeros((3, 4)))  # pyrefly: ignore[bad-argument-type]
    found = Refined("periodic_banding", pure, (), np.zeros(0), 1.0, np.zeros(4), np.zeros(4))
    (start,) = selection._as_earlier(
        fitted, Match(Trial("periodic_banding", values), 1.0, 1.0, np.zeros(4)), found
    )
    read = {c.path: c.read(start) for c in refinement.effect_coordinates(trial, "periodic_banding")}
    assert np.isfinite(list(read.values())).all()
    assert start.values()["periodic_banding.amplitude_e"] == 7.0
    assert start.values()["periodic_banding.second_harmonic"] == 0.5


def test_candidates_are_refined_from_the_numbers_of_an_earlier_step_too(stated, monkeypatch):
    fitted = states.leaving([100, 80, 60, 0], stated)
    found = refined("vignetting", stated.with_effect("vignetting", corner_loss=0.17), 50.0, 2.0)
    match = Match(Trial("vignetting", (("vignetting.corner_loss", 0.3),)), 9.0, 1.0, np.zeros(4))
    begun: list[list[float]] = []

    def refine(*_, also=(), **__):
        begun.append([camera.values()["vignetting.corner_loss"] for camera in also])
        return found

    monkeypatch.setattr(selection, "first_matches", lambda *_: ([match], [match]))
    monkeypatch.setattr(selection, "refine", refine)
    monkeypatch.setattr(selection, "sharpened", lambda lab, signs, *_: signs)
    for earlier in ({}, {"vignetting": found}, {"smear": found}):
        selection.candidates(None, None, fitted.fitted, fitted, frozenset(), lambda *_: None, earlier)  # pyrefly: ignore[bad-argument-type]
    assert begun == [[], [pytest.approx(0.17)], []]


@pytest.mark.parametrize("power", [1.0, 2.0, 4.0])
def test_the_strength_at_which_a_signature_needs_no_scale_is_found(power):
    """A level is proportional to the strength, a variance to its square, a blur to no power: after four points within 5 %."""
    wanted, past = 3.7, []
    for _ in range(4):
        at = selection._next(past) if past else 0.0
        past.append((at, power * (np.log(wanted) - at)))
    assert selection._next(past) == pytest.approx(np.log(wanted), abs=0.05)


def test_a_strength_between_two_that_were_tried_is_sought_between_them():
    """The better of the two is weaker; the other shows that the secant from the weaker one alone goes too far."""
    weak, strong = (0.0, 2.2), (1.5, -5.0)
    between = selection._next([strong, weak])
    assert between == pytest.approx(1.5 * 2.2 / 7.2)
    assert selection._next([(between, 0.9), weak, strong]) == pytest.approx(
        between + (1.5 - between) * 0.9 / 5.9
    )


def trial(sigma: float) -> Trial:
    """A blur of so many pixels."""
    return Trial("point_spread", (("point_spread.sigma_px", sigma),))


def simulated(lab, reference, tried, report):
    """Signatures without a shift, where only their strengths matter."""
    return Signatures(tuple(tried), np.zeros((len(tried), 4)), np.zeros((len(tried), 4)))


def test_a_blur_of_which_a_weak_trial_matches_best_is_brought_near(stated, monkeypatch):
    """Light on the next pixel grows with erfc(0.5 / (sigma sqrt 2)): 0.2 px of it, times 26, is the light of 0.5 px.

    The residual is so large that the weak trial matches best whatever else was tried, and a strong one not at all.
    """

    def light(one: Trial) -> float:
        return float(erfc(0.5 / (one.by_name["sigma_px"] * np.sqrt(2))))

    def first(signs, *_):
        found = [Match(t, -light(t), light(trial(0.5)) / light(t), np.zeros(4)) for t in signs.trials]
        return found, [max(found, key=lambda m: m.gain)]

    monkeypatch.setattr(selection, "first_matches", first)
    monkeypatch.setattr(selection, "signatures", simulated)
    fitted = SimpleNamespace(camera=stated, reference=None, z=np.zeros(4))
    begun = simulated(None, None, [trial(0.2)], None)
    signs = selection.sharpened(None, begun, fitted, frozenset(), 0.0, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    tried = [t.by_name["sigma_px"] for t in signs.trials]
    assert len(tried) == 1 + selection.SHARPENED
    assert all(a > b for a, b in pairwise(tried[1:]))  # the first goes far beyond, the others come back
    assert abs(np.log(light(trial(tried[-1])) / light(trial(0.5)))) < 0.6


def test_a_faint_blur_is_sought_above_the_strengths_that_show_nothing(stated, monkeypatch):
    """0.12 px puts a four hundredth of the light of 0.2 px on the next pixel; below 0.06 px not one electron of 1e15 goes there."""

    def light(one: Trial) -> float:
        share = float(erfc(0.5 / (one.by_name["sigma_px"] * np.sqrt(2))))
        return share if share > 1e-15 else 0.0

    def scale(one: Trial) -> float:
        return light(trial(0.12)) / light(one) if light(one) else 0.0

    def first(signs, *_):
        found = [Match(t, 9.0 if light(t) else 0.0, scale(t), np.zeros(4)) for t in signs.trials]
        return found, best_of_each(sorted(found, key=lambda m: -m.gain))

    monkeypatch.setattr(selection, "first_matches", first)
    monkeypatch.setattr(selection, "signatures", simulated)
    begun = simulated(None, None, [trial(0.2)], None)
    fitted = SimpleNamespace(camera=stated, reference=None, z=np.zeros(4))
    signs = selection.sharpened(None, begun, fitted, frozenset(), 0.0, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert min(abs(np.log(scale(t))) for t in signs.trials if light(t)) < NEAR_ENOUGH


@pytest.mark.parametrize(("scale", "strengths"), [(1.2, [0.24, 0.2]), (9.0, [1.8, 0.2])])
def test_a_trial_is_a_start_as_well_as_the_strength_it_asks_for(stated, monkeypatch, scale, strengths):
    """Shifts are not proportional to strengths: nine times as strong can be far too strong, and a fifth more of a blur."""
    begun: list[float] = []

    class Begun(Exception):
        pass

    class Climb:
        def __init__(self, *_):
            pass

        def start(self, cameras):
            begun.extend(camera.values()["point_spread.sigma_px"] for camera in cameras)
            raise Begun

    monkeypatch.setattr(refinement, "Climb", Climb)
    monkeypatch.setattr(refinement, "metric", lambda *_: None)
    reference = SimpleNamespace(coordinates=())
    fitted = SimpleNamespace(camera=stated, reference=reference)
    match = Match(Trial("point_spread", (("point_spread.sigma_px", 0.2),)), 9.0, scale, np.zeros(4))
    with pytest.raises(Begun):
        refinement.refine(None, fitted, match, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert begun == pytest.approx(strengths)


def test_what_is_rare_is_seen_to_bring_a_spread_of_its_own():
    """Of six sets of codes that never come one has them among the few codes of a dark frame."""
    scale = np.ones(400)
    moves = np.tile(np.append(30.0, np.zeros(399)), (6, 1)) + 0.05 * np.random.default_rng(0).standard_normal(
        (6, 400)
    )
    assert not is_random(moves, scale)
    assert not own_variance(moves, scale).any()
    moves[2, 5] = 90.0
    assert is_random(moves, scale)
    assert np.flatnonzero(own_variance(moves, scale)).tolist() == [5]


def test_a_wide_range_of_numbers_is_tried_in_the_words_that_match_best():
    """A glow of few pixels may lie in every corner: its widths reach from a few pixels of a megapixel sensor to all of it."""
    glow = catalogue()["amplifier_glow"]
    (default,), others = effect_trials(glow), form_trials(glow)
    assert beside_words(default) == []
    corner = next(t for t in others if ("amplifier_glow.place", "top_left") in t.values)
    widths = sorted(dict(t.values)["amplifier_glow.width"] for t in beside_words(corner))
    assert widths[0] * 1280 < 6
    assert widths[-1] > 0.5
    assert max(b / a for a, b in pairwise(widths)) < 3.2  # overlap of neighbouring widths over 0.8
    assert {dict(t.values)["amplifier_glow.place"] for t in beside_words(corner)} == {"top_left"}
