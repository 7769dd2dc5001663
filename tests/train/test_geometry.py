"""Projection against OpenCV, poses against SciPy, boxes and visibility at the border."""

import cv2
import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from visaug.core.errors import InputError
from visaug_train.geometry import Keypoints, Pinhole, project_targets, rotation_matrix
from visaug_train.render.dataset import SPEED_PLUS_CAMERA as CAMERA


def test_projection_equals_opencv():
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -1.2, 4], [2, 1.2, 20], (200, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), CAMERA.matrix, CAMERA.distortion)
    np.testing.assert_allclose(CAMERA.project(points), expected[:, 0], rtol=0, atol=1e-8)


def test_rays_undo_projection():
    pixels = np.stack(np.meshgrid([0.0, 480, 960, 1920], [0.0, 600, 1200]), axis=-1)
    np.testing.assert_allclose(CAMERA.project(CAMERA.rays(pixels) * 7.0), pixels, atol=1e-6)


def test_scaled_camera_scales_pixels():
    point = np.array([0.3, -0.2, 5.0])
    np.testing.assert_allclose(CAMERA.scaled(240, 150).project(point), CAMERA.project(point) / 8)


def test_point_behind_the_camera_has_no_pixel():
    assert np.isnan(CAMERA.project(np.array([0.1, 0.1, -3.0]))).all()


def test_rotation_is_scipys_active_one():
    w, x, y, z = q = np.array([0.5, -0.1, 0.7, 0.2])
    np.testing.assert_allclose(rotation_matrix(q), Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-12)


def test_tango_equals_the_published_points(shared_data):
    published = scipy.io.loadmat(shared_data / "tango_geometry" / "tangoPoints.mat")["tango3Dpoints"].T
    np.testing.assert_allclose(Keypoints.load("tango").points_m, published, atol=1e-12)


def test_speedplus_camera_file(shared_data):
    camera = Pinhole.load(shared_data / "tango_geometry" / "camera.json")
    np.testing.assert_allclose(camera.matrix, CAMERA.matrix)
    np.testing.assert_allclose(camera.distortion, CAMERA.distortion)
    assert (camera.width, camera.height) == (1920, 1200)


def test_box_is_cut_at_the_border_and_points_beyond_are_invisible():
    keypoints = Keypoints.load("tango")
    identity = np.array([[1.0, 0, 0, 0]] * 3)
    # In the middle, over the left border, wholly outside.
    translations = np.array([[0, 0, 4.0], [-1.3, 0, 4.0], [-6.0, 0, 4.0]])
    targets = project_targets(CAMERA, keypoints, identity, translations)
    assert targets.seen.tolist() == [True, True, False]
    assert targets.inside[0].all()
    assert 0 < targets.inside[1].sum() < 11
    assert not targets.inside[2].any()
    assert targets.boxes[1, 0] == 0
    whole = targets.points[0]
    np.testing.assert_allclose(targets.boxes[0], [*whole.min(axis=0), *whole.max(axis=0)])


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ("points_m: {a: [0, 0, 0]}", "points_m"),
        ("points_m: {a: [0, 0], b: [1, 1, 1], c: [2, 2, 2], d: [0, 1, 2]}", "points_m"),
        ("[", "YAML"),
    ],
)
def test_bad_keypoints_are_refused(tmp_path, content, field):
    path = tmp_path / "points.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match=field):
        Keypoints.load(path)


def test_own_keypoints_are_read(tmp_path):
    path = tmp_path / "points.yaml"
    path.write_text("points_m: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]")
    assert len(Keypoints.load(path)) == 4
