"""Cameras made for a study: the true one acts as the camera that it states, estimates come from pictures, both reach arms."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import visaug
from visaug.core.errors import InputError
from visaug_train import reduction, training
from visaug_train.config import check_config
from visaug_train.geometry import Keypoints, Pinhole, project_targets
from visaug_train.metrics import Detections
from visaug_train.render.dataset import DOMAINS
from visaug_train.render.independent_camera import LIGHTBOX_LINES_CAMERA, SUNLAMP_LINES_CAMERA
from visaug_train.report import write_report
from visaug_train.results import ablate
from visaug_train.speed import PoseSet
from visaug_train.studies import target
from visaug_train.studies.target import is_plain, true_camera


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
    monkeypatch.setattr(training, "predict", predict)


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


REDUCED = {
    "resolution": [120, 192],
    "bit_depth": 12,
    "gain_e_per_dn": 0.3,
    "black_level_dn": 400.0,
    "read_noise": {"sigma_e": 12.0},
    "dsnu": {"pixel_e": 9.0, "row_e": 8.0, "column_e": 8.0},
    "prnu": {"pixel": 0.02},
    "effects": [{"name": "row_noise", "sigma_e": 10.0}, {"name": "jpeg", "quality": 95}],
}


@pytest.mark.parametrize(
    ("how", "size"), [("area", (64, 40)), ("area", (80, 50)), ("linear", (80, 50)), ("linear", (64, 40))]
)
@pytest.mark.parametrize("level", [0.0, 0.5])
def test_a_reduced_camera_has_the_noise_of_reduced_images(how, size, level):
    """24 images: rows and columns by some 1000 numbers and pixels by 50,000: within 10 % and 4 %."""
    content = REDUCED | {"effects": REDUCED["effects"][:1]}
    torch.manual_seed(2)
    flat = torch.full((24, 1, 120, 192), level)
    whole = visaug.VISNoise(visaug.Camera.load(content), black_level="keep")(flat)[:, 0].numpy()
    truth = np.stack([reduction.reduced(image, size, how) for image in whole])
    small = visaug.Camera.load(reduction.reduced_camera(REDUCED, (192, 120), size, how))
    assert list(small.effect_names) == ["row_noise"]
    assert tuple(small.resolution) == (size[1], size[0])
    found = visaug.VISNoise(small, black_level="keep")(torch.full((24, 1, size[1], size[0]), level))[
        :, 0
    ].numpy()
    for part, tolerance in ((rows_of, 0.1), (columns_of, 0.1), (pixels_of, 0.04)):
        assert part(found) == pytest.approx(part(truth), rel=tolerance)


def rows_of(images):
    return images.mean(2).std(1).mean()


def columns_of(images):
    return images.mean(1).std(1).mean()


def pixels_of(images):
    """Differences of neighbours would see the correlation that interpolation makes: all of what rows and columns leave."""
    return (images - images.mean(2, keepdims=True) - images.mean(1, keepdims=True)).std(axis=(1, 2)).mean()


def test_the_size_at_which_arms_put_a_cameras_noise_on(tmp_path):
    poses = PoseSet("target", Pinhole(96, 64, np.eye(3), np.zeros(5)), (), np.zeros((0, 4)), np.zeros((0, 3)))
    small = CONTENT | {"output": str(tmp_path / "out"), "data": CONTENT["data"] | {"image_size": [48, 32]}}
    assert target._seen_size(check_config(small), "found", poses) == (48, 32)
    on_sensor = {"vis": {"camera": "found", "resolution": "sensor", "black_level": "keep"}}
    arms = CONTENT["arms"] | {"estimated": on_sensor}
    assert target._seen_size(check_config(small | {"arms": arms}), "found", poses) is None
    both = check_config(small | {"arms": arms | {"other": CONTENT["arms"]["estimated"]}})
    with pytest.raises(InputError, match="both resolutions"):
        target._seen_size(both, "found", poses)


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
