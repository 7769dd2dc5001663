"""Flats of one exposure: fine steps of a lamp whose photons are not known, and flats beyond saturation."""

from dataclasses import replace

import numpy as np
import pytest

from tests.characterization.simulated import Sensor, plan
from visaug import characterize
from visaug.characterization.alarms import all_warnings
from visaug.characterization.alike import merged_groups
from visaug.characterization.facts import look
from visaug.characterization.usable import usable
from visaug.frames import FrameSet

SENSOR = Sensor()
FULL = SENSOR.full_well_e / SENSOR.quantum_efficiency  # photons


def lit(photons, flat: int = 2, seed: int = 1) -> FrameSet:
    return SENSOR.expose(plan(photons=photons, flat=flat, temperatures=(20.0,)), seed)


def blank(frames: FrameSet) -> FrameSet:
    """The same frames without their photons."""
    return frames.with_records([replace(r, photons=None) for r in frames.records])


def of_flats(frames: FrameSet) -> list[tuple[int, ...]]:
    return [group.indices for group in merged_groups(frames, look(frames)) if group.kind == "flat"]


@pytest.mark.parametrize("count", [2, 3])
def test_fine_steps_of_a_lamp_of_unknown_photons_are_levels(count):
    """Fifty of them up to nine tenths of saturation, as a release of EMVA 1288 asks for: the brightest are 2 % apart."""
    frames = lit(np.linspace(0.02, 0.9, 50) * FULL, count)
    assert of_flats(blank(frames)) == of_flats(frames)
    assert len(of_flats(frames)) == 50


def test_a_lamp_up_and_down_has_the_same_levels():
    up = np.array([0.5, 0.53, 0.56, 0.6]) * FULL
    groups = of_flats(blank(lit([*up, *up[::-1]])))
    assert [len(group) for group in groups] == [4, 4, 4, 4]


def test_a_lamp_that_flickers_has_one_level():
    """Six flats within 2 %: a gap by chance parts one in two hundred; three of 60 or more come once in 300 such tests."""
    rng = np.random.default_rng(4)
    parted = 0
    for seed in range(60):
        frames = lit(0.5 * FULL * rng.uniform(0.99, 1.01, 6), flat=1, seed=seed)
        parted += len(of_flats(blank(frames))) > 1
    assert parted <= 2


def test_light_that_alternates_from_frame_to_frame_has_one_level():
    (group,) = of_flats(blank(lit(0.5 * FULL * np.tile([1.0, 1.05], 4), flat=1)))
    assert len(group) == 8


@pytest.mark.parametrize("edge", [0.99, 1.2])
def test_saturated_flats_of_unknown_photons_are_not_compared(edge):
    """Their level does not tell the light: nothing else of the set is left out, and with photons nothing at all."""
    frames = lit(np.array([0.1, 0.3, 0.5, 0.7, 0.9, edge, 1.5]) * FULL)
    shape = frames.shape(0)
    assert len(usable(frames, shape)) == len(frames)
    made = usable(blank(frames), shape)
    assert sorted({r.sequence for r in frames.records} - {r.sequence for r in made.records}) == [
        r.sequence for r in frames.records if (r.photons or 0) > 0.95 * FULL
    ]
    (said,) = [w for w in all_warnings(made) if w.startswith("saturated_flats")]
    assert "photons are not known" in said


def test_flats_below_saturation_are_all_compared():
    for levels in ([0.1, 0.3, 0.5, 0.7, 0.9], [0.5], [0.9, 0.95]):
        frames = blank(lit(np.array(levels) * FULL, flat=1))
        assert len(usable(frames, frames.shape(0))) == len(frames)


def test_saturated_flats_of_another_gain_are_not_compared():
    """At a tenth of the gain in e-/DN the converter's top is at 1310 e-."""
    records = plan(photons=(1000.0, 3000.0, 6000.0), temperatures=(20.0,), flat=2, gains=(20.0,))
    records = [replace(r, photons=9 * r.photons) if r.photons and r.gain_db else r for r in records]
    frames = blank(SENSOR.expose(records, 3))
    made = {r.sequence for r in usable(frames, frames.shape(0)).records}
    left = [r for r in records if r.sequence not in made]
    assert {(r.kind, r.gain_db, r.photons) for r in left} == {("flat", 20.0, 9 * 450.0)}


@pytest.mark.parametrize("share", [0.99, 1.0, 1.01, 1.02, 1.03])
def test_the_edge_of_saturation_is_no_cosmic_ray(share):
    """Most pixels stay at the full well there, and a few are below it in one of two frames."""
    frames = lit(np.array([0.1, 0.3, 0.5, 0.7, 0.9, share]) * FULL, seed=3)
    assert not [w for w in characterize(frames).warnings if w.startswith("cosmic_rays")]


def test_flats_of_a_small_window_beside_full_frames_are_no_levels_of_these():
    whole = lit(np.array([0.1, 0.3, 0.5, 0.7]) * FULL)
    r0, r1, c0, c1 = window = (8, 24, 10, 40)
    other = lit(np.array([0.2, 0.6]) * FULL, seed=2)
    parts = [i for i, r in enumerate(other.records) if r.kind in ("bias", "flat")]
    records = [
        *whole.records,
        *(
            replace(other.records[i], sequence=len(whole) + k, file=f"{k}", window=window)
            for k, i in enumerate(parts)
        ),
    ]
    pixels = [whole.read(i) for i in range(len(whole))]
    pixels += [other.read(i)[r0:r1, c0:c1] for i in parts]
    both = FrameSet.from_arrays(records, [p.astype(np.uint16) for p in pixels], bit_depth=16)
    found, alone = characterize(both), characterize(whole)
    assert any(w.startswith("flats_of_windows") for w in found.warnings)
    for key in ("gain_e_per_dn", "quantum_efficiency", "prnu.pixel"):
        assert found.parameters[key].value == pytest.approx(alone.parameters[key].value, rel=1e-6)
