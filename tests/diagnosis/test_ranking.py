"""What is told of candidates that come close."""

import pytest

from tests.diagnosis.states import refined
from visaug.diagnosis import ranking


@pytest.mark.parametrize(("behind", "told"), [(0.0, True), (5.0, True), (7.0, False), (-4.0, True)])
def test_candidates_that_frames_cannot_tell_apart_are_told_with_what_would(stated, monkeypatch, behind, told):
    """To 6 in log likelihood: simulated sets are too few to say more. The simpler of two may be the one behind."""
    asked = []
    monkeypatch.setattr(
        ranking, "measurement", lambda cameras, at_hand, report: asked.append(set(cameras)) or "flats"
    )
    found = ranking.Ranking(None, ())  # pyright: ignore[reportArgumentType]
    names = ("brighter_fatter", "interpixel_crosstalk")
    one, other = (refined(name, stated.with_effect(name), 40.0, 1.0) for name in names)
    far = refined("smear", stated.with_effect("smear"), 3.0, 1.0)
    found.note_ambiguous([one, ranking.replace(other, gain=40.0 - behind), far], lambda *_: None)
    assert found.ambiguous == ([{"effects": list(names), "measure": "flats"}] if told else [])
    assert asked == ([set(names)] if told else [])
