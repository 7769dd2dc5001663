"""Which of the candidates is accepted, and in what order they are asked."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tests.diagnosis.states import leaving, refined
from visaug.diagnosis import adding, choice
from visaug.diagnosis.refinement import Refined


def deciding() -> choice.Choice:
    """A choice whose simulations a test gives."""
    lab = SimpleNamespace(statistics=(), confirming=())
    return choice.Choice(lab, None, adding.Adding(lab, None, (), None), None)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("gains", "accepted", "hold", "chosen"),
    [
        ({"row_noise": 9.5, "flicker_noise": 4.2}, "both", "flicker_noise", "flicker_noise"),
        ({"row_noise": 9.5, "flicker_noise": 3.2}, "both", "flicker_noise", "row_noise"),  # too far behind
        ({"row_noise": 9.5, "flicker_noise": 4.2}, "both", "", "row_noise"),
        ({"row_noise": 9.5, "flicker_noise": 4.2}, "flicker_noise", "flicker_noise", "flicker_noise"),
        ({"row_noise": 9.5, "flicker_noise": 4.2}, "", "flicker_noise", None),
    ],
)
def test_of_rivals_nearly_alike_it_is_the_one_with_which_the_camera_holds(
    monkeypatch, stated, gains, accepted, hold, chosen
):
    begun, found = deciding(), candidates(stated, gains)
    choosing(begun, monkeypatch, rivals=2, accepted=tuple(gains) if accepted == "both" else (accepted,))
    monkeypatch.setattr(choice.Choice, "holds", lambda self, state: state.accepted == (hold,))
    one = begun.accepted(leaving([9.0], stated), found, None)  # pyright: ignore[reportArgumentType]
    assert (one and one.refined.effect) == chosen
    if chosen == "flicker_noise" and accepted == "both":
        assert [r.effect for r, _ in one.standing] == ["flicker_noise", "row_noise"]  # still a rival to it


@pytest.mark.parametrize("rival_is_accepted", [True, False])
def test_one_far_behind_is_asked_where_all_rivals_are_refused(monkeypatch, stated, rival_is_accepted):
    gains = {"light_drift": 130.0, "rts_noise": 9.0, "interpixel_crosstalk": 60.0, "row_noise": 40.0}
    accepted = ("interpixel_crosstalk", *(("light_drift",) if rival_is_accepted else ()))
    begun, found = deciding(), candidates(stated, gains)
    asked = choosing(begun, monkeypatch, rivals=1, accepted=accepted)
    one = begun.accepted(leaving([9.0], stated), found, None)  # pyright: ignore[reportArgumentType]
    assert one is not None
    assert one.refined.effect == ("light_drift" if rival_is_accepted else "interpixel_crosstalk")
    assert asked == ["light_drift", *([] if rival_is_accepted else ["interpixel_crosstalk"])]
    assert "row_noise" in [other.effect for other in one.others]


@pytest.mark.parametrize("refuses", ["explains", "recurs_so", "_improves", None])
def test_a_candidate_must_pass_every_check(stated, monkeypatch, refuses):
    """One that does not joins the refused, which speak against others that say the same."""
    begun = deciding()
    for name in ("explains", "recurs_so"):
        monkeypatch.setattr(choice, name, lambda *_, name=name: name != refuses)
    monkeypatch.setattr(choice.Choice, "_improves", lambda *_: refuses != "_improves")
    refused = []
    flare = stated.with_effect("lens_flare", ghost_share=0.003, halo_share=0.015)
    pair = (refined("lens_flare", flare, 9.0, 1.0), leaving([0.0], flare, "lens_flare"))
    state = leaving([3.0], stated)
    assert begun._is_acceptable(state, pair, refused, None) is (refuses is None)  # pyright: ignore[reportArgumentType]
    assert [r.effect for r, _ in refused] == ([] if refuses is None else ["lens_flare"])
    assert all(moves == pytest.approx([3.0]) for _, moves in refused)


@pytest.mark.parametrize("hopeless", ["light_drift", "row_noise"])
def test_one_that_is_not_promising_is_told_far_behind_and_stands_for_none(monkeypatch, stated, hopeless):
    """It is no rival, however much its first match gained; and where all are refused it still speaks for what says the same."""
    gains = {"light_drift": 130.0, "row_noise": 120.0, "vignetting": 60.0}
    begun, found = deciding(), candidates(stated, gains)
    (other,) = {"light_drift", "row_noise"} - {hopeless}
    asked = choosing(begun, monkeypatch, rivals=2, accepted=(other,))
    made = adding.Adding.where_promising
    monkeypatch.setattr(
        adding.Adding,
        "where_promising",
        lambda self, state, r: None if r.effect == hopeless else made(self, state, r),
    )
    state = leaving([9.0] * 4, stated)
    one = begun.accepted(state, found, None)  # pyright: ignore[reportArgumentType]
    assert one is not None
    assert [r.effect for r, _ in one.standing] == [one.refined.effect] == [other] == asked
    assert {r.effect: r.gain <= one.refined.gain - choice.DECISIVE for r in one.others}[hopeless]
    monkeypatch.setattr(choice.Choice, "_is_acceptable", lambda *_: False)
    refused = []
    monkeypatch.setattr(
        choice.Choice,
        "_is_said",
        lambda self, state, r, moves, those: bool(refused.append(list(those)) or True),
    )
    assert begun.accepted(state, found, None) is None  # pyright: ignore[reportArgumentType]
    assert [r.effect for r, _ in refused[-1]] == [hopeless]


@pytest.mark.parametrize(
    ("explaining", "promising", "taken"),
    [
        (("even", "random"), ("even", "random"), "even"),  # the other words are not asked
        (("random",), ("even", "random"), "random"),
        (("random",), ("random",), "random"),
        ((), ("even",), "even"),
        ((), (), "even"),
    ],
)
def test_what_does_not_explain_is_asked_in_other_words(monkeypatch, stated, explaining, promising, taken):
    """Codes missing evenly fit a little better than the random ones that are missing, and explain nothing."""
    states, asked = {word: leaving([0.0], stated) for word in ("even", "random")}, []

    def where_promising(self, state, r):
        asked.append(word := r.camera.choices()["missing_codes.pattern"])
        return states[word] if word in promising else None

    even, other = (
        refined("missing_codes", stated.with_effect("missing_codes", density=0.02, pattern=word), gain, 1.0)
        for word, gain in (("even", 218.0), ("random", 186.0))
    )
    monkeypatch.setattr(adding.Adding, "where_promising", where_promising)
    monkeypatch.setattr(
        choice, "explains", lambda _, before, after: any(after is states[w] for w in explaining)
    )
    found, after = deciding()._simulated(leaving([9.0], stated), replace(even, otherwise=other))
    assert found.words == {"missing_codes.pattern": taken}
    assert after is (states[taken] if taken in promising else None)
    assert asked == ["even"] if "even" in explaining else ["even", "random"]


def candidates(stated, gains: dict[str, float]) -> list[Refined]:
    return [refined(name, stated.with_effect(name), gain, 1.0) for name, gain in gains.items()]


def choosing(begun: choice.Choice, monkeypatch, rivals: int, accepted: tuple[str, ...]) -> list[str]:
    """Leaves a search nothing to do but choose; which effects are asked is in the list."""
    asked = []

    def is_acceptable(self, state, candidate, refused, by_chance):
        asked.append(candidate[0].effect)
        return candidate[0].effect in accepted

    monkeypatch.setattr(choice, "rivals", lambda lab, found, *_: found[:rivals])
    monkeypatch.setattr(choice, "decided", lambda statistics, state, simulated: simulated)
    monkeypatch.setattr(choice, "is_beyond", lambda *_: True)
    monkeypatch.setattr(
        adding.Adding, "where_promising", lambda self, state, r: leaving([0.0], r.camera, r.effect)
    )
    monkeypatch.setattr(choice.Choice, "_is_acceptable", is_acceptable)
    return asked


@pytest.mark.parametrize(
    ("names", "before", "after", "again", "completes"),
    [
        (1, 0.005, 0.4, False, True),  # what stood out is gone
        (
            1,
            0.09,
            0.09,
            False,
            False,
        ),  # nothing stood out: the first effect's form may have left what both move
        (1, 0.09, 0.09, True, True),  # but not in frames that did not find it
        (1, 0.005, 0.005, True, False),
        (0, 0.005, 0.4, True, False),
    ],
)
def test_a_second_effect_completes_a_camera_by_what_stood_out_or_is_there_again(
    names, before, after, again, completes
):
    states = [SimpleNamespace(accepted=("brighter_fatter",) * names, p_value=p) for p in (before, after)]
    assert choice._completes(*states, again=again) is completes  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("names", "gain", "after", "has"),
    [(1, 14.0, 0.005, True), (2, 14.0, 0.005, False), (2, 14.0, 0.4, True), (2, 6.0, 0.4, False)],
)
def test_beside_two_effects_a_third_must_leave_nothing(monkeypatch, names, gain, after, has):
    """A ghost of a ten-thousandth met one statistic of many that the forms of a veil and of a bent response left."""
    monkeypatch.setattr(choice, "acts_elsewhere", lambda *_: True)
    accepted = ("veiling_glare", "nonlinearity")[:names]
    states = [SimpleNamespace(accepted=accepted, p_value=p) for p in (0.005, after)]
    assert choice._has_a_case([], *states, gain=gain, again=True) is has  # pyright: ignore[reportArgumentType]
