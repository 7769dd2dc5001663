"""Cameras with an effect of a user's file in other processes: copies, pickles, and processes that have not loaded the file."""

import copy
import pickle
import subprocess
import sys

import pytest
import torch

from visaug import Camera, VISNoise
from visaug.core.sampling import Stream
from visaug.effects import catalogue, load_file, registered

SOURCE = """
from visaug.effects import Effect, Parameter, Stage

class Lift(Effect):
    name = "lift"
    stage = Stage.READOUT
    summary = "Raises every pixel."
    equation = "V <- V + lift_e"
    source = "assumed"
    lift_e = Parameter(2.0, unit="e-", high=100.0, strength=True, trials=(1.0, 2.0), source="assumed")

    def apply(self, signal, p, stream, context):
        return signal + p.lift_e
"""


@pytest.fixture
def camera(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(SOURCE)
    with registered():
        load_file(file)
        yield Camera.load(
            {"resolution": [4, 6], "gain_e_per_dn": 1.0, "effects": [{"name": "lift", "lift_e": 9.0}]}
        )


def taken(camera):
    return camera.expose(torch.zeros(1, 1, 4, 6), Stream([1], [1], 1, (range(4), range(6))))


def test_a_file_leaves_nothing_beside_it(camera, tmp_path):
    assert [file.name for file in tmp_path.iterdir()] == ["mine.py"]


def test_copies_have_the_class_that_was_loaded(camera, tmp_path):
    (tmp_path / "mine.py").unlink()
    for other in (copy.deepcopy(camera), pickle.loads(pickle.dumps(camera))):
        assert type(other.effects[-1]) in [type(effect) for effect in camera.effects]
        assert {type(e) for e in other.effects} == {type(e) for e in camera.effects}
        assert torch.equal(taken(other), taken(camera))


@pytest.mark.parametrize("by", ["pickle", "cloudpickle"])
def test_a_process_that_has_not_loaded_the_file_gets_the_same_frame(camera, tmp_path, by):
    """With the file gone, as on another machine; the effect is in its catalogue too."""
    noise = VISNoise(camera, seed=4)
    (tmp_path / "noise").write_bytes(pytest.importorskip(by).dumps((camera, noise)))
    (tmp_path / "mine.py").unlink()
    call = f'''
import pickle, torch
from visaug.core.sampling import Stream
from visaug.effects import catalogue
camera, noise = pickle.loads(open(r"{tmp_path / "noise"}", "rb").read())
frame = camera.expose(torch.zeros(1, 1, 4, 6), Stream([1], [1], 1, (range(4), range(6))))
torch.save((frame, noise(torch.full((1, 1, 4, 6), 0.5)), "lift" in catalogue()), r"{tmp_path / "out.pt"}")
'''
    subprocess.run([sys.executable, "-c", call], check=True)
    frame, noisy, is_known = torch.load(tmp_path / "out.pt")
    assert is_known
    assert torch.equal(frame, taken(camera))
    assert torch.equal(noisy, VISNoise(camera, seed=4)(torch.full((1, 1, 4, 6), 0.5)))


def test_an_effect_that_is_out_of_the_catalogue_stays_out(camera):
    stored = pickle.dumps(camera)
    with registered(alone=True):
        assert pickle.loads(stored).effect_names == ["lift"]
        assert "lift" not in catalogue()
