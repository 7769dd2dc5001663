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
def setting():
    errors = SimpleNamespace(distance=SimpleNamespace(error=lambda *_: None))
    measured = [SimpleNamespace(statistics=())] * 3
    return SimpleNamespace(errors=errors, lab=SimpleNamespace(measured=measured), report=lambda *_: None)


def in_order(ranked):
    return sorted(ranked.values(), key=lambda r: -r.probability)


@pytest.mark.parametrize(("behind", "told"), [(0.0, True), (2.9, True), (3.1, False), (50.0, False)])
def test_accepted_candidates_with_nearly_the_same_odds_are_ambiguous(
    stated, monkeypatch, setting, behind, told
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
    chosen = Accepted((one, other), [0.0, -behind], [refused])
    _, ambiguous = ranking.chosen_ranks(setting, leaving([9.0] * 4, stated), chosen, one.state, None, {})
    assert ambiguous == ([{"effects": list(NAMES), "measure": "flats"}] if told else [])
    assert asked == ([set(NAMES)] if told else [])


def test_probabilities_follow_from_the_odds(stated, setting):
    found = [refined(name, stated.with_effect(name), 40.0) for name in NAMES]
    for difference in (0.0, 2.0, 8.0):
        ranked = ranking.ranks(setting, leaving([9.0] * 4, stated), found, [500.0, 500.0 - difference], {})
        first, second = in_order(ranked)
        assert first.probability + second.probability == pytest.approx(1)
        assert second.probability / first.probability == pytest.approx(np.exp(-difference))


def test_a_refused_candidate_is_less_probable_than_the_accepted_ones(stated, setting):
    """All together by one in twenty, and each by what its gain is less than the largest."""
    accepted = judged(
        refined("row_noise", camera := stated.with_effect("row_noise"), 40.0), leaving([0.0] * 4, camera)
    )
    others = [
        refined(name, stated.with_effect(name), gain) for name, gain in zip(NAMES, (90.0, 86.0), strict=True)
    ]
    chosen = Accepted((accepted,), [0.0], others)
    found, _ = ranking.chosen_ranks(setting, leaving([9.0] * 4, stated), chosen, accepted.state, None, {})
    ranked = in_order(found)
    probabilities = [r.probability for r in ranked]
    assert [r.effect for r in ranked] == ["row_noise", *NAMES]
    behind = np.log(probabilities[0] / np.array(probabilities[1:]))
    np.testing.assert_allclose(behind, np.array([ODDS, ODDS + 4]) + np.log(2))


def test_an_accepted_effect_has_intervals_and_keeps_its_probability(stated, setting):
    """Later steps rank the others anew."""
    camera = stated.with_effect("row_noise")
    before, after = leaving([9.0] * 4, stated), leaving([0.0] * 4, camera, "row_noise")
    one = judged(refined("row_noise", camera, 40.0), after)
    smear = refined("smear", stated.with_effect("smear"), 30.0)
    first = ranking.ranks(setting, before, [one.refined, smear], [40.0, 30.0], {})
    assert first["row_noise"].parameters["sigma_e"].low is None
    chosen = Accepted((one,), [0.0], [smear])
    found, _ = ranking.chosen_ranks(setting, before, chosen, after, None, first)
    assert found["row_noise"].parameters["sigma_e"].low is not None
    again = ranking.ranks(setting, after, [one.refined, smear], [0.0, 10.0], found)
    assert again["row_noise"] == found["row_noise"]
    assert again["smear"].probability > 0.5
