"""What planned frames would show of an effect, before any is taken."""

import pytest

from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug.diagnosis import planned
from visaug.diagnosis.candidates.trials import trials


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


def test_an_effect_that_the_camera_has_is_refused(stated: Camera):
    with pytest.raises(InputError, match="shot_noise"):
        planned.before_frames(stated, ("shot_noise",), lambda *_: None)
