"""A missing extra is one line that names it; what needs none works without."""

import subprocess
import sys
from pathlib import Path

import pytest

from visaug import InputError
from visaug.core.extras import EXTRAS, check_installed, extra

ROOT = Path(__file__).resolve().parents[2]
NOISE = """
import sys, torch
for name in sys.argv[1:]:
    sys.modules[name] = None
import visaug
torch.manual_seed(3)
noise = visaug.VISNoise("sony_imx174", gain_db=24)
images = torch.linspace(0, 1, 128).reshape(2, 1, 8, 8)
noisy = noise(images)
assert bool((noisy == noise(images, params=noise._params)).all()) and noise(images[0]).shape == (1, 8, 8)
kept = visaug.VISNoise("sony_imx174", p=0.5)
some = kept(images.repeat(32, 1, 1, 1))
same = (some == images.repeat(32, 1, 1, 1)).flatten(1).all(1)
assert bool((same == (kept._params["batch_prob"] < 0.5)).all()) and 0 < int(same.sum()) < 64
print(noisy.double().sum().item(), isinstance(noise, torch.nn.Module))
"""


@pytest.mark.parametrize("name", ["astropy", "starlette", "rawpy"])
def test_a_missing_package_names_its_extra(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    expected = rf"data\.fits: {name} is not installed; expected pip install 'visaug\[{EXTRAS[name]}\]'"
    with pytest.raises(InputError, match=expected), extra("data.fits"):
        __import__(name)
    with pytest.raises(InputError, match=expected):
        check_installed(name, file="data.fits")


def test_a_module_of_no_extra_stays_missing():
    with pytest.raises(ModuleNotFoundError), extra():
        __import__("no_such_package_of_visaug")


def test_every_extra_exists():
    tomllib = pytest.importorskip("tomllib")  # of Python 3.11
    with (ROOT / "pyproject.toml").open("rb") as file:
        declared = tomllib.load(file)["project"]["optional-dependencies"]
    assert set(EXTRAS.values()) <= set(declared)


def test_noise_is_the_same_without_kornia():
    """64 images with p = 0.5: none or all are changed with a probability of 2^-63."""
    with_it, without = (
        subprocess.run(
            [sys.executable, "-c", NOISE, *names], capture_output=True, text=True, check=True
        ).stdout
        for names in ((), ("kornia", "astropy", "matplotlib", "jinja2", "tifffile", "torchvision"))
    )
    assert with_it == without
    assert with_it.endswith("True\n")
