"""Probabilities of the candidates, and which of them the frames do not distinguish."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.states import judged, leaving, refined
from visaug.diagnosis import ranking
from visaug.diagnosis.choice import Accepted
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.outcome import several_maxima
from visaug.diagnosis.result import FittedValue

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
    """They are reported with the frames in which they differ. A candidate that does not stand is no rival, whatever it gains."""
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


def test_intervals_hold_the_values_of_other_options_that_are_about_as_probable(stated, setting, monkeypatch):
    """A corner loss by a power of the radius, and by cos^4: neither form's interval holds what the other one gives."""
    of_law = {"power": (0.205, 0.204, 0.206), "cos4": (0.199, 0.198, 0.200)}

    def estimated(effect, camera, *_):
        law = camera.choices()["vignetting.law"]
        power = {"power": FittedValue(1.8, 1.7, 1.9)} if law == "power" else {}
        return {"corner_loss": FittedValue(*of_law[law], "fraction"), **power}

    monkeypatch.setattr(ranking, "estimates", estimated)
    one, other = (
        judged(refined("vignetting", camera, 40.0), leaving([0.0] * 4, camera, "vignetting"))
        for camera in (stated.with_effect("vignetting", law=law) for law in of_law)
    )
    for otherwise, low in ((None, 0.204), (other, 0.198)):
        chosen = Accepted((replace(one, otherwise=otherwise),), [0.0], [])
        ranked, _ = ranking.chosen_ranks(setting, leaving([9.0] * 4, stated), chosen, one.state, None, {})
        parameters = ranked["vignetting"].parameters
        assert parameters["corner_loss"] == FittedValue(0.205, low, 0.206, "fraction")
        assert parameters["power"] == FittedValue(1.8, 1.7, 1.9)


@pytest.mark.parametrize(("period", "apart"), [(9.7, True), (19.3, False)])
def test_another_maximum_is_told_where_values_or_options_differ(stated, monkeypatch, period, apart):
    """A period and half of it. What differs by less than the intervals of both is the same maximum."""
    periods = {
        2.0: FittedValue(19.4, 19.2, 19.6, "row"),
        1.0: FittedValue(period, period - 0.1, period + 0.1, "row"),
    }

    def estimated(effect, camera, *_):
        strength = camera.values()["periodic_banding.amplitude_e"]
        return {"amplitude_e": FittedValue(1.0, 0.5, 1.5, "e-"), "period": periods[strength]}

    monkeypatch.setattr(ranking, "estimates", estimated)
    cameras = [stated.with_effect("periodic_banding", amplitude_e=e) for e in periods]
    one, other = (
        judged(refined("periodic_banding", camera, 40.0), leaving([0.0] * 4, camera, "periodic_banding"))
        for camera in cameras
    )
    end = leaving([0.0] * 4, cameras[0], "periodic_banding")
    assert ranking.other_maximum(one, end) is None
    text = ranking.other_maximum(replace(one, otherwise=other), end)
    assert text == ("period 9.7 row as with period 19.4 row" if apart else None)
    history = [SimpleNamespace(standing=()), SimpleNamespace(standing=(replace(one, otherwise=other),))]
    told = several_maxima(history, end)  # pyrefly: ignore[bad-argument-type]
    assert (
        told
        == [
            "maxima: periodic_banding: about as likely with period 9.7 row as with period 19.4 row; its intervals hold both"
        ]
        * apart
    )
    assert several_maxima(history, leaving([0.0] * 4, stated)) == []  # pyrefly: ignore[bad-argument-type]


def test_another_option_is_another_maximum(stated):
    one, other = (
        judged(refined("vignetting", camera, 40.0), leaving([0.0] * 4, camera, "vignetting"))
        for camera in (stated.with_effect("vignetting", law=law) for law in ("power", "cos4"))
    )
    text = ranking.other_maximum(replace(one, otherwise=other), one.state)
    assert text == "law cos4 as with law power"


def test_an_effect_is_reported_as_it_is_beside_later_ones(stated, setting, monkeypatch):
    """Its probability and the error with it stay those of its own step; one that was left out later keeps what it had."""
    camera = stated.with_effect("row_noise", sigma_e=2.0)
    first = judged(refined("row_noise", camera, 40.0), leaving([0.0] * 4, camera, "row_noise"))
    before = leaving([9.0] * 4, stated)
    ranked, _ = ranking.chosen_ranks(setting, before, Accepted((first,), [0.0], []), first.state, None, {})
    both = stated.with_effect("row_noise", sigma_e=1.5).with_effect("smear")
    end = leaving([0.0] * 4, both, "row_noise", "smear")
    told = ranking.refitted(ranked, [first], end)["row_noise"]
    assert told.parameters["sigma_e"].value == pytest.approx(1.5)
    assert told.probability == ranked["row_noise"].probability
    assert ranking.refitted(ranked, [first], leaving([0.0] * 4, both, "smear")) == ranked
