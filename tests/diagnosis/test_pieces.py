"""Trials, chance and what is told of the rest."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from tests.diagnosis.small import frame_set
from visaug import Camera
from visaug.diagnosis.candidates.refinement import coordinates_of
from visaug.diagnosis.candidates.trials import base_trials, is_proposed, missing_base, trials
from visaug.diagnosis.chance import chance
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.parameters import base_coordinates, effect_coordinates
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.fitting.robust import p_value, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.residue import describe
from visaug.diagnosis.state import State
from visaug.effects import catalogue
from visaug.statistics import Statistic


def test_p_value_counts_the_larger_ones():
    assert p_value(2.5, np.array([1.0, 2.0, 3.0, 4.0])) == pytest.approx(3 / 5)


def test_a_statistic_that_never_varies_is_no_evidence():
    np.testing.assert_array_equal(standardised(np.array([5.0, 2.0]), np.array([0.0, 1.0])), [0.0, 2.0])


def test_every_effect_is_tried_within_its_bounds(stated):
    tried = trials(stated)
    proposed = {name for name, effect in catalogue().items() if not effect.base and is_proposed(effect)}
    assert {t.effect for t in tried} == proposed
    assert {"row_noise", "blooming", "point_spread"} <= proposed
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


def test_a_part_of_a_base_term_at_zero_is_a_candidate_by_itself(stated):
    """A maker's file with the PRNU of pixels alone: columns and rows are tried, and the pixels' stays a nuisance parameter."""
    partly = Camera.load({**stated.to_dict(), "prnu": {"pixel": 0.006}})
    assert missing_base(partly) == ["prnu"]
    tried = base_trials(partly, "prnu")
    assert {path for trial in tried for path, _ in trial.values} == {"prnu.column", "prnu.row"}
    fitted = base_coordinates(partly, frame_set(0), True)
    lab = SimpleNamespace(frames=frame_set(0))
    own = coordinates_of("prnu", tried[0].on(partly), lab, fitted)  # pyrefly: ignore[bad-argument-type]
    assert [c.path for c in own] == ["prnu.column", "prnu.row"]


def test_what_is_left_is_described_along_its_axis_and_growth():
    statistics = [
        Statistic("level", f"s{i}", f"dark {t} s {c} C", ("column",), "DN", "dark", t, c)
        for i in range(6) for t in (0.1, 2.0) for c in (20.0, 30.0)
    ] + [Statistic("noise", f"n{i}", "bias", ("time",), "1", "bias") for i in range(6)]  # fmt: skip
    z = np.array([12.0 * (s.exposure_s > 1) * (1 + (s.temperature_c > 25)) for s in statistics])
    residue = describe(statistics, z)
    assert residue.axis == ("column",)
    assert set(residue.grows_with) == {"exposure", "temperature"}


def chance_of(null: np.ndarray, shapes: np.ndarray):
    """The p-value that `chance` gives a residual, from simulated sets (R, n) and signatures (n_shapes, n)."""
    law = Null(null, np.full(null.shape[1], 1e-9), np.zeros((null.shape[1], 1)), np.ones(1))
    reference = SimpleNamespace(whole_null=law, whole=SimpleNamespace(sets=null), largest=law.largest)
    signed = SimpleNamespace(
        trials=[SimpleNamespace(effect=str(i)) for i in range(len(shapes))], values=shapes
    )
    lab = SimpleNamespace(whole_of=lambda values: values)

    def p_of(residual: np.ndarray) -> float:
        fitted = Fitted(reference, None, residual, residual, residual)  # pyrefly: ignore[bad-argument-type]
        own = np.arange(len(residual))
        return chance(lab, signed, State.plain(fitted, (own, own, own))).p_value  # type: ignore[arg-type]

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


def test_all_frames_together_tell_whether_anything_is_missing(stated):
    """Statistics of the discovery frames lie where those of the whole set have the same name."""
    lab = Laboratory(frame_set(5), stated)
    find, confirm, whole = lab.measured
    shape = lab.whole_of(np.arange(1.0, len(find.values) + 1))
    names = [(s.view, s.name, s.frames) for s in find.statistics]
    for s, value in zip(whole.statistics, shape, strict=True):
        name = (s.view, s.name, s.frames)
        assert value == (names.index(name) + 1 if name in names else 0)
    assert np.count_nonzero(shape) > 0.9 * len(find.values)
    assert len(confirm.values) < len(find.values) <= len(whole.values)


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


def test_a_signature_may_be_scaled_to_the_other_sign_only_where_its_strength_has_two(stated):
    by_form = {(t.effect, dict(t.values).get("fixed_pattern_structure.shape")): t for t in trials(stated)}
    slope = by_form["fixed_pattern_structure", "slope"]
    assert slope.is_signed
    assert dict(slope.times(-2.0).values)["fixed_pattern_structure.amplitude_e"] == -2.0
    glow = by_form["amplifier_glow", None]
    assert not glow.is_signed
    assert dict(glow.times(-2.0).values)["amplifier_glow.rate_e_per_s"] == 0.0  # its lower bound


def test_a_diagnosis_proposes_no_effect_that_frames_cannot_show():
    """Frames end at the converter; the three shapes of blur beside point_spread are tried where they are named."""
    camera = Camera.load({"resolution": [16, 16], "gain_e_per_dn": 1.0})
    blurs, pictures = {"motion_blur", "defocus", "diffraction"}, {"tone_curve", "sharpening", "jpeg"}
    assert not {trial.effect for trial in trials(camera)} & (blurs | pictures)
    asked = {trial.effect for trial in trials(camera, only=frozenset(blurs | pictures))}
    assert asked & (blurs | pictures) == blurs


def test_values_estimated_from_frames_are_brought_into_range():
    from visaug.diagnosis.candidates.trials import within_bounds
    from visaug.effects import CosmicRays

    point = {"rate_per_mpx_s": 3.0, "charge_e_per_px": 50.0, "length_px": 64.4}
    assert within_bounds(CosmicRays, point) == point | {"length_px": CosmicRays.parameters["length_px"].high}
