"""What the name of a file says, and what it leaves open because it can be read in two ways."""

import pytest

from visaug.frames.names import kind_of, kind_of_name, read_name


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("FLAT_0.10s_gain100_offset50_0001.tif", "flat"),
        ("offset50/DARK_3.tif", "dark"),
        ("offset_001.fits", "bias"),  # French and Italian programs call bias frames so
        ("offsets/1.fits", "bias"),
        ("offset50_0001.fits", None),
        ("FLAT_reverse_bias_30V_0001.tif", "flat"),
        ("reverse_bias_30V_dark_1s.tif", "dark"),
        ("zero_gain_flat_1.tif", "flat"),
        ("zero_004.fits", "bias"),
        ("flat_light3_1.tif", "flat"),
        ("darkflat_2s.tif", "dark"),
        ("ledflats/3.tif", "flat"),
        ("superdark_2.fits", "dark"),
        ("inflation_darkness.tif", None),
    ],
)
def test_kind(name, kind):
    assert read_name(name).facts.get("kind") == kind
    assert kind_of_name(name) == kind


@pytest.mark.parametrize("text", ["FLAT,LAMP", "DOMEFLAT", "cflat", "Flat Field", "Sky Flats"])
def test_kinds_of_observatories(text):
    assert kind_of(text) == "flat"


@pytest.mark.parametrize(
    ("part", "seconds"),
    [
        ("0.10s", 0.1),
        ("250us", 250e-6),
        ("12.5ms", 0.0125),
        ("30.00sec", 30.0),
        ("1_100s", 0.01),
        ("1-250s", 0.004),
        ("1e-3s", 1e-3),
        ("0_5s", 0.5),
        ("0_25ms", 0.25e-3),
        ("1m30s", 90.0),
        ("2min", 120.0),
        ("003_2s", 2.0),
        ("20260301_2s", 2.0),
        ("2026-03-01_22-05-10_2s", 2.0),
        ("gain_100_10s", 10.0),
        ("exp10ms", 0.01),
        ("T22-05-10s", None),  # a time of day
        ("3_2s", None),  # 3.2 s, or frame 3 of 2 s
        ("10-20s", None),
        ("A7s", None),  # a camera
    ],
)
def test_exposure(part, seconds):
    for name in (f"dark_{part}_0001.tif", f"{part}/dark_0001.fits", f"dark_{part}.npy"):
        found = read_name(name).facts.get("exposure_s")
        assert found == (None if seconds is None else pytest.approx(seconds, rel=1e-9))


@pytest.mark.parametrize(
    ("part", "degrees"),
    [
        ("20C", 20.0),
        ("-10C", -10.0),
        ("−10C", -10.0),
        ("+20C", 20.0),
        ("-05C", -5.0),
        ("m10C", -10.0),
        ("minus10C", -10.0),
        ("minus_10C", -10.0),
        ("T25_5C", 25.5),
        ("12_5C", None),
        ("m10_5C", -10.5),
        ("T-10C", -10.0),
        ("temp-10degC", -10.0),
        ("-10.00C", -10.0),
        ("QHY268C", None),
        ("QHY_8C", None),
        ("Altair183C", None),
        ("QHY8C_-10C", -10.0),
        ("x-10C", None),  # a dash or a minus
        ("999C", None),
    ],
)
def test_temperature(part, degrees):
    assert read_name(f"dark_{part}_2s_0001.tif").facts.get("temperature_c") == degrees


@pytest.mark.parametrize(
    ("name", "setting"),
    [
        ("flat_gain100_offset50_1.tif", "GAIN=100 OFFSET=50"),
        ("gain_100/flat_1.tif", "GAIN=100"),
        ("flat_gain_100_0001.tif", "GAIN=100"),
        ("flat_gain1.5_0001.tif", "GAIN=1.5"),
        ("dark_zero_gain_0001.tif", None),  # a running number
        ("dark_gain_7.tif", None),
        ("dark_gain12dB.tif", None),
    ],
)
def test_setting(name, setting):
    assert read_name(name).facts.get("setting") == setting


def test_words_and_what_is_unclear():
    found = read_name("darks/x_1_100s_m10C_1.tif")
    assert found.words == {"kind": "darks", "exposure_s": "1_100s", "temperature_c": "m10c"}
    assert read_name("dark_3_2s.tif").unclear == ["3_2s"]
    # the nearer name does not confirm the folder's
    assert "exposure_s" not in read_name("dark_5s/3_2s.tif").facts
