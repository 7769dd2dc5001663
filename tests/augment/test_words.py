"""Images of whole numbers, which go through the compiled chain without floats of their size."""

import numpy as np
import pytest
import torch

from visaug import Camera, InputError
from visaug.augment import ImageNoise, SensorNoise
from visaug.camera.loops import ends

CAMERA = {
    "resolution": [64, 96],
    "bit_depth": 12,
    "gain_e_per_dn": 2.0,
    "black_level_dn": 60,
    "read_noise": {"sigma_e": 6.0, "shape": -0.1},
    "prnu": {"column": 0.01, "row": 0.01, "pixel": 0.01},
    "dsnu": {"column_e": 4.0, "row_e": 4.0, "pixel_e": 4.0},
    "randomize": {"gain_db": {"std": 2.0}},
}
EXTRA = {  # what a call can have: options of the noise, and further effects of the camera
    "plain": ({}, []),
    "kept": ({"fixed_pattern": "camera"}, []),
    "crop": ({"origin": (3, 5)}, []),
    "dim": ({"exposure": (0.1, 0.2), "strength": 2.0}, []),
    "lines": ({}, [{"name": "row_noise", "sigma_e": 9.0}, {"name": "column_noise", "sigma_e": 9.0}]),
    "exact": ({}, [{"name": "flicker_noise", "sigma_e": 9.0}]),
    "picture": ({}, [{"name": "tone_curve", "gamma": 2.0}]),
    "sensor": ({"resolution": "sensor"}, []),
    "still": ({"strength": 0.0}, []),
}


@pytest.mark.parametrize("case", EXTRA)
@pytest.mark.parametrize(("kind", "white"), [(np.uint8, 255), (np.uint16, 65535), (np.uint16, 4095)])
def test_whole_numbers_are_the_rounded_floats(case, kind, white):
    """Of the same draws: `SensorNoise` on the values, in float32, and rounded here."""
    options, effects = EXTRA[case]
    camera = Camera.load({**CAMERA, "effects": effects})
    image = np.linspace(0, white, 32 * 48).reshape(32, 48).round().astype(kind)
    bits = 12 if white == 4095 else None
    torch.manual_seed(4)
    got = ImageNoise(camera, bits=bits, transfer="linear", seed=3, **options)(image)
    torch.manual_seed(4)
    torch.rand(())  # the draw of p
    noise = SensorNoise(camera, transfer="linear", seed=3, **options)
    values = torch.from_numpy(image.astype(np.float32) / np.float32(white))[None, None]
    expected = np.rint(noise(values)[0, 0].numpy() * np.float32(white))
    assert got.dtype == kind
    # The loop rounds the product of 24 bits once, NumPy twice: of 16 bits a tie may fall to the other side.
    assert np.abs(got - expected).max() <= (1 if white == 65535 else 0)
    assert (got != expected).mean() < 0.01
    assert (got != image).mean() > 0.2 or case == "still"


def test_bands_of_whole_numbers_have_noise_of_their_own():
    """Correlation of two independent bands of 128 x 128 pixels: standard deviation 1/128; 5 of them, 6e-7."""
    noise = ImageNoise(Camera.load(CAMERA | {"resolution": [128, 128], "prnu": {}, "dsnu": {}}))
    bands = noise(np.full((128, 128, 6), 120, np.uint8)).reshape(-1, 6).T
    apart = np.corrcoef(bands.astype(float))[~np.eye(6, dtype=bool)]
    assert np.abs(apart).max() < 5 / 128
    assert (bands.std(1) > 0.5).all()


def test_words_far_above_white_are_refused():
    with pytest.raises(InputError, match="bits: the largest value is 60000; expected at most 4095"):
        ImageNoise(Camera.load(CAMERA), bits=12)(np.full((8, 8), 60000, np.uint16))


def test_noise_of_a_strided_image_leaves_the_image():
    image = np.full((64, 64), 100, np.uint8)
    view = image[::2, ::-2]
    before = image.copy()
    noisy = ImageNoise(Camera.load(CAMERA))(view)
    assert noisy.shape == view.shape
    assert (noisy != view).any()
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("kind", [torch.float32, torch.float64, torch.float16])
def test_the_ends_of_images_leave_out_what_is_missing(kind):
    images = torch.linspace(-0.3, 1.4, 3 * 130 * 7).reshape(1, 3, 130, 7).to(kind)
    images[0, 1, 4, 2] = torch.nan
    low, high = float(images[0, 0, 0, 0]), float(images[0, 2, 129, 6])
    assert ends(images) == (low, high)
    assert ends(images.flip(2)) == (low, high)
    assert ends(images * torch.nan) == (torch.inf, -torch.inf)


@pytest.mark.parametrize("fast", [True, False])
def test_draws_of_another_number_of_images_are_refused(fast):
    """A compiled loop would read keys beyond the end of their table."""
    noise = SensorNoise(Camera.load(CAMERA), fast=fast)
    images = torch.full((3, 1, 8, 8), 0.5)
    for count in (1, 2, 4):
        with pytest.raises(InputError, match=f"are of {count} images"):
            noise.apply_draws(images, noise.draw(count))
        with pytest.raises(InputError, match=f"are of {count} images"):
            noise.apply_to_words(images.to(torch.uint8), noise.draw(count), 255)
    assert noise.apply_draws(images, noise.draw(3)).shape == images.shape


def test_an_empty_batch_stays_empty():
    noise = SensorNoise(Camera.load(CAMERA))
    assert noise(torch.zeros(0, 1, 8, 8)).shape == (0, 1, 8, 8)
    assert noise(torch.zeros(0, 3, 8, 8)).shape == (0, 3, 8, 8)
