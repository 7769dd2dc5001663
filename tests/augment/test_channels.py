"""Order of channels, alpha and bands, several images of one sample: the same in every adapter."""

import io

import albumentations
import kornia.augmentation as K
import numpy as np
import pytest
import tifffile
import torch
from PIL import Image
from torchvision import tv_tensors

from visaug import Camera, InputError, VISNoise
from visaug.augment import AlbumentationsNoise, ImageNoise, SensorNoise, TorchvisionNoise
from visaug.augment.image_io.arrays import _picture_channels

LOUD = {"resolution": [64, 64], "bit_depth": 12, "gain_e_per_dn": 0.3, "read_noise": {"sigma_e": 20.0}}
CAMERA = Camera.load(LOUD)
COLOUR = Camera.load(
    LOUD | {"colour": {"cfa": "RGGB", "white_balance": [4.0, 1.0, 1.0], "matrix": np.eye(3).tolist()}}
)
STILL = Camera.load(
    LOUD | {"read_noise": {"sigma_e": 2.0}, "dsnu": {"pixel_e": 60.0}}
)  # mostly fixed pattern
VARIED = Camera.load(LOUD | {"randomize": {"read_noise.sigma_e": {"uniform": [5.0, 100.0]}}})


def alike(first, second) -> float:
    return float(np.corrcoef(np.asarray(first, float).ravel(), np.asarray(second, float).ravel())[0, 1])


@pytest.mark.parametrize("channels", [3, 4])
def test_bgr_is_rgb_turned_over(channels):
    """The same seed, hence the same bytes."""
    image = np.random.default_rng(0).integers(30, 200, (64, 64, channels)).astype(np.uint8)
    turned = image.copy()
    turned[..., :3] = image[..., 2::-1]
    for make in (ImageNoise, AlbumentationsNoise):
        for options in ({"order": "RGB"}, {"order": "BGR"}):
            noise = make(COLOUR, **options)
            given = image if options["order"] == "RGB" else turned
            torch.manual_seed(5)
            if make is AlbumentationsNoise:
                noise.set_random_seed(5)
                made = noise(image=given)["image"]
            else:
                made = noise(given)
            back = (
                made if options["order"] == "RGB" else np.concatenate([made[..., 2::-1], made[..., 3:]], -1)
            )
            if options["order"] == "RGB":
                first = back
            else:
                assert np.array_equal(first, back)
    with pytest.raises(InputError, match="order"):
        ImageNoise(COLOUR, order="GBR")


def test_red_has_the_noise_of_red():
    """A white balance of 4 makes red's noise 4 times that of blue; read noise alone; demosaicing treats both alike."""
    flat = np.full((64, 64, 3), 40, np.uint8)
    for order, red, blue in (("RGB", 0, 2), ("BGR", 2, 0)):
        noisy = ImageNoise(COLOUR, transfer="linear", order=order)(flat).astype(float)
        assert noisy[..., red].std() > 1.5 * noisy[..., blue].std()


def test_a_pil_image_states_its_order():
    image = Image.fromarray(np.full((64, 64, 3), 40, np.uint8))
    noisy = np.asarray(ImageNoise(COLOUR, transfer="linear", order="BGR")(image)).astype(float)
    assert noisy[..., 0].std() > 1.5 * noisy[..., 2].std()


ADAPTERS = {
    "VISNoise": lambda **options: VISNoise(CAMERA, **options),
    "SensorNoise": lambda **options: SensorNoise(CAMERA, **options),
    "ImageNoise": lambda **options: lambda x: ImageNoise(CAMERA, **options)(x[0])[None],
    "TorchvisionNoise": lambda **options: TorchvisionNoise(CAMERA, **options),
}


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_alpha_stays_and_bands_are_sensors_of_their_own(adapter):
    """Correlation of 4,096 pixels: standard error 0.016, and 0.09 is left by chance once in 10^7."""
    make = ADAPTERS[adapter]
    for channels in (2, 4):
        image = torch.full((1, channels, 64, 64), 0.3)
        noisy = make()(image)
        assert torch.equal(noisy[:, -1], image[:, -1])
        assert (noisy[:, :-1] != 0.3).float().mean() > 0.9
        assert torch.equal(noisy[:, 0], noisy[:, -2])  # one monochrome sensor
        bands = make(mono=False)(image)[0].flatten(1)
        assert float((torch.corrcoef(bands) - torch.eye(channels)).abs().max()) < 0.09
    bands = make()(torch.full((1, 10, 64, 64), 0.3))[0].flatten(1)
    assert float((torch.corrcoef(bands) - torch.eye(10)).abs().max()) < 0.09
    with pytest.raises(InputError, match="10 channels"):
        make(mono=True)(torch.full((1, 10, 64, 64), 0.3))


def test_alpha_of_a_pil_image_is_alpha_whatever_mono():
    image = Image.fromarray(np.full((8, 8, 4), 120, np.uint8))
    for noise in (ImageNoise(CAMERA, mono=False), TorchvisionNoise(CAMERA, mono=False)):
        assert (np.asarray(noise(image))[..., 3] == 120).all()


def test_a_colour_camera_takes_no_bands():
    with pytest.raises(InputError):
        VISNoise(COLOUR)(torch.full((1, 10, 64, 64), 0.3))


def pairs():
    """Two images of one sample through a camera whose fixed pattern is twice its temporal noise, by library."""
    flat = torch.full((1, 64, 64), 0.5)
    made = TorchvisionNoise(STILL)({"left": tv_tensors.Image(flat), "right": tv_tensors.Image(flat)})
    yield "torchvision", made["left"], made["right"]
    gray = np.full((64, 64), 30000, np.uint16)
    both = albumentations.Compose([AlbumentationsNoise(STILL)], additional_targets={"right": "image"})
    made = both(image=gray, right=gray)
    yield "albumentations", made["image"], made["right"]
    seeded = albumentations.Compose(
        [AlbumentationsNoise(STILL, seed=3)], additional_targets={"right": "image"}
    )
    made = seeded(image=gray, right=gray)
    yield "albumentations, seed", made["image"], made["right"]
    sequence = K.AugmentationSequential(VISNoise(STILL), data_keys=["input", "input"])
    left, right = sequence(flat[None], flat[None])
    yield "kornia", left, right


def test_images_of_one_sample_share_the_camera_and_not_the_noise():
    """Pattern 60 e-, temporal noise (614 + 4)^1/2 = 25 e-: correlation 0.85; standard error 0.005."""
    for library, left, right in pairs():
        assert 0.8 < alike(left, right) < 0.9, library


def test_a_pair_replays_in_kornia():
    sequence = K.AugmentationSequential(VISNoise(STILL), data_keys=["input", "input"])
    left, right = torch.rand(2, 1, 16, 16), torch.rand(2, 1, 16, 16)
    first = sequence(left, right)
    again = sequence(left, right, params=sequence._params)
    assert torch.equal(first[0], again[0])
    assert torch.equal(first[1], again[1])
    alone = VISNoise(STILL)
    noisy = alone(left)
    assert torch.equal(alone(left, params=alone._params), noisy)


def test_a_batch_in_torchvision_has_a_camera_for_each_image():
    """Read noise of 5 to 100 e-: the spread of 32 images of one camera would be 1.6 %; a video has one camera."""
    batch = torch.full((32, 1, 64, 64), 0.5)
    spread = TorchvisionNoise(VARIED)(batch).std(dim=(1, 2, 3))
    assert spread.max() > 1.5 * spread.min()
    clip = TorchvisionNoise(VARIED)(tv_tensors.Video(batch)).std(dim=(1, 2, 3))
    assert clip.max() < 1.2 * clip.min()
    half = TorchvisionNoise(VARIED, p=0.5)(batch)
    noised = (half != 0.5).flatten(1).any(1).sum()
    assert 3 <= noised <= 29  # binomial(32, 0.5): outside once in 700,000


def test_sixteen_bit_of_either_byte_order():
    held = io.BytesIO()
    tifffile.imwrite(held, np.full((32, 32), 30000, np.uint16), byteorder=">")
    image = Image.open(held)
    noisy = ImageNoise(CAMERA)(image)
    assert (image.mode, noisy.mode) == ("I;16B", "I;16B")
    values = np.asarray(noisy).astype(float)
    assert values.mean() == pytest.approx(30000, rel=0.01)
    assert values.std() > 100


@pytest.mark.parametrize(
    ("image", "advice"),
    [
        (torch.linspace(0, 255, 4096).reshape(1, 1, 64, 64), "by 255"),
        (torch.linspace(-2, 2, 4096).reshape(1, 1, 64, 64), "before Normalize"),
        (torch.linspace(-0.2, 0.2, 4096).reshape(1, 1, 64, 64), "before Normalize"),
        (
            torch.cat([torch.full((4000,), 0.3), torch.full((96,), 50.0)]).reshape(1, 1, 64, 64),
            "high-dynamic-range",
        ),
    ],
)
def test_advice_fits_the_values(image, advice):
    with pytest.raises(InputError, match=advice):
        VISNoise(CAMERA)(image)


def test_an_image_that_dips_below_black_is_taken():
    image = torch.full((1, 1, 64, 64), 0.3)
    image[..., :4] = -0.1
    assert VISNoise(CAMERA)(image).min() >= 0


@pytest.mark.parametrize("rank", ["", "node-1", "-1", "3"])
def test_any_rank_in_the_environment(rank, monkeypatch):
    monkeypatch.setenv("RANK", rank)
    assert VISNoise(CAMERA)(torch.full((1, 1, 8, 8), 0.3)).shape == (1, 1, 8, 8)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_bits_have_a_meaning_for_sixteen_bit_words_alone(dtype):
    with pytest.raises(InputError, match="12 bit are given"):
        ImageNoise(CAMERA, bits=12)(np.zeros((8, 8), dtype))


def test_the_picture_in_a_multilayer_exr(tmp_path):
    layers = ["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B", "ViewLayer.Combined.A"]
    passes = ["ViewLayer.DiffCol.R", "ViewLayer.DiffCol.G", "ViewLayer.DiffCol.B", "ViewLayer.Depth.Z"]
    assert _picture_channels(passes + layers, tmp_path) == tuple(layers)
    assert _picture_channels(["R", "G", "B", "A", *passes], tmp_path) == ("R", "G", "B", "A")
    assert _picture_channels(["render.Y", "Z"], tmp_path) == ("render.Y",)
    with pytest.raises(InputError, match="several pictures"):
        _picture_channels(layers + [name.replace("ViewLayer", "Second") for name in layers], tmp_path)
    with pytest.raises(InputError, match="holds the channels"):
        _picture_channels(["ViewLayer.Depth.Z"], tmp_path)
