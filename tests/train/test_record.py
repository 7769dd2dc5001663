"""A run's hash knows its cameras and weights by value; an untrained config is refused before anything is written."""

import pytest
import yaml

from visaug.camera import camera as camera_module
from visaug.core.errors import InputError
from visaug.effects.catalogue import catalogue, load_file, registered
from visaug_train import commands
from visaug_train.config import check_config
from visaug_train.parallel import _in_folder
from visaug_train.record import decides, surroundings

CAMERA = {"resolution": [32, 32], "gain_e_per_dn": 0.5}
TILT = """
from visaug.effects import Effect, Parameter, Stage

class Tilt(Effect):
    name, stage, summary, source = "tilt", Stage.READOUT, "A slope along the rows.", "made up"
    slope_e = Parameter(1.0, unit="e-", high=100.0, strength=True, source="made up")

    def apply(self, signal, p, stream, context):
        return signal + FACTOR * p.slope_e * context.columns(signal)
"""


@pytest.fixture
def data_yaml(tmp_path):
    (tmp_path / "conversion.json").write_text("{}")
    return tmp_path / "data.yaml"


def config(**changes):
    return check_config(
        {"name": "n", "output": "o", "data": {"rendered": {}}, "arms": {"baseline": {}, "vis": {}}} | changes
    )


def test_a_shipped_camera_that_changes_is_another_run(tmp_path, data_yaml, monkeypatch):
    file = tmp_path / "shipped.yaml"
    monkeypatch.setattr(camera_module, "shipped", lambda: {"lab": file})
    made = config(arms={"baseline": {}, "vis": {"vis": {"camera": "lab"}}})
    found = []
    for sigma_e in (1.0, 1.0, 2.0):
        file.write_text(yaml.safe_dump(CAMERA | {"read_noise": {"sigma_e": sigma_e}}))
        found.append(decides(made, made.arm("vis"), data_yaml))
    assert found[0] == found[1] != found[2]
    assert found[2]["cameras"][0]["read_noise"]["sigma_e"] == 2.0


@pytest.mark.parametrize("of", ["camera", "arm"])
def test_an_effect_of_ones_own_that_changes_is_another_run(of, tmp_path, data_yaml):
    """Whether the camera's file names it or the arm adds it; runs without one are what they were."""
    entry, file = {"name": "tilt", "slope_e": 2.0}, tmp_path / "tilt.py"
    camera = tmp_path / "camera.yaml"
    camera.write_text(yaml.safe_dump(CAMERA | ({"effects": [entry]} if of == "camera" else {})))
    vis = {"camera": str(camera), **({"effects": [entry]} if of == "arm" else {})}
    found = []
    for factor in ("1", "1", "2"):
        file.write_text(TILT.replace("FACTOR", factor))
        with registered():
            load_file(file)
            made = config(arms={"baseline": {}, "vis": {"vis": vis}})
            found.append(decides(made, made.arm("vis"), data_yaml))
            assert "sha256" not in str(decides(made, made.arm("baseline"), data_yaml)["cameras"])
    assert found[0] == found[1] != found[2]


def test_a_node_of_a_cluster_knows_the_effects_of_ones_own(tmp_path, monkeypatch):
    """It starts without them; what the driver loaded is loaded there, in the driver's folder."""
    file = tmp_path / "tilt.py"
    file.write_text(TILT.replace("FACTOR", "1"))
    monkeypatch.chdir(tmp_path)
    seen = []

    def work(study, arm, seed):
        seen.append((study, arm, seed, "tilt" in catalogue()))

    with registered():
        assert "tilt" not in catalogue()
        assert _in_folder("study", work, "vis", 3, str(tmp_path), [file]) is None
    assert seen == [("study", "vis", 3, True)]


def test_weights_are_known_by_their_bytes(tmp_path, data_yaml):
    weights = tmp_path / "w.pt"
    digests = set()
    for content in (b"a", b"bb"):
        weights.write_bytes(content)
        made = config(model=str(weights))
        digests.add(decides(made, made.arm("vis"), data_yaml)["model_sha256"])
    assert len(digests) == 2
    assert decides(config(), config().arm("vis"), data_yaml)["model_sha256"] is None


def test_a_start_is_part_of_the_run(data_yaml):
    plain, started = config(), config(start={"epochs": 3})
    assert decides(plain, plain.arm("vis"), data_yaml) != decides(started, started.arm("vis"), data_yaml)


def test_versions_and_device_are_recorded():
    assert {"python", "visaug", "torch", "device"} <= surroundings("cpu").keys()
    assert surroundings("cpu")["device"].startswith("cpu")


def test_evaluating_what_is_not_trained_says_so_and_writes_nothing(tmp_path):
    content = {
        "name": "n",
        "output": str(tmp_path / "out"),
        "data": {"rendered": {}},
        "arms": {"baseline": {}, "vis": {}},
    }
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match="arm vis, seed 0 is not trained; expected visaug train"):
        commands.evaluate(tmp_path / "c.yaml")
    assert not (tmp_path / "out").exists()
