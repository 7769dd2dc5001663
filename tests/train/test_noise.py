"""Arms made of cameras: populations, effects of random strength in a share of the images, white noise of equal variance."""

import numpy as np
import pytest
import torch

import visaug
from visaug.core.errors import InputError
from visaug_train.arms import Arm, Vis, White
from visaug_train.noise import batch_noise, vis_noise

QUIET = {"name": "quiet", "resolution": [40, 40], "bit_depth": 12, "gain_e_per_dn": 10.0}
LOUD = QUIET | {"name": "loud", "read_noise": {"sigma_e": 2000.0}}


@pytest.fixture
def cameras(tmp_path):
    for content in (QUIET, LOUD):
        visaug.Camera.load(content).save(tmp_path / f"{content['name']}.yaml")
    return [str(tmp_path / f"{name}.yaml") for name in ("quiet", "loud")]


@pytest.mark.parametrize("effects", [[], [{"name": "row_noise", "sigma_e": 0.0, "p": 0.5}]])
def test_each_image_gets_one_camera_of_the_population(cameras, effects):
    """300 images, half by each: 114 to 186 are four standard deviations, left by chance once in 16,000."""
    torch.manual_seed(1)
    noisy = vis_noise(Vis(camera=cameras, effects=effects))(torch.full((300, 1, 20, 20), 0.5))
    loud = (noisy.std(dim=(1, 2, 3)) > 0.02).sum()
    assert 114 < loud < 186


def test_an_effect_comes_in_its_share_with_strengths_of_its_range(cameras):
    """400 images, p = 0.3: 83 to 157 are four standard deviations. Rows of 100 to 300 e- (of 40,950 at white)."""
    torch.manual_seed(2)
    effects = [{"name": "row_noise", "sigma_e": [100.0, 300.0], "p": 0.3}]
    noisy = vis_noise(Vis(camera=cameras[0], effects=effects))(torch.full((400, 3, 200, 6), 0.5))
    assert torch.equal(noisy[:, 0], noisy[:, 1])
    sigma_e = noisy[:, 0].double().mean(dim=2).std(dim=1) * 4095 * 10
    # Without row noise the mean of 6 pixels of 20,475 e- has a deviation of 58 e- (shot noise).
    has = sigma_e > 85
    assert 83 < has.sum() < 157
    drawn = (sigma_e[has] ** 2 - 20475 / 6).sqrt()
    assert drawn.min() > 70
    assert drawn.max() < 360
    assert drawn.mean() == pytest.approx(200, abs=30)  # 120 draws of deviation 58: five standard errors


def test_values_may_be_words_and_are_then_those_of_the_camera():
    values = {"reading": "paper", "read_noise.meaning": "scale"}
    noise = vis_noise(Vis(camera="flir_cm3_u3_13y3c", set=values))
    spec = noise.sensor.cameras[0].spec
    assert (spec.reading, spec.read_noise.meaning) == ("paper", "scale")


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ({"name": "row_noise", "sigma_e": [3.0, 1.0]}, r"effects\.row_noise\.sigma_e"),
        ({"name": "row_noise", "sigma_e": [1.0, 2.0, 3.0]}, r"effects\.row_noise\.sigma_e"),
        ({"name": "row_noise", "sigma_e": [-1.0, 2.0]}, "sigma_e"),
        ({"name": "no_such", "p": 0.5}, "no_such"),
    ],
)
def test_an_effect_that_cannot_be_is_refused_before_training(cameras, effect, message):
    with pytest.raises(InputError, match=message):
        vis_noise(Vis(camera=cameras[0], effects=[effect]))


def test_white_noise_of_equal_variance_has_no_structure(cameras):
    """Column patterns of a sensor, and white noise of the same variance: 5 % is four standard errors of 60 images."""
    values = {"dsnu.column_e": 600.0}
    images = torch.full((60, 1, 40, 40), 0.4)
    torch.manual_seed(3)
    sensor = batch_noise(Arm(vis=Vis(camera=cameras[0], set=values)))(images)
    white = batch_noise(Arm(white=White(camera=cameras[0], set=values, variance="sensor")))(images)
    variances = [float(noisy.var(dim=(1, 2, 3)).mean()) for noisy in (sensor, white)]
    assert variances[1] == pytest.approx(variances[0], rel=0.12)
    columns = [float(noisy.mean(dim=2).var(dim=2).mean()) for noisy in (sensor, white)]
    assert columns[0] > 0.9 * variances[0]
    assert columns[1] < 2 * variances[1] / 40


def test_white_noise_of_eq_6_takes_one_camera(cameras):
    with pytest.raises(InputError, match=r"white\.camera"):
        batch_noise(Arm(white=White(camera=cameras)))
    noisy = batch_noise(Arm(white=White(camera=cameras[1])))(torch.full((4, 1, 40, 40), 0.5))
    # Shot noise of 20,475 e- and 2000 e- of read noise at 40,950 e- for white; 6400 pixels know it to 1 %.
    assert float(noisy.std()) == pytest.approx(np.sqrt(20475 + 2000**2) / 40950, rel=0.05)
