"""A bench with small frames, whose comparison is done, and a cache of its own."""

import os

import pytest

from tests.diagnosis.small import PLAN, frame_set, row_noise, stated_camera
from visaug.app.lab import Bench
from visaug.diagnosis.session import session as session_module
from visaug.effects import registered

FEW = 60  # simulated sets


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, "VISAUG_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module", autouse=True)
def shipped_effects_alone():
    """Effects that other tests load from files are not offered here."""
    with registered(alone=True):
        yield


@pytest.fixture(scope="session")
def frames():
    """Frames of the small camera with row noise of 2 e- that its file does not tell."""
    return frame_set(3, [row_noise(2.0)], plan=tuple(PLAN[:9] + PLAN[24:27] + PLAN[30:33] + PLAN[36:]))


@pytest.fixture(scope="session")
def compared(frames):
    bench = Bench(stated_camera(), frames, sets=FEW)
    bench.compare(lambda *_: None)
    return bench.comparison


@pytest.fixture
def bench(frames, compared, tmp_path, monkeypatch):
    monkeypatch.setattr(session_module, "compare", lambda *_, **__: compared)
    return Bench(stated_camera(), frames, output=tmp_path / "out" / "camera.yaml", sets=FEW)
