"""camera.yaml: what is taken, what is refused, and by which name."""

import math
from pathlib import Path

import pytest

from visaug.camera import Camera
from visaug.core.errors import InputError

PLAIN = {"name": "plain", "resolution": [20, 30], "gain_e_per_dn": 0.5}

FULL = """
name: hidden camera
resolution: [200, 256]            # rows, columns
bit_depth: 16
reading: physical
quantum_efficiency: 0.61
gain_e_per_dn: 0.19
gain_db: 0
black_level_dn: 240
full_well_e: 11000
exposure_s: 0.01
temperature_c: 20
read_noise: {sigma_e: 2.37, shape: -0.1}
dark_current: {a_e_per_s: 0.136, b_per_c: 0.14}
prnu: {column: 0.002, row: 0.0015, pixel: 0.006}
dsnu: {column_e: 1.4, row_e: 0.3, pixel_e: 1.1}
effects:
  - {name: row_noise, sigma_e: 1.2}
randomize:
  gain_db: {std: 2.0}
  read_noise.sigma_e: 0.2
  row_noise.sigma_e: 0.5
"""


def with_values(**values):
    return {**PLAIN, **values}


def test_a_full_file_is_read(tmp_path: Path):
    (tmp_path / "camera.yaml").write_text(FULL)
    camera = Camera.load(tmp_path / "camera.yaml")
    assert camera.resolution == (200, 256)
    assert camera.bit_depth == 16
    values = camera.values()
    assert values["read_noise.shape"] == -0.1
    assert values["row_noise.sigma_e"] == 1.2
    assert values["full_well_e"] == 11000
    assert camera.effect_names == ["row_noise"]
    assert camera.choices() == {"read_noise.meaning": "standard_deviation"}


@pytest.mark.parametrize(
    ("content", "path"),
    [
        (with_values(gian_db=3), "gian_db"),
        (with_values(read_noise={"sigma": 1}), "read_noise.sigma"),
        (with_values(read_noise={"sigma_e": -1}), "read_noise.sigma_e"),
        (with_values(read_noise={"sigma_e": math.nan}), "read_noise.sigma_e"),
        (with_values(read_noise={"shape": -0.6}), "read_noise.shape"),
        (with_values(read_noise={"meaning": "width"}), "read_noise.meaning"),
        (with_values(quantum_efficiency=61), "quantum_efficiency"),
        (with_values(gain_e_per_dn=0), "gain_e_per_dn"),
        (with_values(gain_e_per_dn="a lot"), "gain_e_per_dn"),
        (with_values(resolution=[0, 30]), "resolution"),
        (with_values(resolution=[30]), "resolution"),
        (with_values(bit_depth=17), "bit_depth"),
        (with_values(reading="letter"), "reading"),
        (with_values(full_well_e=0), "full_well_e"),
        (with_values(exposure_s=-1), "exposure_s"),
        (with_values(dark_current={"a_e_per_s": 1, "doubling_c": 8}), "dark_current"),
        (with_values(dark_current={"reference_e_per_s": 1, "doubling_c": 8}), "dark_current"),
        (  # a file with a and b of this could not be read again
            with_values(
                dark_current={"reference_e_per_s": 1, "reference_temperature_c": 20, "doubling_c": 1.2}
            ),
            "dark_current.b_per_c",
        ),
        (with_values(prnu={"pixel": 0.9}), "prnu.pixel"),
        (with_values(gain_db=True), "gain_db"),  # which a lax reader takes for 1
        (with_values(bit_depth=True), "bit_depth"),
        (with_values(read_noise={"sigma_e": False}), "read_noise.sigma_e"),
        (with_values(resolution=[True, 30]), "resolution.0"),
        (with_values(randomize={"gain_db": {"std": True}}), "randomize.gain_db.std"),
        (with_values(effects=[{"name": "row_noise", "sigma_e": True}]), "effects.0.sigma_e"),
        (with_values(effects=[{"name": "no_such_thing"}]), "effects.0.name"),
        (with_values(effects=[{"sigma_e": 1}]), "effects.0.name"),
        (with_values(effects=[{"name": "read_noise"}]), "effects.0.name"),  # a base term is no further effect
        (with_values(effects=[{"name": "row_noise", "sigma": 1}]), "effects.0.sigma"),
        (with_values(effects=[{"name": "row_noise", "sigma_e": -1}]), "effects.0.sigma_e"),
        (with_values(effects=[{"name": "row_noise", "sigma_e": "much"}]), "effects.0.sigma_e"),
        (with_values(effects=[{"name": "row_noise", "sigma_e": math.inf}]), "effects.0.sigma_e"),
        (with_values(effects=[{"name": "row_noise"}, {"name": "row_noise"}]), "effects"),
        (with_values(randomize={"gain": 1}), "randomize.gain"),
        (with_values(randomize={"row_noise.sigma_e": 1}), "randomize.row_noise.sigma_e"),  # it has none
        (with_values(randomize={"gain_db": {"range": 1}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": -1}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"half_normal": -1}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"uniform": 3}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"uniform": [3, 2]}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"uniform": [3, 200]}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"std": [3, 20]}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"std": 1, "uniform": [0, 1]}}), "randomize.gain_db"),
        (with_values(randomize={"gain_db": {"log_uniform": [0, 3]}}), "randomize.gain_db"),
        (
            with_values(bit_depth=8, randomize={"black_level_dn": {"uniform": [1, 255]}}),
            "randomize.black_level",
        ),
        (with_values(correlated=[["gain_db", "gain", 0.2]]), "correlated.0"),
        (
            with_values(correlated=[["gain_db", "exposure_s", 0.2], ["exposure_s", "gain_db", 0.3]]),
            "correlated.1",
        ),
        (with_values(correlated=[["gain_db", "gain_db", 0.2]]), "correlated.0"),
        (with_values(correlated=[["gain_db", "exposure_s", 1.0]]), "correlated.0"),
        (with_values(correlated=[["gain_db", "exposure_s"]]), "correlated.0"),
        (
            with_values(
                randomize={"gain_db": {"std": 1}, "exposure_s": 0.1, "temperature_c": {"std": 1}},
                correlated=[
                    ["gain_db", "exposure_s", 0.9],
                    ["exposure_s", "temperature_c", 0.9],
                    ["gain_db", "temperature_c", -0.9],
                ],
            ),
            "correlated",
        ),
        (with_values(read_noise={"shape": -0.4}), "read_noise.shape"),
        (with_values(read_noise={"after_gain_dn": -1}), "read_noise.after_gain_dn"),
        ({"name": "no gain", "resolution": [20, 30]}, "gain_e_per_dn"),
    ],
)
def test_what_is_refused_names_its_key_in_one_line(content, path):
    with pytest.raises(InputError) as caught:
        Camera.load(content)
    assert caught.value.field.startswith(path)
    assert path in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"read_noise": 6},
            "read_noise: has no keys of its own (got 6); expected for example {sigma_e: 6.0}",
        ),
        ({"effects": "row_noise"}, "effects: is not a list (got 'row_noise'); expected for example [{name: "),
        ({"gain_e_per_dn": "two"}, "gain_e_per_dn: is not a number (got 'two')"),
        (
            {"resolution": [0, 4]},
            "resolution: rows and columns are each from 1 to 65535 (got [0, 4]); expected [rows, columns]",
        ),
        ({"resolution": [1, 2, 3]}, "resolution: has too many entries (got [1, 2, 3]); expected [rows, "),
    ],
)
def test_a_value_of_another_kind_is_told_with_an_example(wrong, said):
    with pytest.raises(InputError) as caught:
        Camera.load({"resolution": [8, 8], "gain_e_per_dn": 0.5, **wrong})
    assert said in str(caught.value)


@pytest.mark.parametrize("text", ["- a\n- b\n", "", "name: [\n", "\x00"])
def test_what_is_no_camera_file_names_the_file(tmp_path: Path, text):
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.raises(InputError, match=r"camera\.yaml") as caught:
        Camera.load(tmp_path / "camera.yaml")
    assert "\n" not in str(caught.value)


def test_an_unknown_name_lists_the_shipped_ones():
    with pytest.raises(InputError, match="sony_imx174"):
        Camera.load("sony_imx175")


def test_numbers_that_yaml_takes_for_words_are_numbers(tmp_path: Path):
    text = "resolution: [8, 8]\ngain_e_per_dn: 1e-1\neffects: [{name: row_noise, sigma_e: 2e-1}]\n"
    (tmp_path / "camera.yaml").write_text(text)
    values = Camera.load(tmp_path / "camera.yaml").values()
    assert values["gain_e_per_dn"] == 0.1
    assert values["row_noise.sigma_e"] == 0.2


def test_a_datasheets_dark_current_doubles_as_told():
    datasheet = {"reference_e_per_s": 3.0, "reference_temperature_c": 45.0, "doubling_c": 7.0}
    values = Camera.load(with_values(dark_current=datasheet)).values()

    def dark_current(temperature_c):
        a, b = values["dark_current.a_e_per_s"], values["dark_current.b_per_c"]
        return a * math.exp(b * temperature_c)

    assert dark_current(45.0) == pytest.approx(3.0)
    assert dark_current(52.0) == pytest.approx(6.0)
    assert dark_current(38.0) == pytest.approx(1.5)


@pytest.mark.parametrize(("bits", "black"), [(12, 4095), (12, 5000), (8, 255)])
def test_a_black_level_that_leaves_no_range_is_refused(bits, black):
    with pytest.raises(InputError, match="black_level_dn"):
        Camera.load(with_values(bit_depth=bits, black_level_dn=black))


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [({"prnu": {"pixel": 0.8}}, "0.008 for 0.8 %"), ({"quantum_efficiency": 60}, "0.6 for 60 %")],
)
def test_a_share_in_per_cent_is_told_as_a_fraction(wrong, hint):
    with pytest.raises(InputError, match=f"a fraction: {hint}"):
        Camera.load({"resolution": [8, 8], "gain_e_per_dn": 0.5, **wrong})


@pytest.mark.parametrize(
    ("spread", "value"),
    [
        ({"gain_db": 0.5}, "0"),
        ({"full_well_e": {"half_normal": 5.0}}, "inf"),
        ({"gain_db": {"std": 0.5}}, None),
        ({"gain_db": 0}, None),
        ({"exposure_s": 0.5}, None),
        ({"full_well_e": {"uniform": [10, 20]}}, None),
    ],
)
def test_a_spread_around_nothing_is_said(spread, value, caplog):
    Camera.load({"resolution": [8, 8], "gain_e_per_dn": 1.0, "randomize": spread})
    (path, given), expected = *spread.items(), "another law, such as {uniform: [a, b]}: the value is"
    said = f"randomize.{path} = {given} has no effect; expected {expected} {value}"
    assert caplog.messages == ([] if value is None else [said])
