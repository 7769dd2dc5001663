"""FITS as observatories and amateurs write it, each file made by astropy."""

import numpy as np
import pytest
from astropy.io import fits

from visaug.core.errors import InputError
from visaug.frames import FrameSet

RNG = np.random.default_rng(21)


def write(path, pixels, **header):
    unit = fits.PrimaryHDU(pixels)
    unit.header.update({k.replace("_", "-") if k == "CCD_TEMP" else k: v for k, v in header.items()})
    unit.writeto(path)


def pixels(shape=(6, 8)):
    return RNG.integers(100, 5000, shape, dtype=np.uint16)


@pytest.mark.parametrize("ending", [".fits.fz", ".fits.gz", ".fts"])
def test_packed_files_are_read(tmp_path, ending):
    image = pixels((20, 30))
    header = fits.Header({"IMAGETYP": "Bias Frame"})
    if ending == ".fits.fz":
        fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(image, header)]).writeto(tmp_path / f"a{ending}")
    else:
        fits.PrimaryHDU(image, header).writeto(tmp_path / f"a{ending}")
    frames = FrameSet.load(tmp_path)
    assert [r.kind for r in frames.records] == ["bias"]
    np.testing.assert_array_equal(frames.read(0), image)


def test_a_cube_is_a_frame_for_each_slice(tmp_path):
    cube = pixels((3, 6, 8))
    write(tmp_path / "cube.fits", cube, OBSTYPE="DARK", EXPTIME=4.0, CCD_TEMP=-7.5)
    frames = FrameSet.load(tmp_path)
    assert [(r.file, r.kind, r.exposure_s, r.temperature_c) for r in frames.records] == [
        (f"cube.fits#[{i}]", "dark", 4.0, -7.5) for i in range(3)
    ]
    for i in range(3):
        np.testing.assert_array_equal(frames.read(i), cube[i])
    (tmp_path / "frames.csv").write_text("file,kind\ncube.fits#[7],bias\n")
    with pytest.raises(InputError, match="outside shape"):
        FrameSet.load(tmp_path).read(0)


def test_amplifiers_in_several_extensions_are_regions_in_the_detectors_directions(tmp_path):
    """Two amplifiers that read outwards, each with two columns of overscan, put together give the detector."""
    detector = pixels((6, 8))
    stored = {"AMP1": detector[:, :4], "AMP2": detector[:, 4:][:, ::-1]}
    places = {"AMP1": "[1:4,1:6]", "AMP2": "[8:5,1:6]"}
    units = [
        fits.PrimaryHDU(header=fits.Header({"IMAGETYP": "flat", "EXPTIME": 2.0, "GAIN": 3, "FILTER": "V"}))
    ]
    for name, image in stored.items():
        header = {
            "DETSEC": places[name],
            "DETSIZE": "[1:8,1:6]",
            "TRIMSEC": "[1:4,1:6]",
            "BIASSEC": "[5:6,1:6]",
        }
        overscan = np.full((6, 2), 99, np.uint16)
        units.append(fits.ImageHDU(np.hstack([image, overscan]), fits.Header(header), name=name))
    units.append(fits.ImageHDU(np.zeros((6, 8), np.uint8), name="MASK"))
    fits.HDUList(units).writeto(tmp_path / "mosaic.fits")
    frames = FrameSet.load(tmp_path)
    assert [(r.file, r.setting, r.filter) for r in frames.records] == [
        ("mosaic.fits#AMP1", "GAIN=3 AMP=AMP1", "V"),
        ("mosaic.fits#AMP2", "GAIN=3 AMP=AMP2", "V"),
    ]
    whole = np.zeros((6, 8))
    for i, record in enumerate(frames.records):
        assert record.window is not None
        r0, r1, c0, c1 = record.window
        whole[r0:r1, c0:c1] = frames.read(i)
    np.testing.assert_array_equal(whole, detector)
    assert any(w.startswith("overscan") and "[5:6,1:6]" in w for w in frames.warnings)
    (tmp_path / "frames.csv").write_text("file,kind,exposure_s\nmosaic.fits,flat,2\n")
    with pytest.raises(InputError, match="several images; expected one of AMP1, AMP2"):
        FrameSet.load(tmp_path).read(0)


def test_overscan_of_a_single_image_is_cut_off(tmp_path):
    image = pixels((7, 12))
    write(tmp_path / "a.fits", image, IMAGETYP="zero", BIASSEC="[11:12,1:7]", TRIMSEC="[1:10,2:7]")
    frames = FrameSet.load(tmp_path)
    np.testing.assert_array_equal(frames.read(0), image[1:7, :10])
    assert frames.records[0].window is None
    assert any(w.startswith("overscan") for w in frames.warnings)


def test_settings_filters_mosaics_masters_and_bits(tmp_path):
    write(
        tmp_path / "a.fits",
        pixels(),
        IMAGETYP="FLAT",
        EXPTIME=1.5,
        GAIN=120.0,
        OFFSET=30,
        READOUTM="High Gain",
        FILTER="Ha",
        BAYERPAT="RGGB",
        XBAYROFF=1,
        BITDEPTH=14,
        XBINNING=2,
        **{"DATE-OBS": "2026-03-01T00:00:02"},
    )
    write(
        tmp_path / "b.fits",
        pixels().astype(np.float32),
        IMAGETYP="Master Dark",
        EXPTIME=9.0,
        FILTER="Ha",
        **{"DATE-OBS": "2026-03-01T00:00:01"},
    )
    write(
        tmp_path / "c.fits",
        pixels().astype(np.float32),
        IMAGETYP="dark",
        EXPTIME=9.0,
        NCOMBINE=16,
        **{"DATE-OBS": "2026-03-01T00:00:03.5"},
    )
    master, flat, combined = FrameSet.load(tmp_path).records
    assert flat.setting == "GAIN=120 OFFSET=30 READOUTM=High_Gain XBINNING=2"
    assert (flat.filter, flat.bayer, flat.bit_depth, flat.combined) == ("Ha", "GRBG", 14, 1)
    # What the others do not state is taken for the one value that is stated, but for binning, which is 1 unless stated.
    assert (master.combined, master.filter, master.setting) == (
        0,
        None,
        "GAIN=120 OFFSET=30 READOUTM=High_Gain",
    )
    assert combined.combined == 16
    assert combined.time_s - flat.time_s == 1.5


def test_header_wins_over_name_and_name_fills_what_it_lacks(tmp_path):
    (tmp_path / "flats").mkdir()
    write(tmp_path / "flats" / "x_2s.fits", pixels(), IMAGETYP="Dark Flat")
    write(tmp_path / "flats" / "y_3s_-5C.fits", pixels())
    records = FrameSet.load(tmp_path).records
    assert [(r.kind, r.exposure_s, r.temperature_c) for r in records] == [
        ("dark", 2.0, None),
        ("flat", 3.0, -5.0),
    ]


def test_subframe_is_a_region(tmp_path):
    write(tmp_path / "a.fits", pixels(), IMAGETYP="bias", XORGSUBF=100, YORGSUBF=20)
    assert FrameSet.load(tmp_path).records[0].window == (20, 26, 100, 108)


def test_a_number_that_is_none_is_named(tmp_path):
    write(tmp_path / "a.fits", pixels(), IMAGETYP="dark", EXPTIME="long")
    with pytest.raises(InputError, match=r"a.fits: EXPTIME: 'long' is not a number"):
        FrameSet.load(tmp_path)
