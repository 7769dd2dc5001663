"""Every snippet of docs/augment.md runs, and its measured numbers are those of the code."""

import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

import visaug
from visaug.augment import SensorNoise
from visaug.augment.files import augment_files

PAGE = Path(__file__).parents[2] / "docs" / "augment.md"
SNIPPETS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.S)


@pytest.mark.parametrize("number", range(len(SNIPPETS)))
def test_snippet_runs(number):
    if "albumentations" in SNIPPETS[number]:
        pytest.importorskip("albumentations")
    exec(compile(SNIPPETS[number], f"{PAGE.name} snippet {number + 1}", "exec"), {})


def test_the_page_has_its_snippets():
    assert len(SNIPPETS) >= 7


def test_every_option_of_the_sensor_is_in_the_table():
    import inspect

    from visaug.augment import SensorNoise

    text = PAGE.read_text(encoding="utf-8")
    for name in inspect.signature(SensorNoise).parameters:
        assert name in ("camera", "fast", "origin") or f"| `{name}`" in text, name


def test_the_measured_rise_of_a_dark_image(tmp_path):
    """Render and command of the page."""
    render = Path(str(files("visaug.data") / "example" / "render.png"))
    clean = np.asarray(Image.open(render).convert("RGB"))
    black = clean.max(-1) == 0
    assert (round(clean.mean()), round(black.mean(), 2)) == (19, 0.85)

    def means(**options):
        camera = visaug.Camera.load("spacecraft_inspection")
        out = tmp_path / repr(options)
        augment_files([render], out, camera, transfer="srgb", **options)
        noisy = np.asarray(Image.open(out / "render.png").convert("RGB"))
        return round(noisy.mean()), round(noisy[black].mean())

    assert means(exposure=0.1) == (44, 29)
    assert means() == (25, 7)
    assert means(black_level="keep")[1] == 56
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert (
        "rises from 19 to 44, and that of its black pixels from 0 to 29; with full exposure to 25 and 7"
        in text
    )
    assert "which is 56 of 255 in sRGB" in text


def test_the_noise_at_base_gain():
    """Of the machine-vision cameras, without spreads, at mid-gray."""
    names = (
        "sony_imx174", "sony_imx250", "sony_imx287", "sony_imx900_low_gain", "kit_ufo_camera", "ams_cmv4000",
        "basler_ccd12_emva1288", "flir_cm3_u3_13y3c",
    )  # fmt: skip
    gray = torch.full((1, 1, 256, 256), 0.5)
    spread = {}
    for transfer in ("linear", "srgb"):
        found = []
        for name in names:
            content = visaug.Camera.load(name).to_dict()
            camera = {key: value for key, value in content.items() if key not in ("randomize", "correlated")}
            noise = SensorNoise(camera, transfer=transfer, mono=True, seed=1)
            found.append(float((noise(gray) * 255).round().std()))
        spread[transfer] = [min(found), max(found)]
    assert spread["linear"] == pytest.approx([1.3, 2.5], abs=0.06)
    assert spread["srgb"] == pytest.approx([0.8, 1.7], abs=0.06)
    assert "(1.3 to 2.5 of 255)" in PAGE.read_text(encoding="utf-8")
    assert "1.3 to 2.5 of 255" in (PAGE.parent / "faq.md").read_text(encoding="utf-8")
