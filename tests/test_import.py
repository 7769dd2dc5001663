"""`import visaug` and `visaug --help` are light."""

import json
import resource
import subprocess
import sys

import pytest

import visaug

HEAVY = ["kornia", "matplotlib", "pydantic", "astropy", "ultralytics", "pandas", "panel", "scipy", "torch"]


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


def test_import_touches_nothing_heavy():
    loaded = json.loads(
        python(f"import visaug, sys, json; print(json.dumps([m for m in {HEAVY} if m in sys.modules]))")
    )
    assert loaded == []


def test_help_touches_nothing_heavy():
    code = (
        "import sys, json\nfrom visaug.app.cli import main\n"
        "try: main(['diagnose', '--help'])\nexcept SystemExit: pass\n"
        f"print(json.dumps([m for m in {HEAVY} + ['rich'] if m in sys.modules]))"
    )
    assert json.loads(python(code).splitlines()[-1]) == []


def test_help_is_quick():
    """Processor time, so that a busy machine does not fail it."""
    took = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "visaug", "--help"], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        took.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(took) < 0.5


def test_import_costs_next_to_nothing_beyond_torch():
    """Processor time of `import visaug`, and of the README's first names, beside that of torch in one process."""
    code = (
        "import time; a = time.process_time(); import torch; b = time.process_time()\n"
        "import visaug; c = time.process_time()\n"
        "visaug.Camera, visaug.VISNoise; print(b - a, c - b, time.process_time() - c)"
    )
    runs: list[tuple[float, ...]] = []
    for _ in range(3):  # a busy machine may spoil a run
        runs.append(tuple(map(float, python(code).split())))
        if min(run[1] for run in runs) < 0.2 and any(names < 2 * alone for alone, _, names in runs):
            return
    pytest.fail(f"seconds of torch, of visaug and of its names, of three runs: {runs}")


@pytest.mark.parametrize("name", visaug.__all__)
def test_every_exported_name_exists(name):
    assert getattr(visaug, name) is not None
    assert name in dir(visaug)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nonsense"):
        _ = visaug.nonsense
