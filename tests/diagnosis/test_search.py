"""An accepted effect is compared with its rivals again beside a later one."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from tests.diagnosis.small import frame_set
from tests.diagnosis.states import judged, leaving, refined
from visaug import Camera
from visaug.diagnosis import adding, search
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.ranking import Ranking
from visaug.diagnosis.result import Ranked, Step
from visaug.diagnosis.session.fits import Fits


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
    own = judged(flare, leaving([0, 0, 0, 30], veiled["flare"], "lens_flare"), cost=5.0)
    begun.stood = [[own, judged(veil, alone, cost=2.0)], []]
    begun.errors = SimpleNamespace(told=lambda fitted: None)  # pyright: ignore[reportAttributeAccessIssue]
    begun.lab = SimpleNamespace(statistics=())  # pyright: ignore[reportAttributeAccessIssue]
    begun.steps = [
        Step(word, None) for word in ("refit", "add lens_flare", "add charge_transfer_inefficiency")
    ]
    begun.walk = [leaving([300, 200, 90, 40], veiled["trail"]), *(alone, alone)]
    begun.adding = adding.Adding(None, None, (), None)  # pyright: ignore[reportArgumentType]
    begun.ranking = Ranking(None, ())  # pyright: ignore[reportArgumentType]
    begun.ranking._ranked = {
        name: Ranked(name, probability, None, {})
        for name, probability in (
            ("lens_flare", 0.98),
            ("veiling_glare", 0.02),
            ("charge_transfer_inefficiency", 1.0),
        )
    }
    return begun


@pytest.mark.parametrize(("odds", "first"), [(-2.0, "veiling_glare"), (-4.0, "lens_flare")])
def test_an_effect_gives_way_to_a_rival_that_is_more_probable_beside_a_later_effect(
    veiled, monkeypatch, odds, first
):
    """Both are compared as missing in the camera without any effect. The rival has fewer parameters, which cost 3 less."""
    begun = searching(veiled)
    plain = leaving([300, 200, 90, 40], veiled["trail"])
    both = leaving([0, 0, 0, 25], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    under = veiled["trail"].with_effect("veiling_glare", share=0.016)
    swapped = leaving([1, 0, 0, 0], under, "veiling_glare", "charge_transfer_inefficiency")
    compared = []

    def between(before, one, other):
        compared.append((before is plain, one is swapped, other is both))
        return odds

    monkeypatch.setattr(adding.Adding, "swapped", lambda *_: swapped)
    monkeypatch.setattr(search, "between", between)
    found = begun._reconsidered(plain, both)
    assert found is (swapped if first == "veiling_glare" else both)
    assert compared == [(True, True, True)]
    assert [step.action for step in begun.steps] == [
        "refit",
        f"add {first}",
        "add charge_transfer_inefficiency",
    ]
    assert {r.effect: r.probability for r in begun.ranking.ranked}[first] == 0.98


@pytest.mark.parametrize("adequate", [True, False])
def test_an_effect_is_dropped_if_the_later_one_alone_explains_everything(veiled, monkeypatch, adequate):
    """Two effects of which neither alone is adequate both stay."""
    begun = searching(veiled)
    alone = begun.stood[0][1].state
    begun.steps[2] = Step("add veiling_glare", None)
    begun.signs = ()  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(
        search,
        "chance",
        lambda lab, signs, state: SimpleNamespace(p_value=0.5 if adequate and state is alone else 0.01),
    )
    both = leaving([0, 0, 0, 1], veiled["flare"].with_effect("veiling_glare"), "lens_flare", "veiling_glare")
    found = begun._reconsidered(leaving([300, 200, 90, 40], veiled["trail"]), both)
    assert found is (alone if adequate else both)
    kept = ["refit", *([] if adequate else ["add lens_flare"]), "add veiling_glare"]
    assert [step.action for step in begun.steps] == kept


def test_the_rival_takes_the_place_with_its_own_numbers(veiled, monkeypatch):
    begun = searching(veiled)
    made = {}

    def reference(lab, camera, coordinates, *_, **__):
        made.update(camera=camera, paths=[c.path for c in coordinates])
        return SimpleNamespace()

    monkeypatch.setattr(adding.cache, "reference", reference)
    monkeypatch.setattr(adding.Adding, "_refitted", lambda self, begun, near: begun)
    monkeypatch.setattr(adding.cache, "settled", lambda lab, fitted, *_: fitted)
    both = leaving([0, 0, 0, 25], veiled["flare and trail"], "lens_flare", "charge_transfer_inefficiency")
    camera = veiled["veil"].replace({"veiling_glare.width_px": 14.0})
    alone = leaving([300, 200, 90, 40], camera, "veiling_glare")
    state = begun.adding.swapped(both, "lens_flare", alone)
    assert state.accepted == ("veiling_glare", "charge_transfer_inefficiency")
    assert set(made["camera"].effect_names) == {"charge_transfer_inefficiency", "veiling_glare"}
    assert made["camera"].values()["veiling_glare.width_px"] == 14.0
    assert made["camera"].choices()["veiling_glare.profile"] == "exponential"
    assert "charge_transfer_inefficiency.share_per_transfer" in made["paths"]
    assert "veiling_glare.share" in made["paths"]
    assert not any(path.startswith("lens_flare.") for path in made["paths"])


def test_a_step_has_the_numbers_of_the_steps_before(veiled, monkeypatch):
    begun = searching(veiled)
    state = leaving([2, 20, 0, 0], veiled["veil"], "veiling_glare")
    flare, veil = (j.refined for j in begun.stood[0])
    begun.signs = begun._seen = ()  # pyright: ignore[reportAttributeAccessIssue]
    begun.without, begun.report, begun.refined = frozenset(), lambda *_: None, {}
    begun.ranking = SimpleNamespace(rank=lambda *_: None)  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(search, "accepted", lambda *_: None)
    had: list[dict] = []

    def candidates(*known):
        had.append(dict(known[-1]))
        return [flare] if len(had) == 1 else [veil]

    monkeypatch.setattr(search, "candidates", candidates)
    for _ in range(3):
        begun._add(state)
    assert had == [{}, {"lens_flare": flare}, {"lens_flare": flare, "veiling_glare": veil}]


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
        search.cache, "reference", lambda lab, camera, coordinates, *_: given.append(coordinates)
    )
    search._Search(Laboratory(frames, stated), stated, frozenset(), lambda *_: None, 20)._reference()
    Fits(stated, frames)._reference((), lambda *_: None)
    assert len(given) == 2
    for coordinates in given:
        paths = {c.path for c in coordinates}
        assert "gain_e_per_dn" in paths
        assert ("quantum_efficiency" in paths) == calibrated
