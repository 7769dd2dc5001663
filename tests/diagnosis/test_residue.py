"""What is left is told along its axis and by what it grows with."""

import numpy as np
import pytest

from visaug.diagnosis.residue import describe
from visaug.fingerprint import Statistic

CONDITIONS = [(exposure, celsius) for exposure in (0.1, 1.0) for celsius in (20.0, 30.0)]


def darks(name: str) -> list[Statistic]:
    return [
        Statistic("defects", name, f"dark {e:g} s {t:g} C", ("pixel",), "1", "dark", e, t)
        for e, t in CONDITIONS
    ]


def grown(values: dict[str, tuple[float, ...]]) -> tuple[str, ...]:
    """What is said to make statistics grow of which each has one value at every condition."""
    statistics = [s for name in values for s in darks(name)]
    return describe(statistics, np.concatenate([np.array(v, float) for v in values.values()])).grows_with


def test_counts_that_are_full_do_not_hide_growth_with_temperature():
    """Hot pixels are all found in the cold already; how far out they are still grows."""
    found = grown({"count": (2, 11, 11, 11.2), "variance": (3, 9, 20, 40), "skewness": (1, 4, 12, 19)})
    assert found == ("exposure", "temperature")


@pytest.mark.parametrize("warm", [1.0, 0.9, 1.1])
def test_a_glow_that_no_temperature_changes(warm):
    assert grown({n: (1, 1, 20 + i, warm * (20 + i)) for i, n in enumerate("abcd")}) == ("exposure",)


def test_what_is_measured_on_all_dark_frames_together_tells_no_growth():
    """Codes are counted over all dark frames, under the name of the longest."""
    statistics = [
        Statistic("codes", f"bit {i}", "dark 1 s 30 C", ("level",), "share", "dark", 1.0, 30.0)
        for i in range(4)
    ]
    statistics += darks("variance")
    assert describe(statistics, np.array([500.0, 400, 300, 200, 20, 21, 20, 19])).grows_with == ()
