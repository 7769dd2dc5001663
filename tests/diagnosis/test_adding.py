"""A camera with one effect more: from where it is refitted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.residuals import state
from tests.diagnosis.states import leaving, refined
from visaug.diagnosis import adding
from visaug.diagnosis.adding import Adding
from visaug.diagnosis.parameters import Coordinate, strengths_of
from visaug.diagnosis.spread import Scatter

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

    def refit(lab, reference, report, begin=None):
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
    fitted = Adding(None, first, (), lambda *_: None)._refitted(reference, near)  # pyright: ignore[reportArgumentType]
    assert fitted.camera.values()["brighter_fatter.beyond"] == pytest.approx(kept)
    assert len(begun) == 2  # the gain is where the file says: that start is none of its own


def test_a_number_that_was_bent_is_tried_as_the_file_says(stated, monkeypatch):
    """Another valley must only be deeper."""
    bent = stated.replace({"gain_e_per_dn": 1.4})

    def refit(lab, reference, report, begin=None):
        return SimpleNamespace(camera=begin or bent, misfit=90.0 if begin is None else 89.0)

    monkeypatch.setattr(adding, "refit", refit)
    reference = SimpleNamespace(coordinates=(GAIN,), null_steps=np.array([[0.01], [-0.01]]))
    first = SimpleNamespace(camera=stated, coordinates=(GAIN,))
    near = SimpleNamespace(camera=bent, reference=SimpleNamespace(coordinates=(GAIN,)))
    fitted = Adding(None, first, (), lambda *_: None)._refitted(reference, near)  # pyright: ignore[reportArgumentType]
    assert fitted.camera.values()["gain_e_per_dn"] == pytest.approx(stated.values()["gain_e_per_dn"])


@pytest.fixture
def drift(stated):
    """A candidate whose scatter tells its strength."""
    camera = stated.with_effect("light_drift")
    own = (
        Coordinate("light_drift.sigma", True, 0.1, 1.5),
        Coordinate("light_drift.correlation", False, 0.1, 0.5),
    )
    return replace(refined("light_drift", camera, 9.0, 1.0), coordinates=own)


@pytest.mark.parametrize(
    ("may", "scatters", "far", "sets"),
    [
        (True, False, False, [30, 120]),
        (False, False, False, [30]),
        (
            False,
            True,
            False,
            [30, 120],
        ),  # how strong it is, and so what it explains, is not told by a few sets
        (True, False, True, [30, 30, 120]),
    ],
)
def test_a_few_simulated_sets_end_what_does_not_explain_what_it_moves(
    monkeypatch, stated, may, scatters, far, sets
):
    found = refined("row_noise", stated.with_effect("row_noise"), 9.0, 1.0)
    before, made = leaving([9.0], stated), []

    def reference(lab, camera, coordinates, count, *_):
        made.append(count)
        return SimpleNamespace(camera=camera, coordinates=tuple(coordinates))

    def refitted(lab, reference, *_):
        return SimpleNamespace(
            camera=reference.camera, reference=reference, residual=np.zeros(1), whole_residual=np.zeros(1)
        )

    told = SimpleNamespace(tells=False) if scatters else None
    monkeypatch.setattr(adding.cache, "reference", reference)
    monkeypatch.setattr(adding.cache, "refit", refitted)
    monkeypatch.setattr(adding.cache, "is_far", lambda *_: far and made == [30])
    monkeypatch.setattr(Adding, "_refitted", lambda self, reference, near: refitted(None, reference))
    monkeypatch.setattr(Adding, "_moves_of", lambda *_: (None, None))
    monkeypatch.setattr(Adding, "_scatter", lambda *_: told)
    monkeypatch.setattr(adding, "may_explain", lambda *_: may)
    added = Adding(SimpleNamespace(statistics=()), None, (), None).where_promising(before, found)  # pyright: ignore[reportArgumentType]
    assert (added is not None) == (may or scatters)
    assert made == sets


@pytest.mark.parametrize(
    ("holds", "strengths", "taken"),
    [
        ((True, True), (0.02, 0.02), (0.0, 1)),  # where the first holds no other numbers are tried
        ((False, False), (0.02, 0.02), (0.9, 2)),  # the better of the two is simulated in full
        ((False, False), (0.02, None), (0.0, 1)),  # of the other no strength meets its scatter
        ((False, False), (None, 0.02), (None, 0)),
    ],
)
def test_of_what_scatters_the_better_numbers_are_simulated_in_full(
    monkeypatch, stated, drift, holds, strengths, taken
):
    """How a lamp's levels hang together is told by the second of two sketches; only that one is completed."""
    before, calls = state([9.0]), []

    def scattering(self, state, effect, camera, own, sets, begun=None):
        calls.append((sets, camera.values()["light_drift.correlation"]))
        strength = strengths[len(calls) - 1] if begun is None else 0.02
        return (
            None
            if strength is None
            else SimpleNamespace(fitted=SimpleNamespace(reference=SimpleNamespace(camera=camera)))
        )

    told = Scatter(2.0, np.ones(9), strengths_of("light_drift", drift.coordinates))
    cameras = [stated.with_effect("light_drift", correlation=c) for c in (0.0, 0.9)]
    monkeypatch.setattr(Adding, "_otherwise", lambda *_: iter(cameras))
    monkeypatch.setattr(Adding, "_scatter", lambda *_: told)
    monkeypatch.setattr(Adding, "_scattering", scattering)
    monkeypatch.setattr(Adding, "_holds_where_it_acts", lambda *_: holds[len(calls) - 1])
    monkeypatch.setattr(adding, "decided", lambda statistics, state, pairs: pairs[::-1])
    begun = Adding(SimpleNamespace(statistics=()), None, (), None)  # pyright: ignore[reportArgumentType]
    sketch = SimpleNamespace(fitted=SimpleNamespace(camera=drift.camera))
    so = begun._as_it_scatters(before, drift, sketch)  # pyright: ignore[reportArgumentType]
    correlation, sketched = taken
    assert (so is None) == (correlation is None)
    if so is not None:
        assert calls[-1] == (adding.SETS_AFTER, correlation)
        assert [sets for sets, _ in calls[:-1]][:sketched] == [adding.SETS_BEFORE] * sketched


@pytest.mark.parametrize(
    ("explaining", "may", "taken"),
    [
        (("scatter", "moves"), True, "scatter"),
        (
            ("moves",),
            True,
            "moves",
        ),  # one rare code in the dark scatters as many would, of which a flat knows nothing
        (("moves",), False, "scatter"),  # a few sets show that it would not
        ((), True, "scatter"),
    ],
)
def test_a_strength_by_scatter_that_explains_nothing_gives_way_to_the_moves(
    monkeypatch, stated, explaining, may, taken
):
    found = refined("missing_codes", stated.with_effect("missing_codes"), 9.0, 1.0)
    states = {name: leaving([1.0], stated) for name in ("sketch", "scatter", "moves")}
    monkeypatch.setattr(Adding, "_sketched", lambda *_: states["sketch"])
    monkeypatch.setattr(Adding, "_may_explain", lambda *_: True)
    monkeypatch.setattr(Adding, "_as_it_scatters", lambda *_: states["scatter"])
    monkeypatch.setattr(Adding, "_settled", lambda self, state, r, sketch: sketch)
    monkeypatch.setattr(Adding, "_completed", lambda *_: states["moves"])
    monkeypatch.setattr(adding, "may_explain", lambda *_: may)
    monkeypatch.setattr(
        adding, "explains", lambda _, before, after: any(after is states[k] for k in explaining)
    )
    added = Adding(SimpleNamespace(statistics=()), None, (), None).where_promising(
        leaving([9.0], stated), found
    )  # pyright: ignore[reportArgumentType]
    assert added is states[taken]
