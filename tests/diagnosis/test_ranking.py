"""Probabilities of the candidates, and which of them the frames do not distinguish."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.states import judged, leaving, refined
from visaug.diagnosis import ranking
from visaug.diagnosis.choice import Accepted
from visaug.diagnosis.criterion import ODDS

NAMES = ("brighter_fatter", "interpixel_crosstalk")


@pytest.fixture
def empty() -> ranking.Ranking:
    return ranking.Ranking(SimpleNamespace(error=lambda *_: None), ())  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("behind", "told"), [(0.0, True), (2.9, True), (3.1, False), (50.0, False)])
def test_accepted_candidates_with_nearly_the_same_odds_are_ambiguous(
    stated, monkeypatch, empty, behind, told
):
    """They are reported with the frames in which they differ. A refused candidate is no rival, whatever it gains."""
    asked = []
    monkeypatch.setattr(
        ranking, "measurement", lambda cameras, at_hand, report: asked.append(set(cameras)) or "flats"
    )
    one, other = (
        judged(refined(name, camera := stated.with_effect(name), 40.0), leaving([0.0] * 4, camera, name))
        for name in NAMES
    )
    refused = refined("smear", stated.with_effect("smear"), 400.0)
    empty.choose(
        leaving([9.0] * 4, stated), Accepted([one, other], [0.0, -behind], [refused]), None, lambda *_: None
    )
    assert empty.ambiguous == ([{"effects": list(NAMES), "measure": "flats"}] if told else [])
    assert asked == ([set(NAMES)] if told else [])


def test_probabilities_follow_from_the_odds(stated, empty):
    found = [refined(name, stated.with_effect(name), 40.0) for name in NAMES]
    for difference in (0.0, 2.0, 8.0):
        empty.rank(leaving([9.0] * 4, stated), found, [500.0, 500.0 - difference])
        first, second = empty.ranked
        assert first.probability + second.probability == pytest.approx(1)
        assert second.probability / first.probability == pytest.approx(np.exp(-difference))


def test_a_refused_candidate_is_less_probable_than_the_accepted_ones(stated, empty):
    """All together by one in twenty, and each by what its gain is less than the largest."""
    accepted = judged(
        refined("row_noise", camera := stated.with_effect("row_noise"), 40.0), leaving([0.0] * 4, camera)
    )
    others = [
        refined(name, stated.with_effect(name), gain) for name, gain in zip(NAMES, (90.0, 86.0), strict=True)
    ]
    empty.choose(leaving([9.0] * 4, stated), Accepted([accepted], [0.0], others), None, lambda *_: None)
    probabilities = [r.probability for r in empty.ranked]
    assert [r.effect for r in empty.ranked] == ["row_noise", *NAMES]
    behind = np.log(probabilities[0] / np.array(probabilities[1:]))
    np.testing.assert_allclose(behind, np.array([ODDS, ODDS + 4]) + np.log(2))


def test_an_accepted_effect_has_intervals_and_keeps_its_probability(stated, empty):
    """Later steps rank the others anew."""
    camera = stated.with_effect("row_noise")
    before, after = leaving([9.0] * 4, stated), leaving([0.0] * 4, camera, "row_noise")
    one = judged(refined("row_noise", camera, 40.0), after)
    smear = refined("smear", stated.with_effect("smear"), 30.0)
    empty.rank(before, [one.refined, smear], [40.0, 30.0])
    assert {r.effect: r.parameters["sigma_e"].low for r in empty.ranked if r.effect == "row_noise"} == {
        "row_noise": None
    }
    empty.choose(before, Accepted([one], [0.0], [smear]), None, lambda *_: None)
    accepted = {r.effect: r for r in empty.ranked}["row_noise"]
    assert accepted.parameters["sigma_e"].low is not None
    empty.rank(after, [one.refined, smear], [0.0, 10.0])
    again = {r.effect: r for r in empty.ranked}
    assert again["row_noise"] == accepted
    assert again["smear"].probability > 0.5
