"""The cameras that come with the package: they load, they expose, and every figure tells where it is from."""

import json
import math
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest
import torch
import yaml

from visaug.app.cli import main
from visaug.camera import Camera, camera_file, draw, shipped
from visaug.core.errors import InputError
from visaug.core.sampling import Stream

ABOUT = ("name", "source", "assumed", "licence", "randomize", "correlated", "reading")
NAMES = sorted(shipped())


def figures(content: dict) -> set[str]:
    """Paths of every figure in a camera file."""
    paths = set()
    for key, value in content.items():
        if key in ABOUT:
            continue
        if key == "effects":
            paths |= {f"{entry['name']}.{name}" for entry in value for name in entry if name != "name"}
        elif isinstance(value, dict):
            paths |= {f"{key}.{name}" for name in value}
        else:
            paths.add(key)
    return paths


def test_the_ones_that_were_promised_are_there():
    assert {"flir_cm3_u3_13y3c", "basler_ccd12_emva1288", "sony_imx174"} <= set(NAMES)
    assert sum("iso" in name for name in NAMES) == 15
    presets = {
        "machine_vision_low_light",
        "phone_at_night",
        "star_tracker",
        "spacecraft_inspection",
        "surveillance_at_night",
    }
    assert presets <= set(NAMES)
    assert len(NAMES) >= 24


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_has_a_source_or_is_marked_as_assumed(name):
    content = yaml.safe_load(shipped()[name].read_text())
    assert all(isinstance(text, str) and text for text in content["source"].values())
    told = {*content["source"], *content["assumed"]}
    untold = {path for path in figures(content) if path not in told and path.partition(".")[0] not in told}
    assert not untold
    twice = set(content["assumed"]) & set(content["source"])
    assert not twice


@pytest.mark.parametrize("name", NAMES)
def test_assumed_figures_are_figures_of_the_file(name):
    content = yaml.safe_load(shipped()[name].read_text())
    assert set(content["assumed"]) <= figures(content)


@pytest.mark.parametrize("name", NAMES)
def test_it_exposes_with_its_own_spreads(name):
    """Mean of a flat at a third of the range, drawn anew for each image, against G, QE and black level
    of each.

    40,000 pixels, fixed patterns of a percent included: within 3 %; a slip in gain or efficiency would
    be seen.
    """
    camera = Camera.load(f"{name}.yaml")
    values = draw(camera, 3, np.random.default_rng(0))
    gain = values["gain_e_per_dn"] * 10 ** ((camera.spec.gain_db - values["gain_db"]) / 20)
    range_e = (2**camera.bit_depth - 1 - values["black_level_dn"]) * gain
    electrons = torch.minimum(range_e, values["full_well_e"]) / 3
    photons = electrons / values["quantum_efficiency"]
    stream = Stream([1, 2, 3], [4, 5, 6], 1, (range(200), range(200)))
    frames = camera.expose(photons.view(3, 1, 1, 1).expand(3, 1, 200, 200).contiguous(), stream, values)
    expected = electrons / gain + camera.spec.black_level_dn
    assert frames.isfinite().all()
    np.testing.assert_allclose(frames.mean((1, 2, 3)).numpy(), expected.numpy(), rtol=0.03)


@pytest.mark.parametrize("name", NAMES)
def test_a_bias_frame_is_not_cut_off_at_zero(name):
    """But for the paper's camera, which has no black level in the paper."""
    camera = Camera.load(name)
    stream = Stream([1], [2], 1, (range(200), range(200)))
    bias = camera.expose(torch.zeros(1, 1, 200, 200), stream, {"exposure_s": 0.0})
    share = (bias == 0).double().mean().item()
    assert share > 0.4 if name == "flir_cm3_u3_13y3c" else share < 0.001


def test_photographic_cameras_are_those_of_the_published_fits(shared_data):
    script = run_path(str(Path(__file__).parents[2] / "scripts" / "make_photographic_cameras.py"))
    for stem, (name, rows, columns, fit, stops) in script["CAMERAS"].items():
        content = json.loads((shared_data / "eld_camera_params" / f"{fit}_params.json").read_text())
        assert shipped()[stem].read_text() == script["camera_file"](content, fit, name, rows, columns, stops)


def test_photographic_read_noise_agrees_with_the_gaussian_fits(shared_data):
    """The fits hold a Gaussian sigma too: the Tukey-lambda's standard deviation must be near it, its scale
    is not.
    """
    fits = {
        "canon_5d4_iso800": "CanonEOS5D4",
        "nikon_d850_iso800": "NikonD850",
        "sony_a7s2_iso800": "SonyA7S2",
    }
    for stem, fit in fits.items():
        content = json.loads((shared_data / "eld_camera_params" / f"{fit}_params.json").read_text())
        law, k = content["Profile-1"]["g_scale"], 8 * content["Kmin"]
        gaussian_e = math.exp(law["slope"] * math.log(k) + law["bias"]) / k
        assert Camera.load(stem).values()["read_noise.sigma_e"] == pytest.approx(gaussian_e, rel=0.12)


def test_photographic_colour_paths_see_daylight_as_white():
    """Camera RGB of D65 by the published matrix times the white balance is gray, and sRGB's primaries come back as themselves."""
    script = run_path(str(Path(__file__).parents[2] / "scripts" / "make_photographic_cameras.py"))
    # XYZ of D65 and of the sRGB primaries: IEC 61966-2-1.
    white = np.array([0.9505, 1.0, 1.0890])
    red, blue = np.array([0.4124, 0.2126, 0.0193]), np.array([0.1805, 0.0722, 0.9505])
    for stem, (_, _, _, fit, _) in script["CAMERAS"].items():
        colour = Camera.load(stem).spec.colour
        assert colour is not None
        published = np.array(script["XYZ_TO_CAMERA"][fit]).reshape(3, 3)
        balanced = published @ np.column_stack([white, red, blue]) * np.array(colour.white_balance)[:, None]
        picture = np.array(colour.matrix) @ (balanced / balanced[1, 0])
        np.testing.assert_allclose(picture, np.column_stack([[1, 1, 1], [1, 0, 0], [0, 0, 1]]), atol=3e-3)


@pytest.mark.parametrize("name", ["SONY_IMX174", "Sony-IMX174", "sony imx174.yaml"])
def test_a_name_in_any_case_is_a_shipped_camera(name, capsys):
    assert camera_file(name) == shipped()["sony_imx174"]
    main(["cameras", name])
    assert capsys.readouterr().out == shipped()["sony_imx174"].read_text()


def test_a_wrong_path_is_told_what_its_folder_has(tmp_path):
    for name in ("data_sheet.yaml", "other.yaml"):
        (tmp_path / name).write_text("resolution: [8, 8]\n")
    with pytest.raises(InputError, match=r"no such camera; its folder has data_sheet.yaml, other.yaml"):
        Camera.load(tmp_path / "camera.yaml")


def test_a_folder_in_place_of_a_file_is_told_what_it_has(tmp_path):
    for k in range(5):
        (tmp_path / f"camera_{k}.yaml").write_text("resolution: [8, 8]\n")
    told = (
        r"is a folder; it has camera_0.yaml, camera_1.yaml, camera_2.yaml and 2 more; expected a camera.yaml"
    )
    with pytest.raises(InputError, match=told):
        Camera.load(tmp_path)


def test_a_name_that_is_nearly_right_is_proposed():
    with pytest.raises(InputError, match=r"did you mean .*sony_imx174"):
        Camera.load("sony_imx147")
