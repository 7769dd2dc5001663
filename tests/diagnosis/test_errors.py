"""On which frames an error is reported."""

import pytest

from visaug.diagnosis.fitting.errors import Errors
from visaug.statistics.distance import Error

CLEAR, UNCLEAR, VAGUE = Error(0.04, -0.02, 0.1), Error(1.1, -0.4, 2.5), Error(-4.0, -16.0, 6.0)


@pytest.mark.parametrize(
    ("confirmed", "found", "expected"),
    [
        (CLEAR, UNCLEAR, CLEAR),
        (UNCLEAR, CLEAR, CLEAR),  # beside an effect that scatters the hold-out frames may say nothing
        (VAGUE, CLEAR, CLEAR),
        (None, CLEAR, CLEAR),
        (UNCLEAR, UNCLEAR, UNCLEAR),
        (VAGUE, UNCLEAR, UNCLEAR),
        (VAGUE, VAGUE, None),
        (None, None, None),
    ],
)
def test_an_error_is_reported_where_it_is_clear(monkeypatch, confirmed, found, expected):
    errors = object.__new__(Errors)
    monkeypatch.setattr(errors, "_confirms", True, raising=False)
    monkeypatch.setattr(errors, "confirmed", lambda _: confirmed)
    monkeypatch.setattr(errors, "found", lambda _: found)
    assert errors.told(None) is expected  # pyrefly: ignore[bad-argument-type]
