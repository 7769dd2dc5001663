"""A look at what blooms against charge that is moved pixel by pixel."""

import numpy as np
import pytest

from visaug.diagnosis.look import spilled
from visaug.effects import Look, catalogue

WELL_E = 10000.0


def spill(light: np.ndarray, share: float, upward: float) -> np.ndarray:
    """Of each pixel's excess its share runs up and down, filling every well on its way."""
    filled = np.minimum(light, WELL_E)
    for rows, part in ((range(len(light)), 1 - upward), (range(len(light))[::-1], upward)):
        for column in range(light.shape[1]):
            carried = 0.0
            for row in rows:
                carried += share * part * max(light[row, column] - WELL_E, 0)
                taken = min(carried, WELL_E - filled[row, column])
                filled[row, column] += taken
                carried -= taken
    return filled


def scene(top: int = 40, rows: int = 90) -> np.ndarray:
    light = np.full((rows, 12), 300.0)
    light[top : top + 5, 3:9] = 60000.0
    return light


def looks(light: np.ndarray, read: np.ndarray):
    rng = np.random.default_rng(1)
    seen = spilled(light, read + rng.normal(0, 5, read.shape), WELL_E)
    none = np.zeros(0)
    look = Look(np.zeros((0, 0)), none, none, none, np.zeros((0, 0)), spilled_e=seen)
    return seen, catalogue()["blooming"].looks(look)


@pytest.mark.parametrize(("share", "upward"), [(1.0, 0.5), (1.0, 0.0), (0.9, 0.3), (0.3, 1.0)])
def test_share_and_direction_of_what_blooms(share, upward):
    """Read noise of 5 e- in some hundred pixels is no more than 1e-3 of 1.5 10^6 e-."""
    seen, (point,) = looks(scene(), spill(scene(), share, upward))
    assert len(seen) == 6
    assert point["share"] == pytest.approx(share, rel=0.01)
    assert point["upward"] == pytest.approx(upward, abs=0.01)


def test_what_runs_off_an_end_tells_no_share():
    light = scene(top=4)
    seen, points = looks(light, spill(light, 1.0, 0.5))
    assert len(seen) == 0
    assert points == []


def test_full_wells_that_stay_full_do_not_bloom():
    seen, points = looks(scene(), np.minimum(scene(), WELL_E))
    assert len(seen) == 6
    assert points == []
