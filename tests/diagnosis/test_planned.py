"""What planned frames would show of an effect, before any is taken."""

import numpy as np
import pytest

from visaug.camera import Camera
from visaug.camera.simulation import simulate
from visaug.core.errors import InputError
from visaug.diagnosis import planned
from visaug.diagnosis.candidates.trials import trials
from visaug.diagnosis.comparison import compare


def test_lines_of_noise_are_shown_by_the_cheapest_frames(stated: Camera, monkeypatch):
    """Row noise of sigma adds sigma^2 to the variance of row means, sigma_read^2 / columns: 40 columns show a fraction of it."""
    monkeypatch.setattr(planned, "WINDOW", (32, 40))
    wanted = ("row_noise", "column_noise")
    few = [trial for trial in trials(stated) if trial.effect in wanted]
    monkeypatch.setattr(planned, "trials", lambda camera, only: few)
    row, column = planned.before_frames(stated, wanted, lambda *_: None)
    read_e = stated.values()["read_noise.sigma_e"]
    for verdict in (row, column):
        assert verdict.parameter == f"{verdict.effect}.sigma_e"
        assert verdict.verdict == "absent"  # with nothing that looks alike
        assert verdict.frames == (planned.WORDS["bias"],)
        assert verdict.limit is not None
        assert 0.02 * read_e < verdict.limit < read_e


def test_sets_with_an_effect_beyond_its_limit_show_it(stated: Camera, monkeypatch):
    """At 1.5 times the limit the test of the camera (2 % of false alarms) shows each of three sets, one fixed seed each."""
    monkeypatch.setattr(planned, "WINDOW", (32, 40))
    wanted = ("row_noise", "dead_pixels", "bit_truncation")
    few = [trial for trial in trials(stated) if trial.effect in wanted]
    monkeypatch.setattr(planned, "trials", lambda camera, only: few)
    rows, dead, bits = planned.before_frames(stated, wanted, lambda *_: None)
    assert bits.limit in (1, 2, 3)  # a camera has whole bits
    assert dead.limit is not None
    assert dead.limit >= 2.99 / (32 * 40)  # so many are in a set with 95 %
    assert rows.limit is not None
    plan = planned.Planned(stated, lambda *_: None).lab.parts[0].plan
    for seed in (1, 2, 3):
        for camera in (
            stated.with_effect("row_noise", sigma_e=1.5 * rows.limit),
            stated.with_effect("dead_pixels", density=1.5 * dead.limit),
            stated.with_effect("bit_truncation", bits=bits.limit),
        ):
            assert not compare(stated, simulate(camera, plan, seed=seed)).adequate


def test_an_effect_that_the_camera_has_is_refused(stated: Camera):
    with pytest.raises(InputError, match="shot_noise"):
        planned.before_frames(stated, ("shot_noise",), lambda *_: None)


def test_what_the_cameras_parameters_take_up_is_no_difference(stated: Camera):
    """Poisson electrons of mean and variance 1 beside a black level and a read noise that are lower by as much.

    Both differ from the camera in their third moment and in saturated flats, of which the read noise alone is the variance.
    """
    values = stated.values()
    by_law = {
        "black_level_dn": values["black_level_dn"] - 1 / values["gain_e_per_dn"],
        "read_noise.sigma_e": np.sqrt(values["read_noise.sigma_e"] ** 2 - 1),
        "full_well_e": values["full_well_e"] + 1,
    }
    with_effect = stated.with_effect("clock_induced_charge", mean_e=1.0)
    own, exact = planned.Planned(stated, lambda *_: None).apart([with_effect, with_effect.replace(by_law)])
    assert np.abs(exact).max() > 5
    assert np.abs(own - exact).max() < 2.5  # standard deviations of one set
