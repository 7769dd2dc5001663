"""Every format gives back the pixels that another program wrote."""

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from PIL import Image

from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet, write_table
from visaug.frames.arrays import WHOLE_BYTES, ArrayFile

RNG = np.random.default_rng(5)
PIXELS = RNG.integers(0, 4096, (2, 6, 8), dtype=np.uint16)


def write_all(folder):
    np.save(folder / "a.npy", PIXELS[0])
    np.save(folder / "stack.npy", PIXELS)
    np.savez(folder / "stored.npz", other=np.zeros(3), frames=PIXELS)
    np.savez_compressed(folder / "packed.npz", frames=PIXELS[:, None])
    np.savez(folder / "fortran.npz", frames=np.asfortranarray(PIXELS))
    tifffile.imwrite(folder / "a.tif", PIXELS[0])
    tifffile.imwrite(folder / "stack.tif", PIXELS, photometric="minisblack")
    Image.fromarray(PIXELS[0]).save(folder / "a.png")
    fits.PrimaryHDU(PIXELS[0]).writeto(folder / "a.fits")
    PIXELS[0].astype("<u2").tofile(folder / "a.raw")


@pytest.mark.parametrize(
    ("name", "which"),
    [
        ("a.npy", 0),
        ("stack.npy#[1]", 1),
        ("stored.npz#frames[1]", 1),
        ("packed.npz#frames[1,0]", 1),
        ("fortran.npz#frames[1]", 1),
        ("a.tif", 0),
        ("stack.tif#[1]", 1),
        ("a.png", 0),
        ("a.fits", 0),
        ("a.raw", 0),
    ],
)
def test_pixels_come_as_written(tmp_path, name, which):
    write_all(tmp_path)
    write_table(tmp_path / "frames.csv", [FrameRecord(0, name, "dark", 0.1)])
    frames = FrameSet.load(tmp_path, resolution=(6, 8), byte_order="little", bits_at="bottom")
    read = frames.read(0)
    assert read.dtype == np.float32
    np.testing.assert_array_equal(read, PIXELS[which])
    assert frames.shape(0) == (6, 8)


@pytest.mark.parametrize("name", ["dark #3.tif", "a[#1].tif", "a#b.tif"])
def test_a_sign_of_numbers_in_a_name_is_part_of_it(tmp_path, name):
    """Only after the ending of a format a # picks a part of the file."""
    tifffile.imwrite(tmp_path / name, PIXELS[0])
    write_table(tmp_path / "frames.csv", [FrameRecord(0, name, "dark", 0.1)])
    np.testing.assert_array_equal(FrameSet.load(tmp_path).read(0), PIXELS[0])
    tifffile.imwrite(tmp_path / name, PIXELS, photometric="minisblack")
    write_table(tmp_path / "frames.csv", [FrameRecord(0, f"{name}#[1]", "dark", 0.1)])
    np.testing.assert_array_equal(FrameSet.load(tmp_path).read(0), PIXELS[1])


@pytest.mark.parametrize("name", ["a.tif#x", "a.png#frames[0]", "a.raw#x"])
def test_an_array_of_a_file_without_arrays_is_refused(tmp_path, name):
    write_all(tmp_path)
    write_table(tmp_path / "frames.csv", [FrameRecord(0, name, "dark", 0.1)])
    frames = FrameSet.load(tmp_path, resolution=(6, 8), byte_order="little", bits_at="bottom")
    with pytest.raises(InputError, match="has no array"):
        frames.read(0)


def test_8_bit_png_and_its_bit_depth(tmp_path):
    pixels = RNG.integers(0, 256, (5, 7), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "p.png")
    frames = FrameSet.load(tmp_path)
    assert frames.records[0].kind == "image"
    assert frames.bit_depth == 8
    np.testing.assert_array_equal(frames.read(0), pixels)


def test_colour_gives_the_green_channel(tmp_path):
    pixels = RNG.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "p.png")
    np.testing.assert_array_equal(FrameSet.load(tmp_path).read(0), pixels[..., 1])


def smooth_12_bit_picture():
    rows, columns = np.mgrid[:40, :50]
    return (300 + 20 * rows + 25 * columns + RNG.normal(0, 6, (40, 50))).astype(np.uint16)


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("top", [False, True])
@pytest.mark.parametrize("bit_depth", [None, 12])
def test_raw_byte_order_and_place_of_the_bits_are_found(tmp_path, order, top, bit_depth):
    picture = smooth_12_bit_picture()
    dark = RNG.normal(40, 3, (40, 50)).astype(np.uint16)
    for name, pixels in (("flat.raw", picture), ("dark.raw", dark)):
        (pixels << (4 if top else 0)).astype("<u2" if order == "little" else ">u2").tofile(tmp_path / name)
    write_table(
        tmp_path / "frames.csv",
        [FrameRecord(0, "dark.raw", "dark", 0.1), FrameRecord(1, "flat.raw", "flat", 0.1, photons=900.0)],
    )
    frames = FrameSet.load(tmp_path, resolution=(40, 50), bit_depth=bit_depth)
    np.testing.assert_array_equal(frames.read(1), picture)
    np.testing.assert_array_equal(frames.read(0), dark)
    assert any("byte_order_assumed" in w and order in w for w in frames.warnings)
    assert any("bits_at_top_assumed" in w for w in frames.warnings) == top
    assert frames.bit_depth == (12 if top or bit_depth else 16)


def test_what_is_assumed_of_raw_files_can_be_overruled(tmp_path):
    picture = smooth_12_bit_picture() << 4
    picture.astype(">u2").tofile(tmp_path / "a.raw")
    frames = FrameSet.load(tmp_path, resolution=(40, 50), byte_order="big", bits_at="bottom")
    np.testing.assert_array_equal(frames.read(0), picture)
    assert frames.warnings == []


def test_raw_needs_the_resolution_and_the_whole_file(tmp_path):
    np.zeros(99, np.uint16).tofile(tmp_path / "a.raw")
    with pytest.raises(InputError, match="resolution"):
        FrameSet.load(tmp_path).read(0)
    with pytest.raises(InputError, match="truncated: 198 bytes"):
        FrameSet.load(tmp_path, resolution=(10, 10)).read(0)


@pytest.mark.parametrize("name", ["a.npy", "stored.npz", "packed.npz", "a.tif", "a.png", "a.fits", "a.raw"])
def test_truncated_file_is_one_clear_line(tmp_path, name):
    write_all(tmp_path)
    data = (tmp_path / name).read_bytes()
    kept = 2880 + 50 if name == "a.fits" else len(data) - len(data) // 3  # FITS: header, part of the pixels
    (tmp_path / name).write_bytes(data[:kept])
    file = name + ("#frames[0]" if name.endswith("npz") else "")
    write_table(tmp_path / "frames.csv", [FrameRecord(0, file, "dark", 0.1)])
    with pytest.raises(InputError, match=name) as caught:
        FrameSet.load(tmp_path, resolution=(6, 8)).read(0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent.npy", "no such file"),
        ("absent.png", "no such file"),
        ("stored.npz#frames[9]", "outside"),
        ("stored.npz#nothing[0]", "holds no array 'nothing'"),
        ("stored.npz", "holds several arrays"),
        ("stack.npy", r"has shape \(2, 6, 8\)"),
        ("a.npy#frames[1", "picks no frame"),
        ("a.doc", "no such file"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, name, message):
    write_all(tmp_path)
    write_table(tmp_path / "frames.csv", [FrameRecord(0, name, "dark", 0.1)])
    with pytest.raises(InputError, match=message):
        FrameSet.load(tmp_path).read(0)


def test_deep_colour_is_refused_rather_than_cut_to_8_bits(tmp_path):
    cv2 = pytest.importorskip("cv2")
    cv2.imwrite(str(tmp_path / "deep.png"), RNG.integers(0, 65536, (4, 4, 3), dtype=np.uint16))
    with pytest.raises(InputError, match="16-bit colour PNG"):
        FrameSet.load(tmp_path).read(0)


def test_large_compressed_array_is_streamed_forth_and_back(tmp_path, monkeypatch):
    monkeypatch.setattr("visaug.frames.arrays.WHOLE_BYTES", 100)
    assert WHOLE_BYTES > 100
    np.savez_compressed(tmp_path / "packed.npz", frames=PIXELS)
    file = ArrayFile(tmp_path / "packed.npz")
    for which in (0, 1, 0):
        np.testing.assert_array_equal(file.read((which,)), PIXELS[which])
    assert file.held_bytes == 0
