"""Noise inside kornia, torchvision v2, albumentations, DataLoader workers and compiled graphs."""

import json
import logging
import pickle
import warnings

import kornia.augmentation as K
import numpy as np
import pytest
import torch
from PIL import Image
from torch.utils.data import DataLoader, Dataset
from torchvision import tv_tensors
from torchvision.transforms import v2

from visaug import Camera, InputError, VISNoise
from visaug.augment import (
    AlbumentationsNoise,
    ImageNoise,
    TorchvisionNoise,
    draws_from_json,
    draws_to_json,
    images,
)

CAMERA = Camera.load(
    {
        "resolution": [24, 32],
        "gain_e_per_dn": 0.3,
        "read_noise": {"sigma_e": 3.0},
        "dsnu": {"row_e": 2.0, "pixel_e": 1.0},
        "prnu": {"pixel": 0.005},
        "randomize": {"gain_db": {"std": 1.0}},
    }
)


def picture(channels: int = 3, dtype=np.uint8, top: int = 200) -> np.ndarray:
    shape = (24, 32) if channels == 1 else (24, 32, channels)
    return np.random.default_rng(1).integers(20, top, shape).astype(dtype)


def test_kornia_sequence_moves_keypoints_and_masks_alike():
    images, masks = torch.rand(2, 1, 24, 32), (torch.rand(2, 1, 24, 32) > 0.5).float()
    points = torch.tensor([[[3.0, 4.0], [20.0, 10.0]]]).repeat(2, 1, 1)
    flip = K.RandomHorizontalFlip(p=1.0)
    keys = ["input", "mask", "keypoints"]
    with_noise = K.AugmentationSequential(VISNoise(CAMERA), flip, data_keys=keys)
    noisy, mask, moved = with_noise(images, masks, points)
    assert torch.equal(mask, masks.flip(-1))
    assert torch.equal(moved, torch.stack([31 - points[..., 0], points[..., 1]], -1))
    assert not torch.equal(noisy, images.flip(-1))
    replayed = with_noise(images, masks, points, params=with_noise._params)
    assert torch.equal(replayed[0], noisy)


def test_torchvision_leaves_boxes_and_masks_alone():
    image = tv_tensors.Image(torch.from_numpy(picture()).permute(2, 0, 1))
    boxes = tv_tensors.BoundingBoxes([[1, 2, 9, 9]], format="XYXY", canvas_size=(24, 32))
    mask = tv_tensors.Mask(torch.ones(24, 32))
    noise = v2.Compose([TorchvisionNoise(CAMERA)])
    out = noise({"image": image, "boxes": boxes, "mask": mask})
    assert isinstance(out["image"], tv_tensors.Image)
    assert out["image"].dtype == torch.uint8
    assert not torch.equal(out["image"], image)
    assert torch.equal(out["boxes"], boxes)
    assert torch.equal(out["mask"], mask)
    assert torch.equal(TorchvisionNoise(CAMERA, p=0.0)(image), image)


def test_albumentations_follows_the_pipelines_seed():
    albumentations = pytest.importorskip("albumentations")

    def pipeline(seed):
        return albumentations.Compose([AlbumentationsNoise(CAMERA, p=1.0)], seed=seed)

    image = picture()
    first, second, third = (pipeline(seed)(image=image)["image"] for seed in (1, 1, 2))
    assert first.dtype == np.uint8
    assert np.array_equal(first, second)
    assert not np.array_equal(first, third)
    assert not np.array_equal(first, image)


@pytest.mark.parametrize(
    ("dtype", "bits", "top"), [(np.uint8, None, 200), (np.uint16, None, 60000), (np.uint16, 10, 900)]
)
@pytest.mark.parametrize("channels", [1, 3])
def test_arrays_keep_their_depth(dtype, bits, top, channels):
    image = picture(channels, dtype, top)
    noisy = ImageNoise(CAMERA, bits=bits)(image)
    assert (noisy.dtype, noisy.shape) == (image.dtype, image.shape)
    full = 2 ** (bits or 8 * image.itemsize) - 1
    difference = (noisy.astype(float) - image) / full
    assert noisy.max() <= full
    assert 1e-4 < difference.std() < 0.05  # about the noise of 10,000 electrons, or the step of 8 bit


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_a_read_only_array_gets_noise_without_a_warning(channels, dtype):
    image = picture(channels) if dtype == np.uint8 else picture(channels, dtype) / np.float32(255)
    image.flags.writeable = False
    before = image.copy()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        noisy = ImageNoise(CAMERA, transfer="linear")(image)
    assert np.array_equal(image, before)
    assert not np.array_equal(noisy, image)


def test_8_bits_of_8_bit_data_are_taken_and_change_nothing():
    """As docs/augment.md says; all other depths of other types than uint16 are refused."""
    noisy = []
    for bits in (None, 8):
        torch.manual_seed(0)
        noisy.append(ImageNoise(CAMERA, transfer="linear", bits=bits)(picture()))
    assert np.array_equal(*noisy)
    for bits, image in ((12, picture()), (8, picture().astype(np.float32) / 255)):
        with pytest.raises(InputError, match="bits: "):
            ImageNoise(CAMERA, transfer="linear", bits=bits)(image)


def test_big_endian_arrays_keep_their_type_and_get_the_same_noise():
    image = picture(3, np.uint16, 60000)
    swapped = image.astype(">u2")
    noisy = ImageNoise(CAMERA, seed=4)(swapped)
    assert noisy.dtype == swapped.dtype
    assert np.array_equal(noisy, ImageNoise(CAMERA, seed=4)(image))
    assert not np.array_equal(noisy, image)


class Flats(Dataset):
    def __init__(self):
        self.noise = ImageNoise(CAMERA)

    def __len__(self):
        return 8

    def __getitem__(self, i):
        return self.noise(torch.full((1, 16, 16), 0.5))


@pytest.mark.parametrize("seed_given", [None, 3])
def test_workers_differ_and_reproduce(seed_given):
    flats = Flats()
    flats.noise = ImageNoise(CAMERA, seed=seed_given)
    torch.set_num_threads(2)  # the parent's threads must not follow into the workers
    ImageNoise(CAMERA)(torch.rand(1, 256, 256))

    def epoch():
        torch.manual_seed(11)
        return torch.cat(list(DataLoader(flats, batch_size=1, num_workers=2)))

    first = epoch()
    assert torch.equal(epoch(), first)
    for i in range(8):
        for j in range(i):
            assert not torch.equal(first[i], first[j])
    torch.set_num_threads(1)


def test_adapters_can_be_pickled():
    for noise in (
        ImageNoise(CAMERA),
        TorchvisionNoise(CAMERA),
        VISNoise(CAMERA),
        AlbumentationsNoise(CAMERA),
    ):
        assert type(pickle.loads(pickle.dumps(noise))).__name__ == type(noise).__name__


def test_images_without_pixels_are_refused_and_batches_of_none_returned():
    for shape in ((3, 0, 8), (0, 8)):
        with pytest.raises(InputError, match="no pixels"):
            TorchvisionNoise(CAMERA)(tv_tensors.Image(torch.rand(*shape)))
    for kind in (np.uint8, np.uint16, np.float32):
        with pytest.raises(InputError, match="no pixels"):
            ImageNoise(CAMERA, bits=12 if kind is np.uint16 else None)(np.zeros((0, 8), kind))
    assert TorchvisionNoise(CAMERA)(tv_tensors.Video(torch.rand(0, 3, 8, 8))).shape == (0, 3, 8, 8)


@pytest.mark.parametrize("channels", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_base_chain_compiles_into_one_graph(channels):
    noise = VISNoise(CAMERA)
    images = torch.rand(2, channels, 8, 12)
    compiled = torch.compile(noise, fullgraph=True, backend="eager")
    noisy = compiled(images)
    same = VISNoise(CAMERA, fast=False)(images, params=noise._params)
    assert (noisy - same).abs().max() * 65535 < 1.5


FORMS = {
    "L": lambda: Image.fromarray(picture(1)),
    "RGB": lambda: Image.fromarray(picture()),
    "LA": lambda: Image.merge("LA", [Image.fromarray(picture(1))] * 2),
    "RGBA": lambda: Image.fromarray(picture(4)),
    "I;16": lambda: Image.fromarray(picture(1, np.uint16, 60000)),
}


@pytest.mark.parametrize("adapter", ["image", "torchvision"])
@pytest.mark.parametrize("mode", FORMS)
def test_pil_images_come_back_as_pil_with_noise_and_their_alpha(mode, adapter):
    image = FORMS[mode]()
    noise = (ImageNoise if adapter == "image" else TorchvisionNoise)(CAMERA, transfer="linear")
    noisy = noise(image)
    assert (noisy.mode, noisy.size) == (mode, image.size)
    before, after = np.asarray(image), np.asarray(noisy)
    colours = before if mode in ("L", "RGB", "I;16") else before[..., :-1]
    light = after if mode in ("L", "RGB", "I;16") else after[..., :-1]
    assert (light != colours).mean() > 0.1
    if mode in ("LA", "RGBA"):
        assert (after[..., -1] == before[..., -1]).all()


@pytest.mark.parametrize("shape", [(24, 32, 4), (24, 32, 2)])
def test_alpha_of_arrays_and_tensors_stays(shape):
    image = np.random.default_rng(3).integers(20, 200, shape).astype(np.uint8)
    albumentations = pytest.importorskip("albumentations")
    for noisy in (
        ImageNoise(CAMERA)(image),
        albumentations.Compose([AlbumentationsNoise(CAMERA, p=1.0)])(image=image)["image"],
        TorchvisionNoise(CAMERA)(torch.from_numpy(image).permute(2, 0, 1)).permute(1, 2, 0).numpy(),
    ):
        assert (noisy[..., -1] == image[..., -1]).all()
        assert (noisy[..., :-1] != image[..., :-1]).any()


def test_what_is_no_image_is_refused_by_name():
    boxes = tv_tensors.BoundingBoxes([[1, 2, 9, 9]], format="XYXY", canvas_size=(24, 32))
    for call, message in (
        (lambda: TorchvisionNoise(CAMERA)(picture()), "ToImage"),
        (lambda: TorchvisionNoise(CAMERA)({"boxes": boxes, "label": 3}), "no image"),
        (lambda: ImageNoise(CAMERA)("photo.jpg"), "str"),
        (lambda: ImageNoise(CAMERA)(Image.new("P", (4, 4))), "mode P"),
        (lambda: ImageNoise(CAMERA)(Image.new("I", (4, 4))), "uint16"),  # convert() would cut it at 255
        (lambda: ImageNoise(CAMERA)(picture().transpose(2, 0, 1)), "channels first"),
        (lambda: ImageNoise(CAMERA)(torch.rand(24, 32, 3)), "channels last"),
        (lambda: TorchvisionNoise(CAMERA)(torch.rand(24, 32, 3)), "channels last"),
        (lambda: TorchvisionNoise(CAMERA)(tv_tensors.Video(torch.rand(2, 24, 32, 3))), "channels last"),
        (lambda: ImageNoise(CAMERA)(torch.rand(2, 3, 24, 32)), "shape"),
        (lambda: ImageNoise(CAMERA)(torch.ones(3, 8, 8, dtype=torch.int64)), "int64"),
        (lambda: ImageNoise(CAMERA)(torch.rand(3, 8, 8) * 255), "values"),
        (lambda: ImageNoise(CAMERA, p=1.5), "probability"),
        (lambda: ImageNoise(CAMERA, p="0.5"), "'0.5' is not a probability"),
        (lambda: TorchvisionNoise(CAMERA, p=None), "None is not a probability"),
        (lambda: TorchvisionNoise(CAMERA, bits=20), "bit"),
        (lambda: ImageNoise(CAMERA, bits=10.5), "bits: 10.5"),
        (lambda: ImageNoise(CAMERA, bits="10"), "bits: '10'"),
        (lambda: ImageNoise(CAMERA, bits=10)(picture(1, np.uint16, 5000)), "bits: .*at most 1023"),
        (lambda: ImageNoise(CAMERA, seed=1.5), "seed"),
        (lambda: VISNoise(CAMERA, seed="5"), "seed"),
    ):
        with pytest.raises(InputError, match=message):
            call()


def test_auto_takes_8_bit_colour_as_srgb_and_says_so_once(caplog, monkeypatch):
    """Shot noise alone, of 0.3 e- per DN of 12 bit: at a tenth of sRGB's range its slope makes 3.0 of linear noise."""
    camera = Camera.load({"resolution": [64, 64], "bit_depth": 12, "gain_e_per_dn": 0.3})
    electrons = 4095 * 0.3
    monkeypatch.setattr(images, "_said", [])
    dark = np.full((256, 256, 3), 26, np.uint8)
    with caplog.at_level(logging.WARNING, logger="visaug"):
        noises = [ImageNoise(camera), TorchvisionNoise(camera), ImageNoise(camera)]
    assert len([record for record in caplog.records if "sRGB" in record.message]) == 1
    srgb = noises[0](dark).astype(float).std()
    light = ((26 / 255 + 0.055) / 1.055) ** 2.4
    slope = 1.055 / 2.4 * light ** (1 / 2.4 - 1)
    # Luminance noise on every channel: 65,536 values, relative standard error 0.3 %; bent by the curve's own curvature.
    assert srgb == pytest.approx(255 * slope * (light / electrons) ** 0.5, rel=0.08)
    assert noises[0](dark[..., 0]).astype(float).std() == pytest.approx(
        255 * (26 / 255 / electrons) ** 0.5, rel=0.03
    )
    forced = ImageNoise(camera, transfer="linear")(dark).astype(float).std()
    assert forced == pytest.approx(255 * (26 / 255 / electrons) ** 0.5, rel=0.03)


def test_options_reach_the_sensor_through_every_adapter():
    options = {"transfer": "srgb", "gain_db": (0.0, 12.0), "exposure": 0.5, "strength": 2.0, "mono": False}
    albumentations = pytest.importorskip("albumentations")
    made = AlbumentationsNoise(CAMERA, p=0.7, **options)
    for sensor in (
        ImageNoise(CAMERA, **options).noise,
        TorchvisionNoise(CAMERA, **options).noise,
        made.noise.noise,
        VISNoise(CAMERA, **options).sensor,
    ):
        assert (sensor.transfer, sensor.gain_db, sensor.exposure) == ("srgb", (0.0, 12.0), (0.5, 0.5))
        assert (sensor.strength, sensor.mono) == (2.0, False)
    for made in (ImageNoise, TorchvisionNoise, AlbumentationsNoise):
        assert "srgb" in repr(made(CAMERA, transfer="srgb"))
        with pytest.raises((InputError, TypeError)):
            made(CAMERA, strenght=2.0)
    assert albumentations


def test_albumentations_writes_itself_to_json_and_comes_back():
    albumentations = pytest.importorskip("albumentations")
    population = [CAMERA, "sony_imx174"]
    pipeline = albumentations.Compose(
        [AlbumentationsNoise(population, p=0.5, bits=12, gain_db=(0.0, 6.0), transfer="linear")], seed=4
    )
    text = json.dumps(albumentations.to_dict(pipeline))
    again = albumentations.from_dict(json.loads(text)).transforms[0]
    assert [camera.to_yaml() for camera in again.noise.noise.cameras] == [
        CAMERA.to_yaml(),
        Camera.load("sony_imx174").to_yaml(),
    ]
    assert (again.p, again.bits, again.noise.noise.gain_db) == (0.5, 12, (0.0, 6.0))
    image = picture(1, np.uint16, 4000)
    replay = albumentations.ReplayCompose([again])
    first = replay(image=image)
    assert np.array_equal(
        albumentations.ReplayCompose.replay(first["replay"], image=image)["image"], first["image"]
    )


@pytest.mark.parametrize("options", [{}, {"seed": 4}], ids=str)
def test_albumentations_replays_every_call_through_json(options):
    """Also where the numbers come from the transform's own seed, of which each call takes others."""
    albumentations = pytest.importorskip("albumentations")
    replay = albumentations.ReplayCompose([AlbumentationsNoise(CAMERA, gain_db=(0.0, 6.0), **options)])
    pair = {"image": picture(1, np.uint8, 100), "images": np.stack([picture(1, np.uint8, 90)] * 2)}
    calls = [replay(**pair) for _ in range(3)]
    assert not np.array_equal(calls[1]["image"], calls[2]["image"])
    for call in calls:
        again = albumentations.ReplayCompose.replay(json.loads(json.dumps(call["replay"])), **pair)
        assert all(np.array_equal(again[key], call[key]) for key in pair)


def test_albumentations_restores_a_camera_with_measured_maps_from_another_folder(tmp_path, monkeypatch):
    albumentations = pytest.importorskip("albumentations")
    folder = tmp_path / "measured"
    folder.mkdir()
    np.save(folder / "dark.npy", np.full((24, 32), 5.0, np.float32))
    content = {"name": "m", "resolution": [24, 32], "gain_e_per_dn": 0.3, "dsnu": {"map": "dark.npy"}}
    (folder / "camera.yaml").write_text(json.dumps(content))
    made = AlbumentationsNoise(folder / "camera.yaml")
    monkeypatch.chdir(tmp_path)
    np.save("dark.npy", np.full((24, 32), 500.0, np.float32))  # of another camera
    restored = albumentations.from_dict(json.loads(json.dumps(albumentations.to_dict(made))))
    (before,), (after,) = made.noise.noise.cameras, restored.noise.noise.cameras
    assert torch.equal(after.maps["dsnu"], before.maps["dsnu"])


class AlbumentedFlats(Dataset):
    def __init__(self):
        import albumentations

        self.noise = albumentations.Compose([AlbumentationsNoise(CAMERA, p=1.0)], seed=2)

    def __len__(self):
        return 6

    def __getitem__(self, i):
        return torch.from_numpy(self.noise(image=np.full((12, 12), 120, np.uint8))["image"])


def test_albumentations_differs_between_workers_and_epochs_and_reproduces():
    pytest.importorskip("albumentations")
    flats = AlbumentedFlats()

    def two_epochs():
        torch.manual_seed(5)
        loader = DataLoader(flats, batch_size=1, num_workers=2)
        return torch.cat([batch for _ in range(2) for batch in loader])

    first = two_epochs()
    assert len({image.numpy().tobytes() for image in first}) == 12
    assert torch.equal(two_epochs(), first)


STILL = Camera.load(  # a fixed pattern far above the temporal noise
    {
        "resolution": [32, 32],
        "bit_depth": 12,
        "gain_e_per_dn": 0.3,
        "read_noise": {"sigma_e": 2.0},
        "dsnu": {"pixel_e": 60.0},
        "randomize": {"gain_db": {"std": 3.0}},
    }
)


def clips():
    """Residuals (clips, frames, pixels) of a mid-gray video through each library."""
    video = torch.full((2, 1, 3, 32, 32), 0.5)
    by_kornia = K.VideoSequential(VISNoise(STILL), data_format="BCTHW", same_on_frame=True)(video)
    yield "kornia", by_kornia[:, 0].flatten(2).numpy() - 0.5
    gray = np.full((3, 32, 32), 30000, np.uint16)
    albumentations = pytest.importorskip("albumentations")
    pipeline = albumentations.Compose([AlbumentationsNoise(STILL, p=1.0)], seed=1)
    made = [pipeline(images=gray)["images"].reshape(3, -1).astype(float) for _ in range(2)]
    yield "albumentations", np.stack(made) - 30000
    frames = tv_tensors.Video(torch.full((3, 1, 32, 32), 0.5))
    made = [TorchvisionNoise(STILL)(frames).flatten(1).numpy() for _ in range(2)]
    yield "torchvision", np.stack(made) - 0.5


def test_video_has_one_camera_and_pattern_and_fresh_temporal_noise():
    """Pattern 60 e- and temporal noise of (614 + 4)^1/2 = 25 e-: correlation 0.85 between frames, 0 between clips."""
    for library, residual in clips():
        frames = np.corrcoef(residual[0])
        assert frames[0, 1] > 0.75, library
        assert frames[0, 1] < 0.99, library
        assert frames[1, 2] > 0.75, library
        # 1,024 pixels: standard error 0.031; 5 of them.
        assert abs(np.corrcoef(residual[0, 0], residual[1, 0])[0, 1]) < 0.16, library


def test_video_replays_and_same_on_batch_stays_the_same():
    video = torch.full((2, 1, 3, 16, 16), 0.5)
    sequence = K.VideoSequential(VISNoise(CAMERA), data_format="BCTHW", same_on_frame=True)
    noisy = sequence(video)
    assert torch.equal(sequence(video, params=sequence._params), noisy)
    alike = VISNoise(CAMERA, same_on_batch=True)(torch.full((3, 1, 16, 16), 0.5))
    assert torch.equal(alike[0], alike[2])


def test_draws_of_a_container_replay_from_json():
    sequence = K.AugmentationSequential(
        K.RandomHorizontalFlip(p=0.5), VISNoise(CAMERA), K.ImageSequential(VISNoise(CAMERA), K.RandomGamma())
    )
    batch = torch.rand(3, 1, 24, 32)
    noisy = sequence(batch)
    stored = json.loads(json.dumps(draws_to_json(sequence._params)))
    assert torch.equal(sequence(batch, params=draws_from_json(stored)), noisy)
    alone = VISNoise([CAMERA, STILL])
    noisy = alone(batch)
    stored = json.loads(json.dumps(draws_to_json(alone._params)))
    assert torch.equal(alone(batch, params=draws_from_json(stored)), noisy)
