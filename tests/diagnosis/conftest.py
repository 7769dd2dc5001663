"""The small camera as its maker tells it, and a cache of its own."""

import os

import pytest

from tests.diagnosis.small import stated_camera
from visaug import Camera
from visaug.effects import registered


@pytest.fixture(scope="session")
def stated() -> Camera:
    return stated_camera()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """What one test simulates of the camera the next may use, whichever process runs it, and nothing of an earlier run."""
    of_process = tmp_path_factory.getbasetemp()
    of_run = of_process.parent if "PYTEST_XDIST_WORKER" in os.environ else of_process
    os.environ["VISAUG_CACHE"] = str(of_run / "cache")


@pytest.fixture(scope="module", autouse=True)
def shipped_effects_alone():
    """Effects that other tests load from files are no candidates here."""
    with registered(alone=True):
        yield
