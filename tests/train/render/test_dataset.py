"""The rendered dataset: same bytes again, going on, what shows where keypoints are."""

import json

import cv2
import numpy as np
import pytest

from visaug.core.errors import InputError
from visaug_train.geometry import Keypoints, project_targets
from visaug_train.render.dataset import RenderSettings, render_dataset
from visaug_train.speed import read_poses


def test_layout_is_that_of_speedplus(rendered):
    camera = json.loads((rendered / "camera.json").read_text())
    assert {"Nu", "Nv", "fx", "fy", "ppx", "ppy", "cameraMatrix", "distCoeffs"} <= camera.keys()
    np.testing.assert_allclose(camera["fx"] / camera["ppx"], camera["cameraMatrix"][0][0])
    record = json.loads((rendered / "sunlamp" / "test.json").read_text())[0]
    assert record.keys() == {"filename", "q_vbs2tango_true", "r_Vo2To_vbs_true"}
    image = cv2.imread(str(rendered / "sunlamp" / "images" / record["filename"]), cv2.IMREAD_UNCHANGED)
    assert image.shape == (100, 160)
    assert image.dtype == np.uint8


def test_interrupted_rendering_gives_the_same_bytes(rendered, settings, tmp_path):
    def stop(_title, done, _total):
        if done > 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(tmp_path, settings, progress=stop)
    assert not (tmp_path / "lightbox" / "test.json").exists()
    render_dataset(tmp_path, settings)
    files = sorted(f.relative_to(rendered) for f in rendered.rglob("*") if f.suffix in (".png", ".json"))
    files = [f for f in files if f.parts[0] != "ultralytics"]
    assert files
    assert all((rendered / f).read_bytes() == (tmp_path / f).read_bytes() for f in files)


def test_other_settings_do_not_mix(rendered):
    with pytest.raises(InputError, match="other settings"):
        render_dataset(rendered, RenderSettings(width=320))


def test_target_shows_inside_its_box_and_nowhere_else(rendered):
    poses = read_poses(rendered, "synthetic", "test")
    targets = project_targets(poses.camera, Keypoints.load(), poses.quaternions, poses.translations)
    for file, (x0, y0, x1, y1) in zip(poses.files, targets.boxes):
        linear = cv2.imread(str(file.parents[1] / "images_linear" / file.name), cv2.IMREAD_UNCHANGED)
        assert linear.dtype == np.uint16
        inside = linear[int(y0) : int(y1) + 1, int(x0) : int(x1) + 1].mean()
        # Far from the target there is black sky, or the Earth; never in all four corners of all images.
        corners = linear[[0, 0, -1, -1], [0, -1, 0, -1]]
        assert inside > 500
        assert corners.min() == 0


def test_domains_are_lit_as_named(rendered):
    def images(domain):
        poses = read_poses(rendered, domain)
        return np.stack([cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in poses.files])

    assert (images("sunlamp") == 255).mean() > 4 * max((images("lightbox") == 255).mean(), 1e-4)
    # Sensor noise fills the sky of the lightbox; the synthetic sky is black.
    assert (images("synthetic") == 0).mean() > 0.5 > (images("lightbox") == 0).mean()
