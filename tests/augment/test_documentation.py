"""Every snippet of docs/augment.md runs."""

import re
from pathlib import Path

import pytest

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
