"""How many simulated sets a verdict takes, and the rate of false alarms that it keeps."""

from types import SimpleNamespace

import numpy as np
import pytest

from visaug.diagnosis.comparison import _tested
from visaug.statistics.tail import is_decided, tail_factor

STATISTICS = 6


def judged(measured: np.ndarray, rng: np.random.Generator) -> tuple[int, float]:
    """Simulated sets and p-value, for a camera whose statistics are standard normal."""
    finding = lambda jobs, report: rng.standard_normal((len(jobs), STATISTICS))  # noqa: E731
    sets, _, p_value = _tested(
        SimpleNamespace(finding=finding),  # pyrefly: ignore[bad-argument-type]
        None,  # pyrefly: ignore[bad-argument-type]
        measured,
        np.full(STATISTICS, 1e-3),
        lambda *_: None,
    )
    return len(sets), p_value


@pytest.mark.parametrize(
    ("deviation", "sets"), [(1.0, 100), (3.0, 400), (20.0, 100)], ids=["common", "close to 2 %", "far"]
)
def test_more_sets_are_simulated_only_where_the_verdict_is_open(deviation, sets):
    """The largest of six deviations exceeds 3.0 in 1.6 % of sets."""
    measured = np.zeros(STATISTICS)
    measured[2] = deviation
    assert judged(measured, np.random.default_rng(3))[0] == sets


@pytest.mark.parametrize(
    ("count", "low", "high"), [(200, 0, 10), pytest.param(700, 4, 26, marks=pytest.mark.slow)]
)
def test_the_rate_of_false_alarms_is_kept(count, low, high):
    """Measured sets of a complete camera, 2 %.

    Binomial(700, 0.02) is outside 4 to 26 in less than 1 of 200 runs. Binomial(200, 0.02) is above 10 in 1 of 390; a rate that is
    too low needs the 700.
    """
    rng = np.random.default_rng(8)
    found = [judged(rng.standard_normal(STATISTICS), rng) for _ in range(count)]
    assert low <= sum(p_value <= 0.02 for _, p_value in found) <= high
    assert np.mean([sets for sets, _ in found]) < 130


def test_a_tail_is_extrapolated_by_its_mean_excess():
    """Of an exponential law, exceeding the largest by its scale is e times as unlikely; 100 excesses give the scale to 10 %."""
    null = np.random.default_rng(5).exponential(2.0, 1000)
    assert tail_factor(float(null.max()) - 0.1, null) == 1
    assert np.log(tail_factor(float(null.max()) + 2.0, null)) == pytest.approx(-1, abs=0.3)
    assert tail_factor(1.0, np.zeros(10)) == 0


@pytest.mark.parametrize(
    ("beyond", "decided"), [(5, True), (10, True), (15, False), (20, False), (25, False), (50, True)]
)
def test_a_verdict_is_open_where_the_interval_of_its_share_holds_2_percent(beyond, decided):
    """Of 1000 sets. Clopper-Pearson, from beta quantiles: 10 have 0.48 to 1.83 %, 15 0.84 to 2.46 %, 50 3.73 to 6.54 %."""
    null = np.arange(1000.0)
    assert is_decided(1000.0 - beyond, null) is decided
