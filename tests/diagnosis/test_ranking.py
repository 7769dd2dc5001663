"""What is told of candidates that come close."""

from types import SimpleNamespace

import pytest
from scipy.stats import norm

from tests.diagnosis.states import leaving, refined
from visaug.diagnosis import ranking


@pytest.mark.parametrize(
    ("behind", "is_simulated", "told"),
    [
        (0.0, True, True),
        (13.0, True, True),
        (15.0, True, False),
        (-4.0, True, True),
        (5.0, False, True),
        (7.0, False, False),
    ],
)
def test_candidates_that_frames_cannot_tell_apart_are_told_with_what_would(
    stated, monkeypatch, behind, is_simulated, told
):
    """Simulated sets are too few to say more. The simpler of two may be the one behind."""
    asked = []
    monkeypatch.setattr(
        ranking, "measurement", lambda cameras, at_hand, report: asked.append(set(cameras)) or "flats"
    )
    found = ranking.Ranking(None, ())  # pyright: ignore[reportArgumentType]
    names = ("brighter_fatter", "interpixel_crosstalk")
    one, other = (refined(name, stated.with_effect(name), 40.0, 1.0) for name in names)
    other = ranking.replace(other, gain=40.0 - behind)
    far = refined("smear", stated.with_effect("smear"), 3.0, 1.0)
    simulated, others = ([one, other], [far]) if is_simulated else ([one], [other, far])
    found.note_ambiguous(simulated, others, lambda *_: None)
    assert found.ambiguous == ([{"effects": list(names), "measure": "flats"}] if told else [])
    assert asked == ([set(names)] if told else [])


def test_odds_are_no_surer_than_the_law_that_they_come_from(stated):
    """A difference that is known to 7 has the wrong sign as often as a Gaussian says."""
    state = leaving([9.0, 0.0, 0.0, 0.0], stated)
    state.fitted.reference.sets = None  # pyright: ignore[reportAttributeAccessIssue]
    found = ranking.Ranking(SimpleNamespace(error=lambda *_: None), ())  # pyright: ignore[reportArgumentType]
    names = ("brighter_fatter", "interpixel_crosstalk")
    for difference in (3.0, 6.0, 12.0, 15.0):
        one, other = (
            refined(name, stated.with_effect(name), gain, 1.0)
            for name, gain in zip(names, (40.0, 40.0 - difference), strict=True)
        )
        found.rank(state, [one, other])
        _, second = found.ranked
        expected = norm.sf(difference / 7.0)
        assert expected / 2 < second.probability < 2 * expected
