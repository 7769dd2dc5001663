"""The main job in small: one report that refers to nothing outside itself, and a second call that only reads."""

import json
import re
from concurrent.futures import Future
from functools import partial
from pathlib import Path

import pytest
import yaml

import visaug
from visaug.effects import catalogue
from visaug_train import demo
from visaug_train.parallel import Workers
from visaug_train.training import train_run

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


class InThisProcess(Workers):
    """Work in this process, whose modules the tests change."""

    def submit(self, function, *arguments):
        done = Future()
        done.set_result(function(*arguments, self.progress))
        return done

    def train(self, study, arm, seed):
        train_run(study, arm, seed, self.progress)


@pytest.fixture
def quick_diagnosis(monkeypatch):
    """A diagnosis of fewer pixels that tries two effects."""
    monkeypatch.setattr(demo, "Workers", InThisProcess)
    tried = {"amplifier_glow", "row_noise"}  # few, so that the test is fast
    without = [name for name, effect in catalogue().items() if not effect.base and name not in tried]
    monkeypatch.setattr(visaug, "diagnose", partial(visaug.diagnose, sets=60, without=without))
    monkeypatch.setattr(demo, "RESOLUTION", (48, 64))


@pytest.mark.slow
def test_the_short_demo_starts_from_weights_and_says_what_it_found(tmp_path, monkeypatch, quick_diagnosis):
    from safetensors.torch import save_file
    from ultralytics import YOLO

    network = YOLO(str(CONFIGS / "demo_network.yaml"), task="pose", verbose=False).model
    save_file(network.half().state_dict(), tmp_path / "start.safetensors")
    content = yaml.safe_load((CONFIGS / "demo_short.yaml").read_text())
    content["data"]["rendered"]["images"] = {
        "synthetic": {"train": 8, "validation": 4, "test": 6},
        "lightbox": {"test": 6},
    }
    content["model"] = str(CONFIGS / "demo_network.yaml")
    content["start"] = {"weights": "start.safetensors", "sha256": "0" * 64}
    content["training"] |= {"epochs": 1, "imgsz": 64, "batch": 8, "device": "cpu"}
    content |= {"bootstrap": 20, "seeds": [0, 1]}
    small = tmp_path / "demo.yaml"
    small.write_text(yaml.safe_dump(content))
    monkeypatch.setattr(demo, "SHORT", small)
    with pytest.raises(visaug.InputError, match=r"start\.safetensors.* has the SHA-256") as refused:
        demo.run_demo(tmp_path / "out")
    content["start"]["sha256"] = re.search(r"SHA-256 (\w+)", str(refused.value))[1]
    small.write_text(yaml.safe_dump(content))
    report, said = demo.run_demo(tmp_path / "out")
    assert len(said) == 3
    assert re.search(r"found missing: (row_noise|nothing)\.", said[0])
    assert "95 % intervals over 2 pairs" in said[2]
    page = report.read_text()
    assert page.index("The finding") < page.index("Hidden effect: ") < page.index("Scores of the arms")


@pytest.mark.slow
def test_demo_writes_one_report_and_goes_on(tmp_path, monkeypatch, quick_diagnosis):
    content = yaml.safe_load((CONFIGS / "demo.yaml").read_text())
    content["data"]["rendered"] |= {
        "width": 160,
        "height": 100,
        "images": {
            "synthetic": {"train": 8, "validation": 4, "test": 6},
            "lightbox": {"test": 6},
            "lightbox_base": {"test": 6},
            "sunlamp": {"test": 6},
        },
    }
    content["training"] |= {"epochs": 1, "imgsz": 64, "batch": 8, "device": "cpu"}
    content["bootstrap"] = 20
    content["start"]["epochs"] = 1
    content["seeds"] = [0]
    content["arms"]["vis"]["vis"]["camera"] = str(CONFIGS / "demo_camera.yaml")
    small = tmp_path / "demo.yaml"
    small.write_text(yaml.safe_dump(content))
    monkeypatch.setattr(demo, "FULL", small)
    seen = set()
    report, _ = demo.run_demo(
        tmp_path / "out", progress=lambda title, done, total: seen.add(title), full=True
    )
    page = report.read_text()
    assert "keypoint AP50-95" in page
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)  # in which four given letters come by chance
    assert "http" not in words.replace("http://www.w3.org", "")
    assert "Hidden effect: " in page
    answer = json.loads((tmp_path / "out" / "hidden_effect" / "diagnosis-0.json").read_text())
    assert answer["accepted"] == ["row_noise"]
    assert (tmp_path / "out" / "tables" / "tables.md").is_file()
    arms = ("baseline", "vis", "vis_diagnosed")
    assert {"rendering", "converting", *(f"training {arm} seed 0" for arm in arms)} <= seen
    assert sum(title.startswith("training the network that all arms start from") for title in seen) == 1
    assert "lightbox_base" in (tmp_path / "out" / "tables" / "overview.csv").read_text()
    found = yaml.safe_load((tmp_path / "out" / "lightbox_camera" / "camera-0.yaml").read_text())
    assert found["read_noise"]["sigma_e"] > 0
    seen.clear()
    demo.run_ablation(tmp_path / "out", progress=lambda title, done, total: seen.add(title), full=True)
    assert not any(title.startswith(("training", "evaluating")) for title in seen)
