"""Arms made of cameras: populations, effects of random strength in a share of the images, white noise of equal variance."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch

import visaug
from visaug.augment.dataset_noise import with_bands, with_transfer
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


@pytest.mark.parametrize("more", [{}, {"p": 0.5}, {"sigma_e": [1.0, 2.0]}])
def test_auto_is_decided_by_the_files_whatever_the_effects_are(tmp_path, more):
    """Colour files of 8 bits are taken as sRGB; the noise is then that of `transfer: srgb` to the bit."""
    cv2.imwrite(str(tmp_path / "rgb.png"), np.zeros((8, 8, 3), np.uint8))
    files = SimpleNamespace(im_files=[str(tmp_path / "rgb.png")])
    effects = [{"name": "row_noise", "sigma_e": 1.5} | more]
    images, found = torch.full((8, 3, 32, 32), 0.1), []
    for transfer in ("auto", "srgb"):
        vis = Vis(camera="sony_imx174", gain_db=24.0, transfer=transfer, effects=effects)
        noise, said = with_transfer(vis_noise(vis), files)
        assert ("taken as sRGB" in said) == (transfer == "auto")
        torch.manual_seed(3)
        found.append(noise(images))
    assert torch.equal(*found)


def test_channels_are_bands_also_with_drawn_effects():
    noise = vis_noise(
        Vis(camera="sony_imx174", effects=[{"name": "row_noise", "sigma_e": [1.0, 2.0], "p": 0.5}])
    )
    noise, said = with_bands(noise, 6)
    assert "6 channels taken as bands" in said
    assert noise(torch.full((4, 6, 16, 16), 0.5)).shape == (4, 6, 16, 16)


@pytest.mark.parametrize(
    "more",
    [
        {"gain_db": 30.0},
        {"exposure": 0.05},
        {"strength": 5.0},
        {"effects": [{"name": "row_noise", "sigma_e": 300}]},
        {"transfer": "srgb"},
        {"full_scale_photons": 500.0},
        {"resolution": "sensor"},
    ],
)
def test_what_eq_6_does_not_hold_is_refused(more):
    (key,) = more
    with pytest.raises(ValueError, match=f"{key} has no part in eq. 6"):
        White(camera="sony_imx174", **more)
    White(camera="sony_imx174", variance="sensor", **more)


def test_a_gain_that_is_set_acts_in_eq_6():
    """20 dB are a tenth of the electrons, whose shot noise is about three times as strong."""
    images, found = torch.full((8, 1, 64, 64), 0.5), []
    for values in ({}, {"gain_db": 20.0}):
        torch.manual_seed(0)
        found.append(batch_noise(Arm(white=White(camera="sony_imx174", set=values)))(images).std())
    assert 2.5 < found[1] / found[0] < 3.8


def test_an_effect_stands_once_and_a_population_has_a_camera():
    twice = [{"name": "row_noise", "sigma_e": 300}, {"name": "row_noise", "sigma_e": [0.1, 0.2]}]
    with pytest.raises(ValueError, match="row_noise is listed twice"):
        Vis(camera="sony_imx174", effects=twice)
    for part in (Vis, White):
        with pytest.raises(ValueError, match="is empty; expected a camera"):
            part(camera=[])
