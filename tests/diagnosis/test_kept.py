"""A set of which a part is taken from a kept set of a similar camera equals one that is simulated whole, bit for bit."""

import numpy as np
import pytest
import torch

from tests.diagnosis.small import frame_set, stated_camera
from visaug import Camera
from visaug.camera.simulation import simulate
from visaug.diagnosis import kept as kept_sets
from visaug.diagnosis.candidates.trials import trials
from visaug.diagnosis.fitting.parameters import base_coordinates, moved
from visaug.diagnosis.kept import KeptSet, KeptSets
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.part import MeasuredFrames
from visaug.diagnosis.spread import Work
from visaug.effects import Effect, Parameter, Stage, registered
from visaug.statistics.split import WHOLE

SEED = 11


@pytest.fixture(scope="module")
def plan():
    (part,) = Laboratory(frame_set(5), stated_camera()).parts_to_simulate
    assert isinstance(part, MeasuredFrames)
    return part.plan


@pytest.fixture(scope="module")
def kept(plan):
    found = KeptSet(stated_camera())
    found.take(plan, SEED, range(len(plan)), 16)
    return found


def differing(camera: Camera, plan, kept: KeptSet) -> set[int]:
    """Positions that a camera changes; all frames are checked against a simulation of the whole set."""
    whole = simulate(camera, plan, SEED)
    part, touched = kept.changed(camera, plan, SEED, range(len(plan)), 16)
    for i in range(len(plan)):
        np.testing.assert_array_equal(
            part.read(i), whole.read(i), err_msg=f"{camera.effect_names}, frame {i}"
        )
        assert i in touched or np.array_equal(kept.frames[i], whole.read(i))
    return touched


def test_the_kept_set_is_the_simulated_one(plan, kept):
    whole = simulate(kept.camera, plan, SEED)
    for i in range(len(plan)):
        np.testing.assert_array_equal(kept.frames[i], whole.read(i))


@pytest.mark.parametrize("name", sorted({trial.effect for trial in trials(stated_camera())}))
def test_every_effect_of_the_catalogue(plan, kept, name):
    strongest = [trial for trial in trials(kept.camera) if trial.effect == name][-1]
    differing(strongest.on(kept.camera), plan, kept)


def test_every_number_of_the_camera(plan, kept):
    coordinates = base_coordinates(kept.camera, frame_set(5), True)
    at = [c.read(kept.camera) for c in coordinates]
    for j, coordinate in enumerate(coordinates):
        there = [x + coordinate.step * (k == j) for k, x in enumerate(at)]
        differing(moved(kept.camera, coordinates, there), plan, kept)


def test_an_effect_of_light_leaves_dark_frames_and_a_late_one_starts_late(plan, kept, monkeypatch):
    kinds = [record.kind for record in plan.records]
    touched = differing(kept.camera.with_effect("vignetting", corner_loss=0.3), plan, kept)
    assert {kinds[i] for i in touched} == {"flat"}
    applied: list[str] = []
    ordinary = kept_sets._Run.through

    def noted(self, effects, *rest):
        applied.extend(effect.name for effect in effects)
        return ordinary(self, effects, *rest)

    monkeypatch.setattr(kept_sets._Run, "through", noted)
    kept.changed(kept.camera.with_effect("bit_truncation", bits=2), plan, SEED, range(len(plan)), 16)
    assert "bit_truncation" in applied
    assert "photon_shot_noise" not in applied
    assert "read_noise" not in applied


def test_a_users_own_effect(plan, kept):
    """It acts in exposures of a second or more alone, and on the gain that the conditions give it."""

    class LongOnes(Effect):
        name = "long_ones"
        stage = Stage.READOUT
        order = 99
        offset_dn = Parameter(1.0, unit="DN", high=50.0, strength=True, trials=(1.0,))

        def apply(self, signal, p, stream, context):
            offset = p.offset_dn * context.gain_e_per_dn
            return signal + torch.where(context.exposure_s >= 1, offset, 0 * offset)

    long = {i for i, record in enumerate(plan.records) if record.exposure_s >= 1}
    with registered(LongOnes):
        camera = kept.camera.with_effect("long_ones", offset_dn=3.0)
        assert differing(camera, plan, kept) == long
        own = KeptSet(camera)
        own.take(plan, SEED, range(len(plan)), 16)
        other = camera.replace({"gain_e_per_dn": 1.1 * camera.spec.gain_e_per_dn})  # which this effect reads
        differing(other, plan, own)


def test_statistics_are_those_of_sets_simulated_whole():
    camera, frames = stated_camera(), frame_set(5)
    lab, fresh = Laboratory(frames, camera), Laboratory(frames, camera)
    lab.simulated([(camera, k) for k in range(2)])
    jobs = [(camera.with_effect(name), k) for name in ("vignetting", "smear", "row_parity") for k in range(2)]
    for got, expected in zip(lab.simulated(jobs), fresh.simulated(jobs), strict=True):
        np.testing.assert_array_equal(got, expected)
    np.testing.assert_array_equal(lab.finding(jobs), fresh.simulated(jobs)[0])


def test_kept_sets_stay_within_their_memory():
    camera, parts = stated_camera(), Laboratory(frame_set(5), stated_camera()).parts_to_simulate
    one = Work(parts, 0, (WHOLE,), is_reference=True)
    one((camera, 0))
    (size,) = [kept.size for sets in one.kept._sets.values() for kept in sets.values()]
    kept = KeptSets(int(2.5 * size))
    work = Work(parts, 0, (WHOLE,), is_reference=True, kept=kept)
    other = camera.replace({"black_level_dn": camera.spec.black_level_dn + 3})
    for job in ((camera, 0), *((other, k) for k in range(4))):
        work(job)
    held = [(of, one) for of, sets in kept._sets.items() for one in sets.values()]
    assert sum(one.size for _, one in held) <= kept.memory
    assert [of for of, _ in held] == [other, other]


def test_a_camera_that_remembers_is_simulated_whole(plan):
    found = KeptSet(stated_camera().with_effect("image_lag", share=0.05))
    frames = found.take(plan, SEED, range(len(plan)), 16)
    assert found.remembers
    assert not found.frames
    whole = simulate(found.camera, plan, SEED)
    for i in range(len(plan)):
        np.testing.assert_array_equal(frames.read(i), whole.read(i))
