"""Cameras made for a study: the true one acts as the camera that it states, estimates come from pictures, both reach arms."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

import visaug
from visaug.errors import InputError
from visaug_train import scoring, target, training
from visaug_train.ablation import ablate
from visaug_train.config import check_config
from visaug_train.geometry import Keypoints, Pinhole, project_targets
from visaug_train.metrics import Detections
from visaug_train.render.dataset import DOMAINS
from visaug_train.render.independent_camera import LIGHTBOX_LINES_CAMERA, SUNLAMP_LINES_CAMERA
from visaug_train.report import write_report
from visaug_train.speed import PoseSet
from visaug_train.target import is_plain, true_camera


@pytest.mark.parametrize("camera", [LIGHTBOX_LINES_CAMERA, SUNLAMP_LINES_CAMERA])
@pytest.mark.parametrize("level", [0.0, 0.4])
def test_the_true_camera_takes_the_pictures_of_the_independent_one(camera, level):
    """40 pictures of 64 x 64, rows and columns of equal strength.

    Of 2560 rows the standard error of a standard deviation is 1.4 %; columns and pixels of the independent camera are one
    specimen's, 64 columns, 9 %. Tails: Student's t and Tukey-lambda agree in variance, the cut at black takes part of both.
    """
    shape = (64, 64)
    photons = np.full(shape, level * camera.saturation_e / camera.quantum_efficiency)
    rng = np.random.default_rng(3)
    taken = np.stack([camera.to_8bit(camera.expose(photons, rng)) for _ in range(40)]).astype(float)
    noise = visaug.VISNoise(visaug.Camera.load(true_camera(camera, "test", shape)), black_level="keep")
    torch.manual_seed(3)
    modelled = 255 * noise(torch.full((40, 1, *shape), level))[:, 0].numpy()
    assert modelled.mean() == pytest.approx(taken.mean(), abs=0.4)
    rows = [f.mean(axis=2).std(axis=1).mean() for f in (modelled, taken)]
    assert rows[0] == pytest.approx(rows[1], rel=0.05)
    # What is left without rows and columns: shot, read, pixels.
    left = [
        (
            f
            - f.mean(axis=2, keepdims=True)
            - f.mean(axis=1, keepdims=True)
            + f.mean(axis=(1, 2), keepdims=True)
        ).std()
        for f in (modelled, taken)
    ]
    assert left[0] == pytest.approx(left[1], rel=0.05)


def test_only_cameras_that_a_file_states_in_full_are_known():
    known = {name for name, d in DOMAINS.items() if d.camera is not None and is_plain(d.camera)}
    assert known == {"lightbox_base", "lightbox_lines", "sunlamp_lines"}
    assert not is_plain(replace(LIGHTBOX_LINES_CAMERA, tap_gain=0.1))


CONTENT = {
    "name": "target",
    "data": {
        "rendered": {
            "width": 96,
            "height": 64,
            "attitude_deg": 20,
            "images": {
                "synthetic": {"train": 4, "validation": 2, "test": 3},
                "lightbox_lines": {"train": 30, "test": 8},
            },
        },
        "test": {
            "synthetic": {"domain": "synthetic", "split": "test"},
            "lightbox": {"domain": "lightbox_lines", "split": "test"},
        },
    },
    "training": {"epochs": 1, "imgsz": 96},
    "cameras": {
        "found": {"pictures": {"domain": "lightbox_lines", "split": "train"}},
        "known": {"rendered": "lightbox_lines"},
    },
    "arms": {
        "baseline": {},
        "estimated": {"vis": {"camera": ["found"], "black_level": "keep"}},
        "true_camera": {"vis": {"camera": "known", "black_level": "keep"}},
    },
    "oracle": "true_camera",
    "seeds": [0, 1, 2],
    "bootstrap": 30,
}


@pytest.fixture
def stubbed(monkeypatch):
    """No network: off by pixels that hang on the arm and, a little, on the seed."""

    def train(config, noise, arguments, data_yaml, folder, seed, title, progress, clean_epochs=0):
        (folder / "weights").mkdir(parents=True)
        (folder / "weights" / "best.pt").write_bytes(b"")
        (folder / "results.csv").write_text("epoch,train/pose_loss\n1,2.0\n")
        return 1.0

    def predict(weights, poses, *_, **__):
        arm, seed = weights.parts[-3].split("-seed")[0], int(weights.parts[-3].split("-seed")[1][0])
        shift = {"baseline": 2.0, "estimated": 0.9, "true_camera": 0.5}[arm] + 0.01 * seed
        targets = project_targets(poses.camera, Keypoints.load(), poses.quaternions, poses.translations)
        return [
            Detections(box[None] + shift, points[None] + shift, np.ones((1, 11)), np.ones(1))
            for box, points in zip(targets.boxes, targets.points)
        ]

    monkeypatch.setattr(training, "_train", train)
    monkeypatch.setattr(scoring, "predict", predict)


def test_a_study_estimates_trains_and_reports_the_share(stubbed, tmp_path):
    config = check_config(CONTENT | {"output": str(tmp_path / "out")})
    ablation = ablate(config)
    estimate, true = ablation.study.cameras
    assert (estimate.pictures, true.pictures) == (30, 0)
    assert ablation.config.arm("estimated").vis.cameras == [str(estimate.file)]
    rows = estimate.answer["parameters"]["row_noise.sigma_e"]["value"]
    assert rows / estimate.answer["parameters"]["gain_e_per_dn"]["value"] == pytest.approx(
        2.4 / 0.642, rel=0.25
    )
    (gain,) = ablation.gains
    assert (gain.arm, gain.domains) == ("estimated", ("lightbox",))
    assert gain.share == pytest.approx(gain.gain[0] / gain.oracle[0])
    assert gain.low < gain.share < gain.high
    page = write_report(ablation).read_text()
    assert "Gain by cameras estimated from pictures" in page
    assert "share of that gain" in page
    assert "estimated" in (ablation.write(config.output).parent / "oracle.csv").read_text()
    made = estimate.file.stat().st_mtime_ns
    assert training.prepare(config).cameras[0].file.stat().st_mtime_ns == made


def test_pictures_are_reduced_as_the_training_copies_are(tmp_path):
    """White noise of 8 DN, averaged over 2 x 2 pixels: 4 DN and the rounding of codes; 5 % is five standard errors."""
    rng = np.random.default_rng(0)
    for n in range(2):
        noisy = np.rint(rng.normal(100, 8, (64, 96))).astype(np.uint8)
        cv2.imwrite(str(tmp_path / f"{n}.png"), noisy)
    pinhole = Pinhole(96, 64, np.eye(3), np.zeros(5))
    files = tuple(sorted(tmp_path.glob("*.png")))
    poses = PoseSet("target", pinhole, files, np.zeros((2, 4)), np.zeros((2, 3)))
    content = CONTENT | {"output": str(tmp_path / "out")}
    config = check_config(content | {"data": CONTENT["data"] | {"image_size": [48, 32]}})
    small = target._pictures(poses.files, poses, target._seen_size(config, "found", poses), "area")
    assert small.shape(0) == (32, 48)
    assert np.std([small.read(n) for n in range(2)]) == pytest.approx(np.hypot(4, 12**-0.5), rel=0.05)
    on_sensor = {"vis": {"camera": "found", "resolution": "sensor", "black_level": "keep"}}
    arms = CONTENT["arms"] | {"estimated": on_sensor}
    config = check_config(content | {"data": CONTENT["data"] | {"image_size": [48, 32]}, "arms": arms})
    assert target._seen_size(config, "found", poses) is None
    config = check_config(content | {"arms": arms | {"other": CONTENT["arms"]["estimated"]}})
    with pytest.raises(InputError, match="both resolutions"):
        target._seen_size(config, "found", poses)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"cameras": {"found": {}}}, "one of pictures and rendered"),
        ({"cameras": {"found": {"rendered": "sunlamp"}}}, "camera of sunlamp is not known"),
        ({"oracle": "baseline"}, "oracle"),
    ],
)
def test_a_mistake_is_refused_before_anything_is_rendered(stubbed, tmp_path, changes, expected):
    with pytest.raises(InputError, match=expected):
        ablate(check_config(CONTENT | {"output": str(tmp_path / "out")} | changes))
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").glob("data-*"))
