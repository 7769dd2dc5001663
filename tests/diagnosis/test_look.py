"""Values that are read from the frames before anything is fitted."""

from dataclasses import replace

import pytest

from tests.diagnosis.small import PLAN, SENSOR, frame_set
from visaug.diagnosis.candidates.trials import looked
from visaug.diagnosis.laboratory import Laboratory


@pytest.mark.parametrize("well_e", [6000.0, 7200.0])  # brightest flats: 11000 DN of 0.7 e-/DN, 7700 e-
def test_a_full_well_that_the_camera_file_leaves_out_is_read_from_the_flats_that_it_clips(stated, well_e):
    """The mean of clipped flats is the full well; offsets of columns and rows are 2 e- at most (SENSOR.dsnu_e)."""
    frames = frame_set(9, sensor=replace(SENSOR, well_e=well_e), plan=tuple(PLAN))
    without = stated.replace({"full_well_e": float("inf")})
    (trial,) = [t for t in looked(Laboratory(frames, without), without) if t.effect == "saturation"]
    assert trial.looked
    assert dict(trial.values)["full_well_e"] == pytest.approx(well_e, abs=5.0)
    assert not any(t.effect == "saturation" for t in looked(Laboratory(frames, stated), stated))


def test_flats_below_the_full_well_show_none(stated):
    without = stated.replace({"full_well_e": float("inf")})
    lab = Laboratory(frame_set(9), without)
    assert not any(t.effect == "saturation" for t in looked(lab, without))
