"""Effects hidden in pictures of unknown scenes, against cameras in plain NumPy. False alarms at 2 %; seeds are fixed."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import visaug
from benchmark import pictures as independent
from visaug.app.cli import main
from visaug.core.errors import InputError
from visaug.diagnosis.candidates import signatures
from visaug.diagnosis.candidates.trials import trials
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue
from visaug.frames import FrameRecord, FrameSet
from visaug.pictures.part import with_a_well
from visaug.pictures.scenes import _expected

SIDE = (64, 96)
CAMERA = independent.PictureCamera("small", 3.5, 14.0, black_dn=12.0, pixel_fixed_e=4.0)
STATED = visaug.Camera.load(
    {
        "resolution": list(SIDE),
        "bit_depth": 8,
        "gain_e_per_dn": 3.5,
        "black_level_dn": 12,
        "read_noise": {"sigma_e": 14.0},
        "dsnu": {"pixel_e": 4.0},
    }
)
TRIED = ("row_noise", "vignetting", "image_lag")
OTHERS = [name for name in catalogue() if name not in TRIED]


def taken(change, seed, n=16):
    rng = np.random.default_rng(seed)
    scenes = [independent.spacecraft(rng, SIDE, 0.4) for _ in range(n)]
    return independent.take(replace(CAMERA, **change), scenes, seed)


def in_memory(pictures):
    return FrameSet.from_arrays([FrameRecord(i, f"{i}.png", "image") for i in range(len(pictures))], pictures)


@pytest.fixture(scope="module")
def row_noise():
    return visaug.diagnose(STATED, in_memory(taken({"row_e": 12.0}, 1)), without=OTHERS, sets=60)


def test_row_noise_is_named_and_what_pictures_cannot_show(row_noise):
    found = json.loads(json.dumps(row_noise.to_json()))
    assert found["accepted"] == ["row_noise"]
    assert found["fits"]["adequate_after"]
    sigma = found["ranking"][0]["parameters"]["sigma_e"]
    assert sigma["low"] < 12 < sigma["high"]
    assert set(found["cannot_show"]) == {"image_lag", "vignetting"}
    assert found["used"]["frames"] == 16
    assert sorted(n for part in found["frames"].values() for n in part) == list(range(16))
    assert "row_noise" in row_noise.camera.effect_names


def test_the_command_reads_a_folder_of_pictures_and_writes_a_page(row_noise, tmp_path, monkeypatch, capsys):
    folder = independent.save(taken({"row_e": 12.0}, 1), tmp_path / "target")
    STATED.save(tmp_path / "camera.yaml")
    asked = {}

    def diagnose(camera, frames, **options):
        asked.update(options, pictures=frames.is_pictures)
        return row_noise

    monkeypatch.setattr(visaug, "diagnose", diagnose, raising=False)
    words = ["diagnose", str(folder), "--camera", str(tmp_path / "camera.yaml"), "--scenes", str(folder)]
    main([*words, "--transfer", "srgb", "--report", str(tmp_path / "d.html")])
    assert (asked["pictures"], asked["scenes"], asked["transfer"]) == (True, folder, "srgb")
    assert "cannot show: " in capsys.readouterr().out
    assert (tmp_path / "d.html").stat().st_size > 10_000


def test_nothing_is_named_where_nothing_is_hidden():
    found = visaug.diagnose(STATED, in_memory(taken({}, 12)), without=OTHERS, sets=60)
    assert found.accepted == ()
    assert found.adequate_before


def test_a_comparison_sees_what_the_camera_lacks_and_where():
    assert visaug.compare(STATED, in_memory(taken({}, 3))).adequate
    comparison = visaug.compare(STATED, in_memory(taken({"column_fixed_e": 9.0}, 4)))
    assert not comparison.adequate
    assert {"seams", "fixed_pattern"} <= {place.view for place in comparison.where}


def test_few_scenes_tell_no_falloff_of_light():
    """Three pictures with a bright target in the middle would say that light falls off by half."""
    scenes, said = in_memory(taken({}, 6, n=3)), []
    assert np.isnan(_expected(scenes, STATED, "linear", 255.0, said.append))[:, :2].all()
    assert any(text.startswith("scenes_tell_nothing: ") for text in said)
    assert np.isfinite(_expected(in_memory(taken({}, 6, n=24)), STATED, "linear", 255.0, said.append)).any()


def test_too_few_pictures_and_pictures_without_a_region_are_refused():
    with pytest.raises(InputError, match="at least 6"):
        visaug.diagnose(STATED, in_memory(taken({}, 5, n=4)))
    texture = np.random.default_rng(1).integers(0, 2, (8, *SIDE)).astype(np.uint8) * 200 + 20
    texture = texture.repeat(3, 1).repeat(3, 2)[:, : SIDE[0], : SIDE[1]]
    with pytest.raises(InputError, match="neither a black sky nor flat regions"):
        visaug.diagnose(STATED, in_memory(list(texture)))
    for level in (0, 255):
        with pytest.raises(InputError, match="with noise"):
            visaug.diagnose(STATED, in_memory([np.full(SIDE, level, np.uint8)] * 8))


def test_the_lab_refuses_pictures():
    with pytest.raises(InputError, match="diagnose"):
        visaug.Session(STATED, in_memory(taken({}, 6, n=7)))


def renders(n=8):
    rng = np.random.default_rng(2)
    return [np.rint(255 * independent.spacecraft(rng, (160, 192))).astype(np.uint8) for _ in range(n)]


@pytest.mark.parametrize(
    ("command", "words", "status", "stream"),
    [
        ("diagnose", [], 0, "out"),
        ("diagnose", ["--json=-"], 0, "err"),
        ("compare", [], 0, "out"),
        ("compare", ["--fail-on-misfit"], 3, "err"),
        ("compare", ["--fail-on-misfit", "--json=-"], 3, "err"),
    ],
)
def test_renders_have_no_sensor_noise_to_diagnose(tmp_path, capsys, command, words, status, stream):
    folder, camera = independent.save(renders(), tmp_path / "renders"), tmp_path / "camera.yaml"
    STATED.replace({"resolution": [160, 192]}).save(camera)
    with pytest.raises(SystemExit) as ended:
        main([command, str(folder), "--camera", str(camera), *words])
    assert ended.value.code == status
    said = capsys.readouterr()
    assert "no sensor noise found" in getattr(said, stream)
    if "--json=-" in words:
        (warning,) = json.loads(said.out)["warnings"]
        assert warning.startswith("no_sensor_noise: ")


def test_pictures_of_one_bright_level_are_no_sky():
    rng = np.random.default_rng(1)
    bright = in_memory([np.rint(rng.normal(150, 5, SIDE)).astype(np.uint8) for _ in range(8)])
    dark = in_memory([np.rint(rng.normal(12, 4, SIDE)).clip(0).astype(np.uint8) for _ in range(8)])
    for frames, kind in ((bright, "flat"), (dark, "dark")):
        found = Laboratory(frames, with_a_well(STATED))
        assert {record.kind for record in found.frames.records} == {kind}


def test_a_full_well_that_pictures_do_not_tell_is_marked_as_assumed():
    assert with_a_well(STATED).spec.assumed == ["full_well_e"]
    known = STATED.replace({"full_well_e": 900.0})
    assert with_a_well(known) is known


def test_pictures_with_more_bits_than_the_camera_are_refused():
    deep = [picture.astype(np.uint16) * 257 for picture in taken({}, 3, n=6)]
    with pytest.raises(InputError, match="pictures of 16 bits and a camera of 8"):
        visaug.compare(STATED, in_memory(deep))


def test_codes_of_the_files_are_those_of_the_simulation():
    """Simulated pictures of 12-bit files have integer codes of 12 bits. Rounding to 8 bits would add noise and leave out codes."""
    camera = visaug.Camera.load(
        STATED.to_dict() | {"bit_depth": 12, "gain_e_per_dn": 3.5 / 16, "black_level_dn": 12 * 16}
    )
    files = [FrameRecord(i, f"{i}.png", "image") for i in range(6)]
    frames = FrameSet.from_arrays(files, [p.astype(np.uint16) * 16 for p in taken({}, 3, n=6)], bit_depth=12)
    (part,) = Laboratory(frames, with_a_well(camera), 0).parts
    codes = part._taken(with_a_well(camera), 0, np.arange(6))[0] * 4095 / 255
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-3)
    assert np.count_nonzero(np.rint(codes).astype(int) % 16) > 0.8 * codes.size


def test_symmetries_of_simulated_pictures_have_no_bias():
    """Noise alone lifts pixels of bright surfaces to saturation, others than in the smoothed pictures. False alarms: 2e-4."""
    rng = np.random.default_rng(125)
    scenes = [independent.spacecraft(rng, (80, 128), 0.5) for _ in range(24)]
    stated = visaug.Camera.load(STATED.to_dict() | {"resolution": [80, 128]})
    lab = Laboratory(in_memory(independent.take(CAMERA, scenes, 125)), camera := with_a_well(stated), 0)
    values = np.concatenate([lab.simulated([(camera, k)])[2] for k in range(20)])
    areas = [i for i, s in enumerate(lab.measured[2].statistics) if s.view == "saturated_areas"]
    mean, spread = values[:, areas].mean(0), values[:, areas].std(0, ddof=1)
    assert spread.any()
    assert np.all(np.abs(mean) <= 4 * spread * np.sqrt(1 / 20 + 1 / 8))


def test_falloff_is_left_out_without_other_scenes_and_saturated_areas_are_not():
    """Neither as a difference of the measured pictures nor as one of a camera with vignetting."""
    rng = np.random.default_rng(4)
    scenes = [independent.sunlit(rng, (160, 192)) for _ in range(16)]
    stated = with_a_well(visaug.Camera.load(STATED.to_dict() | {"resolution": [160, 192]}))
    pictures = in_memory(independent.take(CAMERA, scenes, 4))
    dim = in_memory([np.rint(100 * scene.clip(0, 1)).astype(np.uint8) for scene in scenes])
    for others in (None, dim):
        lab = Laboratory(pictures, stated, 0, scenes=others)
        values = lab.simulated([(stated.with_effect("vignetting", corner_loss=0.3), 0), (stated, 1)])[2]
        views = [s.view for s in lab.measured[2].statistics]
        falloff, areas = (
            [i for i, view in enumerate(views) if view == v] for v in ("falloff", "saturated_areas")
        )
        if others is None:
            assert not values[:, falloff].any()
            assert not lab.measured[2].values[falloff].any()
        assert values[:, areas].any()
        assert lab.measured[2].values[areas].any()


def test_strengths_to_try_follow_the_noise_of_the_pictures(monkeypatch):
    """Trial values are made for a read noise of 1.5 e-; this camera has 14."""
    lab = Laboratory(in_memory(taken({}, 1)), STATED)
    tried = []

    def unmoved(lab, reference, trials, numbers, *_):
        tried.extend(trials)
        return np.zeros((len(trials), len(numbers), len(lab.statistics)))

    monkeypatch.setattr(signatures, "moves_of", unmoved)
    count = len(lab.statistics)
    reference = SimpleNamespace(
        scale=np.ones(count),
        null_scale=np.ones(count),
        camera=STATED,
        coordinates=(),
        priors=np.zeros(0),
        slopes=np.zeros((count, 0)),
    )
    only_rows = [trial for trial in trials(STATED) if trial.effect == "row_noise"]
    signatures.scanned(lab, reference, only_rows, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    expected = [catalogue()["row_noise"].parameters["sigma_e"].trials[k] * 14 / 1.5 for k in (0, -1)]
    assert [trial.by_name["sigma_e"] for trial in tried] == pytest.approx(expected)
