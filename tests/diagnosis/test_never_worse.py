"""The hold-out frames decide whether a refit without a new effect is kept."""

from types import SimpleNamespace

import pytest

from visaug.comparison import Error
from visaug.diagnosis import search
from visaug.diagnosis.result import Step


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
    state = one._no_worse(found)
    assert state.fitted == ("given" if keeps_file else "refitted")
    assert one.steps[-1].error.value == (1.0 if keeps_file else error)
