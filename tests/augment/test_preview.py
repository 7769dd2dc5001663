"""The numbers below a preview are the noise's standard deviation."""

import os

import numpy as np
import pytest

from visaug import Camera
from visaug.augment import SensorNoise
from visaug.augment.image_io import Picture
from visaug.augment.preview import LEVELS, MIDDLE, VISIBLE, liveliest, middle, noise_by_level, shown, visible


def test_noise_by_level_is_shot_and_read_noise():
    gain, read = 0.4, 12.0
    camera = Camera.load(
        {"resolution": [64, 64], "bit_depth": 12, "gain_e_per_dn": gain, "read_noise": {"sigma_e": read}}
    )
    picture = Picture(np.zeros((10, 10, 1), np.uint8))
    full = 4095 * gain
    expected = [255 * (level / 255 * full + read**2) ** 0.5 / full for level in LEVELS]
    # 147,456 pixels: relative standard error 0.2 %; the lowest level lies 2.3 deviations above black, 242 2.0 below white.
    measured = noise_by_level(picture, SensorNoise(camera), seed=3)
    assert measured[1:4] == pytest.approx(expected[1:4], rel=0.02)
    assert measured[0] == pytest.approx(expected[0], rel=0.05)


def test_gain_and_exposure_are_chosen_where_noise_shows_and_kept_where_given():
    """Shot noise alone at level 128 is 255 sqrt(0.5 / full) levels: 2.8 at 4095 e-, 11 at a sixteenth of that (24 dB)."""
    camera = Camera.load({"resolution": [64, 64], "bit_depth": 12, "gain_e_per_dn": 1.0})
    picture = Picture(np.zeros((10, 10, 1), np.uint8))
    noise, words = visible(picture, camera, seed=0)
    assert noise_by_level(picture, noise, 0, (MIDDLE,))[0] >= VISIBLE
    assert (noise.gain_db, noise.exposure, words) == (
        (24, 24), (1, 1), "gain 24 dB (chosen), exposure 1 (chosen)",
    )  # fmt: skip
    noise, words = visible(picture, camera, seed=0, gain_db=0, exposure=1.0)
    assert noise_by_level(picture, noise, 0, (MIDDLE,))[0] < VISIBLE
    assert words == "gain 0 dB, exposure 1"


def test_the_magnified_part_lies_where_levels_are_middling():
    crop = np.zeros((60, 80, 3), np.uint8)
    crop[:30], crop[40:, 60:] = 255, 128
    part = liveliest(crop, 20, 20)
    assert (crop[part] == 128).all()


def test_the_window_is_the_middle_and_shows_the_picture():
    pixels = np.arange(20 * 30, dtype=np.uint16).reshape(20, 30, 1) * 100
    window = middle(Picture(pixels), 4, 6)
    assert (window[0].start, window[1].start) == (8, 12)
    crop = shown(Picture(pixels), window)
    assert crop.shape == (4, 6, 3)
    assert (crop[..., 1] == np.round(pixels[8:12, 12:18, 0] * (255 / 65535))).all()
    assert middle(Picture(pixels), 400, 600) == (slice(0, 20), slice(0, 30))
    bright = shown(Picture(np.full((2, 2, 3), 0.2140, np.float32)), (slice(None), slice(None)))
    assert bright[0, 0, 0] == pytest.approx(127.5, abs=1)  # light of 0.214 is sRGB's middle


def test_a_sheet_replaces_a_sheet_and_nothing_else(tmp_path):
    from PIL import Image

    from visaug import InputError
    from visaug.report.preview import write_preview

    Image.fromarray(np.full((12, 16, 3), 90, np.uint8)).save(tmp_path / "photo.png")
    camera = Camera.load({"resolution": [16, 16], "gain_e_per_dn": 0.4})
    for _ in range(2):
        write_preview(tmp_path / "photo.png", [camera], tmp_path / "sheet.png")
    kept = (tmp_path / "photo.png").read_bytes()
    with pytest.raises(InputError, match="no sheet of visaug"):
        write_preview(tmp_path / "photo.png", [camera], tmp_path / "photo.png")
    assert (tmp_path / "photo.png").read_bytes() == kept
    write_preview(tmp_path / "sheet.png", [camera], tmp_path / "photo.png", force=True)


def test_a_name_that_is_not_utf8_gets_a_sheet(tmp_path):
    from PIL import Image

    from visaug.report.preview import write_preview

    Image.fromarray(np.full((12, 16, 3), 90, np.uint8)).save(tmp_path / "photo.png")
    odd = tmp_path / os.fsdecode(b"caf\xe9.png")
    try:
        (tmp_path / "photo.png").rename(odd)
    except OSError:
        pytest.skip("the file system takes UTF-8 alone")
    camera = Camera.load({"resolution": [16, 16], "gain_e_per_dn": 0.4})
    write_preview(odd, [camera], tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").is_file()


@pytest.mark.parametrize(
    ("values", "bits", "told"),
    [
        (
            np.full((12, 16), 64810, np.uint16),
            12,
            r"a\.npy: bits: contains the value 64810; expected at most 4095",
        ),
        (np.full((12, 16), 90, np.uint8), 12, r"a\.npy: bits: 12 bit are given for an image of uint8"),
        (np.full((12, 16), np.nan, np.float32), None, r"a\.npy: holds no pixel with light"),
    ],
)
def test_a_picture_that_cannot_be_shown_is_one_clear_line(values, bits, told, tmp_path):
    from visaug import InputError
    from visaug.report.preview import write_preview

    np.save(tmp_path / "a.npy", values)
    camera = Camera.load({"resolution": [16, 16], "gain_e_per_dn": 0.4})
    with pytest.raises(InputError, match=told):
        write_preview(tmp_path / "a.npy", [camera], tmp_path / "sheet.png", bits=bits)
    assert not (tmp_path / "sheet.png").exists()


@pytest.mark.filterwarnings("error")
def test_pixels_without_a_number_are_black():
    light = np.array([[[np.nan], [np.inf], [-np.inf], [1.0]]], np.float32)
    assert shown(Picture(light), (slice(None), slice(None)))[0, :, 0].tolist() == [0, 255, 0, 255]


@pytest.mark.parametrize(("top", "clipped"), [(1.0, False), (40.0, True)])
def test_a_picture_that_is_clipped_is_said(tmp_path, top, clipped):
    """As a render of high dynamic range, most of which would be white."""
    from visaug.report.preview import write_preview

    camera = Camera.load({"resolution": [16, 16], "gain_e_per_dn": 0.4})
    np.save(tmp_path / "a.npy", np.linspace(0, top, 40 * 40, dtype=np.float32).reshape(40, 40))
    said = write_preview(tmp_path / "a.npy", [camera], tmp_path / "sheet.png")
    assert said.endswith(", values outside [0, 1] clipped") == clipped
