"""Regions of pictures, and what is left of noise and patterns in them. Margins are four standard errors or more."""

import numpy as np
import pytest

from benchmark import pictures as independent
from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet
from visaug.pictures.blocks import Rounding
from visaug.pictures.files import largest_group
from visaug.pictures.regions import KEPT, dark_residuals, find_regions, lit_residuals
from visaug.pictures.symmetry import symmetry_sums

SIDE = (128, 160)
CAMERA = independent.PictureCamera("one", 16.0, 28.0, black_dn=10.0)


def taken(content, n=16, seed=1, camera=CAMERA):
    rng = np.random.default_rng(seed)
    scenes = [getattr(independent, content)(rng, SIDE) for _ in range(n)]
    return np.stack(independent.take(camera, scenes, seed)).astype(np.float32), np.stack(scenes)


def regions_of(pictures):
    return find_regions(pictures, 250.0, Rounding(np.ones((8, 8)), False))


@pytest.fixture(scope="module")
def spacecraft():
    pictures, scenes = taken("spacecraft")
    return pictures, scenes, regions_of(pictures)


def test_the_sky_is_found_and_holds_no_light(spacecraft):
    _, scenes, regions = spacecraft
    assert regions.sky == pytest.approx(10, abs=0.3)
    light = scenes.reshape(16, 16, 8, 20, 8).max((2, 4))
    assert regions.dark.mean() > 0.5 * (light < 1e-3).mean()
    assert light[regions.dark].max() < 0.01


def test_scenes_without_a_sky_have_none():
    assert regions_of(taken("natural")[0]).sky is None


def test_what_is_left_of_the_sky_is_its_noise(spacecraft):
    pictures, _, regions = spacecraft
    left = dark_residuals(pictures, regions.dark)
    inside = regions.dark.repeat(8, 1).repeat(8, 2)
    assert left.std() == pytest.approx(np.hypot(28 / 16, 12**-0.5), rel=0.02)
    assert np.ptp(left[~inside]) == 0


def test_flat_regions_keep_the_noise_that_the_choice_did_not_look_at(spacecraft):
    """White noise keeps its variance in each coefficient; shot noise follows the level."""
    pictures, _, regions = spacecraft
    for k, (level, left) in enumerate(zip(regions.levels, lit_residuals(pictures, regions), strict=True)):
        inside = (regions.lit == k).repeat(8, 1).repeat(8, 2)
        variance = ((level - 10) * 16 + 28**2) / 16**2 + 1 / 12
        assert left.var() == pytest.approx(variance * KEPT.mean(), rel=0.06)
        assert np.ptp(left[~inside]) == 0


def test_loss_of_light_in_the_corner_is_told_by_its_slope():
    """Even fields of changing level: V = 1 - 0.3 r^2."""
    y, x = ((np.arange(n) + 0.5 - n / 2) / (np.hypot(*SIDE) / 2) for n in SIDE)
    levels = np.random.default_rng(2).uniform(60, 200, 12)
    pictures = 10 + levels[:, None, None] * (1 - 0.3 * (y[:, None] ** 2 + x[None] ** 2))
    sums = symmetry_sums(pictures, np.ones((12, 16, 20), bool), 10.0, 250.0, (0, 0), SIDE)
    assert sums.ratio[0] == pytest.approx(
        0.3, rel=0.12
    )  # of the level where it is, which is lower than in the middle
    assert sums.ratio[1] == pytest.approx(0.3, rel=0.45)


def test_saturated_areas_are_as_long_either_way_unless_charge_spills():
    """Round spots: zero within three of its own errors; with spilled charge far from it."""
    rng = np.random.default_rng(3)
    rows, columns = np.indices(SIDE)
    spots = []
    for _ in range(20):
        y, x = rng.uniform(20, 100, 2)
        spots.append(np.exp(-((rows - y) ** 2 + (columns - x) ** 2) / 20) * rng.uniform(2, 6))
    for share, spills in ((0.0, False), (0.9, True)):
        camera = independent.PictureCamera("one", 16.0, 28.0, black_dn=10.0, bloom_share=share)
        pictures = np.stack(independent.take(camera, spots, 4)).astype(float)
        sums = symmetry_sums(pictures, np.zeros((20, 16, 20), bool), 10.0, 250.0, (0, 0), SIDE)
        error = np.sqrt((sums.deviations**2).sum(0))
        assert (sums.ratio[3] > 5 * error[3]) is np.bool_(spills)
        if not spills:
            assert abs(sums.ratio[3]) < 3 * error[3]


def test_a_set_without_pictures_is_refused_in_one_line():
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0) for i in range(3)]
    frames = FrameSet.from_arrays(records, np.zeros((3, 32, 32), np.uint16))
    with pytest.raises(InputError, match="no ordinary pictures"):
        largest_group(frames, print)
