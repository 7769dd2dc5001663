"""What a header says: kinds, units, temperatures, settings, overscan, mosaics, calibrated frames."""

import numpy as np
import pytest
from astropy.io import fits

from visaug.core.errors import InputError
from visaug.frames import FrameSet, read_table
from visaug.frames.units import celsius, seconds

RNG = np.random.default_rng(5)
PIXELS = RNG.integers(100, 4000, (6, 10)).astype(np.uint16)


def write(folder, name, pixels=PIXELS, /, **cards):
    header = fits.Header()
    for key, value in cards.items():
        header[key.replace("__", " ").replace("_", "-")] = value
    fits.PrimaryHDU(pixels, header).writeto(folder / name)


def load(folder, *cards, **more):
    for n, own in enumerate(cards):
        write(folder, f"{n}.fits", **{"IMAGETYP": "bias", **own, **more})
    return FrameSet.load(folder)


def words(frames):
    return {w.split(":")[0] for w in frames.warnings}


@pytest.mark.parametrize(
    ("card", "kind"),
    [
        ({"IMGTYPE": "FLAT"}, "flat"),
        ({"CALTYPE": "dark"}, "dark"),
        ({"HIERARCH ESO DPR TYPE": "FLAT,LAMP"}, "flat"),
        ({"FRAME": "unknown", "CALTYPE": "bias"}, "bias"),
        ({"IMAGETYP": "offset"}, "bias"),
    ],
)
def test_kinds_under_other_keywords(tmp_path, card, kind):
    header = fits.Header([("EXPTIME", 1.0), *card.items()])
    fits.PrimaryHDU(PIXELS, header).writeto(tmp_path / "a.fits")
    assert FrameSet.load(tmp_path).records[0].kind == kind


@pytest.mark.parametrize(
    ("value", "comment", "unit", "expected"),
    [
        (2, "", "", 2.0),
        (500, "[ms] exposure time", "", 0.5),
        (500, "exposure in microseconds", "", 500e-6),
        (500, "", "ms", 0.5),
        (0.1, "minimum of two", "", 0.1),
        ("20 ms", "", "", 0.02),
        ("1/100", "", "", 0.01),
        (3, "[s] exposure", "ms", 3.0),
        (2, "[hr]", "", 7200.0),
        (2, "exposure in minutes", "", 120.0),
        (3, "seconds (min 0.1)", "", 3.0),
    ],
)
def test_units_of_exposures(value, comment, unit, expected):
    assert seconds(value, comment, unit) == pytest.approx(expected)


def test_units_in_a_file(tmp_path):
    frames = load(
        tmp_path, {"IMAGETYP": "dark", "EXPTIME": 250}, {"IMAGETYP": "dark", "EXPTIME": 250}, TIMEUNIT="ms"
    )
    assert [r.exposure_s for r in frames.records] == [0.25, 0.25]
    assert "exposure_unit" in words(frames)


@pytest.mark.parametrize(
    ("value", "degrees"),
    [
        (-273.15, None),
        (-999.0, None),
        (999, None),
        (9999, None),
        (-128.5, -128.5),
        (263.15, -10.0),
        (6553.5, None),
        (20, 20.0),
    ],
)
def test_temperatures_that_are_none_or_kelvin(tmp_path, value, degrees):
    frames = load(tmp_path, {"CCD-TEMP": value})
    assert frames.records[0].temperature_c == (None if degrees is None else pytest.approx(degrees))
    said = {"temperature_unknown", "temperature_kelvin"} & words(frames)
    assert said == (
        {"temperature_unknown"} if degrees is None else {"temperature_kelvin"} if value > 150 else set()
    )


def test_kelvin_by_its_unit_and_in_a_table(tmp_path):
    assert celsius(120.0, "[K] detector") == (pytest.approx(-153.15), "kelvin")
    (tmp_path / "frames.csv").write_text(
        "file,kind,temperature_c\na.npy,bias,263.15\nb.npy,bias,-999\nc.npy,bias,-20\n"
    )
    warnings = []
    degrees = [r.temperature_c for r in read_table(tmp_path / "frames.csv", warnings)]
    assert degrees == [pytest.approx(-10.0), None, -20.0]
    assert [w.split(":")[0] for w in warnings] == ["temperature_kelvin", "temperature_unknown"]


def test_gain_is_a_setting_or_a_measured_gain(tmp_path):
    for name, gains, settings, word in (
        ("setting", (100, 100, 200), ["GAIN=100", "GAIN=100", "GAIN=200"], "setting"),
        ("scatters", (1.501, 1.5, 1.499), [None] * 3, "gain_measured"),
        ("lacking", (100, 100, None), ["GAIN=100"] * 3, "setting_assumed"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        frames = load(folder, *({} if g is None else {"GAIN": g} for g in gains))
        assert [r.setting for r in frames.records] == settings
        assert word in words(frames)
    header = fits.Header([("IMAGETYP", "bias"), ("GAIN", 1.5, "[e-/ADU] gain")])
    (tmp_path / "unit").mkdir()
    fits.PrimaryHDU(PIXELS, header).writeto(tmp_path / "unit" / "a.fits")
    assert FrameSet.load(tmp_path / "unit").records[0].setting is None


def test_two_bodies_are_two_settings(tmp_path):
    frames = load(tmp_path, {"SERIAL": "A1"}, {"SERIAL": "B2"}, {"SERIAL": "A1"}, INSTRUME="ZWO 183")
    one, other, again = (r.setting for r in frames.records)
    assert one == again != other
    assert "setting" in words(frames)
    (tmp_path / "one").mkdir()
    assert load(tmp_path / "one", {}, {}, INSTRUME="ZWO 183").records[0].setting is None


@pytest.mark.parametrize(
    "card",
    [
        {"CALSTAT": "BD"},
        {"CALSTAT": "F"},
        {"ZEROCOR": "Zero level correction done"},
        {"BIASSUB": True},
        {"BUNIT": "electron"},
        {"BUNIT": "adu/s"},
        {"BUNIT": "DN sec^-1"},
        {"BUNIT": "MJy/sr"},
    ],
)
def test_calibrated_frames_are_left_out(tmp_path, card):
    frames = load(tmp_path, {}, {}, card)
    assert [r.file for r in frames.records] == ["0.fits", "1.fits"]
    assert "calibrated_frames" in words(frames)
    (tmp_path / "all").mkdir()
    with pytest.raises(InputError, match="calibrated already"):
        load(tmp_path / "all", card)


@pytest.mark.parametrize(
    "card",
    [
        {"CALSTAT": ""},
        {"CALSTAT": "none"},
        {"CALSTAT": "RAW"},
        {"ZEROCOR": False},
        {"FLATCORR": "PERFORM"},
        {"DARKCORR": "OMIT"},
        {"BUNIT": "adu"},
        {"BUNIT": "counts/sample"},
        {"BUNIT": "electronic units"},
    ],
)
def test_frames_that_were_not_calibrated_stay(tmp_path, card):
    assert len(load(tmp_path, {}, card)) == 2


@pytest.mark.parametrize("comment", ["[F]", "degrees Fahrenheit", "[mK]"])
def test_other_degrees_are_not_taken_for_celsius(comment):
    assert celsius(68.0, comment) == (None, "none")


@pytest.mark.parametrize(
    ("card", "word"),
    [
        ({"EXPTIME": 2.0, "EXPOSURE": 2000.0}, "exposure_contradicted"),
        ({"EXPTIME": 2.0, "EXPOSURE": 2.01}, None),
        ({"EXPTIME": 0.5, "EXPOINUS": 500000}, None),
        ({"IMAGETYP": "dark", "OBSTYPE": "flat"}, "kind_contradicted"),
        ({"IMAGETYP": "dark", "OBSTYPE": "Dark Frame"}, None),
    ],
)
def test_headers_that_contradict_themselves(tmp_path, card, word):
    said = words(load(tmp_path, {**card, "EXPTIME": card.get("EXPTIME", 2.0)}))
    assert {w for w in said if w.endswith("_contradicted")} == ({word} if word else set())


@pytest.mark.parametrize("name", ["SNAPSHOT", "COADDS", "NCOADDS"])
def test_frames_that_the_camera_combined(tmp_path, name):
    assert [r.combined for r in load(tmp_path, {name: 4}, {name: 1}).records] == [4, 1]


@pytest.mark.parametrize("name", ["EMGAIN", "PREAMP", "ISO"])
def test_other_gains_are_settings(tmp_path, name):
    assert [r.setting for r in load(tmp_path, {name: 1}, {name: 100}).records] == [f"{name}=1", f"{name}=100"]


def test_black_levels_are_settings(tmp_path):
    frames = load(tmp_path, {"BLKLEVEL": 10}, {"BLKLEVEL": 40})
    assert [r.setting for r in frames.records] == ["BLKLEVEL=10", "BLKLEVEL=40"]


@pytest.mark.parametrize(
    ("values", "bits"),
    [((4095, 4095), 12), ((4095, 3000), None), ((65535, 65535), None), ((4000, 4000), None)],
)
def test_bits_from_the_largest_value(tmp_path, values, bits):
    """A value that differs from file to file is each frame's own maximum."""
    frames = load(tmp_path, *({"DATAMAX": v} for v in values))
    assert {r.bit_depth for r in frames.records} == {bits}


@pytest.mark.parametrize(
    ("cards", "kept"),
    [
        ({"BIASSEC": "[9:10,1:6]"}, (slice(None), slice(0, 8))),
        ({"BIASSEC": "[1:2,1:6]"}, (slice(None), slice(2, None))),
        ({"BIASSEC": "[1:10,6:6]"}, (slice(0, 5), slice(None))),
        ({"OVERSCAN": "[9 10 1 6]"}, (slice(None), slice(0, 8))),
        ({"CCDSEC": "[1:8,1:6]"}, (slice(None), slice(0, 8))),
        (
            {"CCDSEC": "[101:110,1:6]"},
            (slice(None), slice(None)),
        ),  # a window of the sensor, as large as the file
        ({"BIASSEC": "[5:6,1:6]"}, (slice(None), slice(None))),  # between two halves
        ({"TRIMSEC": "[2:9,2:5]", "BIASSEC": "[10:10,1:6]"}, (slice(1, 5), slice(1, 9))),
    ],
)
def test_overscan(tmp_path, cards, kept):
    frames = load(tmp_path, cards)
    np.testing.assert_array_equal(frames.read(0), PIXELS[kept])
    said = [w for w in frames.warnings if w.startswith("overscan")]
    assert bool(said) == ("CCDSEC" not in cards or "1:8" in cards["CCDSEC"])
    assert all(("not cut off" in w) == (cards.get("BIASSEC") == "[5:6,1:6]") for w in said)


COLOURS = np.array(list("RGGB")).reshape(2, 2)


@pytest.mark.parametrize("rows", [6, 7])
@pytest.mark.parametrize("order", ["TOP-DOWN", "BOTTOM-UP"])
@pytest.mark.parametrize("trim", [None, "[2:9,1:6]", "[1:10,2:6]"])
def test_mosaic_at_the_frames_own_corner(tmp_path, rows, order, trim):
    """The picture is made from its top; the file holds it in the order that ROWORDER names."""
    picture = np.array([[ord(COLOURS[r % 2, c % 2]) for c in range(10)] for r in range(rows)], np.uint16)
    stored = picture[::-1] if order == "BOTTOM-UP" else picture
    cards = {"IMAGETYP": "bias", "BAYERPAT": "RGGB", "ROWORDER": order, **({"TRIMSEC": trim} if trim else {})}
    write(tmp_path, "a.fits", np.ascontiguousarray(stored), **cards)
    frames = FrameSet.load(tmp_path)
    seen = "".join(chr(int(v)) for v in frames.read(0)[:2, :2].ravel())
    assert frames.records[0].bayer == seen
