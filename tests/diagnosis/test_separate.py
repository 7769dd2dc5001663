"""Which frames would distinguish two effects."""

import pytest

from tests.diagnosis.small import CHART, PLAN, frame_set
from visaug.diagnosis.separate import measurement
from visaug.statistics import fingerprint

VEIL = {"name": "veiling_glare", "share": 0.01}
FLARE = {"name": "lens_flare", "ghost_share": 0.002, "halo_share": 0.01}
STRIPES = {"name": "row_noise", "sigma_e": 0.5}
WAVES = {"name": "periodic_banding", "amplitude_e": 0.7, "period_rows": 9.0}
DEFECTS = {"name": "hot_pixels", "density": 0.005}
CURVE = {"name": "nonlinearity"}
SEAM = {"name": "tap_mismatch", "offset_e": 3.0, "gain": 0.01}
STEPS = {"name": "fixed_pattern_structure", "shape": "steps", "amplitude_e": 1.5}
CORNERS = {"name": "vignetting", "corner_loss": 0.05}
BIAS, DARKS, FLATS = PLAN[:12], PLAN[12:24], PLAN[24:]


def told(stated, one: dict, other: dict, plan=()) -> str:
    at_hand = fingerprint(frame_set(3, plan=tuple(plan))).statistics if plan else ()
    pair = {effect["name"]: stated.with_effect(**effect) for effect in (one, other)}
    return measurement(pair, at_hand, lambda *_: None)


@pytest.mark.parametrize(
    ("one", "other", "wanted"),
    [
        (VEIL, FLARE, "a test chart with edges"),
        (STRIPES, WAVES, "a stack of bias frames"),
        (CURVE, CORNERS, "flats over the whole range"),
        (STRIPES, DEFECTS, "a series of dark frames"),
    ],
)
def test_frames_in_which_two_effects_differ_are_asked_for(stated, one, other, wanted):
    assert told(stated, one, other).startswith(wanted)


def test_frames_that_are_there_already_are_not_asked_for(stated):
    assert not told(stated, STRIPES, WAVES, BIAS).startswith("a stack of bias frames")
    assert told(stated, VEIL, FLARE, BIAS + DARKS + FLATS).startswith("a test chart with edges")


def test_where_all_kinds_are_there_more_of_the_best_are_asked_for(stated):
    all_kinds = BIAS + DARKS + FLATS + CHART
    assert told(stated, VEIL, FLARE, all_kinds).startswith(
        "many more frames of the kinds already taken, above all a test chart"
    )


def test_flats_of_one_level_do_not_stand_for_a_whole_range(stated):
    assert told(stated, SEAM, STEPS, BIAS).startswith("flats over the whole range")  # the seam has a gain
    assert told(stated, CURVE, CORNERS, FLATS[6:9] * 4).startswith("flats over the whole range")


def test_what_differs_in_the_cameras_own_numbers_is_no_difference(stated):
    """Few frames leave the black level and the gain open: a flat does not know them."""
    elsewhere = stated.replace({"black_level_dn": 134.0, "gain_e_per_dn": 0.73})
    pair = {"veiling_glare": stated.with_effect(**VEIL), "lens_flare": elsewhere.with_effect(**FLARE)}
    assert measurement(pair, (), lambda *_: None).startswith("a test chart with edges")


def test_cameras_that_differ_in_nothing_are_told_so(stated):
    faint = ({**STRIPES, "sigma_e": 1e-3}, {**WAVES, "amplitude_e": 1e-3})
    assert "the differences are small" in told(stated, *faint)
