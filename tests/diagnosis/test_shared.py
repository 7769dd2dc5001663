"""Sets of one number share signals and sums: values are those of sets that share nothing, for less work."""

import numpy as np
import pytest

from tests.diagnosis.small import frame_set, stated_camera
from visaug.camera import chain
from visaug.camera.history import Reach
from visaug.core.recurrent import Recurrent
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import NOTHING, Shared
from visaug.effects import Stage, catalogue
from visaug.statistics.split import CONFIRM, FIND, WHOLE
from visaug.statistics.stack import Stack

SEED = 5


@pytest.fixture(scope="module")
def part():
    return Laboratory(frame_set(1), stated_camera()).parts_to_simulate[0]


def trials(*names: str):
    """Cameras with one effect each, at the first values that a diagnosis tries."""
    own = catalogue()
    return [
        stated_camera().with_effect(
            name, **{key: p.trials[0] for key, p in own[name].parameters.items() if p.trials}
        )
        for name in names
    ]


@pytest.mark.parametrize("most", [2**16, 2**22, 2**30])
def test_every_effect_gives_the_values_that_it_gives_alone(part, most):
    """With room for little, for some and for all. Sums of compiled loops may round in another order, noise would be another."""
    tried = [n for n, effect in catalogue().items() if effect.proposed and effect.stage != Stage.PICTURE]
    cameras = trials(*(name for name in tried if not catalogue()[name].base))
    cameras += [camera.with_effect("row_noise", sigma_e=2.0) for camera in cameras[::3]]
    shared = Shared(Recurrent(most), Recurrent(most))
    for k, camera in enumerate(cameras):
        uses = (FIND,) if k % 4 else (FIND, CONFIRM, WHOLE)
        together = part.simulated(camera, SEED, uses, shared)
        alone = part.simulated(camera, SEED, uses, Shared(Recurrent(0), Recurrent(0)))
        for one, other in zip(together, alone, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-8, err_msg=f"{camera.effect_names}")


def counts(part, cameras, monkeypatch, shared):
    """Runs of effects, and stacks of frames reduced, for each camera."""
    runs, stacks = [], []
    run, init = chain._run, Stack.__init__
    monkeypatch.setattr(chain, "_run", lambda *a, **k: runs.append(a[0]) or run(*a, **k))
    monkeypatch.setattr(Stack, "__init__", lambda s, frames: stacks.append(s) or init(s, frames))
    found = []
    for camera in cameras:
        Reach.of(camera)  # takes frames of its own
        before = len(runs), len(stacks)
        part.simulated(camera, SEED, (FIND,), shared)
        found.append((len(runs) - before[0], len(stacks) - before[1]))
    return found


def test_readout_begins_with_the_electrons_of_another_camera(part, monkeypatch):
    names = ("row_noise", "column_parity", "row_parity", "tap_mismatch")
    first, second, third, fourth = counts(part, trials(*names), monkeypatch, Shared.empty())
    assert first == second  # the first one is not known to come again
    assert third == fourth
    batches = first[0] // 3  # electrons, the effect, and what follows
    assert third[0] == 2 * batches


def test_groups_that_an_effect_leaves_alone_are_not_reduced_again(part, monkeypatch):
    """Light changes no dark frame: of these neither the chain nor the sums are gone through again."""
    found = counts(part, trials("vignetting", "fringing", "dust"), monkeypatch, Shared.empty())
    lit = {g.indices for g in part.frames.groups() if g.kind in ("flat", "scene")}
    assert found[2][1] == sum(1 for _ in lit) < found[0][1]


def test_cameras_with_memory_share_no_signals(part):
    (camera,) = trials("image_lag")
    assert Reach.of(camera) != NOTHING
    shared = Shared.empty()
    for _ in range(3):
        part.simulated(camera, SEED, (FIND,), shared)
    assert not shared.signals._asked
