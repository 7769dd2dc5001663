"""Hidden effects end to end, with training, network and diagnosis stubbed: what is taken, made, said and kept."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

import visaug
from tests.hostile import check_page
from tests.hostile_pages import NASTY, check_file
from visaug.core.errors import InputError
from visaug_train import training
from visaug_train.config import check_config
from visaug_train.geometry import Keypoints, project_targets
from visaug_train.metrics import Detections
from visaug_train.report import write_report
from visaug_train.results import ablate
from visaug_train.studies.hidden import PLAIN, hidden_cameras, outcomes, plan_of, proof_sections

CAMERA = {
    "resolution": [100, 160],
    "bit_depth": 12,
    "quantum_efficiency": 0.6,
    "gain_e_per_dn": 0.12,
    "black_level_dn": 64,
    "full_well_e": 220,
    "read_noise": {"sigma_e": 3.0},
    "randomize": {"gain_db": {"std": 1.0}},
}
BANDING = {"name": "periodic_banding", "amplitude_e": 40, "period_rows": 9}
BLOOMING = {"name": "blooming", "share": 0.9}


@pytest.fixture
def study_config(rendered, tmp_path):
    def make(**changes):
        return check_config(
            {
                "name": NASTY,
                "output": str(tmp_path / "out"),
                "data": {
                    "root": str(rendered),
                    "test": {"synthetic": {"domain": "synthetic", "split": "test"}},
                },
                "training": {"epochs": 1, "imgsz": 64},
                "arms": {"vis": {"vis": {"camera": str(camera_file)}}},
                "baseline": "vis",
                "hidden": {"effects": {"banding": BANDING, "blooming": BLOOMING}},
                "seeds": [0, 1],
                "bootstrap": 50,
            }
            | changes
        )

    camera_file = tmp_path / "camera.yaml"
    visaug.Camera.load(CAMERA).save(camera_file)
    return make


@pytest.fixture
def stubbed(monkeypatch):
    """No network: keypoints are off by more pixels where the test camera has what the training noise lacks."""
    calls = {"diagnose": 0, "train": []}
    answers = {"banding": ["periodic_banding"], "blooming": ["smear"]}

    @dataclass
    class Answer:
        camera: visaug.Camera
        accepted: list[str]

        def to_json(self):
            return {
                "accepted": self.accepted,
                "steps": [],
                "error": {"before": 1.0, "after": 0.1, "floor": 0.0},
            }

    def diagnose(camera, frames, seed=0, progress=None):
        accepted = list(answers.values())[calls["diagnose"]]
        calls["diagnose"] += 1
        for name in accepted:
            camera = camera.with_effect(name)
        return Answer(camera, accepted)

    def train(config, noise, arguments, data_yaml, folder, seed, title, progress, clean_epochs=0):
        calls["train"].append(folder.name.rsplit("-", 2)[0])
        (folder / "weights").mkdir(parents=True)
        (folder / "weights" / "best.pt").write_bytes(b"")
        (folder / "results.csv").write_text("epoch,train/pose_loss\n1,2.0\n")
        return 1.0

    def predict(weights, poses, *_, **__):
        arm, domain = weights.parts[-3], poses.name
        targets = project_targets(poses.camera, Keypoints.load(), poses.quaternions, poses.translations)
        knows = arm.startswith(domain) and not arm.startswith(
            "blooming_named"
        )  # smear was named there, which is no help
        shift = 0.5 if domain in ("synthetic", PLAIN) or knows else 3.0
        return [
            Detections(box[None] + shift, points[None] + shift, np.ones((1, 11)), np.ones(1))
            for box, points in zip(targets.boxes, targets.points)
        ]

    monkeypatch.setattr(visaug, "diagnose", diagnose)
    monkeypatch.setattr(training, "_train", train)
    monkeypatch.setattr(training, "predict", predict)
    return calls


def test_a_study_shows_cost_recovery_control_and_who_knew(study_config, stubbed, request):
    ablation = ablate(study_config())
    assert list(ablation.means) == ["vis", "banding_named", "blooming_named", "blooming_known"]
    assert list(ablation.study.tests) == ["synthetic", PLAIN, "banding", "blooming"]
    banding, blooming = outcomes(ablation)
    assert (banding.hidden.named, banding.hidden.known) == ("banding_named", "banding_named")
    assert (banding.hidden.wrong, blooming.hidden.wrong) == ("blooming_named", "banding_named")
    assert banding.cost.clear == -1
    assert banding.named is not None
    assert banding.named.clear == 1
    assert banding.named.after == pytest.approx(banding.cost.before)
    assert banding.wrong is not None
    assert banding.wrong.clear == 0
    assert blooming.named is not None
    assert blooming.named.clear == 0
    assert blooming.known is not None
    assert blooming.known.clear == 1
    assert "named periodic_banding, which is right" in banding.finding()
    assert "named smear, which is wrong" in blooming.finding()
    assert "does not clearly change" in blooming.finding()

    written = ablation.write(ablation.config.output)
    assert "| periodic_banding | periodic_banding |" in written.read_text()
    assert "the same run" in (written.parent / "effects.csv").read_text()
    report = write_report(ablation)
    assert "What a hidden effect costs" in report.read_text()
    check_page(report.read_text())
    assert len(proof_sections(ablation)) == 3

    made = {file: file.stat().st_mtime_ns for file in ablation.config.output.glob("cameras/**/*.*")}
    trained = list(stubbed["train"])
    ablate(study_config())
    assert stubbed["diagnose"] == 2
    assert stubbed["train"] == trained
    assert sorted(set(trained)) == ["banding_named", "blooming_known", "blooming_named", "vis"]
    assert len(trained) == 8  # four networks for each of two seeds: the baseline is shared
    assert made == {file: file.stat().st_mtime_ns for file in made}
    check_file(request.getfixturevalue("browser"), report)  # last: it skips where there is no Chromium


def test_cameras_differ_by_their_effect_alone(study_config, stubbed):
    tests = training.prepare(study_config()).tests
    one_dn = 255 / 4095
    for plain, banding in zip(tests[PLAIN].files, tests["banding"].files):
        before, after = (cv2.imread(str(f), cv2.IMREAD_GRAYSCALE).astype(int) for f in (plain, banding))
        inside = (before > 0) & (after > 0)
        seen = inside.any(axis=1)  # rows that are not clipped at black throughout
        difference = np.where(inside, after - before, np.nan)[seen]
        level = np.nanmedian(difference, axis=1)
        assert np.nanmax(np.abs(difference - level[:, None])) <= 2  # every pixel of a row shifts alike
        assert np.nanmax(np.abs(level)) == pytest.approx(40 / 0.12 * one_dn, abs=2)


def test_frames_of_the_plan_hold_bias_darks_flats_and_scenes(study_config):
    camera = hidden_cameras(study_config())[PLAIN]
    plan = plan_of(camera)
    assert {record.kind for record in plan.records} == {"bias", "dark", "flat", "scene"}
    brightest = max(r.photons for r in plan.records if r.photons)
    assert brightest * 0.6 > 220  # beyond full well


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"hidden": {"effects": {"banding": {"name": "no_such"}}}}, "no_such"),
        ({"hidden": {"effects": {"banding": {"name": "row_noise", "sigma": 1}}}}, "sigma"),
        ({"hidden": {"effects": {"plain": BANDING}}}, "hidden.effects.plain"),
        ({"hidden": {"effects": {"banding": BANDING}, "views": "lightbox"}}, "hidden.views"),
        ({"arms": {"vis": {"gaussian": {}}}}, "arms.vis"),
    ],
)
def test_a_mistake_is_refused_in_one_line_before_anything_is_taken(study_config, stubbed, changes, expected):
    with pytest.raises(InputError, match=expected):
        ablate(study_config(**changes))
    assert not list(Path(study_config().output).glob("cameras/*"))


def test_a_camera_of_another_size_is_refused(study_config, stubbed, tmp_path):
    visaug.Camera.load(CAMERA | {"resolution": [50, 80]}).save(tmp_path / "camera.yaml")
    with pytest.raises(InputError, match=r"expected \[100, 160\]"):
        ablate(study_config())
