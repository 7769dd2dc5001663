"""Configs: inheritance, complaints with the key's path, the shipped ones."""

from pathlib import Path

import pytest
import yaml

from visaug.core.errors import InputError
from visaug_train.config import check_config, load_config
from visaug_train.record import decides
from visaug_train.training import batch_noise

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
STUDIES = sorted(p for p in CONFIGS.glob("*.yaml") if "\noutput:" in p.read_text())


def minimal(**changes):
    return {
        "name": "n",
        "output": "o",
        "data": {"rendered": {}},
        "arms": {
            "baseline": {"gaussian": {"p": 0.2}, "training": {"degrees": 5}},
            "vis": {"like": "baseline"},
        },
    } | changes


def test_an_arm_takes_over_what_it_does_not_say():
    arms = minimal()["arms"] | {"more": {"like": "vis", "training": {"scale": 0.1}, "blur": {}}}
    arm = check_config(minimal(arms=arms)).arm("more")
    assert arm.training == {"degrees": 5, "scale": 0.1}
    assert arm.gaussian.p == 0.2
    assert arm.blur is not None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"epochs": 3}, "epochs: is not a key"),
        ({"data": {}}, "data: give one of root and rendered"),
        ({"data": {"rendered": {"attitude_deg": 500}}}, "data.rendered.attitude_deg"),
        ({"training": {"seed": 1}}, "training.seed"),
        ({"baseline": "none"}, "baseline"),
        ({"seeds": []}, "seeds"),
        ({"arms": {"baseline": {"like": "baseline"}}}, "arms.baseline.like"),
        ({"arms": {"baseline": {"blur": {"p": 2}}}}, "arms.baseline.blur.p"),
        (
            {"arms": {"baseline": {"gaussian": {"std": [0.3, 0.1]}}}},
            r"arms\.baseline\.gaussian\.std: .*low, high",
        ),
        ({"arms": {"baseline": {"erase": {"aspect": [0, 1]}}}}, "arms.baseline.erase.aspect.0"),
        ({"arms": {"baseline": {"randconv": {"kernels": [2]}}}}, "arms.baseline.randconv.kernels"),
        (
            {"arms": {"baseline": {"vis": {"camera": "x", "effects": [{"p": 1}]}}}},
            "vis.effects: .*has no name",
        ),
    ],
)
def test_what_is_wrong_is_named_by_its_path(changes, message):
    with pytest.raises(InputError, match=message):
        check_config(minimal(**changes))


def test_a_config_on_top_of_another(tmp_path):
    (tmp_path / "base.yaml").write_text(yaml.safe_dump(minimal(training={"epochs": 3, "batch": 4})))
    (tmp_path / "top.yaml").write_text("extends: base.yaml\nname: m\ntraining: {epochs: 5}\n")
    config = load_config(tmp_path / "top.yaml")
    assert (config.name, config.output) == ("m", Path("o"))
    assert config.training == {"epochs": 5, "batch": 4, "augmentations": []}
    (tmp_path / "base.yaml").write_text("extends: top.yaml\n")
    with pytest.raises(InputError, match="extends: is"):
        load_config(tmp_path / "top.yaml")


def test_a_reduction_needs_a_size():
    with pytest.raises(InputError, match=r"data\.reduce: needs data\.image_size"):
        check_config(minimal(data={"rendered": {}, "reduce": "area"}))
    data = check_config(minimal(data={"rendered": {}, "image_size": [32, 20], "channels": 1})).data
    assert (data.reduction, data.copies) == ("area", ["32x20", "area", "gray"])


def test_the_start_is_that_of_an_arm_or_of_none():
    assert check_config(minimal(start={"epochs": 2})).start.like is None
    with pytest.raises(InputError, match=r"start\.like"):
        check_config(minimal(start={"epochs": 2, "like": "none"}))


def test_a_key_of_another_part_is_not_suggested_for_itself():
    """`resolution` is a key of a camera, and of a rendering."""
    with pytest.raises(InputError, match="resolution: is not a key of a config") as refused:
        check_config(minimal(resolution=[64, 64]))
    assert "did you mean resolution?" not in str(refused.value)


def test_missing_file_is_one_line(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_config(tmp_path / "none.yaml")


@pytest.mark.parametrize("path", STUDIES, ids=lambda p: p.stem)
def test_shipped_configs_are_sound(path):
    config = load_config(path)
    for name in config.arms:
        arm = config.arm(name)
        if set(arm.camera_files) & config.cameras.keys():  # made before a training
            assert set(arm.camera_files) <= config.cameras.keys()
        else:
            assert batch_noise(arm) is not None


def test_arms_of_the_ablation_differ_where_they_say():
    config = load_config(CONFIGS / "ablation.yaml")
    camera = {name: batch_noise(config.arm(name)) for name in config.arms if config.arm(name).vis}
    cameras = {
        name: noise[1].sensor.cameras[0] for name, noise in camera.items() if hasattr(noise[1], "sensor")
    }
    assert cameras["vis_gaussian_tails"].spec.read_noise.shape == 0.14
    assert "read_noise.shape" not in cameras["vis_gaussian_tails"].spec.randomize
    assert cameras["vis_no_fixed_pattern"].spec.dsnu.column_e == 0
    assert "row_noise" in cameras["vis_row_noise"].effect_names
    assert "row_noise" not in cameras["vis"].effect_names


def test_white_noise_that_is_there_already_is_taken_off():
    from visaug.camera import Camera
    from visaug_train.arms import Vis
    from visaug_train.noise import vis_noise

    path = str(CONFIGS / "demo_camera.yaml")
    spec = Camera.load(path).spec
    present = 0.5 * spec.read_noise.sigma_e / (4095 * spec.gain_e_per_dn)
    left = vis_noise(Vis(camera=path, white_std_present=present)).sensor.cameras[0].spec.read_noise.sigma_e
    assert left == pytest.approx(spec.read_noise.sigma_e * 0.75**0.5)


@pytest.mark.parametrize(
    "more", [{"gain_db": 20.0}, {"gain_db": [14.0, 26.0]}, {"set": {"gain_db": 20.0}}], ids=str
)
def test_what_is_there_is_taken_off_at_the_arms_own_gain(more, tmp_path):
    """20 dB above the camera's 0: the same share of white is a tenth of the electrons."""
    from visaug.camera import Camera
    from visaug_train.arms import Vis
    from visaug_train.noise import vis_noise

    content = {"resolution": [8, 8], "gain_e_per_dn": 0.5, "read_noise": {"sigma_e": 10.0}}
    Camera.load(content).save(tmp_path / "c.yaml")
    present = 6.0 / (65535 * 0.05)
    vis = Vis(camera=str(tmp_path / "c.yaml"), white_std_present=present, **more)
    assert vis_noise(vis).sensor.cameras[0].spec.read_noise.sigma_e == pytest.approx(8.0)


def test_unknown_training_argument_is_one_line_before_any_training(tmp_path, capfd):
    from visaug_train.checks import check_arms

    config = check_config(minimal(output=str(tmp_path), training={"epoch": 3}))
    with pytest.raises(InputError, match=r"training: baseline: 'epoch' is not a valid") as caught:
        check_arms(config)
    assert "\n" not in str(caught.value)
    assert "yolo TASK" not in capfd.readouterr().out


@pytest.mark.parametrize("model", ["no_such.yaml", "no_such.pt"])
def test_unknown_network_is_one_line_before_any_training(tmp_path, model):
    from visaug_train.checks import check_arms

    with pytest.raises(InputError, match=f"model: no such network: {model}"):
        check_arms(check_config(minimal(output=str(tmp_path), model=model)))


def test_a_file_without_keys_is_no_config(tmp_path):
    (tmp_path / "text.yaml").write_text("hello")
    with pytest.raises(InputError, match=r"text\.yaml: holds no keys; expected name, output"):
        load_config(tmp_path / "text.yaml")


@pytest.mark.parametrize(
    "changes",
    [
        {"arms": {"baseline": {}, "../../evil": {}}},
        {"arms": {"baseline": {}, "": {}}},
        {"arms": {"baseline": {}, "a/b": {}}},
        {"arms": {"baseline": {}, "x" * 300: {}}},
        {"data": {"rendered": {}, "test": {"../x": {"domain": "synthetic"}}}},
        {"data": {"rendered": {"images": {"../x": {"test": 1}}}}},
        {"data": {"rendered": {"images": {"x": {"test": -1}}}}},
        {"data": {"rendered": {"width": 10**9}}},
        {"data": {"rendered": {}, "image_size": [0, -5]}},
        {"seeds": [-1]},
        {"seeds": [2**40]},
        {"seeds": [1, 1]},
        {"training": {"save_dir": "/tmp/x"}},
        {"arms": {"baseline": {"blur": {"p": float("nan")}}}},
        {"arms": {"baseline": {"blur": {"sigma_px": [0.1, float("nan")]}}}},
    ],
)
def test_names_seeds_and_sizes_that_are_refused(changes):
    with pytest.raises(InputError):
        check_config(minimal(**changes))


def test_where_a_camera_file_lies_decides_nothing(tmp_path, monkeypatch):
    (tmp_path / "camera.yaml").write_text("{resolution: [8, 8], gain_e_per_dn: 2.0}")
    (tmp_path / "conversion.json").write_text("{}")
    monkeypatch.chdir(tmp_path)

    def digest(camera):
        config = check_config(minimal(arms={"baseline": {"vis": {"camera": camera}}}))
        return decides(config, config.arm("baseline"), tmp_path / "data.yaml")

    assert digest("camera.yaml") == digest(str(tmp_path / "camera.yaml")) == digest("./camera.yaml")
    (tmp_path / "camera.yaml").write_text("{resolution: [8, 8], gain_e_per_dn: 3.0}")
    (tmp_path / "other.yaml").write_text("{resolution: [8, 8], gain_e_per_dn: 2.0}")
    assert digest("camera.yaml") != digest("other.yaml")


NETWORKS = {
    "garbage.pt": "hello",
    "list.yaml": "- 1\n",
    "half.yaml": "nc: 1\nbackbone: []\n",
    "layer.yaml": "nc: 1\nkpt_shape: [4, 3]\nbackbone: [[-1, 1, Foo, [3]]]\nhead: [[[0], 1, Pose, [nc, kpt_shape]]]\n",
    "points.yaml": "points_m: {a: [0, 0, 0]}\n",
    "yolov8n.yaml": None,
}


@pytest.mark.parametrize("name", NETWORKS)
def test_what_is_no_pose_network_is_one_line(tmp_path, name):
    from visaug_train.checks import check_network

    content = NETWORKS[name]
    file = tmp_path / name
    if content is not None:
        file.write_text(content)
    with pytest.raises(InputError, match=r"model: .*expected a pose network") as caught:
        check_network(name if content is None else str(file))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("where", ["study", "arm", "start"])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"imgsz": [64, 64]}, r"training\.imgsz: .*is \[64, 64\]"),
        ({"imgsz": "big"}, "training.imgsz"),
        ({"imgsz": None}, "training.imgsz"),
        ({"imgsz": 0}, "training.imgsz"),
        ({"imgsz": -64}, "training.imgsz"),
        ({"imgsz": 10**9}, "training.imgsz"),
        ({"optimizer": "Foo"}, "training.optimizer: .*Foo is not an optimizer"),
    ],
)
def test_arguments_that_ultralytics_does_not_check_are_one_line(tmp_path, monkeypatch, where, given, message):
    from visaug_train import checks

    monkeypatch.setattr(checks, "check_network", lambda _: None)
    changes = {
        "study": {"training": given},
        "arm": {"arms": {"baseline": {}, "vis": {"training": given}}},
        "start": {"start": {"epochs": 1, "training": given}},
    }
    with pytest.raises(InputError, match=message):
        checks.check_arms(check_config(minimal(output=str(tmp_path), **changes[where])))


def test_optimizers_are_those_of_ultralytics():
    import inspect

    from ultralytics.engine.trainer import BaseTrainer

    from visaug_train.checks import OPTIMIZERS

    source = inspect.getsource(BaseTrainer.build_optimizer)
    assert all(f'"{name}"' in source for name in OPTIMIZERS)
