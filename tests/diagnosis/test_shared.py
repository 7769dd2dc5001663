"""Sets of one number share signals and sums: values are those of sets that share nothing, for less work."""

import gc
import weakref

import numpy as np
import pytest

from tests.diagnosis.small import frame_set, stated_camera
from visaug import simulate
from visaug.camera import chain, simulation
from visaug.camera.history import Reach
from visaug.core.errors import InputError
from visaug.core.recurrent import Recurrent
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import NOTHING, Shared
from visaug.diagnosis.ray_executor import _several
from visaug.diagnosis.spread import Forked, Work, _of_thread
from visaug.effects import Effect, Parameter, Stage, catalogue, registered
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


class Own(Effect):
    """An effect of a user's own in the voltage."""

    name = "own"
    stage = Stage.READOUT
    order = 1
    offset_e = Parameter(1.0, unit="e-", strength=True)
    added_e = 0.0

    def apply(self, signal, p, stream, context):
        return signal + p.offset_e + self.added_e


class OwnInPlace(Own):
    """Changes what it is given, where its trial frames do not show it."""

    def apply(self, signal, p, stream, context):
        return signal + p.offset_e if signal.shape[1] > 1 else signal.add_(p.offset_e)


class OwnMemory(Own):
    """Remembers the frame before in windows that are larger than those in which memory is looked for."""

    def apply(self, signal, p, stream, context):
        before = context.memory.get("own", 0.0)
        if signal.shape[-1] > 16:
            context.memory["own"] = signal[-1:].mean((1, 2, 3), keepdim=True)
        return signal + 1e-3 * p.offset_e * before


class OwnInput(Own):
    def apply(self, signal, p, stream, context):
        return signal


class OwnView(Own):
    def apply(self, signal, p, stream, context):
        return signal[:, :, :]


def as_alone(part, cameras):
    """Whether each camera's values are those of the camera alone."""
    shared = Shared.empty()
    for camera in cameras:
        (together,) = part.simulated(camera, SEED, (FIND,), shared)
        (alone,) = part.simulated(camera, SEED, (FIND,), Shared(Recurrent(0), Recurrent(0)))
        yield np.allclose(together, alone, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("own", [Own, OwnInPlace, OwnMemory, OwnInput, OwnView])
def test_users_effects_give_the_values_that_they_give_alone(part, monkeypatch, own):
    """Also where an effect before them leaves some batches of frames as they are."""
    monkeypatch.setattr(simulation, "BATCH_PIXELS", 4 * 64 * 80)
    with registered(own):
        strong, weak = (stated_camera().with_effect("own", offset_e=e) for e in (3.0, 1.0))
        shaded = [camera.with_effect("vignetting", corner_loss=0.3) for camera in (strong, weak)]
        cameras = [strong, weak, *shaded, stated_camera()] * 3
        assert all(as_alone(part, cameras))


def test_users_effects_may_change_between_sets(part, monkeypatch):
    def changing(camera):
        for k in range(6):
            monkeypatch.setattr(Own, "added_e", 5.0 * (k // 3))
            yield camera

    with registered(Own):
        assert all(as_alone(part, changing(stated_camera().with_effect("own"))))


def test_signals_before_a_users_effect_are_shared(part, monkeypatch):
    with registered(Own):
        cameras = [stated_camera().with_effect("own", offset_e=e) for e in (1.0, 2.0, 3.0)]
        found = counts(part, cameras, monkeypatch, Shared.empty())
    assert found[2][0] < found[0][0]


def test_values_of_a_users_effect_behind_the_converter_are_checked(part):
    def apply(self, signal, p, stream, context):
        return signal + context.max_dn

    behind = type("Behind", (Own,), {"stage": Stage.DIGITAL, "order": 99, "apply": apply})
    with registered(behind):
        camera = stated_camera().with_effect("own")
        with pytest.raises(InputError, match="largest value"):
            part.simulated(camera, SEED, (FIND,), Shared.empty())
        for taken in (part.take(camera, SEED), simulate(camera, part.plan)):
            with pytest.raises(InputError, match="largest value"):
                taken.read(0)


def test_nothing_is_kept_once_the_simulations_are_done():
    parts = Laboratory(frame_set(1), stated_camera()).parts_to_simulate
    forked, part = Forked(), weakref.ref(parts[0])
    assert len(list(forked(Work(parts, 0, (FIND,)), [(stated_camera(), 0)]))) == 1
    assert vars(_of_thread)
    del forked, parts
    gc.collect()
    assert part() is None


def test_a_task_of_a_cluster_leaves_nothing_behind():
    parts = Laboratory(frame_set(1), stated_camera()).parts_to_simulate
    assert len(_several((Work(parts, 0, (FIND,)), []), [(stated_camera(), 0)])) == 1
    assert not vars(_of_thread)
