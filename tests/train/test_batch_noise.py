"""Blur, white noise and the white noise of a camera's variance."""

import pytest
import torch

from visaug.camera import Camera
from visaug_train.batch_noise import GaussianBlur, GaussianNoise
from visaug_train.noise import WhiteSensorNoise


def test_blur_keeps_the_mean_and_spreads_a_point_by_its_sigma():
    torch.manual_seed(0)
    images = torch.zeros(2, 3, 41, 41)
    images[:, :, 20, 20] = 1
    blurred = GaussianBlur(p=1.0, sigma_px=(1.5, 1.5))(images)
    assert blurred.sum(dim=(2, 3)).flatten().tolist() == pytest.approx([1] * 6, abs=1e-4)
    x = torch.arange(41.0) - 20
    variance = (blurred[0, 0].sum(dim=0) * x**2).sum()
    # The kernel is cut at 3 sigma, which takes about 1 % off its standard deviation.
    assert float(variance) ** 0.5 == pytest.approx(1.5, rel=0.03)


def test_noise_has_its_standard_deviation_and_one_draw_for_all_channels():
    torch.manual_seed(0)
    noise = GaussianNoise(p=1.0, std=(0.05, 0.05))(torch.full((4, 3, 200, 200), 0.5)) - 0.5
    assert torch.equal(noise[:, 0], noise[:, 2])
    # 160,000 values: relative standard error of the deviation 0.18 %; 5 of them.
    assert float(noise[:, 0].std()) == pytest.approx(0.05, rel=0.01)


def test_a_share_of_the_images_is_left_alone():
    torch.manual_seed(0)
    images = torch.full((400, 1, 4, 4), 0.5)
    changed = (GaussianNoise(p=0.25, std=(0.1, 0.1))(images) != images).flatten(1).any(dim=1)
    # Binomial, 400 x 0.25: standard deviation 8.7; 5 of them.
    assert abs(int(changed.sum()) - 100) < 44


@pytest.mark.parametrize(
    ("law", "temperature_c", "degrees"),
    [("exponential", 10, 10.0), ("exponential", 60, 60.0), ("arrhenius", 60, 60 * 273.15 / 333.15)],
)
def test_white_sensor_noise_is_equation_6(law, temperature_c, degrees):
    torch.manual_seed(0)
    camera = Camera.load(
        {
            "resolution": [64, 64],
            "bit_depth": 12,
            "gain_e_per_dn": 0.5,
            "black_level_dn": 95,
            "quantum_efficiency": 0.6,
            "exposure_s": 2.0,
            "temperature_c": temperature_c,
            "read_noise": {"sigma_e": 9.0},
            "dark_current": {"a_e_per_s": 20.0, "b_per_c": 0.05, "law": law},
            "dsnu": {"column_e": 50.0},
        }
    )
    noise = WhiteSensorNoise(camera)(torch.full((8, 1, 150, 150), 0.4)) - 0.4
    electrons = 0.4 * 4000 * 0.5  # 1 is the saturation, 4095 - 95 DN
    dark = 2.0 * 20 * 2.718281828 ** (0.05 * degrees)
    expected = (electrons + dark + 81) ** 0.5 / 0.5 / 4000
    # 180,000 values: relative standard error 0.17 %; 6 of them. The fixed pattern has no part in it.
    assert float(noise.std()) == pytest.approx(expected, rel=0.01)
