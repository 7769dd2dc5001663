"""A camera with one more effect: where its refit starts, how many sets are simulated, and how its strength is estimated."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.states import Stated, leaving, refined
from visaug.diagnosis import adding
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.criterion import SHARE
from visaug.diagnosis.fitting import fit
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.parameters import Coordinate, intervals
from visaug.diagnosis.fitting.reference import Null, Reference, SimulatedStatistics
from visaug.diagnosis.fitting.uses import Use
from visaug.diagnosis.scatter import VarianceStrength, scatter

BEYOND = Coordinate("brighter_fatter.beyond", False, 0.05, 0.5)
GAIN = Coordinate("gain_e_per_dn", True, 0.02, 0.3)


@pytest.mark.parametrize(
    ("misfits", "kept"),
    [
        ((90.0, 95.0), 0.05),  # about as deep: a form that meets the shoulders of a spot or its edges
        ((90.0, 40.0), 0.05),
        ((90.0, 100.0), 0.15),  # the other valley is clearly deeper
    ],
)
def test_numbers_stay_in_the_valley_where_they_were_unless_another_is_clearly_deeper(
    stated, monkeypatch, misfits, kept
):
    """The first fit takes the arms of a kernel to 0.15, a hundred standard deviations from where they were without tracks."""
    was = stated.with_effect("brighter_fatter", beyond=0.05)
    bent = stated.with_effect("brighter_fatter", beyond=0.15)
    begun = []

    def refit(lab, reference, report, begin=None, known=None):
        assert (known is None) is (begin is None)  # further starts know the first fit
        begun.append(begin)
        camera, fit = (bent, misfits[0]) if begin is None else (begin, misfits[1])
        return SimpleNamespace(camera=camera, misfit=fit)

    monkeypatch.setattr(adding, "refit", refit)
    spread = np.array([0.01, 0.001])
    reference = SimpleNamespace(
        coordinates=(GAIN, BEYOND), null_steps=np.array([1.0, -1.0])[:, None] * spread
    )
    first = SimpleNamespace(camera=stated, coordinates=(GAIN,))
    near = SimpleNamespace(camera=was, reference=SimpleNamespace(coordinates=(GAIN, BEYOND)))
    fitted = Adding(None, first, (), lambda *_: None)._refitted(reference, near)  # pyrefly: ignore[bad-argument-type]
    assert fitted.camera.values()["brighter_fatter.beyond"] == pytest.approx(kept)
    assert len(begun) == 2  # the gain is where the file says: that start is none of its own


def test_a_number_that_was_bent_is_tried_as_the_file_says(stated, monkeypatch):
    """Another valley must only be deeper."""
    bent = stated.replace({"gain_e_per_dn": 1.4})

    def refit(lab, reference, report, begin=None, known=None):
        assert (known is None) is (begin is None)  # further starts know the first fit
        return SimpleNamespace(camera=begin or bent, misfit=90.0 if begin is None else 89.0)

    monkeypatch.setattr(adding, "refit", refit)
    reference = SimpleNamespace(coordinates=(GAIN,), null_steps=np.array([[0.01], [-0.01]]))
    first = SimpleNamespace(camera=stated, coordinates=(GAIN,))
    near = SimpleNamespace(camera=bent, reference=SimpleNamespace(coordinates=(GAIN,)))
    fitted = Adding(None, first, (), lambda *_: None)._refitted(reference, near)  # pyrefly: ignore[bad-argument-type]
    assert fitted.camera.values()["gain_e_per_dn"] == pytest.approx(stated.values()["gain_e_per_dn"])


SIGMA = Coordinate("light_drift.sigma", True, 0.1, 1.5)
FITTED = VarianceStrength(1.0, np.ones(9), (SIGMA,), in_variance=False)
RANDOM = VarianceStrength(1.0, np.ones(9), (SIGMA,), in_variance=True)
STRONGER = VarianceStrength(2.0, np.ones(9), (SIGMA,), in_variance=True)


@pytest.fixture
def drift(stated):
    """A candidate with a strength and another free parameter."""
    own = (SIGMA, Coordinate("light_drift.correlation", False, 0.1, 0.5))
    return replace(
        refined("light_drift", stated.with_effect("light_drift", sigma=0.01), 9.0), coordinates=own
    )


@pytest.fixture
def begun() -> Adding:
    return Adding(None, None, (), lambda *_: None)  # pyrefly: ignore[bad-argument-type]


def scattering(monkeypatch, *told: VarianceStrength | None) -> None:
    """Gives the estimates of a strength, the last one for all further states."""
    left = list(told)
    monkeypatch.setattr(adding, "scatter", lambda *_: left.pop(0) if len(left) > 1 else left[0])


@pytest.mark.parametrize(
    ("far", "decided", "few", "many"),
    [
        (set(), True, [30], [60]),
        (set(), False, [30], [60, 120]),
        ({"light_drift.sigma"}, True, [30, 30], [60]),
        ({"light_drift.sigma", "gain_e_per_dn"}, True, [30, 30], [60]),
    ],
)
def test_sets_are_simulated_until_the_evidence_is_decided_and_anew_where_the_fit_ends_far_from_them(
    monkeypatch, stated, drift, begun, far, decided, few, many
):
    """Derivatives of the camera's own parameters are reused where these did not move far."""
    made = []

    def reference(lab, camera, coordinates, count, report, known=None, begun=None):
        made.append((count, begun, known))
        made_here = leaving([1.0], camera).fitted.reference
        made_here.sets = [0.0] * count
        return made_here

    def refitted(lab, reference, *_, **__):
        return Fitted(reference, reference.camera, *np.ones((3, 1)))

    def follow(lab, fitted, report):
        ends.append(len(fitted.reference.sets))
        return fitted

    ends = []
    monkeypatch.setattr(adding, "followed", follow)
    for module in (adding, fit):
        monkeypatch.setattr(module, "make_reference", reference)
        monkeypatch.setattr(module, "refit", refitted)
    monkeypatch.setattr(adding, "evidence", lambda *_: SimpleNamespace(is_decided=decided))
    monkeypatch.setattr(fit, "far_coordinates", lambda *_: far if len(made) == 1 else set())
    monkeypatch.setattr(Adding, "_refitted", lambda self, reference, near: refitted(None, reference))
    scattering(monkeypatch, FITTED)
    before = leaving([9.0], stated)
    before.fitted.reference.coordinates.append(GAIN)
    sketch = begun.sketched(before, drift)
    assert [count for count, *_ in made] == few
    assert made[-1][2] is (None if "gain_e_per_dn" in far else before.fitted.reference)
    after = begun.completed(before, drift, sketch)
    assert [count for count, *_ in made] == few + many
    assert made[len(few)][1] is sketch.fitted.reference  # its sets are reused
    assert ends == [30, *many]  # each fit is followed to its end
    assert after.accepted == ("light_drift",)


@pytest.mark.parametrize(
    ("told", "share", "hopeless"),
    [
        (None, 0.49 * SHARE, True),
        (FITTED, 0.49 * SHARE, True),
        (FITTED, 0.51 * SHARE, False),
        (None, 1.0, False),
        (RANDOM, 0.1, False),  # its strength is not known yet
        (STRONGER, -1.0, False),
    ],
)
def test_few_sets_exclude_a_fitted_effect_that_explains_little(
    monkeypatch, stated, drift, begun, told, share, hopeless
):
    """Half of the least share of the criterion."""
    scattering(monkeypatch, told)
    monkeypatch.setattr(adding, "evidence", lambda *_: Stated(share * 100, share))
    assert begun.is_hopeless(leaving([9.0], stated), drift, leaving([1.0], stated)) is hopeless


@pytest.mark.parametrize(
    ("told", "reproduced", "by_means"),
    [
        (None, True, True),
        (FITTED, True, True),
        (RANDOM, True, False),
        (STRONGER, True, False),
        (RANDOM, False, True),
    ],
)
def test_a_strength_is_estimated_from_variance_where_means_do_not_determine_it(
    monkeypatch, stated, drift, begun, told, reproduced, by_means
):
    """The fit of the means is kept if the other estimate does not reproduce itself."""
    states = {name: leaving([1.0], stated) for name in ("sketch", "variance", "means")}
    scattering(monkeypatch, told)
    monkeypatch.setattr(Adding, "_as_it_scatters", lambda *_: states["variance"] if reproduced else None)
    monkeypatch.setattr(Adding, "grown", lambda *_: states["means"])
    monkeypatch.setattr(adding, "evidence", lambda *_: SimpleNamespace(is_decided=True))
    after = begun.completed(leaving([9.0], stated), drift, states["sketch"])
    assert after is states["means" if by_means else "variance"]


@pytest.mark.parametrize(
    ("told", "strengths", "kept"),
    [
        ([RANDOM], [0.01], 0.01),
        ([STRONGER, RANDOM], [0.01, 0.02], 0.02),  # simulated again with the new strength
        ([STRONGER, STRONGER], [0.01, 0.02], None),
    ],
)
def test_a_strength_from_variance_must_reproduce_itself(
    monkeypatch, stated, drift, begun, told, strengths, kept
):
    """The strength is held in the fit; only the other parameter is free."""
    scattering(monkeypatch, *told)
    tried, free = [], []

    def added(self, state, effect, camera, own, sets, begun, settle):
        tried.append(camera.values()["light_drift.sigma"])
        free.append([c.path for c in own])
        return leaving([1.0], camera, effect)

    monkeypatch.setattr(Adding, "_added", added)
    after = begun._scattering(leaving([9.0], stated), drift, drift.camera, (SIGMA,), 30)
    assert tried == pytest.approx(strengths)
    assert not any("light_drift.sigma" in paths for paths in free)
    assert (after is None) == (kept is None)
    if after is not None:
        assert after.scatters == (RANDOM,)
        assert after.fitted.camera.values()["light_drift.sigma"] == pytest.approx(kept)


@pytest.mark.parametrize(("share", "stronger"), [(0.3, True), (0.8, False), (1.0, False)])
def test_the_answer_of_a_strength_is_simulated_within_its_bound(stated, share, stronger):
    """Thirty statistics that a share moves at random, in proportion; at most 1, so that less of it is simulated near that.

    Also a drift of the first parameter's kind, by 100, which the refit takes out.
    """
    own = Coordinate("blooming.share", True, 0.1, 1.5)
    camera, count = stated.with_effect("blooming", share=share), 60
    slopes = np.ones((30, 1))
    asked = []

    def of(strength: float) -> np.ndarray:
        rng = np.random.default_rng(0)
        return rng.standard_normal((count, 30)) + 4 * strength * rng.standard_normal((count, 30))

    class Lab:
        def finding(self, jobs, report=None):
            asked.append(jobs[0][0].values()["blooming.share"] / share)
            return of(asked[0])[: len(jobs)] + 100

    def use(sets: np.ndarray) -> Use:
        null = Null(sets - sets.mean(0), np.full(30, 0.1), np.zeros((30, 0)), np.zeros(0))
        return Use(np.random.default_rng(9).normal(0, 4.1, 30), sets, null, np.zeros(30))

    before, after = use(of(0.0)), use(of(1.0))
    told = scatter(before, after, (own,))
    assert told is not None
    black = Coordinate("black_level_dn", False, 1.0, 1e3)
    sample = SimulatedStatistics(of(1.0), slopes, np.zeros(30))
    reference = Reference(camera, (black,), sample, sample, sample)
    states = (
        SimpleNamespace(find=before),
        SimpleNamespace(find=after, fitted=SimpleNamespace(reference=reference)),
    )
    answering = Adding(Lab(), None, (), lambda *_: None)._answering(*states, told)  # pyrefly: ignore[bad-argument-type]
    assert asked == pytest.approx([1.5 if stronger else 1 / 1.5])
    assert answering.answer == pytest.approx(1, abs=0.2)


def test_an_effect_of_more_sets_than_a_later_one_keeps_its_interval(stated, drift):
    """A drift by 120 sets, then row noise by 2: each interval is 1.96 standard deviations of its own sets."""
    told = np.exp(np.random.default_rng(0).normal(0, 0.2, 120))
    both = drift.camera.with_effect("row_noise", sigma_e=2.0)
    state = replace(leaving([1.0], both, "row_noise"), scatters=(replace(RANDOM, of_sets=told),))
    state.fitted.reference.spread_steps = np.array([[-0.1], [0.1]])
    coordinates, steps, undetermined = state.numbers
    found = intervals(coordinates, both, steps, undetermined)
    for path, sd in (("light_drift.sigma", np.log(told).std(ddof=1)), ("row_noise.sigma_e", 0.1 * 2**0.5)):
        value, _, high = found[path]
        assert high == pytest.approx(value * np.exp(1.96 * sd))


@pytest.mark.parametrize(
    ("evidence", "strengths", "taken", "sketched"),
    [
        ([Stated(10.0), Stated(50.0)], (0.02, 0.02), 0.0, 1),  # the first is enough
        ([Stated(10.0, 0.2), Stated(50.0, 0.2)], (0.02, 0.02), 0.9, 2),  # the more probable of two
        ([Stated(50.0, 0.2), Stated(10.0, 0.2)], (0.02, 0.02), 0.0, 2),
        ([Stated(10.0, 0.2)], (0.02, None), 0.0, 2),  # the other one's strength does not reproduce itself
        ([], (None,), None, 1),
    ],
)
def test_other_parameters_of_a_random_effect_are_tried_at_the_catalogues_values(
    monkeypatch, stated, drift, begun, evidence, strengths, taken, sketched
):
    """With few sets each, until one has the evidence that it should have; the most probable is simulated in full."""
    calls, left, strength = [], list(evidence), list(strengths)

    def scatters(self, state, candidate, camera, of, sets, first=None):
        calls.append((sets, camera.values()["light_drift.correlation"]))
        if sets == adding.STAGES_AFTER[0] and strength.pop(0) is None:
            return None
        return SimpleNamespace(fitted=SimpleNamespace(reference=SimpleNamespace(camera=camera)))

    cameras = [stated.with_effect("light_drift", correlation=c) for c in (0.0, 0.9)]
    monkeypatch.setattr(Adding, "_otherwise", lambda *_: iter(cameras))
    monkeypatch.setattr(Adding, "_scattering", scatters)
    monkeypatch.setattr(adding, "evidence", lambda *_: left.pop(0))
    after = begun._as_it_scatters(leaving([9.0], stated), drift, leaving([1.0], drift.camera), RANDOM)
    assert (after is None) == (taken is None)
    full = [] if taken is None else [(adding.SETS_AFTER, taken)]
    assert calls == [(adding.STAGES_AFTER[0], c) for c in (0.0, 0.9)][:sketched] + full
