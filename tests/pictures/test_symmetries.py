"""Statistics by symmetries of scenes: charge that spilled, and how well few pictures tell an error."""

import numpy as np
import pytest
from scipy import ndimage, stats

from visaug.pictures.scenes import unspilled
from visaug.pictures.symmetry import Sums, area_sums

SATURATED = 240.0


def disk(row: int = 32, column: int = 32, size: float = 5.0) -> np.ndarray:
    y, x = np.indices((64, 64))
    return np.where(np.hypot(y - row, x - column) <= size, 255.0, 20.0)


def spilled(scene: np.ndarray, rows: slice = slice(20, 45), columns: slice = slice(30, 34)) -> np.ndarray:
    found = scene.copy()
    found[rows, columns] = 255.0
    return found


@pytest.mark.parametrize(
    ("scene", "rows", "columns"),
    [
        (disk(), slice(20, 45), slice(30, 34)),
        (disk(), slice(32, 60), slice(30, 35)),  # downwards alone
        (disk(row=6), slice(0, 50), slice(30, 34)),  # up to the border
        (
            np.maximum(disk(row=15), disk(row=45)),
            slice(10, 60),
            slice(30, 34),
        ),  # a trail that joins two lights
    ],
)
def test_charge_that_spilled_along_columns_is_taken_off_a_saturated_area(scene, rows, columns):
    (found,) = unspilled(spilled(scene, rows, columns)[None], SATURATED)
    np.testing.assert_array_equal(found >= SATURATED, scene >= SATURATED)


@pytest.mark.parametrize("scene", [disk(), disk().T, spilled(disk()).T, np.full((64, 64), 20.0)])
def test_areas_that_are_not_longer_along_columns_stay(scene):
    """But for single pixels at the border of an area whose middle is not sharp."""
    (found,) = unspilled(scene[None], SATURATED)
    assert np.count_nonzero(found != scene) <= 4


def test_areas_in_pieces_are_scenes_too():
    """Speckle near saturation: areas whose rows have gaps, and single pixels."""
    rng = np.random.default_rng(0)
    noisy = ndimage.gaussian_filter(rng.normal(245, 16, (20, 64, 64)), (0, 0.7, 0.7))
    found = unspilled(noisy, 250.0)
    assert found.shape == noisy.shape
    assert np.isfinite(found).all()
    assert np.count_nonzero(noisy >= 250.0) - np.count_nonzero(found >= 250.0) > 0


def test_an_area_at_the_border_keeps_what_its_mirror_image_does_not_tell():
    """Three columns at the border, 30 rows: what would lie left of the picture is not known and stays."""
    scene = spilled(np.full((64, 64), 20.0), slice(10, 40), slice(0, 3))
    (found,) = unspilled(scene[None], SATURATED)
    assert (found[26:40, :3] == 20).all()
    assert (found[10:23, :3] == 255).all()
    assert (found[:, 3:] == 20).all()


def test_areas_of_scenes_without_spill_are_alike_along_both_axes_on_the_average():
    """Ellipses in all directions, 400 of them. With charge spilled over 20 rows each they are not. False alarms: 3e-5."""
    rng, scenes = np.random.default_rng(0), []
    y, x = np.indices((48, 48)) - 24
    for angle in rng.uniform(0, np.pi, 400):
        a, b = y * np.cos(angle) + x * np.sin(angle), x * np.cos(angle) - y * np.sin(angle)
        scenes.append(np.where((a / 9) ** 2 + (b / 4) ** 2 <= 1, 255.0, 20.0))
    bloomed = [spilled(scene, slice(14, 34), slice(22, 26)) for scene in scenes]
    plain, longer = (Sums(*area_sums(np.array(s) >= SATURATED)) for s in (scenes, bloomed))
    assert np.all(np.abs(plain.ratio) < 4.2 * np.sqrt(plain.variance))
    assert np.all(longer.ratio[:2] > 4.2 * np.sqrt(longer.variance[:2]))


def rejected(pictures: int, trials: int = 2000) -> tuple[float, float]:
    """Rates at which ratios that are zero are found to differ from it at a stated 5 %, by Student's t and by the normal law."""
    rng = np.random.default_rng(1)
    below = rng.exponential(1.0, (pictures, trials))
    sums = Sums(below * rng.standard_normal((pictures, trials)), below)
    size = np.abs(sums.ratio) / np.sqrt(sums.variance)
    by_t, by_normal = 2 * stats.t.sf(size, sums.freedom), 2 * stats.norm.sf(size)
    return float(np.mean(by_t < 0.05)), float(np.mean(by_normal < 0.05))


@pytest.mark.parametrize("pictures", [6, 12, 40])
def test_students_t_holds_the_error_that_few_pictures_tell(pictures):
    """At most 8 % for the stated 5 %, with pictures of very different weight; the normal distribution rejects more often.

    The rate of right code is below 5.8 %, with a standard deviation of 0.5 % of 2000 ratios: false alarms 3e-5.
    """
    by_t, by_normal = rejected(pictures)
    assert by_t < 0.08
    assert by_normal > by_t


def test_one_picture_that_weighs_most_tells_an_error_badly():
    above, below = np.ones((20, 1)), np.ones((20, 1))
    above[:10] = -0.9
    equal = Sums(above, below)
    assert equal.freedom[0] == pytest.approx(40, rel=0.01)  # equal squares: 2 n^2 / n
    above[0], below[0] = -100, 100
    assert Sums(above, below).freedom[0] < 4


def test_a_ratio_that_is_zero_has_an_error_too():
    above = np.array([3.0, -3, 1, -1, 0, 0])[:, None]
    assert Sums(above, np.full((6, 1), 50.0)).variance[0] > 0
    assert Sums(0 * above, np.full((6, 1), 50.0)).variance[0] == pytest.approx((1 / 300) ** 2)
