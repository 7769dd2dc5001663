"""Mistakes in a camera file: each kind is named and corrected, none is found in a right file."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from benchmark.camera import take
from benchmark.sets import camera_yaml
from benchmark.small import CHART, PLAN, SENSOR, chart
from visaug import Camera, FrameSet
from visaug.diagnosis.camera_file import corrected, suspects, with_enough_photons
from visaug.diagnosis.laboratory import Laboratory
from visaug.frames import FrameRecord

GAIN, READ_E, DARK_E, PER_C = SENSOR.e_per_dn, SENSOR.read_e, SENSOR.dark_e_per_s, SENSOR.dark_per_c


def frames_of(plan) -> FrameSet:
    records = [
        FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, s.photons) for i, s in enumerate(plan)
    ]
    return FrameSet.from_arrays(records, list(take(SENSOR, plan, {}, 7, [])), bit_depth=SENSOR.bits)


@pytest.fixture(scope="module")
def frames() -> FrameSet:
    """By the benchmark's camera, which shares no code with the package."""
    plan, targets = (*PLAN, *CHART), {"chart.npy": chart()}
    records = [
        FrameRecord(i, f"{i}.npy", s.kind, s.seconds, s.celsius, 0.0, s.photons, clean=s.target)
        for i, s in enumerate(plan)
    ]
    taken = take(SENSOR, plan, targets, 7, [])
    return FrameSet.from_arrays(records, list(taken), targets, bit_depth=SENSOR.bits)


@pytest.fixture(scope="module")
def right() -> dict:
    return yaml.safe_load(camera_yaml(SENSOR))


@pytest.mark.parametrize(
    ("wrong", "key", "mistake", "value"),
    [
        ({"gain_e_per_dn": 1 / GAIN}, "gain_e_per_dn", "inverse", GAIN),
        ({"read_noise.sigma_e": READ_E / GAIN}, "read_noise.sigma_e", "unit", READ_E),
        ({"read_noise.sigma_e": READ_E**2}, "read_noise.sigma_e", "variance", READ_E),
        ({"dark_current.a_e_per_s": DARK_E / 1e3}, "dark_current.a_e_per_s", "time_unit", DARK_E),
        ({"dark_current.a_e_per_s": DARK_E * 0.01}, "dark_current.a_e_per_s", "per_frame", DARK_E),
        (
            {"dark_current.a_e_per_s": DARK_E * math.exp(-273.15 * PER_C)},
            "dark_current.a_e_per_s", "kelvin", DARK_E,
        ),
        ({"prnu.column": 100 * SENSOR.prnu[0]}, "prnu.column", "per_cent", SENSOR.prnu[0]),
        ({"black_level_dn": 0.0}, "black_level_dn", "black_level", SENSOR.pedestal_dn),
        ({"quantum_efficiency": SENSOR.efficiency / 5}, "quantum_efficiency", "photons", SENSOR.efficiency),
        ({"exposure_s": 10.0}, "exposure_s", "time_unit", 0.01),
    ],
)  # fmt: skip
def test_a_mistake_is_named_and_corrected(frames, right, wrong, key, mistake, value):
    camera = Camera.load(right).replace({k: v for k, v in wrong.items() if k != "exposure_s"})
    if "exposure_s" in wrong:
        camera = Camera.load({**right, "exposure_s": wrong["exposure_s"]})
    better, found = corrected(camera, frames, Laboratory(frames, camera))
    assert [(m.key, m.mistake) for m in found] == [(key, mistake)]
    assert found[0].value == pytest.approx(value, rel=0.05)
    assert better.to_dict().get(key.split(".")[0]) != camera.to_dict().get(key.split(".")[0])


@pytest.fixture(scope="module")
def cool() -> FrameSet:
    """Darks of two exposures at one temperature, which tell a rate and no law."""
    return frames_of([s for s in PLAN if s.celsius == 20.0])


@pytest.mark.parametrize(
    ("factor", "mistake"),
    [
        (2.0, "per_frame"),  # the longer darks take 2 s
        (1e-3, "time_unit"),
        (math.exp(-273.15 * PER_C), "kelvin"),
        (1.0, None),
    ],
)
def test_a_dark_current_is_judged_at_one_temperature_too(cool, right, factor, mistake):
    camera = Camera.load(right).replace({"dark_current.a_e_per_s": DARK_E * factor})
    better, found = corrected(camera, cool, Laboratory(cool, camera))
    expected = [] if mistake is None else [("dark_current.a_e_per_s", mistake)]
    assert [(m.key, m.mistake) for m in found] == expected
    assert better.values()["dark_current.a_e_per_s"] == pytest.approx(DARK_E, rel=0.05)


def with_photons(factor: float) -> FrameSet:
    frames = frames_of(PLAN)
    return frames.with_records([replace(r, photons=r.photons and r.photons * factor) for r in frames.records])


def test_photons_that_no_efficiency_explains_are_to_be_corrected_in_the_list_of_frames(right):
    """Multiplied so that the efficiency of the file holds; that of the sensor is within 5 %."""
    camera = Camera.load(right)
    frames, (found,) = with_enough_photons(camera, with_photons(0.1))
    assert (found.mistake, found.key, found.value) == ("photons", "quantum_efficiency", SENSOR.efficiency)
    assert "the photons of frames.csv are too low" in found.text
    lit = [(r.photons, s.photons) for r, s in zip(frames.records, PLAN, strict=True) if r.photons]
    assert len(lit) == sum(s.kind == "flat" for s in PLAN)
    assert [made for made, _ in lit] == pytest.approx([true for _, true in lit], rel=0.05)
    assert suspects(camera, frames) == []


@pytest.mark.parametrize("factor", [0.7, 1.0, 10.0])
def test_photons_that_an_efficiency_explains_are_kept(right, factor):
    frames = with_photons(factor)
    assert with_enough_photons(Camera.load(right), frames) == (frames, ())


def test_photons_that_another_efficiency_explains_change_the_efficiency(right):
    frames = with_photons(5.0)
    (few,) = suspects(Camera.load(right), frames)
    assert "frames.csv" not in few.text
    assert few.value == pytest.approx(SENSOR.efficiency / 5, rel=0.05)


def test_another_bit_depth_changes_gain_and_black_level_alike(frames, right):
    factor = 2.0 ** (16 - SENSOR.bits)
    wrong = {"bit_depth": 16, "gain_e_per_dn": GAIN / factor, "black_level_dn": SENSOR.pedestal_dn * factor}
    camera = Camera.load({**right, **wrong})
    better, found = corrected(camera, frames, Laboratory(frames, camera))
    assert [(m.key, m.mistake, m.value) for m in found] == [("bit_depth", "bit_depth", SENSOR.bits)]
    assert better.bit_depth == SENSOR.bits
    assert better.spec.gain_e_per_dn == pytest.approx(GAIN)


def test_a_right_file_has_no_mistake(frames, right):
    camera = Camera.load(right)
    same, found = corrected(camera, frames, Laboratory(frames, camera))
    assert found == ()
    assert same is camera


@pytest.mark.parametrize("factor", [1.35, 1.5, 1.7])
def test_a_little_more_dark_current_than_in_the_file_is_no_mistake(right, factor):
    """Hot pixels or a warmer sensor explain it as well as a figure per frame of 0.75 s, or one in DN."""
    plan = [replace(s, seconds=0.75) if s.seconds == 0.2 else s for s in PLAN]
    camera = Camera.load(right).replace({"dark_current.a_e_per_s": DARK_E / factor})
    assert suspects(camera, frames_of(plan)) == []


def test_a_correction_keeps_measured_maps(frames, right, tmp_path, monkeypatch):
    rows, columns = right["resolution"]
    (tmp_path / "camera").mkdir()
    np.save(tmp_path / "camera" / "dsnu.npy", np.zeros((rows, columns), np.float32))
    (tmp_path / "camera" / "camera.yaml").write_text(
        yaml.safe_dump({**right, "gain_e_per_dn": 1 / GAIN, "dsnu": {**right["dsnu"], "map": "dsnu.npy"}})
    )
    monkeypatch.chdir(tmp_path)
    camera = Camera.load("camera/camera.yaml")
    better, found = corrected(camera, frames, Laboratory(frames, camera, seed=np.int64(0)))
    assert [m.mistake for m in found] == ["inverse"]
    assert better.values()["gain_e_per_dn"] == pytest.approx(GAIN, rel=0.05)
    assert better.maps.keys() == camera.maps.keys() != set()
