"""The Camera class: round trips, changes, gain, and the whole chain against the EMVA 1288 linear model."""

from pathlib import Path

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug.core.sampling import Stream, derive_key

WINDOW = (range(200), range(250))

RICH = {
    "name": "rich",
    "source": {"gain_e_per_dn": "measured"},
    "assumed": ["quantum_efficiency"],
    "resolution": [200, 250],
    "bit_depth": 12,
    "reading": "paper",
    "quantum_efficiency": 0.5,
    "gain_e_per_dn": 2.0,
    "gain_db": 3.0,
    "black_level_dn": 100.0,
    "full_well_e": 9000.0,
    "read_noise": {"sigma_e": 3.0, "shape": -0.2, "meaning": "scale"},
    "dark_current": {"reference_e_per_s": 2.0, "reference_temperature_c": 20.0, "doubling_c": 8.0},
    "prnu": {"pixel": 0.01},
    "dsnu": {"column_e": 1.0},
    "effects": [{"name": "row_noise", "sigma_e": 1.5}],
    "randomize": {"gain_db": {"std": 1.0}, "row_noise.sigma_e": 0.1},
}


def frames(camera: Camera, photons: float, count: int, sensor: int = 0, **values):
    stream = Stream([derive_key("t", i) for i in range(count)], [derive_key("s", sensor)] * count, 1, WINDOW)
    return camera.expose(torch.full((count, 1, 200, 250), photons), stream, values or None)


def test_saving_and_loading_gives_the_same_camera(tmp_path: Path):
    camera = Camera.load(RICH)
    camera.save(tmp_path / "out" / "camera.yaml")
    again = Camera.load(tmp_path / "out" / "camera.yaml")
    assert again.to_dict() == camera.to_dict()
    assert again.values() == pytest.approx(camera.values(), rel=1e-12)
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["camera.yaml"]  # nothing half-written is left


def test_a_failed_save_leaves_the_old_file(tmp_path: Path, monkeypatch):
    path = tmp_path / "camera.yaml"
    path.write_text("precious")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        Camera.load(RICH).save(path)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_replace_changes_what_it_names_and_nothing_else():
    camera = Camera.load(RICH)
    new = {
        "gain_e_per_dn": 3.0,
        "read_noise.sigma_e": np.float32(4.5),
        "row_noise.sigma_e": torch.tensor(0.5),
    }
    changed = camera.replace(new)
    assert changed.values() == {**camera.values(), **{path: float(value) for path, value in new.items()}}
    assert changed.choices() == camera.choices()
    assert camera.values()["gain_e_per_dn"] == 2.0


def test_every_value_can_be_put_back():
    for content in (RICH, {"resolution": [4, 4], "gain_e_per_dn": 1.0}):
        camera = Camera.load(content)
        assert camera.replace(camera.values()).values() == camera.values()


@pytest.mark.parametrize(
    ("path", "value"),
    [("column_noise.sigma_e", 1.0), ("row_noise.width", 1.0), ("gain", 1.0), ("read_noise.sigma", 1.0)],
)
def test_replace_refuses_a_path_that_the_camera_lacks(path, value):
    with pytest.raises(InputError, match=path.replace(".", r"\.")):
        Camera.load(RICH).replace({path: value})


@pytest.mark.parametrize(
    ("value", "said"),
    [(64, "is not a list"), ([64], "is missing"), ([64, 2.5], "integer"), ([0, 8], "1 to 65535")],
)
def test_a_wrong_resolution_says_what_it_should_be(value, said):
    with pytest.raises(InputError, match=rf"{said}.*\[rows, columns\]|\[rows, columns\].*{said}"):
        Camera.load(RICH | {"resolution": value})


@pytest.mark.parametrize("value", [-1.0, float("nan"), "much"])
def test_replace_refuses_a_value_out_of_bounds(value):
    with pytest.raises(InputError, match="sigma_e"):
        Camera.load(RICH).replace({"row_noise.sigma_e": value})


@pytest.mark.parametrize(
    "value", ["much", None, float("nan"), -1e6, 1e6, [1.0], np.array([1.0, 2.0])], ids=repr
)
def test_replace_refuses_a_gain_out_of_bounds(value):
    with pytest.raises(
        InputError, match=r"gain_db: .* is out of range; expected a number from -60 to 120 dB"
    ):
        Camera.load(RICH).replace({"gain_db": value})


@pytest.mark.parametrize(
    "twenty",
    ["20", "2e1", np.float32(20), np.array([20.0]), torch.nn.Parameter(torch.tensor(20.0))],
    ids=repr,
)
def test_replace_takes_numbers_of_any_type(twenty):
    found = Camera.load(RICH).replace({"gain_db": twenty, "exposure_s": twenty}).values()
    assert (found["gain_db"], found["exposure_s"]) == (20.0, 20.0)
    assert found["gain_e_per_dn"] == pytest.approx(2.0 * 10 ** (-17 / 20))


def test_a_range_of_whole_numbers_has_a_whole_middle():
    camera = Camera.load(RICH).with_effect("jpeg", quality=(50, 85), chroma="full")
    assert camera.values()["jpeg.quality"] in (67.0, 68.0)
    assert camera.spec.randomize["jpeg.quality"] == {"uniform": [50.0, 85.0]}
    assert Camera.load(RICH).with_effect("row_noise", sigma_e=(1, 2)).values()["row_noise.sigma_e"] == 1.5
    with pytest.raises(InputError, match="no_such_effect"):
        camera.with_effect("no_such_effect", sigma_e=(1, 2))


def test_effects_come_and_go():
    camera = Camera.load(RICH)
    assert camera.with_effect("row_noise", sigma_e=0.25).values()["row_noise.sigma_e"] == 0.25
    without = camera.without_effect("row_noise")
    assert without.effect_names == []
    assert "row_noise.sigma_e" not in without.spec.randomize
    assert without.with_effect("row_noise").values()["row_noise.sigma_e"] == 1.0  # the catalogue's default
    with pytest.raises(InputError, match="no_such_effect"):
        camera.with_effect("no_such_effect")


def test_twenty_decibels_are_a_tenth_of_the_electrons():
    camera = Camera.load(RICH)
    assert camera.gain_at(3.0) == 2.0
    assert camera.gain_at(23.0) == pytest.approx(0.2)
    assert camera.gain_at(3.0 - 20 * np.log10(2)) == pytest.approx(4.0)


@pytest.mark.parametrize("gain_db", [0.0, 6.0, 12.0])
@pytest.mark.parametrize("efficiency", [0.3, 0.9])
def test_photon_transfer_follows_the_linear_model(gain_db, efficiency):
    """sigma_y^2 = K^2 (sigma_d^2 + eta mu_p + mu_dark) + 1/12, mu_y = K (eta mu_p + mu_dark) + black level.

    Five standard errors at 18 comparisons of each: a false alarm in 50,000 runs.
    """
    camera = Camera.load(
        {
            "resolution": [200, 250],
            "gain_e_per_dn": 4.0,
            "quantum_efficiency": efficiency,
            "black_level_dn": 50,
            "read_noise": {"sigma_e": 6.0},
            "dark_current": {"a_e_per_s": 20.0, "b_per_c": 0.09},
        }
    )
    k = 1 / camera.gain_at(gain_db)
    dark_e = 0.2 * 20.0 * np.exp(0.09 * 30.0)
    for photons in (0.0, 200.0, 20000.0):
        y = frames(camera, photons, 4, gain_db=gain_db, temperature_c=30.0, exposure_s=0.2).double()
        mean = k * (efficiency * photons + dark_e) + 50
        variance = k**2 * (36 + efficiency * photons + dark_e) + 1 / 12
        n = y.numel()
        assert y.mean().item() == pytest.approx(mean, abs=5 * np.sqrt(variance / n))
        # shape 0.14 and Poisson have a kurtosis near 3, so a variance has the relative error sqrt(2 / n)
        assert y.var().item() == pytest.approx(variance, rel=5 * np.sqrt(2.2 / n))


def test_the_papers_reading_loses_shot_noise_by_the_quantum_efficiency():
    """Its eqs. 8 and 9 give electrons a variance of QE^2 mu_p; physics gives QE mu_p."""
    content = {"resolution": [200, 250], "gain_e_per_dn": 1.0, "quantum_efficiency": 0.5}
    physical = frames(Camera.load(content), 10000.0, 2).double().var().item()
    paper = frames(Camera.load({**content, "reading": "paper"}), 10000.0, 2).double().var().item()
    bound = 5 * np.sqrt(2 / 100_000)
    assert physical == pytest.approx(5000 + 1 / 12, rel=bound)
    assert paper == pytest.approx(
        2500 + 1 / 12 + 1 / 12 + 1 / 12, rel=bound
    )  # rounding twice and the uniform noise


def test_full_well_and_converter_clip():
    camera = Camera.load(
        {"resolution": [200, 250], "gain_e_per_dn": 1.0, "bit_depth": 12, "full_well_e": 3000}
    )
    assert frames(camera, 1e5, 1).unique().tolist() == [3000]
    assert frames(camera.replace({"full_well_e": 1e6}), 1e5, 1).unique().tolist() == [4095]


def test_another_sensor_has_another_pattern_the_same_sensor_the_same():
    camera = Camera.load(
        {"resolution": [200, 250], "gain_e_per_dn": 0.01, "black_level_dn": 5000, "dsnu": {"pixel_e": 5}}
    )
    first, second = frames(camera, 0.0, 2)
    assert torch.equal(first, second)
    other = frames(camera, 0.0, 1, sensor=1)[0]
    correlation = np.corrcoef(first.flatten(), other.flatten())[0, 1]
    assert abs(correlation) < 5 / np.sqrt(50_000)


@pytest.mark.parametrize("gain_db", [-2.0, 13.0])
def test_a_replaced_gain_in_db_acts_from_the_cameras_own_reference(gain_db):
    """10 dB more are 10^-0.5 of the electrons; the read noise in DN tells the gain in use."""
    camera = Camera.load({"resolution": [200, 200], "gain_e_per_dn": 0.9, "gain_db": 3, "black_level_dn": 900,
                          "read_noise": {"sigma_e": 20.0}})  # fmt: skip
    expected = 0.9 * 10 ** ((3 - gain_db) / 20)
    turned = camera.replace({"gain_db": gain_db})
    assert turned.gain_at(gain_db) == pytest.approx(expected)
    assert turned.gain_at(3.0) == pytest.approx(0.9)
    dark = turned.expose(torch.zeros(1, 1, 200, 200), Stream([1], [2], 1, (range(200), range(200))))
    assert dark.std().item() == pytest.approx(20 / expected, rel=5 * (0.5 / 200**2) ** 0.5)


def test_a_gain_replaced_with_its_decibels_is_a_new_reference():
    camera = Camera.load({"resolution": [8, 8], "gain_e_per_dn": 0.9, "gain_db": 3})
    values = camera.replace({"gain_db": 10.0, "gain_e_per_dn": 0.5}).values()
    assert (values["gain_db"], values["gain_e_per_dn"]) == (10.0, 0.5)


def test_a_camera_cannot_be_changed_in_place():
    """Its numbers are worked out once: another gain in `spec` alone would change a part of what it does."""
    camera = Camera.load({"resolution": [8, 8], "gain_e_per_dn": 1.0})
    for part, name in ((camera.spec, "gain_e_per_dn"), (camera.spec.read_noise, "sigma_e")):
        with pytest.raises(ValidationError, match="frozen"):
            setattr(part, name, 5.0)


def test_values_of_no_parameter_are_refused():
    camera = Camera.load({"resolution": [8, 8], "gain_e_per_dn": 1.0})
    stream = Stream([1], [2], 1, (range(8), range(8)))
    with pytest.raises(
        InputError, match=r"read_noise\.sigma: is not a parameter of this camera; expected one of"
    ):
        camera.expose(torch.ones(1, 1, 8, 8), stream, {"read_noise.sigma": 5.0})
    with pytest.raises(InputError, match="gain: is not a parameter"):
        camera.finish(torch.ones(1, 1, 8, 8), values={"gain": 1.0})
