"""Statistics by symmetries of scenes: charge that spilled, and how well few pictures tell an error."""

import numpy as np
import pytest
from scipy import stats

from visaug.comparison.picture_scenes import without_spill
from visaug.fingerprint.pictures.symmetry import Sums, area_sums

SATURATED = 240.0


def disk(size: float = 5.0) -> np.ndarray:
    y, x = np.indices((64, 64)) - 32
    return np.where(np.hypot(y, x) <= size, 255.0, 20.0)


def spilled(scene: np.ndarray) -> np.ndarray:
    found = scene.copy()
    found[20:45, 30:34] = 255.0
    return found


def test_charge_that_spilled_along_columns_is_taken_off_a_saturated_area():
    (found,) = without_spill(spilled(disk())[None], SATURATED)
    np.testing.assert_array_equal(found >= SATURATED, disk() >= SATURATED)
    np.testing.assert_array_equal(found, disk())


@pytest.mark.parametrize("scene", [disk(), disk().T, spilled(disk()).T, np.full((64, 64), 20.0)])
def test_areas_that_are_not_longer_along_columns_stay(scene):
    np.testing.assert_array_equal(without_spill(scene[None], SATURATED)[0], scene)


def test_an_area_at_the_border_of_the_picture_stays_where_its_mirror_image_is_outside():
    scene = np.full((64, 64), 20.0)
    scene[10:40, 0:3] = 255.0
    (found,) = without_spill(scene[None], SATURATED)
    assert (found <= scene).all()
    assert (found[:, 3:] == 20).all()


def test_areas_of_scenes_without_spill_are_alike_along_both_axes_on_the_average():
    """Ellipses in all directions, 400 of them; spilled charge makes each longer along columns. False alarms: 3e-5."""
    rng, sums = np.random.default_rng(0), []
    y, x = np.indices((48, 48)) - 24
    for angle in rng.uniform(0, np.pi, 400):
        a, b = y * np.cos(angle) + x * np.sin(angle), x * np.cos(angle) - y * np.sin(angle)
        sums.append(np.where((a / 9) ** 2 + (b / 4) ** 2 <= 1, 255.0, 20.0))
    above, below = area_sums(np.array(sums) >= SATURATED)
    found = Sums(above, below)
    assert np.all(np.abs(found.ratio) < 4.2 * np.sqrt(found.variance))
    trimmed = Sums(*area_sums(without_spill(np.array(sums), SATURATED) >= SATURATED))
    assert np.all(trimmed.ratio <= found.ratio)


def rejected(pictures: int, by: str) -> float:
    """Rate at which a ratio that is zero is found to differ from it at a stated 5 %."""
    rng, hits, trials = np.random.default_rng(1), 0, 2000
    for _ in range(trials):
        below = rng.exponential(1.0, (pictures, 1))
        one = Sums(below * rng.standard_normal((pictures, 1)), below)
        size = float(np.abs(one.ratio[0]) / np.sqrt(one.variance[0]))
        hits += 2 * (stats.t.sf(size, one.freedom[0]) if by == "t" else stats.norm.sf(size)) < 0.05
    return hits / trials


@pytest.mark.parametrize("pictures", [6, 12, 40])
def test_students_t_holds_the_error_that_few_pictures_tell(pictures):
    """At most 8 % for the stated 5 %, with pictures of very different weight; the normal distribution rejects more often."""
    assert rejected(pictures, "t") < 0.08
    assert rejected(pictures, "normal") > rejected(pictures, "t")


def test_one_picture_that_weighs_most_tells_an_error_badly():
    above, below = np.ones((20, 1)), np.ones((20, 1))
    above[:10] = -0.9
    equal = Sums(above, below)
    assert equal.freedom[0] == pytest.approx(40, rel=0.01)  # equal squares: 2 n^2 / n
    above[0], below[0] = -100, 100
    assert Sums(above, below).freedom[0] < 4
