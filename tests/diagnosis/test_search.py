"""An earlier name is thought over once a later effect is there."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from visaug import Camera
from visaug.comparison import Error
from visaug.diagnosis import adding, naming, search
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.parameters import effect_coordinates
from visaug.diagnosis.rank import Refined
from visaug.diagnosis.ranking import Ranking
from visaug.diagnosis.result import Ranked, Step
from visaug.fingerprint import Statistic

STATISTIC = Statistic("scene", "slope", "scene spot", ("level",))


def leaving(residual, camera: Camera, *accepted: str) -> State:
    left = np.array(residual, float)
    coordinates = [c for name in accepted for c in effect_coordinates(camera, name)]
    steps = np.zeros((2, len(coordinates)))
    reference = SimpleNamespace(
        null_scale=np.ones(len(left)), coordinates=coordinates, null_steps=steps, untold=steps[0]
    )
    fitted = Fitted(reference, camera, left, left, left)  # pyright: ignore[reportArgumentType]
    return State(fitted, accepted, np.zeros(len(left)), np.zeros(len(left)))


def refined(effect: str, camera: Camera, gain: float, cost: float) -> Refined:
    own = tuple(effect_coordinates(camera, effect))
    return Refined(effect, camera, own, np.zeros(len(own)), gain, np.zeros(4), np.zeros(4), cost)


@pytest.fixture
def veiled(stated) -> dict[str, Camera]:
    trail = stated.with_effect("charge_transfer_inefficiency", share_per_transfer=1e-4)
    return {
        "flare": stated.with_effect("lens_flare", ghost_share=0.003, halo_share=0.015),
        "veil": stated.with_effect("veiling_glare", share=0.016, width_px=14.0, profile="exponential"),
        "flare and trail": trail.with_effect("lens_flare", ghost_share=0.003, halo_share=0.015),
        "trail": trail,
    }


def searching(veiled) -> search._Search:
    """After a flare and a charge transfer were accepted; a veil had been simulated beside the flare."""
    begun = object.__new__(search._Search)
    flare = refined("lens_flare", veiled["flare"], 1660.0, 5.0)
    veil = refined("veiling_glare", veiled["veil"], 1480.0, 2.0)
    alone = leaving([2, 20, 0, 0], veiled["veil"], "veiling_glare")
    begun.stood = [[(flare, leaving([0, 0, 0, 30], veiled["flare"])), (veil, alone)], []]
    begun.errors = SimpleNamespace(told=lambda fitted: None)  # pyright: ignore[reportAttributeAccessIssue]
    begun.steps = [
        Step(word, None) for word in ("refit", "add lens_flare", "add charge_transfer_inefficiency")
    ]
    begun.walk = [leaving([300, 200, 90, 40], veiled["trail"]), *(alone, alone)]
    begun.adding = adding.Adding(None, None, (), None)  # pyright: ignore[reportArgumentType]
    begun.ranking = Ranking(None)  # pyright: ignore[reportArgumentType]
    begun.ranking._ranked = {
        name: Ranked(name, probability, None, {})
        for name, probability in (
            ("lens_flare", 0.98),
            ("veiling_glare", 0.02),
            ("charge_transfer_inefficiency", 1.0),
        )
    }
    return begun


@pytest.mark.parametrize(("density", "first"), [(5.0, "veiling_glare"), (-900.0, "lens_flare")])
def test_a_name_gives_way_to_a_rival_that_says_more_beside_a_later_effect(
    veiled, monkeypatch, density, first
):
    begun = searching(veiled)
    plain = leaving([300, 200, 90, 40], veiled["trail"])
    both = leaving([0, 0, 0, 25], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    under = veiled["trail"].with_effect("veiling_glare", share=0.016)
    swapped = leaving([1, 0, 0, 0], under, "veiling_glare", "charge_transfer_inefficiency")
    monkeypatch.setattr(adding.Adding, "swapped", lambda *_: swapped)
    monkeypatch.setattr(
        naming, "log_density", lambda fitted, *_: density if fitted is swapped.fitted else 0.0
    )
    found = begun._reconsidered(plain, both)
    assert found is (swapped if first == "veiling_glare" else both)
    assert [step.action for step in begun.steps] == [
        "refit",
        f"add {first}",
        "add charge_transfer_inefficiency",
    ]
    assert {r.effect: r.probability for r in begun.ranking.ranked}[first] == 0.98


@pytest.mark.parametrize("holds", [True, False])
def test_a_name_goes_where_the_later_effect_alone_leaves_nothing(veiled, monkeypatch, holds):
    """A blur that had taken most of what blooms; but two effects of which neither alone is enough both stay."""
    begun = searching(veiled)
    (_, alone) = begun.stood[0][1]
    begun.steps[2] = Step("add veiling_glare", None)
    monkeypatch.setattr(begun, "_holds", lambda state: holds and state is alone)
    both = leaving([0, 0, 0, 1], veiled["flare"].with_effect("veiling_glare"), "lens_flare", "veiling_glare")
    found = begun._reconsidered(leaving([300, 200, 90, 40], veiled["trail"]), both)
    assert found is (alone if holds else both)
    kept = ["refit", *([] if holds else ["add lens_flare"]), "add veiling_glare"]
    assert [step.action for step in begun.steps] == kept


def test_the_rival_takes_the_place_with_its_own_numbers(veiled, monkeypatch):
    begun = searching(veiled)
    (own, _), (rival, _) = begun.stood[0]
    made = {}

    def reference(lab, camera, coordinates, *_, **__):
        made.update(camera=camera, paths=[c.path for c in coordinates])
        return SimpleNamespace()

    monkeypatch.setattr(adding.cache, "reference", reference)
    monkeypatch.setattr(adding.Adding, "_refitted", lambda self, reference: reference)
    monkeypatch.setattr(adding.cache, "settled", lambda lab, fitted, *_: fitted)
    both = leaving([0, 0, 0, 25], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    state = begun.adding.swapped(both, own, rival)
    assert state.accepted == ("veiling_glare", "charge_transfer_inefficiency")
    assert set(made["camera"].effect_names) == {"charge_transfer_inefficiency", "veiling_glare"}
    assert made["camera"].values()["veiling_glare.width_px"] == 14.0
    assert made["camera"].choices()["veiling_glare.profile"] == "exponential"
    assert "charge_transfer_inefficiency.share_per_transfer" in made["paths"]
    assert "veiling_glare.share" in made["paths"]
    assert not any(path.startswith("lens_flare.") for path in made["paths"])


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
    veiled, monkeypatch, stated, gains, accepted, hold, chosen
):
    begun, found = searching(veiled), candidates(stated, gains)
    choosing(begun, monkeypatch, rivals=2, accepted=tuple(gains) if accepted == "both" else (accepted,))
    monkeypatch.setattr(begun, "_holds", lambda state: state.accepted == (hold,))
    one = begun._accepted(leaving([9.0], stated), found, None)  # pyright: ignore[reportArgumentType]
    assert (one and one.refined.effect) == chosen
    if chosen == "flicker_noise" and accepted == "both":
        assert [r.effect for r, _ in one.standing] == ["flicker_noise", "row_noise"]  # still a rival to it


@pytest.mark.parametrize("rival_is_accepted", [True, False])
def test_one_far_behind_is_asked_where_all_rivals_are_refused(veiled, monkeypatch, stated, rival_is_accepted):
    gains = {"light_drift": 130.0, "rts_noise": 9.0, "interpixel_crosstalk": 60.0, "row_noise": 40.0}
    accepted = ("interpixel_crosstalk", *(("light_drift",) if rival_is_accepted else ()))
    begun, found = searching(veiled), candidates(stated, gains)
    asked = choosing(begun, monkeypatch, rivals=1, accepted=accepted)
    one = begun._accepted(leaving([9.0], stated), found, None)  # pyright: ignore[reportArgumentType]
    assert one is not None
    assert one.refined.effect == ("light_drift" if rival_is_accepted else "interpixel_crosstalk")
    assert asked == ["light_drift", *([] if rival_is_accepted else ["interpixel_crosstalk"])]
    assert "row_noise" in [other.effect for other in one.others]


@pytest.mark.parametrize(("furthest", "told"), [(3.8, False), (60.0, True)])
def test_an_error_that_surely_stays_is_told_where_something_stands_out(veiled, stated, furthest, told):
    """Of a faint effect the error is mostly noise, and 0.9 of it may stay though the camera holds."""
    begun, state = (
        searching(veiled),
        leaving([furthest, 1.0, 0.5], stated.with_effect("row_noise"), "row_noise"),
    )
    begun.steps[-1] = Step("add row_noise", Error(0.9, 0.3, 1.4))
    begun.lab = SimpleNamespace(measured=[None, None, SimpleNamespace(statistics=[STATISTIC] * 3)])  # pyright: ignore[reportAttributeAccessIssue]
    reference = cast(SimpleNamespace, state.fitted.reference)
    reference.whole_null, reference.largest = SimpleNamespace(scale=np.ones(3)), np.linspace(2.5, 5.0, 120)
    assert begun._is_far_off(state) is told
    assert (begun._form(state) is None) is not told


@pytest.mark.parametrize("refuses", ["explains", "recurs_so", "_improves", None])
def test_a_candidate_must_pass_every_check(veiled, monkeypatch, refuses):
    """One that does not joins the refused, which speak against others that say the same."""
    begun = searching(veiled)
    begun.lab = SimpleNamespace(statistics=(), confirming=())  # pyright: ignore[reportAttributeAccessIssue]
    for name in ("explains", "recurs_so"):
        monkeypatch.setattr(search, name, lambda *_, name=name: name != refuses)
    monkeypatch.setattr(begun, "_improves", lambda *_: refuses != "_improves")
    refused = []
    pair = (refined("lens_flare", veiled["flare"], 9.0, 1.0), leaving([0.0], veiled["flare"], "lens_flare"))
    state = leaving([3.0], veiled["trail"])
    assert begun._is_acceptable(state, pair, refused, None) is (refuses is None)  # pyright: ignore[reportArgumentType]
    assert [r.effect for r, _ in refused] == ([] if refuses is None else ["lens_flare"])
    assert all(moves == pytest.approx([3.0]) for _, moves in refused)


@pytest.mark.parametrize("hopeless", ["light_drift", "row_noise"])
def test_one_that_is_not_promising_is_told_far_behind_and_stands_for_none(
    veiled, monkeypatch, stated, hopeless
):
    """It is no rival, however much its first match gained; and where all are refused it still speaks for what says the same."""
    gains = {"light_drift": 130.0, "row_noise": 120.0, "vignetting": 60.0}
    begun, found = searching(veiled), candidates(stated, gains)
    (other,) = {"light_drift", "row_noise"} - {hopeless}
    asked = choosing(begun, monkeypatch, rivals=2, accepted=(other,))
    made = adding.Adding.where_promising
    monkeypatch.setattr(
        adding.Adding,
        "where_promising",
        lambda self, state, r: None if r.effect == hopeless else made(self, state, r),
    )
    state = leaving([9.0] * 4, stated)
    one = begun._accepted(state, found, None)  # pyright: ignore[reportArgumentType]
    assert one is not None
    assert [r.effect for r, _ in one.standing] == [one.refined.effect] == [other] == asked
    assert {r.effect: r.gain <= one.refined.gain - search.DECISIVE for r in one.others}[hopeless]
    monkeypatch.setattr(begun, "_is_acceptable", lambda *_: False)
    refused = []
    monkeypatch.setattr(
        begun, "_is_said", lambda state, r, moves, those: bool(refused.append(list(those)) or True)
    )
    assert begun._accepted(state, found, None) is None  # pyright: ignore[reportArgumentType]
    assert [r.effect for r, _ in refused[-1]] == [hopeless]


@pytest.mark.parametrize(("may", "scatters"), [(True, False), (False, False), (False, True)])
def test_a_few_simulated_sets_end_what_does_not_explain_what_it_moves(monkeypatch, stated, may, scatters):
    """But for an effect that scatters: how strong it is, and so what it explains, is not told by a few sets."""
    (found,) = candidates(stated, {"row_noise": 9.0})
    state, full, sets = leaving([9.0], stated), leaving([0.0], stated), []

    def reference(lab, camera, coordinates, count, *_):
        sets.append(count)
        return state.fitted.reference

    monkeypatch.setattr(adding.cache, "reference", reference)
    monkeypatch.setattr(adding.Adding, "_refitted", lambda *_: state.fitted)
    monkeypatch.setattr(adding.Adding, "_moves_of", lambda *_: (None, None))
    monkeypatch.setattr(adding.Adding, "_scatter", lambda *_: "so much" if scatters else None)
    monkeypatch.setattr(adding, "may_explain", lambda *_: may)
    monkeypatch.setattr(adding.Adding, "with_candidate", lambda self, state, r, begun: full)
    lab = SimpleNamespace(statistics=())
    added = adding.Adding(lab, None, (), None).where_promising(state, found)  # pyright: ignore[reportArgumentType]
    assert added is (full if may or scatters else None)
    assert sets == [adding.SETS_BEFORE]


def candidates(stated, gains: dict[str, float]) -> list[Refined]:
    return [refined(name, stated.with_effect(name), gain, 1.0) for name, gain in gains.items()]


def choosing(begun: search._Search, monkeypatch, rivals: int, accepted: tuple[str, ...]) -> list[str]:
    """Leaves a search nothing to do but choose; which effects are asked is in the list."""
    asked = []

    def is_acceptable(state, candidate, refused, by_chance):
        asked.append(candidate[0].effect)
        return candidate[0].effect in accepted

    begun.lab = None  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(search, "rivals", lambda lab, found, *_: found[:rivals])
    monkeypatch.setattr(search, "decided", lambda state, simulated: simulated)
    monkeypatch.setattr(search, "is_beyond", lambda *_: True)
    monkeypatch.setattr(
        adding.Adding, "where_promising", lambda self, state, r: leaving([0.0], r.camera, r.effect)
    )
    monkeypatch.setattr(begun, "_is_acceptable", is_acceptable)
    return asked


@pytest.mark.parametrize(("left", "told"), [([0, 27], True), ([0, 6], False), ([60, 0], False)])
def test_a_trace_is_told_where_it_stands_far_out_and_no_accepted_effect_acts(stated, left, told):
    """A glow leaves 1 % of the error. It moves the first statistic by 400 standard deviations, the second, of dust, not at all."""
    glowing = stated.with_effect("amplifier_glow", rate_e_per_s=20.0)
    state = leaving([0, 0], glowing, "amplifier_glow")
    z = np.array(left, float)
    reference = SimpleNamespace(whole_null=SimpleNamespace(scale=np.ones(2)))
    fitted = SimpleNamespace(reference=reference, whole_residual=z)
    state = replace(state, fitted=fitted, whole_allowance=np.array([60.0, 0.0]))
    begun = object.__new__(search._Search)
    begun.errors = SimpleNamespace(found=lambda fitted: Error(0.01, 0.005, 0.015))  # pyright: ignore[reportAttributeAccessIssue]
    assert begun._is_worth_telling(state) is told
