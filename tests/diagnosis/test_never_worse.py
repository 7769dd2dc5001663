"""The hold-out frames decide whether a refit without a new effect is kept."""

from types import SimpleNamespace
from typing import cast

import pytest

from visaug.diagnosis import search
from visaug.diagnosis.result import Step
from visaug.diagnosis.state import State
from visaug.statistics.distance import Error


@pytest.mark.parametrize(
    ("error", "accepted", "keeps_file"),
    [(1.16, (), True), (0.97, (), False), (1.16, ("row_noise",), False)],
)
def test_a_refit_that_raises_the_error_is_not_kept(monkeypatch, error, accepted, keeps_file):
    monkeypatch.setattr(search.State, "plain", lambda fitted: SimpleNamespace(fitted=fitted, accepted=()))
    found = SimpleNamespace(fitted="refitted", accepted=accepted)
    one = object.__new__(search._Search)
    vars(one).update(
        walk=[found], steps=[Step("refit", Error(error, error - 0.1, error + 0.1))], _unfitted="given"
    )
    vars(one)["errors"] = SimpleNamespace(
        told=lambda fitted: Error(1.0, 0.9, 1.1) if fitted == "given" else None
    )
    state = one._no_worse(cast(State, found))
    assert state.fitted == ("given" if keeps_file else "refitted")
    told = one.steps[-1].error
    assert told is not None
    assert told.value == (1.0 if keeps_file else error)


@pytest.mark.parametrize(
    ("lows", "kept", "dropped"),
    [
        ((0.9, 0.3, 1.04), ("row_noise",), "image_lag"),
        ((0.9, 1.02, 1.04), (), "row_noise"),
        ((0.9, 0.3, 0.99), ("row_noise", "image_lag"), None),
        ((0.9, 1.04, 0.3), ("row_noise", "image_lag"), None),
    ],
    ids=["the last raises it", "both raise it", "within its interval", "only the first, before the second"],
)
def test_last_effects_that_raise_the_error_are_dropped(monkeypatch, lows, kept, dropped):
    """Errors of the refit and of one and two effects: an effect goes where the whole interval lies above the file's error of 1."""
    names = ("row_noise", "image_lag")
    walk = [SimpleNamespace(fitted=low, accepted=names[:n]) for n, low in enumerate(lows)]
    one = object.__new__(search._Search)
    vars(one).update(walk=list(walk), lab=None, signs=None)
    vars(one)["errors"] = SimpleNamespace(told=lambda low: Error(low + 0.1, low, low + 0.2))
    one.steps = [Step(f"state {n}", one.errors.told(low)) for n, low in enumerate(lows)]
    monkeypatch.setattr(search, "chance", lambda lab, signs, state: SimpleNamespace(p_value=0.01))
    state, p_value, last = one._without_idle_effects(cast(State, walk[-1]), 0.3)
    assert (state.accepted, last) == (kept, dropped)
    assert one.walk == walk[: len(kept) + 1]
    assert len(one.steps) == len(kept) + 1
    assert p_value == (0.3 if dropped is None else 0.01)
