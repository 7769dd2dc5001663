"""Which of the candidates is accepted, and in what order they are simulated."""

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis.states import Stated, leaving, refined
from visaug import Camera
from visaug.diagnosis import choice
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.fitting.parameters import Coordinate

GAINS = {"light_drift": 130.0, "row_noise": 120.0, "flicker_noise": 110.0, "vignetting": 60.0, "smear": 55.0}
REFUSED = Stated(ODDS - 1)


class Simulations:
    """Adds candidates without simulating; records their names.

    The evidence of each is given, by its name or by its form, and the log odds of pairs, by the first's name: those of the
    scores if omitted.
    """

    effects = 5

    def __init__(
        self,
        evidence: dict[str, Stated],
        hopeless: tuple[str, ...] = (),
        against: dict[str, float] | None = None,
    ):
        self._evidence, self._hopeless, self._against = evidence, hopeless, against or {}
        self.sketches: list[str] = []
        self.completions: list[str] = []
        self.parameters: list[int] = []

    @staticmethod
    def name(camera: Camera, effect: str) -> str:
        return camera.choices().get(f"{effect}.pattern", effect)

    def with_candidate(self, state, candidate: Refined):
        name = self.name(candidate.camera, candidate.effect)
        self.sketches.append(name)
        if name not in self._hopeless:
            self.completions.append(name)
        return leaving([1.0 if name in self._hopeless else 0.0], candidate.camera, candidate.effect)

    def _of(self, after) -> tuple[str, Stated]:
        name = self.name(after.fitted.camera, after.accepted[-1])
        return name, self._evidence.get(name, REFUSED)

    def evidence(self, before, after, parameters: int, effects: int) -> Stated:
        assert effects == self.effects
        self.parameters.append(parameters)
        return self._of(after)[1]

    def between(self, before, one, other) -> float:
        (name, own), (_, rival) = self._of(one), self._of(other)
        return self._against.get(name, own.score - rival.score)


def chosen(monkeypatch, stated, simulations: Simulations, gains=GAINS) -> choice.Accepted | None:
    found = [refined(name, stated.with_effect(name), gain) for name, gain in gains.items()]
    return accepted(monkeypatch, stated, simulations, found)


def accepted(monkeypatch, stated, simulations: Simulations, found: list[Refined]) -> choice.Accepted | None:
    monkeypatch.setattr(choice, "evidence", simulations.evidence)
    monkeypatch.setattr(choice, "between", simulations.between)
    return choice.accepted(leaving([9.0], stated), found, simulations)  # pyrefly: ignore[bad-argument-type]


def test_of_those_accepted_the_most_probable_is_chosen(monkeypatch, stated):
    """Not the one with the largest gain or with the largest odds against no effect.

    All rivals are simulated, and those farther behind are not.
    """
    odds = {"light_drift": 20.0, "row_noise": 50.0, "flicker_noise": 40.0, "vignetting": 90.0}
    simulations = Simulations({name: Stated(value) for name, value in odds.items()})
    one = chosen(monkeypatch, stated, simulations)
    assert one is not None
    assert one.best.refined.effect == "row_noise"
    assert one.odds == [0, -10, -30]
    assert [j.refined.effect for j in one.standing] == ["row_noise", "flicker_noise", "light_drift"]
    assert [r.effect for r in one.others] == ["vignetting", "smear"]
    assert simulations.completions == simulations.sketches == ["light_drift", "row_noise", "flicker_noise"]


def test_odds_between_pairs_choose_among_those_accepted(monkeypatch, stated):
    """The scores take statistics as independent; the odds of a pair do not, and count parameters as the scores do."""
    evidence = {"light_drift": Stated(60.0), "row_noise": Stated(50.0, cost=4.0)}
    for against, best, odds in (
        (3.0, "light_drift", -1),
        (4.0 + 0.9 * ODDS, "light_drift", 0),  # more probable, not beyond doubt
        (4.0 + 1.1 * ODDS, "row_noise", -1.1 * ODDS),
    ):
        one = chosen(monkeypatch, stated, Simulations(evidence, against={"row_noise": against}))
        assert one is not None
        assert one.best.refined.effect == best
        assert one.odds == pytest.approx([0, odds])


@pytest.mark.parametrize(
    ("gain", "against", "best"),
    [
        (0.0, 0.0, "smear"),  # as probable, with a parameter less
        (1e-3, 0.0, "tap_mismatch"),
        (0.0, -1.0, "tap_mismatch"),  # more probable all the same
    ],
)
def test_of_two_equally_probable_ones_that_without_an_idle_strength_is_first(
    monkeypatch, stated, gain, against, best
):
    """Two taps of one gain have a strength more than they need."""
    taps = stated.with_effect("tap_mismatch", gain=gain, offset_e=2.0)
    strengths = [Coordinate(f"tap_mismatch.{key}", False, 1e-3, 1.0) for key in ("gain", "offset_e")]
    found = [
        replace(refined("tap_mismatch", taps, 60.0), coordinates=tuple(strengths)),
        refined("smear", stated.with_effect("smear"), 59.0),
    ]
    evidence = {"tap_mismatch": Stated(60.0), "smear": Stated(59.0)}
    simulations = Simulations(evidence, against={"smear": against})
    one = accepted(monkeypatch, stated, simulations, found)
    assert one is not None
    assert one.best.refined.effect == best
    assert {j.refined.effect for j in one.standing} == {"tap_mismatch", "smear"}
    assert one.odds == pytest.approx([0.0, against])


def blinking(stated, **values) -> list[Refined]:
    rts = stated.with_effect("dark_current_rts", **values)
    found = [
        refined("dark_current_rts", rts, 60.0),
        refined("hot_pixels", stated.with_effect("hot_pixels"), 50.0),
    ]
    return [*found, refined("dust", stated.with_effect("dust"), 20.0)]


@pytest.mark.parametrize(
    ("values", "score", "names"),
    [
        ({"kept": 0.9}, 40.0, ["dark_current_rts", "hot_pixels"]),
        ({"kept": 0.99}, 40.0, ["hot_pixels"]),  # no pixel jumps
        ({"kept": 0.9, "duty": 1.0}, 40.0, ["hot_pixels"]),
        ({"kept": 0.99}, ODDS - 1, []),  # hot pixels are refused, and what they explain is no dust
    ],
)
def test_an_effect_is_named_only_where_the_frames_show_what_sets_it_apart(
    monkeypatch, stated, values, score, names
):
    evidence = {
        "dark_current_rts": Stated(90.0),
        "hot_pixels": Stated(score),
        "dust": Stated(10.0),
    }
    one = accepted(monkeypatch, stated, Simulations(evidence), blinking(stated, **values))
    assert [j.refined.effect for j in (one.standing if one else ())] == names


def test_a_special_case_of_what_the_camera_has_stands_back(monkeypatch, stated):
    """Hot pixels whose rates have another law leave what pixels that never jump explain; dust is named all the same."""
    evidence = {"dark_current_rts": Stated(90.0), "dust": Stated(10.0)}
    found = [one for one in blinking(stated, kept=0.99) if one.effect != "hot_pixels"]
    assert accepted(monkeypatch, stated, Simulations(evidence), found) is None
    one = accepted(monkeypatch, stated.with_effect("hot_pixels"), Simulations(evidence), found)
    assert one is not None
    assert [j.refined.effect for j in one.standing] == ["dust"]


@pytest.mark.parametrize(
    ("half", "becomes"),
    [(0.4, None), (0.6, "veiling_glare")],  # 1.96 relative standard deviations below and above 1
)
def test_a_share_that_its_interval_does_not_tell_from_0_sets_nothing_apart(stated, half, becomes):
    flare = stated.with_effect("lens_flare", ghost_share=0.01, halo_share=0.03)
    state = leaving([0.0], flare, "lens_flare")
    coordinates = state.fitted.reference.coordinates
    own = next(k for k, c in enumerate(coordinates) if c.path == "lens_flare.ghost_share")
    steps = np.zeros((3, len(coordinates)))
    steps[:, own] = [-half, 0.0, half]  # of a standard deviation of `half`
    reference = state.fitted.reference
    reference.spread_steps = steps  # pyrefly: ignore[read-only]
    judged = choice.Judged(refined("lens_flare", flare, 60.0), state, Stated(90.0))  # pyrefly: ignore[bad-argument-type]
    assert judged.becomes == becomes
    assert judged.accepts is (becomes is None)


def test_nothing_is_accepted_if_the_most_probable_candidate_falls_short(monkeypatch, stated):
    simulations = Simulations({"light_drift": Stated(500.0, share=0.3), "row_noise": Stated(20.0)})
    assert chosen(monkeypatch, stated, simulations) is None
    simulations = Simulations({"light_drift": Stated(10.0, share=0.3), "row_noise": Stated(20.0)})
    one = chosen(monkeypatch, stated, simulations)
    assert one is not None
    assert [j.refined.effect for j in one.standing] == ["row_noise"]
    assert "light_drift" in [r.effect for r in one.others]


class Unproven(Stated):
    """Evidence that reaches what the effect would explain as the cause, and whose parameters cost more."""

    @property
    def odds(self) -> float:
        return ODDS - 1


def test_one_that_is_refused_for_its_odds_alone_stands_back(monkeypatch, stated):
    """An uneven light of four numbers explains more than a vignetting of one, and is less probable than nothing missing."""
    simulations = Simulations({"light_drift": Unproven(500.0), "row_noise": Stated(20.0)})
    one = chosen(monkeypatch, stated, simulations)
    assert one is not None
    assert [j.refined.effect for j in one.standing] == ["row_noise"]
    assert chosen(monkeypatch, stated, Simulations({"light_drift": Unproven(500.0)})) is None
    short = Simulations({"light_drift": Unproven(500.0, share=0.3), "row_noise": Stated(20.0)})
    assert chosen(monkeypatch, stated, short) is None


@pytest.mark.parametrize(
    ("refused", "against", "odds"),
    [
        (Stated(58.0, share=0.5), -0.9 * ODDS, [0, -0.9 * ODDS]),
        (Stated(58.0, share=0.5), 10 * ODDS, [0, 0]),  # it does not replace what was accepted
        (Stated(58.0, share=0.5), -1.1 * ODDS, [0]),
        (Stated(ODDS - 1), 0.0, [0]),  # not better than nothing
    ],
)
def test_a_refused_candidate_that_is_about_as_probable_is_a_rival(
    monkeypatch, stated, refused, against, odds
):
    simulations = Simulations(
        {"light_drift": Stated(60.0), "row_noise": refused}, against={"row_noise": against}
    )
    one = chosen(monkeypatch, stated, simulations)
    assert one is not None
    assert [j.refined.effect for j in one.standing] == ["light_drift", "row_noise"][: len(odds)]
    assert one.odds == pytest.approx(odds)
    assert ("row_noise" in [r.effect for r in one.others]) is (len(odds) == 1)


def test_candidates_behind_are_simulated_if_the_first_are_refused(monkeypatch, stated):
    simulations = Simulations({"smear": Stated(30.0)})
    one = chosen(monkeypatch, stated, simulations)
    assert one is not None
    assert one.best.refined.effect == "smear"
    assert simulations.sketches == list(GAINS)
    assert [r.effect for r in one.others] == [name for name in GAINS if name != "smear"]


def test_nothing_is_chosen_if_all_are_refused(monkeypatch, stated):
    simulations = Simulations({})
    assert chosen(monkeypatch, stated, simulations) is None
    assert simulations.sketches == list(GAINS)


def test_no_more_than_three_are_simulated_together(monkeypatch, stated):
    gains = dict.fromkeys(GAINS, 100.0)
    simulations = Simulations({name: Stated(30.0) for name in gains})
    one = chosen(monkeypatch, stated, simulations, gains)
    assert one is not None
    assert simulations.sketches == list(gains)[:3]


@pytest.mark.parametrize("gain", [0.0, -5.0])
def test_a_candidate_without_a_gain_is_not_simulated(monkeypatch, stated, gain):
    """Not even if it would be accepted; it is among the others."""
    simulations = Simulations({"smear": Stated(90.0), "row_noise": Stated(30.0)})
    one = chosen(monkeypatch, stated, simulations, {"row_noise": 5.0, "smear": gain})
    assert simulations.sketches == ["row_noise"]
    assert one is not None
    assert [r.effect for r in one.others] == ["smear"]
    assert chosen(monkeypatch, stated, Simulations({"smear": Stated(90.0)}), {"smear": gain}) is None


def test_a_candidate_that_few_sets_exclude_is_not_simulated_in_full(monkeypatch, stated):
    simulations = Simulations({"row_noise": Stated(30.0)}, hopeless=("light_drift",))
    one = chosen(monkeypatch, stated, simulations)
    assert one is not None
    assert one.best.refined.effect == "row_noise"
    assert simulations.sketches == ["light_drift", "row_noise", "flicker_noise"]
    assert simulations.completions == ["row_noise", "flicker_noise"]


def test_the_number_of_free_parameters_is_that_of_the_candidate(monkeypatch, stated):
    simulations = Simulations({})
    chosen(monkeypatch, stated, simulations, {"brighter_fatter": 5.0, "point_spread": 4.9})
    assert simulations.parameters == [4, 1]


@pytest.mark.parametrize(
    ("evidence", "form"),
    [
        ({"even": Stated(20.0), "random": Stated(50.0)}, "random"),
        ({"even": Stated(50.0), "random": Stated(20.0)}, "even"),
        ({"even": Stated(50.0, share=0.3), "random": Stated(20.0)}, "random"),
        ({"even": Stated(50.0), "random": Stated(90.0, share=0.3)}, "even"),
        ({}, None),
    ],
)
def test_the_other_options_of_an_effect_are_simulated_too(monkeypatch, stated, evidence, form):
    """One of its forms stands for the effect: one that is accepted, then the one with the larger score."""
    even, random = (
        refined("missing_codes", stated.with_effect("missing_codes", density=0.02, pattern=word), gain)
        for word, gain in (("even", 218.0), ("random", 186.0))
    )
    simulations = Simulations(evidence)
    one = accepted(monkeypatch, stated, simulations, [replace(even, otherwise=random)])
    assert simulations.sketches == ["even", "random"]
    assert (one and [j.refined.words["missing_codes.pattern"] for j in one.standing]) == (form and [form])


@pytest.mark.parametrize(("behind", "is_alike"), [(0.0, True), (ODDS - 0.1, True), (ODDS + 0.1, False)])
def test_other_options_that_are_about_as_probable_are_kept(monkeypatch, stated, behind, is_alike):
    even, random = (
        refined("missing_codes", stated.with_effect("missing_codes", density=0.02, pattern=word), 218.0)
        for word in ("even", "random")
    )
    simulations = Simulations({"even": Stated(90.0), "random": Stated(90.0 - behind)})
    one = accepted(monkeypatch, stated, simulations, [replace(even, otherwise=random)])
    assert one is not None
    kept = one.best.otherwise
    assert (kept is not None) == is_alike
    assert kept is None or kept.refined.words["missing_codes.pattern"] == "random"
