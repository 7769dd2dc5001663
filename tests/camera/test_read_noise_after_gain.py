"""Read noise behind the gain stage: sigma_dn^2 = (sigma_e / G)^2 + after_gain_dn^2 (+ 1/12 of rounding).

False alarms: bounds are five standard errors of a variance, below 1e-5 for each test.
"""

import numpy as np
import pytest
import torch

from tests.camera.on_gpu import take
from visaug.augment import SensorNoise
from visaug.camera import Camera
from visaug.camera.scale import Scale
from visaug.core.sampling import Stream

SIGMA_E, AFTER_DN, GAIN, BLACK, SIDE = 2.6, 3.7, 1.9, 500, 400
ERROR = 5 * (2 / SIDE**2) ** 0.5
CONTENT = {
    "resolution": [SIDE, SIDE],
    "gain_e_per_dn": GAIN,
    "black_level_dn": BLACK,
    "read_noise": {"sigma_e": SIGMA_E, "after_gain_dn": AFTER_DN},
}


def expected(gain_db: float) -> float:
    return (SIGMA_E / (GAIN * 10 ** (-gain_db / 20))) ** 2 + AFTER_DN**2 + 1 / 12


@pytest.mark.parametrize("gain_db", [0.0, 14.0])
@pytest.mark.parametrize("fast", [True, False], ids=["fast", "exact"])
@pytest.mark.parametrize("pattern", ["image", "camera"])
def test_variance_in_dn(gain_db, fast, pattern):
    noise = SensorNoise(
        CONTENT, gain_db=gain_db, fast=fast, fixed_pattern=pattern, black_level="keep", seed=1
    )
    dn = noise(torch.zeros(1, 1, SIDE, SIDE)).double() * 65535
    assert dn.var().item() == pytest.approx(expected(gain_db), rel=ERROR)


def test_variance_in_dn_of_the_expression_for_gpus():
    camera = Camera.load(CONTENT)
    values = {path: np.array([value]) for path, value in camera.values().items()}
    scale = Scale(np.ones(1), np.zeros(1), np.array([1 / 65535]))
    keys = torch.tensor([3])
    dn = take(camera, torch.zeros(1, 1, SIDE, SIDE), scale, values, keys, keys) * 65535
    assert dn.double().var().item() == pytest.approx(expected(0.0), rel=ERROR)


@pytest.mark.parametrize("fast", [True, False], ids=["fast", "exact"])
def test_it_is_fresh_in_every_frame_of_a_kept_pattern(fast):
    noise = SensorNoise(CONTENT, fixed_pattern="camera", fast=fast, seed=2)
    frames = noise(torch.full((2, 1, SIDE, SIDE), 0.01)).flatten(1)
    assert abs(torch.corrcoef(frames)[0, 1]) < 5 / SIDE


def test_without_noise_before_the_gain_it_still_acts():
    camera = Camera.load({**CONTENT, "read_noise": {"after_gain_dn": AFTER_DN}})
    dark = camera.expose(torch.zeros(1, 1, SIDE, SIDE), Stream([1], [2], 1, (range(SIDE), range(SIDE))))
    assert dark.double().var().item() == pytest.approx(AFTER_DN**2 + 1 / 12, rel=ERROR)


def test_noise_in_electrons_falls_as_a_dual_gain_sensors_does():
    """From the two published conversion gains of an IMX900: 5.56 e- at 2.506 e-/DN, 1.954 e- at 0.598 e-/DN."""
    after = ((5.56**2 - 1.954**2) / (2.506**2 - 0.598**2)) ** 0.5
    before = (5.56**2 - (after * 2.506) ** 2) ** 0.5
    content = {"read_noise": {"sigma_e": before, "after_gain_dn": after}, "gain_e_per_dn": 2.506}
    camera = Camera.load({**CONTENT, **content})
    stream = Stream([1], [2], 1, (range(SIDE), range(SIDE)))
    for gain_e_per_dn, published_e in ((2.506, 5.56), (0.598, 1.954)):
        dark = camera.expose(torch.zeros(1, 1, SIDE, SIDE), stream, {"gain_e_per_dn": gain_e_per_dn})
        electrons = (dark.double().var().item() - 1 / 12) ** 0.5 * gain_e_per_dn
        assert electrons == pytest.approx(published_e, rel=ERROR)
