"""What headers and file types say, against what the frames show: bits, mosaics, temperatures, copies, camera files."""

import numpy as np
import pytest

import visaug
from visaug.characterization.facts import look
from visaug.characterization.groups import measure_groups
from visaug.characterization.mosaic import Mosaic
from visaug.frames import FrameRecord, FrameSet

H, W, GAIN, READ, BLACK = 48, 64, 0.4, 4.0, 100.0  # e-/DN, e-, DN


def frame(rng, electrons=0.0, top=4095):
    charge = rng.poisson(np.broadcast_to(electrons, (H, W))) + rng.normal(0, READ, (H, W))
    return np.clip(np.rint(BLACK + charge / GAIN), 0, top).astype(np.uint16)


def sweep(levels=(200, 500, 900, 1300), light=1.0, seed=3, **given):
    rng = np.random.default_rng(seed)
    rows = [("bias", 0.0, 0.0)] * 8 + [("flat", 0.01, e * light) for e in levels for _ in range(4)]
    records = [FrameRecord(i, f"{i}", kind, t, **given) for i, (kind, t, _) in enumerate(rows)]
    return records, [frame(rng, e) for _, _, e in rows]


def test_colours_beside_a_green():
    """Gr stands in a row with R, Gb in one with B: read off the pattern letter by letter."""
    for pattern in ("RGGB", "BGGR", "GRBG", "GBRG"):
        expected = []
        for row in (pattern[:2], pattern[2:]):
            expected += [c if c != "G" else "Gr" if "R" in row else "Gb" for c in row]
        assert list(Mosaic((1, 1, 1, 1), pattern).names) == expected
    assert Mosaic((1, 1, 1, 1), "GBRG").names == ("Gb", "B", "R", "Gr")


@pytest.mark.parametrize(("told", "believed"), [("GRBG", "GRBG"), ("RGGB", None), (None, None)])
def test_flats_contradict_a_header_that_calls_red_and_blue_green(told, believed):
    """Light of GRBG: green 1.2 at (0, 0) and (1, 1). Its responses are 30 standard deviations or more apart."""
    light = np.tile([[1.2, 0.6], [0.9, 1.2]], (H // 2, W // 2))
    records, frames = sweep(light=light, bayer=told)
    result = visaug.characterize(FrameSet.from_arrays(records, frames, bit_depth=12))
    assert ("mosaic_contradicted" in {w.word for w in result.warning_details}) == (told == "RGGB")
    assert set(result.planes) == (set(Mosaic((1, 1, 1, 1), believed).names))


@pytest.mark.parametrize("dtype", [np.uint16, np.int16, np.int32, np.float32, np.float64])
@pytest.mark.parametrize(("levels", "said"), [((200, 900, 1900), False), ((200, 500, 1400), True)])
def test_bits_of_every_type(dtype, levels, said):
    """Flats that pile up at 4095, or reach 3600 DN at most: 12 bits hold them, and an assumption is named."""
    records, frames = sweep(levels)
    result = visaug.characterize(FrameSet.from_arrays(records, [f.astype(dtype) for f in frames]))
    assert result.assumed["bit_depth"] == 12
    assert any(w.startswith("bit_depth_assumed") for w in result.warnings) == said


@pytest.mark.parametrize(("stated", "said"), [(12, False), (14, True), (16, True)])
def test_flats_at_the_top_of_fewer_bits_than_stated_are_named(stated, said):
    records, frames = sweep((200, 900, 1900))
    result = visaug.characterize(FrameSet.from_arrays(records, frames, bit_depth=stated))
    spoiled = {w.word: w.spoils for w in result.warning_details}
    assert ("bit_depth_contradicted" in spoiled) == said
    assert result.assumed["bit_depth"] == stated


def test_a_flat_of_unknown_temperature_is_paired_by_exposure():
    """Dark frames of 0.01 s at 20 degC and of 10 s at 0 degC: the partner of a flat of 0.01 s has its exposure."""
    rng = np.random.default_rng(4)
    rows = [("dark", 0.01, 20.0, 0.0)] * 4 + [("dark", 10.0, 0.0, 300.0)] * 4
    rows += [("flat", 0.01, None, e) for e in (200.0, 900.0) for _ in range(4)]
    records = [FrameRecord(i, f"{i}", kind, t, degrees) for i, (kind, t, degrees, _) in enumerate(rows)]
    frames = FrameSet.from_arrays(records, [frame(rng, e) for *_, e in rows], bit_depth=12)
    levels = measure_groups(frames, look(frames)).levels
    assert [level.dark.group.exposure_s for level in levels] == [0.01, 0.01]
    np.testing.assert_allclose(
        [v.signal for v in levels], [200 / GAIN, 900 / GAIN], rtol=0.01
    )  # of 3072 pixels: 0.1 %


def test_dark_frames_of_another_temperature_are_named():
    rng = np.random.default_rng(5)
    rows = [("dark", 0.01, -30.0, 0.0)] * 4 + [
        ("flat", 0.01, 0.0, e) for e in (200.0, 900.0) for _ in range(4)
    ]
    for degrees, named in ((-30.0, True), (-0.5, False)):
        records = [
            FrameRecord(i, f"{i}", k, t, degrees if k == "dark" else c) for i, (k, t, c, _) in enumerate(rows)
        ]
        frames = FrameSet.from_arrays(records, [frame(rng, e) for *_, e in rows], bit_depth=12)
        details = {w.word: w.spoils for w in visaug.characterize(frames).warning_details}
        assert ("dark_temperature" in details) == named
        assert not named or "prnu.pixel" in details["dark_temperature"]


def test_a_copy_counts_once():
    records, frames = sweep()
    alone = visaug.characterize(FrameSet.from_arrays(records, frames, bit_depth=12))
    twice = [*records, *(FrameRecord(100 + n, f"copy {n}", "flat", 0.01) for n in range(2))]
    result = visaug.characterize(FrameSet.from_arrays(twice, [*frames, frames[-1], frames[-2]], bit_depth=12))
    assert result["gain_e_per_dn"] == alone["gain_e_per_dn"]
    assert any(w.startswith("duplicate_frames") for w in result.warnings)


def test_temperatures_in_kelvin_from_python_and_a_camera_for_every_set():
    """A thermometer beyond what a camera file holds (-150 degC) leaves the camera without that number."""
    for kelvin, celsius, left_out in ((293.15, 20.0, False), (100.0, 100.0, False), (-180.0, -180.0, True)):
        records, frames = sweep(temperature_c=kelvin)
        result = visaug.characterize(FrameSet.from_arrays(records, frames, bit_depth=12))
        assert ("temperature_c" in result.left_out) == left_out
        assert result.to_camera_dict()["gain_e_per_dn"] == pytest.approx(GAIN, rel=0.1)
        if not left_out:
            assert result.to_camera_dict()["temperature_c"] == pytest.approx(celsius)
        assert any(w.startswith("out_of_range") for w in result.warnings) == left_out


def test_patterns_of_windows_at_two_places_are_not_mixed():
    """Every setting in turns in two windows of one size, the first of which counts. Interval of PRNU twice as wide as
    the 95 % one: missed once in 10,000. Over the pixels the map of the response follows PRNU of its window with
    r = 0.95, that of another place with 0 within 0.018 (one standard deviation); the hot pixel is more than 100
    standard deviations above the others.
    """
    rng = np.random.default_rng(81)
    prnu, dark = rng.normal(0, 0.02, (80, 104)), np.full((80, 104), 5.0)
    dark[20, 30] = 300.0  # e-/s; in the first window alone
    places = [(0, 48, 0, 64), (32, 80, 40, 104)]
    settings = [("bias", 0.0, 0.0)] * 8 + [("dark", t, 0.0) for t in (1.0, 5.0) for _ in range(8)]
    settings += [("flat", 0.01, e) for e in (200.0, 500.0, 900.0, 1300.0) for _ in range(8)]
    records, frames = [], []
    for i, (kind, t, e) in enumerate(settings):
        r0, r1, c0, c1 = place = places[i % 2]
        electrons = (e * (1 + prnu) + t * dark)[r0:r1, c0:c1]
        records.append(FrameRecord(i, f"{i}", kind, t, 20.0, photons=e / 0.5 or None, window=place))
        frames.append(frame(rng, electrons))
    result = visaug.characterize(FrameSet.from_arrays(records, frames, bit_depth=12))
    e = result["prnu.pixel"]
    assert 2 * e.low - e.value <= 0.02 <= 2 * e.high - e.value
    assert np.corrcoef(result.maps["response"].ravel(), prnu[:48, :64].ravel())[0, 1] > 0.9
    assert result.maps["dark_current"][20, 30] > 200
    assert np.argwhere(result.maps["defects"]).tolist() == [[20, 30]]


def test_defects_of_another_place_are_not_marked():
    """Dark frames in one window, bias frames and flats in another of that size: an unsteady pixel of the other.

    The probability that a sound pixel deviates by 8 standard deviations is below 1e-10.
    """
    rng = np.random.default_rng(82)
    places = {"dark": (0, 48, 0, 64), "bias": (32, 80, 40, 104), "flat": (32, 80, 40, 104)}
    settings = [("bias", 0.0, 0.0)] * 16 + [("dark", t, 0.0) for t in (1.0, 5.0) for _ in range(4)]
    settings += [("flat", 0.01, e) for e in (300.0, 900.0) for _ in range(4)]
    records, frames = [], []
    for i, (kind, t, e) in enumerate(settings):
        records.append(FrameRecord(i, f"{i}", kind, t, 20.0, photons=e / 0.5 or None, window=places[kind]))
        frames.append(frame(rng, e + 5 * t))
        if kind == "bias":
            frames[-1][7, 9] = 600 if i % 2 else 150
    assert not visaug.characterize(FrameSet.from_arrays(records, frames, bit_depth=12)).maps["defects"].any()
