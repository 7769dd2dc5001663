"""Noise inside kornia, torchvision v2, albumentations, DataLoader workers and compiled graphs."""

import pickle

import kornia.augmentation as K
import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader, Dataset
from torchvision import tv_tensors
from torchvision.transforms import v2

from visaug import Camera, VISNoise
from visaug.augment import AlbumentationsNoise, ImageNoise, TorchvisionNoise

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


@pytest.mark.parametrize("channels", [1, 3])
def test_base_chain_compiles_into_one_graph(channels):
    noise = VISNoise(CAMERA)
    images = torch.rand(2, channels, 8, 12)
    compiled = torch.compile(noise, fullgraph=True, backend="eager")
    noisy = compiled(images)
    same = VISNoise(CAMERA, fast=False)(images, params=noise._params)
    assert (noisy - same).abs().max() * 65535 < 1.5
