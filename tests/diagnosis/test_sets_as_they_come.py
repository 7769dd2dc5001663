"""What laboratories leave in their sets, compared with the true camera: no difference may come of it.

A comparison of the true camera differs with a probability of 2 %; seeds are fixed.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmark.camera import Shot
from tests.diagnosis.small import frame_set, stated_camera
from visaug import FrameSet, InputError, characterize, compare, diagnose
from visaug.characterization.usable import usable
from visaug.diagnosis.laboratory import Laboratory

LIGHTS = (300.0, 1000.0, 3000.0, 6000.0)
PLAN = (
    [Shot("bias", 1e-5, 20.0)] * 6
    + [Shot("dark", 2.0, 20.0)] * 6
    + [Shot("flat", 0.01, 20.0, photons=p) for p in LIGHTS for _ in range(4)]
)


@pytest.fixture(scope="module")
def frames() -> FrameSet:
    return frame_set(21, plan=tuple(PLAN))


def rebuilt(frames: FrameSet, pixels=None, **changes) -> FrameSet:
    pixels = [frames.read(i) for i in range(len(frames))] if pixels is None else pixels
    records = [replace(r, **changes) for r in frames.records]
    kept = [np.asarray(p, np.uint16) if np.all(p % 1 == 0) else p for p in pixels]
    return FrameSet.from_arrays(records, kept, bit_depth=frames.bit_depth)


def test_lights_of_one_exposure_are_apart_without_photons(frames):
    """The photons of each are those of its own level, to 1 %: 20,000 pixels tell it to 0.01 %, the file's gain to a per cent."""
    blank = rebuilt(frames, photons=None)
    lit = Laboratory(usable(blank, stated_camera().resolution), stated_camera()).frames
    told = [lit.records[i].photons for i, r in enumerate(frames.records) if r.kind == "flat"]
    np.testing.assert_allclose(told, np.repeat(LIGHTS, 4), rtol=0.01)
    assert len(set(told)) == len(LIGHTS)
    assert compare(stated_camera(), blank).adequate


def test_photons_that_the_levels_contradict_are_not_used(frames):
    said = rebuilt(frames)
    said = said.with_records([replace(r, photons=5000.0 if r.kind == "flat" else None) for r in said.records])
    result = compare(stated_camera(), said)
    assert result.adequate
    assert any(w.startswith("photons_contradicted") for w in result.warnings)


@pytest.mark.parametrize("copied", [1, 14], ids=["bias", "flat"])
def test_a_copy_counts_once(frames, copied):
    last = replace(frames.records[copied], sequence=len(frames), file="copy.npy")
    pixels = [frames.read(i) for i in (*range(len(frames)), copied)]
    several = FrameSet.from_arrays(
        [*frames.records, last], [p.astype(np.uint16) for p in pixels], bit_depth=frames.bit_depth
    )
    one, other = (compare(stated_camera(), some) for some in (frames, several))
    np.testing.assert_array_equal(one.measured, other.measured)
    assert one.p_value == other.p_value
    assert [w for w in other.warnings if w.startswith("duplicate_frames")] == [
        f"duplicate_frames: frames {len(frames)} are identical to others to the last bit: copies, not exposures, and are left out"
    ]


def test_flats_behind_stated_colour_filters_are_left_out(frames):
    tile = np.tile([[0.5, 1.0], [1.0, 0.7]], (frames.shape(0)[0] // 2, frames.shape(0)[1] // 2))
    black = stated_camera().spec.black_level_dn
    pixels = [frames.read(i) for i in range(len(frames))]
    pixels = [
        np.rint(black + (p - black) * tile) if r.kind == "flat" else p
        for p, r in zip(pixels, frames.records, strict=True)
    ]
    result = compare(stated_camera(), rebuilt(frames, pixels, bayer="RGGB"))
    assert {s.kind for s in result.statistics} == {"bias", "dark"}
    assert result.adequate
    assert any(w.startswith("mosaic: flats and scenes are left out") for w in result.warnings)


def test_stated_filters_that_respond_alike_leave_the_flats(frames):
    result = compare(stated_camera(), rebuilt(frames, bayer="RGGB"))
    assert any(s.kind == "flat" for s in result.statistics)
    assert result.adequate


def test_fractions_of_a_dn_are_of_the_nearest_code(frames):
    """Half a code less would set other bits in a share of 0.1 of the pixels."""
    rng = np.random.default_rng(5)
    pixels = [
        frames.read(i) + rng.uniform(-0.499, 0.499, frames.shape(i)).astype(np.float32)
        for i in range(len(frames))
    ]
    pixels = [np.maximum(p, 0) for p in pixels]
    whole, fractions = (compare(stated_camera(), some) for some in (frames, rebuilt(frames, pixels)))
    is_code = np.array([s.view == "codes" for s in whole.statistics])
    np.testing.assert_array_equal(whole.measured[is_code], fractions.measured[is_code])


def test_a_frame_of_floats_among_words_is_read(frames, tmp_path):
    frames.save(tmp_path / "set")
    for name in sorted((tmp_path / "set").glob("*.npy")):
        if name.stem in ("0", "3", str(len(frames) - 1)):
            np.save(name, np.load(name).astype(np.float32))
    as_words = characterize(frames)
    for bits in (None, frames.bit_depth):
        found = characterize(FrameSet.load(tmp_path / "set", bit_depth=bits))
        assert found["gain_e_per_dn"].value == as_words["gain_e_per_dn"].value


def test_averaged_frames_and_other_settings_are_left_out(frames):
    """By what the set states: a mean of four flats has half their noise, another offset another level."""
    mean = np.mean([frames.read(i) for i in range(12, 16)], axis=0).round()
    pixels = [frames.read(i) for i in range(len(frames))] + [mean, frames.read(0) + 40]
    last = len(frames)
    records = [replace(r, setting="OFFSET=10") for r in frames.records]
    records += [
        replace(records[12], sequence=last, combined=4),
        replace(records[0], sequence=last + 1, setting="OFFSET=50"),
    ]
    mixed = FrameSet.from_arrays(records, [p.astype(np.uint16) for p in pixels], bit_depth=frames.bit_depth)
    one, other = (compare(stated_camera(), some) for some in (frames, mixed))
    np.testing.assert_array_equal(one.measured, other.measured)
    assert {w.split(":")[0] for w in other.warnings} >= {"settings_mixed", "master_frame"}


@pytest.mark.parametrize("value", [0, 100, 4095])
def test_frames_of_one_value_are_refused(frames, value):
    """Saturated frames, and frames of a program, have no noise to compare."""
    images = [np.full(frames.shape(i), value, np.uint16) for i in range(len(frames))]
    flat = FrameSet.from_arrays(frames.records, images, bit_depth=12)
    with pytest.raises(InputError, match="each holds one value in all its pixels"):
        diagnose(stated_camera(), flat)


def test_one_frame_cannot_be_split(frames):
    with pytest.raises(
        InputError, match="1 frame cannot be split into frames that find and frames that confirm"
    ):
        diagnose(stated_camera(), frames.subset([0]), without="row_noise")
