"""The main job in small: one report that refers to nothing outside itself, and a second call that only reads."""

import json
import re
from functools import partial
from pathlib import Path

import pytest
import yaml

import visaug
from visaug.effects import catalogue
from visaug_train import demo
from visaug_train.studies import laboratory

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


@pytest.mark.slow
def test_demo_writes_one_report_and_goes_on(tmp_path, monkeypatch):
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
    monkeypatch.setattr(demo, "CONFIG", small)
    tried = {"amplifier_glow", "row_noise"}  # of the catalogue: the story is told all the same
    without = [name for name, effect in catalogue().items() if not effect.base and name not in tried]
    monkeypatch.setattr(visaug, "diagnose", partial(visaug.diagnose, sets=60, without=without))
    monkeypatch.setattr(laboratory, "RESOLUTION", (48, 64))
    seen = set()
    report = demo.run_demo(tmp_path / "out", progress=lambda title, done, total: seen.add(title))
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
    demo.run_ablation(tmp_path / "out", progress=lambda title, done, total: seen.add(title))
    assert not any(title.startswith(("training", "evaluating")) for title in seen)
