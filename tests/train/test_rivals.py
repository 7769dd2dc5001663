"""The augmentations that sensor noise competes with: their laws, and what holds for all of them."""

import numpy as np
import pytest
import torch

from visaug_train.arms import Arm
from visaug_train.noise import batch_noise

KEYS = ["erase", "sun_flare", "brightness_contrast", "motion_blur", "iso_noise", "randconv", "corruptions"]


@pytest.fixture
def images():
    torch.manual_seed(3)
    smooth = torch.nn.functional.interpolate(torch.rand(8, 1, 6, 8), size=(48, 64), mode="bilinear")
    return smooth.repeat(1, 3, 1, 1)


@pytest.mark.parametrize("key", KEYS)
def test_gray_stays_gray_in_range_and_a_share_of_zero_changes_nothing(key, images):
    changed = batch_noise(Arm(**{key: {"p": 1.0}}))(images)
    assert changed.shape == images.shape
    assert changed.min() >= 0
    assert changed.max() <= 1
    assert torch.equal(changed[:, :1].expand_as(changed), changed)
    assert (changed != images).flatten(1).any(1).float().mean() > 0.8
    torch.testing.assert_close(batch_noise(Arm(**{key: {"p": 0.0}}))(images), images)


def test_brightness_and_contrast_are_a_line(images):
    torch.manual_seed(1)
    changed = batch_noise(Arm(brightness_contrast={"p": 1.0, "brightness": 0.1, "contrast": 0.1}))(images)
    for before, after in zip(images[:, 0], changed[:, 0]):
        inside = (after > 0) & (after < 1)
        slope, shift = np.polyfit(before[inside].numpy(), after[inside].numpy(), 1)
        assert abs(slope - 1) <= 0.1001
        assert abs(shift) <= 0.1001
        torch.testing.assert_close(after[inside], slope * before[inside] + shift, atol=1e-5, rtol=0)


def test_motion_blur_keeps_light_and_has_its_length():
    spot = torch.zeros(64, 1, 33, 33)
    spot[:, :, 16, 16] = 1
    blurred = batch_noise(Arm(motion_blur={"p": 1.0, "length_px": (9.0, 9.0)}))(spot)[:, 0]
    torch.testing.assert_close(blurred.sum((1, 2)), torch.ones(64))
    x = torch.arange(33.0) - 16
    variance = (blurred * (x**2 + x[:, None] ** 2)).sum((1, 2))
    # A line of length L has a variance of L^2 / 12; bilinear shares add at most 1/4 in each direction.
    assert (variance > 81 / 12 - 0.01).all()
    assert (variance < 81 / 12 + 0.51).all()


def test_an_erased_rectangle_has_the_area_that_was_drawn():
    changed = batch_noise(Arm(erase={"p": 1.0, "area": (0.1, 0.1), "aspect": (0.5, 2.0)}))(
        torch.full((32, 1, 100, 100), 2.0 / 3)
    )
    share = (changed[:, 0] != 2.0 / 3).float().mean((1, 2))
    np.testing.assert_allclose(share.numpy(), 0.1, atol=0.012)  # a pixel row or column is 1 % of the side


def test_iso_noise_has_the_moments_of_its_law():
    """x + n (1 - x): mean and variance of n / 255 are r / 255 and r / 255^2 with r = 255 s i. 48 x 10^4 pixels: the
    mean is known to 0.1 %, the variance to 0.3 %, so 2 % is beyond six standard deviations.
    """
    torch.manual_seed(2)
    dark = torch.zeros(48, 1, 100, 100)
    dark[:, :, :, :50] = 0.4
    s = float(dark[0].std())
    noise = batch_noise(Arm(iso_noise={"p": 1.0, "intensity": (0.3, 0.3)}))(dark)[..., 50:] * 255
    rate = 255 * s * 0.3
    assert float(noise.mean()) == pytest.approx(rate, rel=0.02)
    assert float(noise.var()) == pytest.approx(rate, rel=0.02)


def test_random_convolution_is_linear_in_the_image():
    """Same random numbers, half the light: half the picture, as long as nothing is cut off at 0 or 1."""
    noise = batch_noise(Arm(randconv={"p": 1.0, "kernels": [3]}))
    images = torch.rand(16, 1, 20, 20) * 0.1 + 0.05
    torch.manual_seed(5)
    whole = noise(images)
    torch.manual_seed(5)
    half = noise(images / 2)
    kept = ((whole > 0) & (whole < 1)).flatten(1).all(1)
    assert kept.sum() >= 4
    torch.testing.assert_close(half[kept], whole[kept] / 2)
