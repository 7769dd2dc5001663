"""The tutorials run, and their pages show their code."""

import re

import pytest
import tutorials

FILES = sorted(tutorials.FOLDER.glob("*.py"))


SLOW = {"find_missing_effect"}  # a diagnosis


@pytest.mark.parametrize(
    "file",
    [pytest.param(file, marks=[pytest.mark.slow] if file.stem in SLOW else []) for file in FILES],
    ids=lambda file: file.stem,
)
def test_runs(file, monkeypatch, tmp_path):
    monkeypatch.chdir(tutorials.ROOT)
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    names: dict = {}
    for cell in tutorials.cells(file):
        if cell.is_code:
            tutorials.run(cell, names)
    if file.stem == "find_missing_effect":
        assert names["diagnosis"].accepted == ("row_noise",)
    if (
        file.stem == "noise_for_training"
    ):  # eight variances from 65,536 differences each: the slope is known to 1 %
        assert 1 / float(names["slope"]) == pytest.approx(names["full_scale_e"], rel=0.04)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_page_shows_the_code(file):
    shown = re.findall(r"^```python\n(.*?)\n```", file.with_suffix(".md").read_text(), re.M | re.S)
    assert shown == [cell.text for cell in tutorials.cells(file) if cell.is_code]
