"""The pieces of the diagnosis against linear algebra that is done by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from tests.diagnosis.small import Hidden, frame_set
from visaug import Camera
from visaug.comparison import Laboratory
from visaug.diagnosis import fit, naming, rank
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.candidates import Trial, missing_base, trials
from visaug.diagnosis.chance import chance
from visaug.diagnosis.fit import (
    PAIRS,
    USES,
    Fitted,
    Null,
    Reference,
    Sample,
    adjust,
    bias_level,
    derivatives,
    make_reference,
    p_value,
    refit,
    standardised,
)
from visaug.diagnosis.naming import first_matches
from visaug.diagnosis.parameters import base_coordinates, effect_coordinates, intervals, moved
from visaug.diagnosis.rank import (
    Match,
    Metric,
    Refined,
    Signatures,
    best_of_each,
    law,
    newton,
    scatter,
    shrunk,
)
from visaug.diagnosis.residue import describe
from visaug.effects import catalogue
from visaug.fingerprint import Statistic


def test_adjust_solves_the_linear_problem_and_ignores_outliers():
    rng = np.random.default_rng(0)
    slopes = rng.normal(size=(200, 3)) * 10
    truth = np.array([0.3, -0.2, 0.1])
    residual = slopes @ truth + rng.normal(size=200)
    wide = np.full(3, 100.0)
    step = adjust(residual[None], slopes, np.ones(200), wide)[0]
    # standard error 1/(10 sqrt(200)) = 0.007: five of them
    np.testing.assert_allclose(step, truth, atol=0.036)
    residual[:20] += 1000
    np.testing.assert_allclose(adjust(residual[None], slopes, np.ones(200), wide)[0], truth, atol=0.06)


def test_a_number_that_few_statistics_tell_is_fitted_beside_one_that_all_tell():
    """A black level moves what thousands of pixels say to a hundredth of a DN, the share of missing codes one count."""
    slopes = np.column_stack([np.full(800, 5e3), np.r_[3.3, np.zeros(799)]])
    residual = slopes @ np.array([0.02, 0.4])
    step = adjust(residual[None], slopes, np.ones(800), np.array([30.0, 1.5]))[0]
    expected = 0.4 * 3.3**2 / (3.3**2 + 1 / 1.5**2)  # least squares with the prior
    assert step[0] == pytest.approx(0.02, rel=1e-6)
    assert step[1] == pytest.approx(expected, rel=1e-3)


class Wavering:
    """Sets of 401 statistics: the first answers the black level, the others are drawn anew wherever that moves."""

    def __init__(self):
        self.asked = []

    def simulated(self, jobs, report):
        self.asked += [number for _, number in jobs]
        return [
            np.array([self._set(camera.values()["black_level_dn"], number) for camera, number in jobs])
        ] * 3

    @staticmethod
    def _set(level, number):
        return np.r_[level, np.random.default_rng([number, round(1e6 * level)]).normal(size=400)]


def test_what_answers_by_chance_has_hardly_a_derivative(stated):
    free = [c for c in base_coordinates(stated, frame_set(0), True) if c.path == "black_level_dn"]
    lab = Wavering()
    (slopes, *_) = derivatives(lab, stated, free, lambda *_: None, np.ones(401))
    assert slopes[0, 0] == pytest.approx(1.0)
    # Half the difference of two unit normals, eight times: 0.25 rms, 0.41 with three. What is drawn to 0 by the true standard
    # error keeps 0.58 of it, 0.144; by that of eight pairs, whose variance is known to half of itself, a little more.
    assert np.sqrt((slopes[1:, 0] ** 2).mean()) == pytest.approx(0.15, rel=0.15)
    assert max(lab.asked) >= PAIRS
    sure = Wavering()
    derivatives(sure, stated, free, lambda *_: None, np.r_[1e-3, np.full(400, 1e3)])
    assert max(sure.asked) == PAIRS - 1  # noise that counts for nothing costs nothing


def test_a_number_that_the_frames_do_not_tell_has_the_width_of_its_prior(stated):
    """Two numbers; statistics answer the first alone."""
    rng = np.random.default_rng(0)
    free = [
        c
        for c in base_coordinates(stated, frame_set(0), True)
        if c.path in ("read_noise.sigma_e", "quantum_efficiency")
    ]
    slopes = np.column_stack([np.full(50, 20.0), np.zeros(50)])
    sample = Sample(rng.normal(size=(200, 50)), slopes, np.zeros(50))
    reference = Reference(stated, tuple(free), sample, sample, sample)
    assert reference.untold[0] < 0.01
    assert reference.untold[1] == pytest.approx(free[1].prior)
    found = intervals(free, stated, reference.null_steps, reference.untold)
    (known, *bounds), (unknown, low, high) = (found[c.path] for c in free)
    # 50 statistics of standard deviation 1 that answer by 20: 1.96 / (20 sqrt(50)), to 4 standard errors of 200 sets
    assert np.log(np.divide(bounds, known)) == pytest.approx([-0.0139, 0.0139], rel=0.2)
    assert np.log(np.divide((low, high), unknown)) == pytest.approx(
        [-1.96 * free[1].prior, 1.96 * free[1].prior]
    )


def test_p_value_counts_the_larger_ones():
    assert p_value(2.5, np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(3 / 5)


def test_a_statistic_that_never_varies_is_no_evidence():
    np.testing.assert_array_equal(standardised(np.array([5.0, 2.0]), np.array([0.0, 1.0])), [0.0, 2.0])


def test_shrinkage_keeps_strong_correlations_and_drops_chance():
    rng = np.random.default_rng(1)
    base = rng.normal(size=(300, 40))
    base[:, 1] = base[:, 0]
    correlation = shrunk(base)
    assert correlation[0, 1] > 5 * np.abs(correlation[2:, 2:] - np.eye(38)).max() or correlation[0, 1] > 0.4
    assert np.linalg.eigvalsh(correlation).min() > 0
    np.testing.assert_allclose(np.diag(correlation), 1)


def test_every_effect_is_tried_within_its_bounds(stated):
    tried = trials(stated)
    assert {t.effect for t in tried} == {name for name, effect in catalogue().items() if not effect.base}
    for trial in tried:
        trial.on(stated)  # a value out of bounds would be refused


def test_base_terms_at_zero_are_candidates_and_not_free(stated):
    content = stated.to_dict()
    del content["prnu"]
    content["read_noise"]["shape"] = 0.14
    bare = Camera.load(content)
    assert missing_base(bare) == ["prnu", "read_noise"]
    free = {c.path for c in base_coordinates(bare, frame_set(0), True)}
    assert not any(path.startswith("prnu.") for path in free)
    assert "read_noise.shape" not in free
    assert {"gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "dark_current.b_per_c"} <= free


def test_coordinates_round_trip(stated):
    free = base_coordinates(stated, frame_set(0), True)
    same = moved(stated, free, [c.read(stated) for c in free])
    for path, value in stated.values().items():
        assert same.values()[path] == pytest.approx(value, rel=1e-9)


def test_what_is_left_is_described_along_its_axis_and_growth():
    statistics = [
        Statistic("level", f"s{i}", f"dark {t} s {c} C", ("column",), "DN", "dark", t, c)
        for i in range(6) for t in (0.1, 2.0) for c in (20.0, 30.0)
    ] + [Statistic("noise", f"n{i}", "bias", ("time",), "1", "bias") for i in range(6)]  # fmt: skip
    z = np.array([12.0 * (s.exposure_s > 1) * (1 + (s.temperature_c > 25)) for s in statistics])
    residue = describe(statistics, z)
    assert residue.axis == ("column",)
    assert set(residue.grows_with) == {"exposure", "temperature"}


def test_a_black_level_far_from_the_file_is_found(stated):
    """60 DN off, two standard deviations of its prior; the mean of 12 bias frames is known to 0.05 DN with its pattern."""
    off = stated.replace({"black_level_dn": stated.values()["black_level_dn"] + 60})
    lab = Laboratory(frame_set(5), off)
    coordinates = base_coordinates(off, lab.frames, True)
    reference = make_reference(lab, off, coordinates, 16, lambda *_: None)
    fitted = refit(lab, reference, lambda *_: None)
    assert fitted.camera.values()["black_level_dn"] == pytest.approx(120, abs=1)


def chance_of(null: np.ndarray, shapes: np.ndarray):
    """The p-value that `chance` gives a residual, from simulated sets (R, n) and signatures (n_shapes, n)."""
    law = Null(null, np.full(null.shape[1], 1e-9), np.zeros((null.shape[1], 1)), np.ones(1))
    reference = SimpleNamespace(whole_null=law, largest=law.largest)
    signed = SimpleNamespace(
        trials=[SimpleNamespace(effect=str(i)) for i in range(len(shapes))], values=shapes
    )
    lab = SimpleNamespace(whole_of=lambda values: values)

    def p_of(residual: np.ndarray) -> float:
        fitted = SimpleNamespace(reference=reference, residual=residual, whole_residual=residual)
        return chance(lab, signed, State.plain(fitted)).p_value  # type: ignore[arg-type]

    return p_of


def test_chance_is_no_more_certain_of_its_own_sets_than_of_new_ones():
    """60 simulated sets of 200 correlated statistics: what the best of 30 shapes matches in new sets is uniform among them.

    Kolmogorov-Smirnov over 300 new sets at p = 1e-3; a covariance that had seen the sets would be far off.
    """
    rng = np.random.default_rng(3)
    mixing = rng.normal(size=(200, 200)) / 14 + np.eye(200)
    null, new, shapes = (rng.normal(size=(n, 200)) @ mixing for n in (60, 300, 30))
    p_of = chance_of(null, shapes)
    assert kstest([p_of(residual) for residual in new], "uniform").statistic < 1.95 * np.sqrt(
        1 / 60 + 1 / 300
    )


def test_a_way_in_which_sets_scatter_widely_does_not_hide_the_other_ways():
    """300 statistics of 100 simulated sets share five modes, which a covariance drawn towards the identity makes too narrow.

    Signatures along these match every set by chance. One across them, 4.8 standard deviations long, must be seen all the same in
    at least 28 of 40 sets (36 when written; 5 where matches are compared as they are).
    """
    rng = np.random.default_rng(4)
    modes = rng.normal(size=(5, 300))

    def sets(count: int) -> np.ndarray:
        return rng.normal(size=(count, 300)) + 0.5 * rng.normal(size=(count, 5)) @ modes

    across = np.where(np.arange(300) < 16, [1, -1] * 150, 0.0)
    across -= modes.T @ np.linalg.lstsq(modes.T, across, rcond=None)[0]
    p_of = chance_of(sets(100), np.vstack([modes, across]))
    assert sum(p_of(residual + 1.2 * across) <= 0.02 for residual in sets(40)) >= 28


def test_a_set_does_not_widen_its_own_measure():
    """One of 20 sets is 6 standard deviations of the others off: told as 6, not as the 3.5 that it makes of itself."""
    rng = np.random.default_rng(5)
    residuals = rng.normal(size=(20, 1))
    residuals -= residuals.mean(0)
    residuals[7] = 6 * np.sqrt(np.mean(np.delete(residuals, 7, 0) ** 2) * 19 / 18)
    null = Null(residuals, np.full(1, 1e-9), np.zeros((1, 1)), np.ones(1))
    assert null.largest[7] == pytest.approx(6)
    assert abs(residuals[7, 0]) / null.scale[0] < 4


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
    told = scatter(null, nothing, ways)
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


def test_all_frames_together_tell_whether_anything_is_missing(stated):
    """Statistics of the frames that find lie where those of the whole set have the same name."""
    lab = Laboratory(frame_set(5), stated)
    find, confirm, whole = lab.measured
    shape = lab.whole_of(np.arange(1.0, len(find.values) + 1))
    names = [(s.view, s.name, s.frames) for s in find.statistics]
    for s, value in zip(whole.statistics, shape, strict=True):
        name = (s.view, s.name, s.frames)
        assert value == (names.index(name) + 1 if name in names else 0)
    assert np.count_nonzero(shape) > 0.9 * len(find.values)
    assert len(confirm.values) < len(find.values) <= len(whole.values)
    for i, j in zip(*lab.confirming, strict=True):
        assert find.labels[i] == confirm.labels[j]
    assert len(lab.confirming[0]) == len(set(find.labels) & set(confirm.labels)) > 100


def standing(residual: np.ndarray) -> Fitted:
    """What is left of a camera whose statistics are independent, in standard deviations."""
    count = len(residual)
    null = np.random.default_rng(3).normal(size=(400, count))
    scale = np.ones(count)
    reference = SimpleNamespace(null=Null(null, scale, np.zeros((count, 1)), np.ones(1)), null_scale=scale)
    return Fitted(reference, None, residual, np.zeros(count), residual)  # pyright: ignore[reportArgumentType]


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


def test_the_black_level_leaves_where_the_full_well_cuts(stated):
    """In DN: else a fit that moves one would have to move the other to one part in 100 000."""
    free = base_coordinates(stated, frame_set(0), True)
    at = [c.read(stated) for c in free]
    there = moved(
        stated, free, [x + 7.0 * (c.path == "black_level_dn") for x, c in zip(at, free, strict=True)]
    )
    before, after = (c.values() for c in (stated, there))
    assert after["black_level_dn"] == before["black_level_dn"] + 7.0
    cut = [v["full_well_e"] / v["gain_e_per_dn"] + v["black_level_dn"] for v in (before, after)]
    assert cut[1] == pytest.approx(cut[0], rel=1e-12)
    assert any(c.path == "full_well_e" for c in free)


def test_the_least_scaled_of_an_effects_good_trials_is_where_it_starts():
    nothing = np.zeros(3)

    def match(sigma: float, gain: float, scale: float) -> Match:
        return Match(Trial("point_spread", (("point_spread.sigma_px", sigma),)), gain, scale, nothing)

    wide, near, poor = match(0.6, 10.0, 0.001), match(0.12, 9.0, 2.0), match(0.3, 5.0, 1.0)
    other = Match(Trial("blooming", (("blooming.share", 0.1),)), 9.5, 0.3, nothing)
    assert best_of_each([wide, other, near, poor]) == [other, near]


def test_one_residual_that_no_signature_matches_is_seen_with_a_hundred_sets():
    """60 sets: the largest residual has a third of a match's weight, and one sixtieth times three is no 2 %."""
    rng = np.random.default_rng(5)
    null, shapes = rng.normal(size=(60, 40)), np.eye(40)[:20]
    p_of = chance_of(null, shapes)
    residual = rng.normal(size=40)
    residual[20:] = 0.0
    assert p_of(residual) > 0.02
    residual[30] = 15.0
    assert p_of(residual) <= 1 / 60 + 1e-9


def refined(effect: str, camera: Camera, gain: float, cost: float) -> Refined:
    return Refined(effect, camera, (), np.zeros(0), gain, np.full(4, 20.0), np.zeros(4), cost)


def leaving(residual) -> State:
    left = np.array(residual, float)
    reference = SimpleNamespace(null_scale=np.ones(len(left)), coordinates=())
    return State.plain(Fitted(reference, None, left, left, left))  # pyright: ignore[reportArgumentType]


def test_of_two_that_say_the_same_the_simpler_is_taken(stated, monkeypatch):
    """A flare without its ghost is a veil: which of them simulations favour a little is their noise."""
    before, after, elsewhere = leaving([100, 80, 60, 0]), leaving([1, 0, 2, 0]), leaving([1, 0, 2, 30])
    flare, veil = refined("lens_flare", stated, 1890.0, 5.0), refined("veiling_glare", stated, 1900.0, 2.0)
    simulated = [(veil, leaving([0, 1, 0, 1])), (flare, after)]
    density = {id(after.fitted): 60.0, id(elsewhere.fitted): -300.0}
    monkeypatch.setattr(naming, "log_density", lambda fitted, *_: density.get(id(fitted), 0.0))
    assert [r.effect for r, _ in naming.decided(before, simulated)] == ["veiling_glare", "lens_flare"]
    other = [(veil, elsewhere), (flare, after)]  # it says another thing, and far less well
    assert [r.effect for r, _ in naming.decided(before, other)] == ["lens_flare", "veiling_glare"]


def test_what_no_rival_explains_does_not_tell_rivals_apart():
    """5350 or 5340 standard deviations of what blooms, beside a veil and beside a flare."""
    before = leaving([7000.0, 100, 60, 40])
    left = naming._anothers(before, [leaving([5350.0, 1, 50, 31]), leaving([5340.0, 60, 45, 1])])
    assert left.tolist() == [True, False, True, False]


def test_other_words_are_tried_first_with_the_numbers_that_were_found(stated, monkeypatch):
    found = stated.with_effect("vignetting", corner_loss=0.17, power=1.8)
    begun: list[dict] = []

    def refine(lab, fitted, match, *_, **__):
        begun.append(dict(match.trial.values))
        return refined("vignetting", found, 50.0, 2.0)

    monkeypatch.setattr(naming, "refine", refine)

    def match(**values) -> Match:
        named = tuple((f"vignetting.{key}", value) for key, value in values.items())
        return Match(Trial("vignetting", named), 9.0, 1.0, np.zeros(4))

    others = [match(corner_loss=0.3, power=4.0), match(corner_loss=0.3, law="cos4")]
    best = refined("vignetting", found, 60.0, 2.0)
    fitted = leaving([100, 80, 60, 0]).fitted
    assert naming.from_other_starts(None, fitted, best, others, lambda *_: None, 0.0) is best  # pyright: ignore[reportArgumentType]
    first, second = begun
    assert (first["vignetting.law"], first["vignetting.corner_loss"]) == ("cos4", pytest.approx(0.17))
    assert second == {"vignetting.corner_loss": 0.3, "vignetting.power": 4.0}


def test_a_refit_may_begin_elsewhere(stated):
    lab = Laboratory(frame_set(5), stated, 0)
    free = [c for c in base_coordinates(stated, lab.frames, True) if c.path == "quantum_efficiency"]
    reference = make_reference(lab, stated, free, 24, lambda *_: None)
    known = reference.null_steps.std()
    begin = moved(stated, free, [c.read(stated) + 40 * known for c in free])
    here, there = refit(lab, reference, lambda *_: None), refit(lab, reference, lambda *_: None, begin)
    apart = [free[0].read(f.camera) for f in (here, there)]
    assert abs(apart[0] - apart[1]) < 0.5 * known
    assert there.misfit == pytest.approx(here.misfit, rel=0.01)


def test_a_reference_that_was_begun_goes_on_where_it_was(stated):
    lab = Laboratory(frame_set(5), stated, 0)
    free = [c for c in base_coordinates(stated, lab.frames, True) if c.path == "quantum_efficiency"]
    few, many = (make_reference(lab, stated, free, n, lambda *_: None) for n in (4, 9))
    told = []
    again = make_reference(lab, stated, free, 9, lambda *tick: told.append(tick[1:]), begun=few)
    for use in USES:
        assert np.array_equal(getattr(again, use).sets, getattr(many, use).sets)
        assert np.array_equal(getattr(again, use).slopes, getattr(many, use).slopes)
    assert told == [(n, 9) for n in range(5, 10)]


def test_a_fit_that_takes_the_bias_level_for_an_outlier_begins_again(stated, monkeypatch):
    """Rows of the lower half lie 4 e- low: bits of the dark frames hold the black level where it was."""

    def lower_half(x, strength, moment):
        return x - strength * (np.arange(len(x))[:, None] >= len(x) // 2)

    lab = Laboratory(frame_set(5, (Hidden("lower half", "voltage", lower_half, 4.0),)), stated)
    reference = make_reference(lab, stated, base_coordinates(stated, lab.frames, True), 24, lambda *_: None)
    level = bias_level(lab.statistics)
    again = refit(lab, reference, lambda *_: None)
    monkeypatch.setattr(fit, "OFF_BLACK", np.inf)
    held = refit(lab, reference, lambda *_: None)
    assert abs(held.z[level]) > 10
    assert abs(again.z[level]) < 0.7 * abs(held.z[level])
    assert again.misfit < held.misfit


def test_noise_of_derivatives_does_not_shorten_the_step():
    """Derivatives of size 1 under noise of three times their size: the step is told within a fifth (4 standard errors)."""
    rng = np.random.default_rng(5)
    count, twins, truth = 20000, 6, 2.0
    design = 1.0 + 3.0 * rng.standard_normal((1, twins, count))
    left = truth + rng.standard_normal((twins, count))
    step = newton(design, left, np.array([100.0]))
    assert step[0] == pytest.approx(truth, rel=0.2)
    whole, pull = design.mean(1)[0], left.mean(0)
    assert whole @ pull / (whole @ whole) < 0.5 * truth  # what products of the same twins give


def test_a_form_moves_its_own_numbers_alone(stated):
    def free(**values) -> set[str]:
        camera = stated.with_effect("fixed_pattern_structure", **values)
        return {c.path.split(".")[1] for c in effect_coordinates(camera, "fixed_pattern_structure")}

    assert free(shape="steps") == {"amplitude_e", "edge", "second_edge", "second"}
    assert free(shape="slope") == {"amplitude_e", "curvature"}
    assert free(shape="bands") == {"amplitude_e", "period_px"}


def test_every_free_number_of_every_trial_can_move(stated):
    """Also where both the trial and all that its parameter gives to try are 0."""
    for trial in trials(stated):
        if not catalogue()[trial.effect].base:
            for c in effect_coordinates(trial.on(stated), trial.effect):
                assert c.step > 0, c.path
                assert c.prior > 0, c.path


def test_trials_of_a_kind_have_the_same_free_numbers(stated):
    """A start that lacks a part has its number at 0, of which there is no logarithm."""
    kinds: dict[tuple, list[set[str]]] = {}
    for trial in trials(stated):
        camera = trial.on(stated)
        if catalogue()[trial.effect].base:
            continue
        logarithmic = {c.path for c in effect_coordinates(camera, trial.effect) if c.logarithmic}
        kinds.setdefault(trial.kind, []).append(logarithmic)
    assert any(len(alike) > 1 for alike in kinds.values())
    assert all(one == alike[0] for alike in kinds.values() for one in alike)


def test_what_only_one_of_two_moves_is_no_matter_of_form():
    """A blur of the light in place of crosstalk: all edges come back, and the noise, which it leaves, stays correlated a little."""

    def rival(left: np.ndarray, gain: float):
        return SimpleNamespace(gain=gain), SimpleNamespace(fitted=SimpleNamespace(residual=left))

    edges, noise = np.full(6, 100.0), np.full(30, 2.2)
    reference = SimpleNamespace(null_scale=np.ones(36))

    def alike(noise_before: np.ndarray, noise_left: np.ndarray) -> bool:
        state = SimpleNamespace(
            fitted=SimpleNamespace(reference=reference, residual=np.append(edges, noise_before))
        )
        first, other = rival(np.zeros(36), 1000.0), rival(np.append(np.ones(6), noise_left), 950.0)
        return naming._is_alike(state, first, other)  # type: ignore[arg-type]

    assert not alike(noise, noise)
    assert alike(noise, 0.3 * noise)  # it moves them too, in a form of its own
    assert alike(0.1 * noise, 0.1 * noise)


def test_between_two_widths_the_one_whose_moves_are_as_large_as_what_is_left(stated):
    """What a blur moves grows as the fourth power of its width or faster; 0.2 and 0.6 px are both far off 0.47."""
    a, b = (stated.with_effect("point_spread", sigma_px=sigma) for sigma in (0.2, 0.6))

    def wanted(camera: Camera) -> float:
        sigma = camera.values()["point_spread.sigma_px"]
        return 4 * np.log(0.47 / sigma) - 3 * (sigma - 0.47)

    found = rank._balanced(a, b, wanted(a), wanted(b), ["point_spread.sigma_px"], wanted)
    assert found.values()["point_spread.sigma_px"] == pytest.approx(0.47, rel=0.01)


def test_a_width_between_one_that_moves_nothing_and_one_that_moves_far_too_much(stated):
    """0.04 px of blur is nothing at all, 0.2 px a hundredfold of what 0.13 px is."""
    pattern = np.array([8.0, -3.0, 1.0])

    def finding(jobs) -> np.ndarray:
        sigma = [camera.values().get("point_spread.sigma_px", 0.0) for camera, _ in jobs]
        return np.array([(s / 0.13) ** 10 * pattern * (s > 0.05) for s in sigma])

    reference = SimpleNamespace(null_scale=np.ones(3), coordinates=())
    fitted = SimpleNamespace(reference=reference, camera=stated, z=pattern)
    beside = [Trial("point_spread", (("point_spread.sigma_px", sigma),)) for sigma in (0.04, 0.2, 0.6)]
    starts = rank._among(SimpleNamespace(finding=finding), fitted, beside)  # type: ignore[arg-type]
    assert starts[-1].values()["point_spread.sigma_px"] == pytest.approx(0.13, rel=0.05)


def test_a_form_is_tried_in_both_signs_where_its_strength_has_two(stated):
    """Scaling a rising slope never gives a falling one. A number that only one word uses is tried with that word."""
    slopes = [
        dict(t.values)
        for t in trials(stated)
        if ("fixed_pattern_structure.shape", "slope") in t.values and t.effect == "fixed_pattern_structure"
    ]
    found = {
        (s["fixed_pattern_structure.amplitude_e"] > 0, s.get("fixed_pattern_structure.curvature", 0.0))
        for s in slopes
    }
    assert found == {(True, 0.0), (False, 0.0), (True, 0.5), (False, 0.5)}
    glows = [dict(t.values) for t in trials(stated) if t.effect == "amplifier_glow"]
    assert all(g["amplifier_glow.rate_e_per_s"] >= 0 for g in glows)
