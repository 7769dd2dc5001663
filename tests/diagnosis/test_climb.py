"""Steps of an effect's parameters, with the camera's parameters following."""

from types import SimpleNamespace

import numpy as np
import pytest

from visaug.diagnosis.candidates.climb import NEAR, Climb
from visaug.diagnosis.candidates.matches import Match
from visaug.diagnosis.candidates.signatures import SHOWN
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.fitting.law import Metric
from visaug.diagnosis.fitting.parameters import Coordinate, effect_coordinates

BLACK = Coordinate("black_level_dn", False, 1.0, 30.0)
ALONG, OWN = np.eye(200)[:2] * [
    [25.0],
    [20.0],
]  # what a DN of the black level shifts, and the effect by itself


def climb_of(stated, taken: float) -> Climb:
    """An effect that shifts `taken` standard deviations along the black level and 20 by itself, all per unit of its logarithm."""
    camera = stated.with_effect("row_noise", sigma_e=1.0)
    (strength,) = effect_coordinates(camera, "row_noise")
    begin = strength.read(camera)

    def finding(jobs, report=None):
        return np.array(
            [
                (BLACK.read(one) - BLACK.read(stated)) * ALONG
                + (strength.read(one) - begin) * (OWN + taken * ALONG / 25)
                for one, _ in jobs
            ]
        )

    reference = SimpleNamespace(coordinates=(BLACK,), null_scale=np.ones(200))
    fitted = SimpleNamespace(residual=0.5 * OWN, slopes=ALONG[:, None], camera=camera, reference=reference)
    everything = np.full(200, True)
    law = Metric(everything, np.ones(200), np.eye(200) + np.outer(ALONG, ALONG) * BLACK.prior**2)
    match = Match(Trial("row_noise", (("row_noise.sigma_e", 1.0),)), 1.0, 1.0, np.zeros(200))
    lab = SimpleNamespace(finding=finding)
    return Climb(lab, fitted, law, match, camera, [strength])  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("taken", [50.0, 4.0])
def test_the_black_level_follows_where_what_it_takes_up_shows(stated, taken):
    """By less than the distance over which its derivative is taken to hold. Half a unit of the strength explains the residual."""
    climb = climb_of(stated, taken)
    at = [c.read(climb.camera) for c in climb.coordinates]
    black, strength = climb.step(climb.settled(np.array(at)))
    assert strength == pytest.approx(0.5, rel=0.01)
    expected = -0.5 * taken / 25 if 0.5 * taken > SHOWN else 0.0
    assert abs(expected) < NEAR * BLACK.step
    assert black == pytest.approx(expected, rel=0.01)
