"""The main job in small: one report that refers to nothing outside itself, and a second call that only reads."""

import re
from pathlib import Path

import pytest
import yaml

from visaug_train import demo

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
            "sunlamp": {"test": 6},
        },
    }
    content["training"] |= {"epochs": 1, "imgsz": 64, "batch": 8, "device": "cpu"}
    content["bootstrap"] = 20
    content["arms"]["vis"]["vis"]["camera"] = str(CONFIGS / "demo_camera.yaml")
    small = tmp_path / "demo.yaml"
    small.write_text(yaml.safe_dump(content))
    monkeypatch.setattr(demo, "CONFIG", small)
    seen = set()
    report = demo.run_demo(tmp_path / "out", progress=lambda title, done, total: seen.add(title))
    page = report.read_text()
    assert "keypoint AP50-95" in page
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)  # in which four given letters come by chance
    assert "http" not in words.replace("http://www.w3.org", "")
    assert (tmp_path / "out" / "tables" / "tables.md").is_file()
    assert {"rendering", "converting", "training baseline seed 0", "training vis seed 0"} <= seen
    seen.clear()
    demo.run_ablation(tmp_path / "out", progress=lambda title, done, total: seen.add(title))
    assert not any(title.startswith(("training", "evaluating")) for title in seen)
