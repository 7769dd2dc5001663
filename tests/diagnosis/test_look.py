"""Values that are read from the frames before anything is fitted."""

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.small import PLAN, SENSOR, frame_set
from visaug import FrameSet
from visaug.diagnosis.candidates.look import stuck
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


def test_pixels_that_do_not_answer_light_are_counted_with_their_levels(stated):
    """Every frame gives them one code each; 20 e- of temporal noise and columns of 2 e- are no dead pixels."""
    frames, rng = frame_set(9), np.random.default_rng(3)
    assert not any(t.effect == "dead_pixels" for t in looked(Laboratory(frames, stated), stated))
    pixels = frames.stack(range(len(frames))).astype(np.uint16)
    black, top = SENSOR.pedestal_dn, 2**SENSOR.bits - 1
    places = rng.choice(pixels[0].size, 25, replace=False)
    levels = rng.uniform(0, 0.3, 25)
    pixels.reshape(len(pixels), -1)[:, places] = np.rint(black + levels * (top - black))
    targets = {r.clean: frames.clean(i) for i, r in enumerate(frames.records) if r.clean}
    dead = FrameSet.from_arrays(frames.records, list(pixels), targets, bit_depth=SENSOR.bits)
    (trial,) = [t for t in looked(Laboratory(dead, stated), stated) if t.effect == "dead_pixels"]
    assert trial.by_name["density"] == pytest.approx(25 / pixels[0].size)
    assert trial.by_name["level"] == pytest.approx(
        levels.mean(), abs=2e-3
    )  # of the range, a DN is 6e-5 to 2e-4
    assert trial.by_name["spread"] == pytest.approx(levels.std(), abs=2e-3)


@pytest.mark.parametrize(("answer", "count"), [(100.0, 3), (7.0, 0), (-100.0, 0), (0.0, 0)])
def test_dead_pixels_are_told_where_the_others_answer_clearly(stated, answer, count):
    """The answers of the others differ by 1 DN; the dead ones are at code 0, at the black level and at half of the range."""
    dark = np.full((20, 20), 100.0)
    bright = dark + answer + np.random.default_rng(0).normal(0, 1, dark.shape)
    for place, level in enumerate((0.0, 100.0, 100.0 + (2**stated.bit_depth - 1 - 100.0) / 2)):
        dark[0, place] = bright[0, place] = level
    assert stuck(dark, bright, stated).tolist() == [-1.0, 0.0, 0.5][:count]
    assert len(stuck(dark, None, stated)) == 0
