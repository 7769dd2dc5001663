"""PnP recovers known poses, also with outliers; errors and the SPEC score."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from visaug_train.geometry import Keypoints, rotation_matrix
from visaug_train.pose import estimate_pose, pose_errors, spec_score
from visaug_train.render.dataset import SPEED_PLUS_CAMERA as CAMERA

TANGO = Keypoints.load("tango")


def random_pose(seed):
    x, y, z, w = Rotation.random(random_state=seed).as_quat()
    return np.array([w, x, y, z]), np.array([0.2, -0.3, 5.0 + seed % 4])


def pixels(q, r):
    return CAMERA.project(TANGO.points_m @ rotation_matrix(q).T + r)


@pytest.mark.parametrize("seed", range(8))
def test_exact_keypoints_give_the_pose(seed):
    q, r = random_pose(seed)
    pose = estimate_pose(pixels(q, r), np.ones(11), TANGO.points_m, CAMERA)
    assert pose is not None
    position, attitude = pose_errors(*pose, q, r)
    assert position < 1e-5
    assert attitude < 1e-3


@pytest.mark.parametrize("seed", range(8))
def test_two_wild_points_do_no_harm(seed):
    q, r = random_pose(seed)
    points = pixels(q, r) + np.random.default_rng(seed).normal(size=(11, 2)) * 0.3
    points[[2, 7]] += [[400, -250], [-300, 200]]
    pose = estimate_pose(points, np.ones(11), TANGO.points_m, CAMERA)
    assert pose is not None
    position, attitude = pose_errors(*pose, q, r)
    assert position < 0.02
    assert attitude < 2


def test_too_few_points_give_none():
    q, r = random_pose(0)
    points = pixels(q, r)
    points[3:] = np.nan
    assert estimate_pose(points, np.ones(11), TANGO.points_m, CAMERA) is None


def test_errors_by_hand():
    q = np.array([1.0, 0, 0, 0])
    turned = np.array([np.cos(np.radians(5)), np.sin(np.radians(5)), 0, 0])
    assert pose_errors(turned, np.array([0, 0, 5.5]), q, np.array([0, 0, 5.0])) == pytest.approx((0.1, 10))
    # A quaternion and its negative are one attitude.
    assert pose_errors(-turned, np.array([0, 0, 5.0]), q, np.array([0, 0, 5.0]))[1] == pytest.approx(10)
    tiny = np.array([1.0, 1e-6, 0, 0])
    assert pose_errors(tiny, np.ones(3), q, np.ones(3))[1] == pytest.approx(np.degrees(2e-6), rel=1e-3)


def test_score_forgives_below_the_floor():
    score = spec_score(np.array([0.002, 0.01]), np.array([0.16, 1.0]))
    assert score[0] == 0
    assert score[1] == pytest.approx(0.01 + np.radians(1.0))


def test_points_that_fall_together_give_no_pose():
    points = np.full((11, 2), 300.0)
    assert estimate_pose(points, np.ones(11), TANGO.points_m, CAMERA) is None


def few_exact_points(count, invisible, poses=200):
    """Attitude errors in degrees of poses of which `count` points are exact, and the others `invisible` and wrong."""
    rng, errors = np.random.default_rng(11), []
    for seed in range(poses):
        q, r = random_pose(seed)
        points, confidence = pixels(q, r), np.full(11, 0.9)
        wrong = rng.permutation(11)[count:]
        points[wrong] += rng.normal(0, 200, (len(wrong), 2))
        confidence[wrong] = invisible
        pose = estimate_pose(points, confidence, TANGO.points_m, CAMERA)
        assert pose is not None
        errors.append(pose_errors(*pose, q, r)[1])
    return np.array(errors)


@pytest.mark.parametrize("invisible", [0.0, 0.3])
def test_points_that_the_network_calls_invisible_are_not_used(invisible):
    assert (few_exact_points(4, invisible) > 10).mean() <= 0.03
    assert not (few_exact_points(5, invisible) > 10).any()
    assert not (few_exact_points(6, invisible) > 10).any()


def test_the_scale_of_the_confidences_changes_nothing():
    """Eleven equally good points are all used, whatever a network calls good; six of them are worse."""
    rng, q_r = np.random.default_rng(3), [random_pose(seed) for seed in range(60)]
    noisy = [pixels(q, r) + rng.normal(0, 3, (11, 2)) for q, r in q_r]

    def median_error(confidence):
        found = [estimate_pose(p, confidence, TANGO.points_m, CAMERA) for p in noisy]
        return np.median([pose_errors(*pose, q, r)[1] for pose, (q, r) in zip(found, q_r)])

    sure = median_error(np.full(11, 0.9))
    assert [median_error(np.full(11, level)) for level in (0.3, 0.02, 6.0)] == pytest.approx([sure] * 3)
    assert median_error(np.array([0.9] * 6 + [0.0] * 5)) > 1.2 * sure


def test_three_visible_points_give_no_pose():
    q, r = random_pose(0)
    assert estimate_pose(pixels(q, r), np.array([0.9] * 3 + [0.0] * 8), TANGO.points_m, CAMERA) is None
    assert estimate_pose(pixels(q, r), np.zeros(11), TANGO.points_m, CAMERA) is None
