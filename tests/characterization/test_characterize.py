"""Whole characterizations of frames from a camera that shares no code with the package."""

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy import stats

from tests.characterization.simulated import Sensor, plan
from visaug.characterization import characterize
from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet

SETS = 16


@pytest.fixture(scope="module")
def many():
    sensor = Sensor()
    return sensor, [characterize(sensor.expose(plan(), seed)) for seed in range(SETS)]


def test_intervals_cover_the_cameras_own_parameters(many):
    """14 parameters, 16 cameras. A parameter with 95 % coverage misses more than 5 of 16 once in 12,000."""
    sensor, results = many
    for name, true in sensor.truth().items():
        found = [r[name] for r in results]
        hits = sum(e.low <= true <= e.high for e in found)
        assert hits >= SETS - 5, f"{name}: {hits} of {SETS}"
        mean = np.mean([e.value for e in found])
        spread = np.std([e.value for e in found]) / math.sqrt(SETS)
        assert abs(mean - true) < 4.5 * spread + 0.002 * abs(true), f"{name}: {mean} for {true}"


def test_intervals_are_not_idly_wide(many):
    """Half widths near 1.96 times the scatter of the estimates over cameras; factor 3 apart by chance
    never.
    """
    sensor, results = many
    for name in sensor.truth():
        scatter = np.std([r[name].value for r in results])
        width = np.median([(r[name].high - r[name].low) / 2 for r in results])
        assert scatter / 1.5 < width < 6 * scatter, name


def test_json_is_whole_and_finite(many):
    content = json.loads(json.dumps(many[1][0].to_json(), allow_nan=False))
    assert content["schema"] == 1
    assert set(content) == {"schema", "parameters", "not_determined", "warnings", "warning_details"}
    for name, entry in content["parameters"].items():
        assert set(entry) == {"value", "low", "high", "unit", "from"}, name
        assert entry["low"] <= entry["value"] <= entry["high"], name
    emva = (
        "system_gain_dn_per_e quantum_efficiency dark_noise_e dark_noise_dn saturation_photons saturation_e"
    )
    emva += " dsnu_e dsnu_dn prnu_fraction linearity_error_min linearity_error_max dark_current_mean_e_per_s"
    told = {*content["parameters"], *(entry["parameter"] for entry in content["not_determined"])}
    assert {f"emva.{name}" for name in emva.split()} <= told


@pytest.mark.parametrize("kinds", [{"bias"}, {"dark"}, {"flat"}, {"bias", "dark"}, {"dark", "flat"}])
def test_a_figure_is_there_or_told_to_be_missing(kinds):
    """Whatever a set lacks, every figure of both releases is a number or has what it needs, and none is both."""
    rng = np.random.default_rng(0)
    taken = [("bias", 0.0, None, 100)] * 3 + [("dark", 1.0, None, 110)] * 3
    taken += [("flat", 0.01, p, 100 + p / 4) for p in (400, 2000) for _ in range(3)]
    taken = [one for one in taken if one[0] in kinds]
    records = [
        FrameRecord(i, f"{i}", kind, t, photons=photons) for i, (kind, t, photons, _) in enumerate(taken)
    ]
    frames = [rng.normal(level, 3 + (level - 100) ** 0.5 / 2, (12, 17)).round() for *_, level in taken]
    content = characterize(FrameSet.from_arrays(records, frames, bit_depth=12)).to_json()
    needs = {entry["parameter"] for entry in content["not_determined"]}
    release_3 = (
        "system_gain_dn_per_e quantum_efficiency dark_noise_e dark_noise_dn saturation_photons saturation_e dsnu_e dsnu_dn "
        "prnu_fraction linearity_error_min linearity_error_max dark_current_mean_e_per_s dark_current_variance_e_per_s"
    )
    release_4 = (
        "snr_max dynamic_range_db absolute_sensitivity_threshold_e absolute_sensitivity_threshold_photons"
    )
    release_4 += (
        " doubling_temperature_c dsnu_row_e dsnu_column_e dsnu_pixel_e prnu_row prnu_column prnu_pixel"
    )
    names = {f"emva.{n}" for n in release_3.split()} | {f"emva4.{n}" for n in release_4.split()}
    assert names <= needs | content["parameters"].keys()
    assert not needs & content["parameters"].keys()


def test_camera_file_holds_what_was_measured(many):
    result = many[1][0]
    values = result.camera.values()
    for name in ("gain_e_per_dn", "read_noise.sigma_e", "dark_current.b_per_c", "prnu.row", "dsnu.column_e"):
        assert values[name] == pytest.approx(result[name].value, rel=1e-5), name
    assert result.camera.resolution == (48, 64)


def test_every_figure_draws(many):
    figures = many[1][0].plots()
    assert {"photon_transfer", "linearity", "read_noise", "dark_current", "nonuniformity"} == set(figures)
    assert all(figure.axes for figure in figures.values())
    with pytest.raises(InputError, match="gain settings"):
        many[1][0].plot_gain_law()


def test_maps_are_saved_as_fits_and_tiff(many, tmp_path):
    import tifffile
    from astropy.io import fits

    result = many[1][0]
    for path in result.save_maps(tmp_path, ".fits"):
        np.testing.assert_allclose(fits.getdata(path), result.maps[path.stem])
    for path in result.save_maps(tmp_path, ".tif"):
        np.testing.assert_allclose(tifffile.imread(path), result.maps[path.stem])
    assert {"master_bias", "dark_current", "response", "defects"} <= set(result.maps)


def test_without_flats_the_gain_is_not_guessed():
    result = characterize(Sensor().expose(plan(photons=()), 1))
    assert {"gain_e_per_dn", "quantum_efficiency", "prnu.pixel", "read_noise.sigma_e"} <= set(
        result.not_determined
    )
    assert result["read_noise.sigma_dn"].value == pytest.approx(2.37 / 0.2, rel=0.05)
    assert "read_noise.sigma_e" not in result.parameters
    with pytest.raises(InputError, match="gain"):
        _ = result.camera


def test_without_flats_a_given_camera_lends_its_gain():
    from visaug.camera import Camera

    camera = Camera.load({"resolution": [48, 64], "gain_e_per_dn": 0.2, "quantum_efficiency": 0.6})
    result = characterize(Sensor().expose(plan(photons=()), 1), camera)
    assert result["read_noise.sigma_e"].low < 2.37 < result["read_noise.sigma_e"].high
    assert result.camera.spec.quantum_efficiency == 0.6
    assert any("gain_as_given" in w for w in result.warnings)


def test_uncalibrated_flats_tell_the_gain_but_no_efficiency():
    frames = Sensor().expose(plan(), 3)
    records = [
        dataclasses.replace(r, photons=None, exposure_s=0.01 + 1e-6 * r.photons) if r.kind == "flat" else r
        for r in frames.records
    ]
    blank = FrameSet.from_arrays(records, [frames.read(i).astype(np.uint16) for i in range(len(frames))])
    result = characterize(blank)
    assert result["gain_e_per_dn"].low < 0.2 < result["gain_e_per_dn"].high
    assert "quantum_efficiency" in result.not_determined
    assert "emva.quantum_efficiency" in result.not_determined


def test_light_and_temperature_measured_for_each_frame_make_levels():
    frames = Sensor().expose(plan(), 3)
    rng = np.random.default_rng(0)
    records = [
        dataclasses.replace(
            r,
            temperature_c=r.temperature_c + float(rng.uniform(-0.2, 0.2)) if r.kind != "flat" else 20.0,
            photons=r.photons * float(rng.uniform(0.998, 1.002)) if r.kind == "flat" else None,
        )
        for r in frames.records
    ]
    wandering = FrameSet.from_arrays(records, [frames.read(i).astype(np.uint16) for i in range(len(frames))])
    found, steady = characterize(wandering), characterize(frames)
    for name in ("gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "dark_current.b_per_c"):
        assert found[name].value == pytest.approx(steady[name].value, rel=0.02), name


def test_converter_that_clips_hides_the_full_well():
    result = characterize(dataclasses.replace(Sensor(), top_dn=40000, full_well_e=1e9).expose(plan(), 4))
    assert "full_well_e" not in result.parameters
    assert result["gain_e_per_dn"].low < 0.2 < result["gain_e_per_dn"].high


def test_gain_ladder_tells_the_gain_law():
    """Beyond 4 standard errors by chance less than once in 1,000 (t with 19 degrees of freedom)."""
    result = characterize(Sensor().expose(plan(gains=(6, 12)), 5))
    slope = result["gain_law.slope"]
    assert abs(slope.value - 1) < 2 * (slope.high - slope.low) / 2
    assert slope.high - slope.low < 0.1
    assert result.plot_gain_law().axes


def test_row_noise_is_measured_and_named():
    """The interval is 95 %; three times its half width off by chance never."""
    result = characterize(dataclasses.replace(Sensor(), row_noise_e=1.2).expose(plan(), 6))
    assert any(w.startswith("row_noise") for w in result.warnings)
    row = result["temporal.row_e"]
    assert abs(row.value - 1.2) < 1.5 * (row.high - row.low)


def test_dark_frames_after_light_are_left_out():
    """A ghost of 3 % in dark frames right after flats would raise the dark current; with enough others it
    does not.
    """
    sensor, records = Sensor(), plan()
    extra = []
    for k in range(4):
        n = len(records) + 2 * k
        extra += [FrameRecord(n, f"{n}", "flat", 0.01, 20.0, photons=3000.0),
                  FrameRecord(n + 1, f"{n + 1}", "dark", 2.0, 20.0)]  # fmt: skip
    frames = sensor.expose([*records, *extra], 7)
    pixels = [frames.read(i).astype(np.uint16) for i in range(len(frames))]
    for i, record in enumerate(frames.records):
        if record in extra and record.kind == "dark":
            pixels[i] = pixels[i] + np.uint16(0.03 * 3000 * 0.6 / 0.2)
    result = characterize(FrameSet.from_arrays(frames.records, pixels))
    a = result["dark_current.a_e_per_s"]
    assert abs(a.value - 0.136) < 1.5 * (a.high - a.low)


def test_hot_pixels_are_mapped_and_kept_out_of_dsnu():
    frames = Sensor().expose(plan(), 8)
    hot = [(3, 5), (20, 60), (40, 2)]
    pixels = []
    for i, record in enumerate(frames.records):
        pixel = frames.read(i)
        for place in hot:
            pixel[place] += 400 + 3000 * record.exposure_s
        pixels.append(pixel.astype(np.uint16))
    result = characterize(FrameSet.from_arrays(frames.records, pixels))
    assert all(result.maps["defects"][place] & 1 for place in hot)
    assert np.count_nonzero(result.maps["defects"]) < 10
    assert result["dsnu.pixel_e"].value == pytest.approx(1.1, rel=0.1)


def test_drawn_dark_pattern_has_the_bands_and_strength_of_the_measured_one():
    rng = np.random.default_rng(2)
    bands = rng.choice([11.0, 6.0, 1.0], 256) * 5
    bands[:100] += 20
    frames = 1000 + bands + rng.normal(0, 3, (40, 60, 256))
    records = [FrameRecord(i, f"{i}", "bias", 1e-5, 20.0) for i in range(40)]
    result = characterize(FrameSet.from_arrays(records, np.rint(frames).astype(np.uint16)))
    drawn = result.draw_dsnu(1)
    assert drawn.mean(0).std() == pytest.approx(bands.std(), rel=0.2)
    assert np.allclose(drawn, result.draw_dsnu(1))
    # The same values spread like the measured ones: Kolmogorov-Smirnov at one in 10,000.
    columns = drawn.mean(0) - drawn.mean()
    assert stats.ks_2samp(columns, bands - bands.mean()).pvalue > 1e-4


@pytest.mark.parametrize("method", ["emva", "paper"])
def test_unusable_input_is_named(method):
    scene = FrameSet.from_arrays([FrameRecord(0, "s", "scene", 0.1)], np.ones((1, 8, 8), np.uint16))
    with pytest.raises(InputError, match="nothing can be measured"):
        characterize(scene, method=method)
    with pytest.raises(InputError, match="emva or paper"):
        characterize(scene, method="other")


@pytest.mark.parametrize("kind", ["bias", "dark", "flat"])
def test_a_single_frame_tells_little_and_says_so(kind):
    frame = np.random.default_rng(0).integers(90, 110, (1, 16, 20)).astype(np.uint16)
    result = characterize(FrameSet.from_arrays([FrameRecord(0, "a", kind, 0.1, 20.0, photons=5.0)], frame))
    assert result.not_determined
    assert "read_noise.sigma_e" not in result.parameters
    json.dumps(result.to_json(), allow_nan=False)


def test_trial_sets_come_close_to_their_cameras(shared_data):
    """Gain and black level, which the effects hidden there hardly touch."""
    import yaml

    assert list((shared_data / "trial_sets").glob("set_*"))
    for folder in sorted((shared_data / "trial_sets").glob("set_*"))[:2]:
        result = characterize(FrameSet.load(folder))
        camera = yaml.safe_load((folder / "camera.yaml").read_text())
        assert result["gain_e_per_dn"].value == pytest.approx(camera["gain_e_per_dn"], rel=0.03)
        assert result["black_level_dn"].value == pytest.approx(camera["black_level_dn"], abs=3)
