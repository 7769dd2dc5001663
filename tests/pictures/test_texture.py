"""Texture in flat blocks against blocks of known noise and texture. Seeds are fixed."""

import numpy as np
import pytest
from scipy import fft

from visaug.pictures.blocks import NOISE, SIDE, Blocks, Rounding, noise_by_level, texture_share
from visaug.pictures.texture import texture_in

PLAIN = Rounding(np.ones((SIDE, SIDE)), False)


def blocks_with(texture, power, seed=0, count=6000, noise=4.0):
    """Blocks about level 100: white noise of variance 4, and texture of random strength with this power at each frequency."""
    rng = np.random.default_rng(seed)
    strength = rng.choice([0.0, 0.3, 1.0, 3.0], (count, 1, 1)) * texture * noise
    coefficients = rng.normal(0, np.sqrt(noise + strength * power), (count, SIDE, SIDE))
    level = np.full(count, 100.0)
    return Blocks(coefficients, level, np.arange(count) % 12, level)


U, V = np.indices((SIDE, SIDE))
FIELD = 1 / np.maximum(U**2 + V**2, 1) * 5  # near 1 at the frequencies that tell structure
WHITE = np.ones((SIDE, SIDE))


@pytest.mark.parametrize(
    ("texture", "power"), [(0.0, FIELD), (1.0, FIELD), (1.0, FIELD * np.exp(-(U**2 + V**2) / 20))]
)
def test_noise_without_texture_is_found(texture, power):
    """6000 blocks of 43 coefficients: chance moves the variance by 0.3 %; with texture it is some per cent too large."""
    blocks = blocks_with(texture, power)
    levels = noise_by_level(blocks, PLAIN, 12)
    found = texture_in(blocks, levels, PLAIN)
    assert levels.variance / (1 + found.excess()) == pytest.approx(4.0, rel=0.02)
    assert not found.is_white
    if texture:
        truth = power[NOISE].mean()
        assert found.share == pytest.approx(truth, abs=max(0.25 * truth, 3 * found.error))


def test_texture_as_fine_as_noise_is_told():
    blocks = blocks_with(1.0, WHITE)
    found = texture_in(blocks, noise_by_level(blocks, PLAIN, 12), PLAIN)
    assert found.is_white
    assert found.share > texture_share()


def test_below_the_dark_level_there_is_no_texture():
    blocks = blocks_with(1.0, FIELD)
    found = texture_in(blocks, noise_by_level(blocks, PLAIN, 12), PLAIN, dark=200.0)
    assert not found.power.any()
    assert found.share == 0


def test_noise_that_jpeg_has_rounded_is_not_taken_for_texture():
    """White noise of 2 DN after the codec at quality 95: no texture within two standard errors, and little is taken off."""
    from benchmark.pictures import compressed
    from visaug.effects.picture.jpeg import LUMINANCE

    steps = np.array([float(v) for v in LUMINANCE.split()]).reshape(SIDE, SIDE)
    rounding = Rounding(np.clip(np.floor((10 * steps + 50) / 100), 1, 255), True)
    rng = np.random.default_rng(4)
    pictures = [compressed(np.rint(rng.normal(100, 2, (320, 320))).astype(np.uint8), 95) for _ in range(4)]
    pixels = (
        np.stack(pictures).reshape(4, 40, SIDE, 40, SIDE).transpose(0, 1, 3, 2, 4).reshape(-1, SIDE, SIDE)
    )
    coefficients = fft.dctn(pixels.astype(float), axes=(1, 2), norm="ortho")
    level = coefficients[:, 0, 0] / SIDE
    blocks = Blocks(coefficients, level, np.arange(len(level)) % 4, level)
    levels = noise_by_level(blocks, rounding, 4)
    found = texture_in(blocks, levels, rounding)
    assert not found.excess(-2).any()
    assert np.average(found.excess(), weights=levels.blocks.sum(0)) < 0.04
