"""An accepted effect is compared with its rivals again beside a later one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.small import frame_set
from tests.diagnosis.states import Stated, judged, leaving, refined
from visaug import Camera
from visaug.diagnosis import adding, search, swap
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.result import Ranked
from visaug.diagnosis.session.fits import Fits
from visaug.diagnosis.stage import History, SearchStage


@pytest.fixture
def veiled(stated) -> dict[str, Camera]:
    trail = stated.with_effect("charge_transfer_inefficiency", share_per_transfer=1e-4)
    return {
        "flare": stated.with_effect("lens_flare", ghost_share=0.003, halo_share=0.015),
        "veil": stated.with_effect("veiling_glare", share=0.016, width_px=14.0, profile="exponential"),
        "flare and trail": trail.with_effect("lens_flare", ghost_share=0.003, halo_share=0.015),
        "trail": trail,
    }


def flare_and(veiled, last) -> History:
    """A flare was accepted, with a veil as its rival, and then the last effect of a state."""
    flare = refined("lens_flare", veiled["flare"], 1660.0, 5.0)
    veil = refined("veiling_glare", veiled["veil"], 1480.0, 2.0)
    alone = leaving([2, 20, 0, 0], veiled["veil"], "veiling_glare")
    own = judged(flare, leaving([0, 0, 0, 30], veiled["flare"], "lens_flare"), cost=5.0)
    probabilities = {"lens_flare": 0.98, "veiling_glare": 0.02, "charge_transfer_inefficiency": 1.0}
    ranked = {name: Ranked(name, p, None, {}) for name, p in probabilities.items()}
    plain = leaving([300, 200, 90, 40], veiled["trail"])
    return (
        SearchStage(plain, 0.01, None),
        SearchStage(own.state, 0.01, None, (own, judged(veil, alone, cost=2.0)), ranked=ranked),
        SearchStage(last, 0.01, None, ranked=ranked),
    )


def setting(swapped=None, adequate=()):
    """Simulates nothing: an exchange gives `swapped`, and states of `adequate` are adequate."""
    return SimpleNamespace(
        adding=SimpleNamespace(swapped=lambda *_: swapped, without=lambda *_: None, effects=30),
        errors=SimpleNamespace(told=lambda fitted: None),
        tested=lambda state: (state, 0.5 if any(state is one for one in adequate) else 0.01),
    )


@pytest.fixture
def needed(monkeypatch) -> None:
    """The criterion accepts an effect beside the later one."""
    monkeypatch.setattr(swap, "evidence", lambda *_: SimpleNamespace(accepts=True, odds=100.0))


@pytest.mark.parametrize(("accepts", "adequate"), [(True, True), (False, False), (False, True)])
def test_an_effect_that_is_not_needed_beside_a_later_one_is_left_out(veiled, monkeypatch, accepts, adequate):
    """The later one was no rival of it. Both stay where the criterion accepts it, or where the later one leaves something."""
    both = leaving([0, 0, 0, 2], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    alone = leaving([0, 0, 0, 3], veiled["trail"], "charge_transfer_inefficiency")
    history = flare_and(veiled, both)
    trail = refined("charge_transfer_inefficiency", veiled["trail"], 500.0, 1.0)
    history = (*history[:2], replace(history[2], standing=(judged(trail, both),)))
    judging = []

    def evidence(before, after, parameters, effects):
        judging.append((before is alone, after is both, parameters == len(own.refined.coordinates), effects))
        return SimpleNamespace(accepts=accepts, odds=-2.0)

    own = history[1].standing[0]
    monkeypatch.setattr(swap, "evidence", evidence)
    monkeypatch.setattr(swap, "between", lambda *_: -100.0)  # the rival takes no place
    simulating, asked = setting(both, [alone] * adequate), []
    simulating.adding.without = lambda earlier, state, name: asked.append((earlier, state, name)) or alone
    found = swap.reconsidered(simulating, history)  # pyrefly: ignore[bad-argument-type]
    assert judging == [(True, True, True, 30)]
    assert asked == [(history[0].state, both, "lens_flare")]
    dropped = adequate and not accepts
    assert found[-1].state is (alone if dropped else both)
    assert len(found) == (2 if dropped else 3)
    probability = 1 / (1 + np.exp(2.0)) if dropped else 0.98
    assert found[-1].ranked["lens_flare"].probability == pytest.approx(probability)
    assert found[-1].ranked["charge_transfer_inefficiency"].probability == 1.0


@pytest.mark.usefixtures("needed")
@pytest.mark.parametrize(("odds", "first"), [(-2.0, "veiling_glare"), (-4.0, "lens_flare")])
def test_an_effect_gives_way_to_a_rival_that_is_more_probable_beside_a_later_effect(
    veiled, monkeypatch, odds, first
):
    """Both are compared as missing in the camera without any effect. The rival has fewer parameters, which cost 3 less."""
    both = leaving([0, 0, 0, 25], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    under = veiled["trail"].with_effect("veiling_glare", share=0.016)
    swapped = leaving([1, 0, 0, 0], under, "veiling_glare", "charge_transfer_inefficiency")
    history = flare_and(veiled, both)
    compared = []

    def between(before, one, other):
        compared.append((before is history[0].state, one is swapped, other is both))
        return odds

    monkeypatch.setattr(swap, "between", between)
    found = swap.reconsidered(setting(swapped), history)  # pyrefly: ignore[bad-argument-type]
    assert found[-1].state is (swapped if first == "veiling_glare" else both)
    assert compared == [(True, True, True)]
    assert [stage.action for stage in found] == ["refit", f"add {first}", "add charge_transfer_inefficiency"]
    assert found[-1].ranked[first].probability == 0.98


def test_a_refused_rival_takes_no_place(veiled, monkeypatch):
    """It is reported as ambiguous with the accepted effect, and no more."""
    camera = veiled["flare"].with_effect("veiling_glare")
    history = flare_and(veiled, leaving([0, 0, 0, 1], camera, "lens_flare", "veiling_glare"))
    own, rival = history[1].standing
    refused = replace(rival, evidence=Stated(100.0, share=0.2))
    history = (history[0], replace(history[1], standing=(own, refused)), history[2])
    monkeypatch.setattr(swap, "evidence", lambda *_: SimpleNamespace(accepts=False))
    monkeypatch.setattr(swap, "between", lambda *_: 1e3)
    assert swap.reconsidered(setting(adequate=[rival.state]), history) == history  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(("adequate", "accepts"), [(True, False), (True, True), (False, False)])
def test_an_effect_is_dropped_if_the_later_one_alone_explains_everything(
    veiled, monkeypatch, adequate, accepts
):
    """Two effects of which neither alone is adequate both stay, and one that the criterion accepts beside the other."""
    camera = veiled["flare"].with_effect("veiling_glare")
    both = leaving([0, 0, 0, 1], camera, "lens_flare", "veiling_glare")
    history = flare_and(veiled, both)
    alone = history[1].standing[1].state
    judging = []

    def evidence(before, after, parameters, effects):
        judging.append((before is alone, after is both, parameters == len(own.refined.coordinates), effects))
        return SimpleNamespace(accepts=accepts)

    own = history[1].standing[0]
    monkeypatch.setattr(swap, "evidence", evidence)
    found = swap.reconsidered(setting(adequate=[alone] * adequate), history)  # pyrefly: ignore[bad-argument-type]
    dropped = adequate and not accepts
    assert judging == [(True, True, True, 30)] * adequate
    assert found[-1].state is (alone if dropped else both)
    kept = ["refit", *([] if dropped else ["add lens_flare"]), "add veiling_glare"]
    assert [stage.action for stage in found] == kept
    if not dropped:  # 0.98 of the two, and the other is no alternative any more
        assert found[-1].ranked["lens_flare"].probability == pytest.approx(1.0)
        assert found[-1].ranked["veiling_glare"].probability == 0.02


def test_the_rival_keeps_the_interval_that_holds_its_other_options(veiled, monkeypatch):
    camera = veiled["flare"].with_effect("veiling_glare")
    history = flare_and(veiled, leaving([0, 0, 0, 1], camera, "lens_flare", "veiling_glare"))
    own, rival = history[1].standing
    other = replace(rival, state=leaving([3, 20, 0, 0], veiled["veil"], "veiling_glare"))
    rival = replace(rival, otherwise=other)
    history = (history[0], replace(history[1], standing=(own, rival)), history[2])
    handed = []
    monkeypatch.setattr(swap, "accepted_rank", lambda ranked, *about: handed.append(about) or ranked)
    monkeypatch.setattr(swap, "evidence", lambda *_: SimpleNamespace(accepts=False))
    swap.reconsidered(setting(adequate=[rival.state]), history)  # pyrefly: ignore[bad-argument-type]
    assert handed
    assert all(effect == "veiling_glare" and last is other for _, effect, _, last in handed)


def test_the_rival_takes_the_place_with_its_own_numbers(veiled, monkeypatch):
    made = {}

    def reference(lab, camera, coordinates, *_, **__):
        made.update(camera=camera, paths=[c.path for c in coordinates])
        return SimpleNamespace()

    monkeypatch.setattr(adding, "make_reference", reference)
    monkeypatch.setattr(adding.Adding, "_refitted", lambda self, begun, near: begun)
    for name in ("settled", "followed"):
        monkeypatch.setattr(adding, name, lambda lab, fitted, *_: fitted)
    both = leaving([0, 0, 0, 25], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    camera = veiled["veil"].replace({"veiling_glare.width_px": 14.0})
    alone = leaving([300, 200, 90, 40], camera, "veiling_glare")
    simulating = adding.Adding(None, None, (), None)  # pyrefly: ignore[bad-argument-type]
    state = simulating.swapped(both, "lens_flare", alone)
    assert state.accepted == ("veiling_glare", "charge_transfer_inefficiency")
    assert set(made["camera"].effect_names) == {"charge_transfer_inefficiency", "veiling_glare"}
    assert made["camera"].values()["veiling_glare.width_px"] == 14.0
    assert made["camera"].choices()["veiling_glare.profile"] == "exponential"
    assert "charge_transfer_inefficiency.share_per_transfer" in made["paths"]
    assert "veiling_glare.share" in made["paths"]
    assert not any(path.startswith("lens_flare.") for path in made["paths"])


def test_an_effect_is_left_out_with_its_own_numbers_and_what_it_explained(veiled, monkeypatch):
    made = {}

    def reference(lab, camera, coordinates, sets, *_, **__):
        made.update(camera=camera, paths=[c.path for c in coordinates], sets=sets)
        return SimpleNamespace()

    monkeypatch.setattr(adding, "make_reference", reference)
    after = leaving([20, 2, 0, 0], veiled["trail"], "charge_transfer_inefficiency")
    monkeypatch.setattr(adding.Adding, "_refitted", lambda *_: after.fitted)
    for name in ("settled", "followed"):
        monkeypatch.setattr(adding, name, lambda lab, fitted, *_: fitted)
    plain = leaving([300, 200, 0, 0], veiled["trail"])
    both = leaving([0, 0, 0, 0], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    simulating = adding.Adding(None, None, (), None)  # pyrefly: ignore[bad-argument-type]
    alone = simulating.without(plain, both, "lens_flare")
    assert alone.accepted == ("charge_transfer_inefficiency",)
    assert made["sets"] == adding.STAGES_AFTER[0]
    assert set(made["camera"].effect_names) == {"charge_transfer_inefficiency"}
    assert "charge_transfer_inefficiency.share_per_transfer" in made["paths"]
    assert not any(path.startswith("lens_flare.") for path in made["paths"])
    assert alone.explained[0].tolist() == [280, 198, 0, 0]  # by the effect that stays


@pytest.mark.parametrize("calibrated", [True, False])
def test_quantum_efficiency_is_refitted_only_where_the_photons_of_flats_are_measured(
    stated, monkeypatch, calibrated
):
    """Photons that the stated efficiency itself gave cannot correct it; everything else is refitted all the same."""
    frames = frame_set(5)
    if not calibrated:
        frames = frames.with_records([replace(r, photons=None) for r in frames.records])
    given = []
    monkeypatch.setattr(
        search, "make_reference", lambda lab, camera, coordinates, *_: given.append(coordinates)
    )
    search.given_reference(Laboratory(frames, stated), stated, 20, lambda *_: None)
    Fits(stated, frames)._reference((), lambda *_: None)
    assert len(given) == 2
    for coordinates in given:
        paths = {c.path for c in coordinates}
        assert "gain_e_per_dn" in paths
        assert ("quantum_efficiency" in paths) == calibrated
