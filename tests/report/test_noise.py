"""What each part of a camera does alone, on an image of any size."""

import numpy as np
import pytest

from visaug import Camera
from visaug.diagnosis.candidates.trials import effect_trials
from visaug.effects import catalogue
from visaug.report.noise import components

CAMERA = Camera.load(
    {
        "resolution": [64, 80],
        "bit_depth": 12,
        "gain_e_per_dn": 2.0,
        "black_level_dn": 200.0,
        "full_well_e": 7000.0,
        "read_noise": {"sigma_e": 3.0},
    }
)
LARGER = np.random.default_rng(0).random((96, 160)).astype(np.float32)


@pytest.mark.parametrize("name", [name for name, effect in catalogue().items() if not effect.base])
def test_an_image_larger_than_the_sensor_has_a_component_of_every_effect(name):
    for trial in effect_trials(catalogue()[name]):
        found = components(trial.on(CAMERA), LARGER)
        assert found[name.replace("_", " ")].shape == LARGER.shape


def test_read_and_row_noise_have_their_variance():
    """96 rows: the sample variance of rows is within 50 % of the law in all but 0.1 % of seeds; the seed is fixed."""
    found = components(CAMERA.with_effect("row_noise", sigma_e=40.0), np.full((96, 160), 0.5, np.float32))
    assert np.var(found["row noise"].mean(1)) == pytest.approx((40 / 2) ** 2, rel=0.5)
    rounding = 2 / 12  # of both exposures, DN^2
    assert np.var(found["read noise"]) == pytest.approx((3 / 2) ** 2 + rounding, rel=0.1)
