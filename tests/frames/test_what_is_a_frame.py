"""Axes that are not time, formats of other programs, values that are no DN, and the files of a folder."""

import struct
import zlib

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from PIL import Image

from visaug.core.errors import InputError
from visaug.frames import FrameRecord, FrameSet
from visaug.frames.pixels import PixelReader

RNG = np.random.default_rng(8)


def values(*shape, top=4000):
    return RNG.integers(100, top, shape, dtype=np.uint16)


def words(frames):
    return {w.split(":")[0] for w in frames.warnings}


def test_three_planes_of_several_files_are_colours(tmp_path):
    cubes = [values(3, 6, 8) for _ in range(2)]
    for n, cube in enumerate(cubes):
        fits.PrimaryHDU(cube, fits.Header({"IMAGETYP": "bias"})).writeto(tmp_path / f"{n}.fits")
    frames = FrameSet.load(tmp_path)
    assert [r.file for r in frames.records] == ["0.fits#[1]", "1.fits#[1]"]
    np.testing.assert_array_equal(frames.read(1), cubes[1][1])
    assert "colour_planes" in words(frames)
    # Another number of planes beside them makes frames of all.
    fits.PrimaryHDU(values(4, 6, 8), fits.Header({"IMAGETYP": "bias"})).writeto(tmp_path / "2.fits")
    assert len(FrameSet.load(tmp_path)) == 10


@pytest.mark.parametrize(("axis", "frames"), [("RGB", 1), ("TIME", 3), (None, 3)])
def test_what_a_header_calls_the_third_axis(tmp_path, axis, frames):
    header = fits.Header({"IMAGETYP": "bias", **({"CTYPE3": axis} if axis else {})})
    fits.PrimaryHDU(values(3, 6, 8), header).writeto(tmp_path / "a.fits")
    assert len(FrameSet.load(tmp_path)) == frames


def test_planar_colour_tiff_gives_green(tmp_path):
    cube = values(3, 6, 8)
    tifffile.imwrite(tmp_path / "bias_0.tif", cube, photometric="rgb", planarconfig="separate")
    frames = FrameSet.load(tmp_path)
    np.testing.assert_array_equal(frames.read(0), cube[1])
    assert "colour_planes" in words(frames)


def test_channels_of_a_microscope_are_settings_and_time_is_not(tmp_path):
    stack = values(2, 3, 6, 8)
    tifffile.imwrite(tmp_path / "bias_0.ome.tif", stack, photometric="minisblack", metadata={"axes": "TCYX"})
    frames = FrameSet.load(tmp_path)
    assert [(r.file.partition("#")[2], r.setting) for r in frames.records] == [
        (f"[{t},{c}]", f"CHANNEL={c}") for t in range(2) for c in range(3)
    ]
    for i, record in enumerate(frames.records):
        t, c = map(int, record.file.partition("#")[2].strip("[]").split(","))
        np.testing.assert_array_equal(frames.read(i), stack[t, c])


@pytest.mark.parametrize("kind", ["npz", "compressed", "h5", "mat7.3", "mat5"])
def test_stacks_whose_last_axis_is_time(tmp_path, kind):
    """(rows, columns, frames), as MATLAB and some Python programs have them; HDF5 of MATLAB 7.3 holds axes in reverse."""
    stacks = {"bias": values(6, 8, 5), "dark_2s": values(6, 8, 3)}
    if kind == "npz":
        np.savez(tmp_path / "a.npz", **stacks)
    elif kind == "compressed":
        np.savez_compressed(tmp_path / "a.npz", **stacks)
    elif kind == "mat5":
        pytest.importorskip("scipy.io").savemat(tmp_path / "a.mat", stacks)
    else:
        h5py = pytest.importorskip("h5py")
        matlab = kind == "mat7.3"
        with h5py.File(
            tmp_path / ("a.mat" if matlab else "a.h5"), "w", userblock_size=512 if matlab else 0
        ) as file:
            for name, stack in stacks.items():
                data = file.create_dataset(name, data=stack.T if matlab else stack)
                if matlab:
                    data.attrs["MATLAB_class"] = np.bytes_("uint16")
    frames = FrameSet.load(tmp_path)
    assert [r.kind for r in frames.records] == ["bias"] * 5 + ["dark"] * 3
    for i in range(5):
        np.testing.assert_array_equal(frames.read(i), stacks["bias"][..., i])
    np.testing.assert_array_equal(frames.read(7), stacks["dark_2s"][..., 2])
    assert "stack_axis_assumed" in words(frames)


@pytest.mark.parametrize(
    ("shapes", "count"),
    [
        ({"bias": (3, 6, 8), "dark_1s": (9, 6, 8)}, 12),  # they agree in the last two axes
        ({"bias": (20, 6, 8)}, 20),
        ({"bias": (5, 6, 8), "dark_1s": (6, 8)}, 6),
        ({"bias": (6, 8, 9), "dark_1s": (6, 8)}, 10),
    ],
)
def test_which_axis_is_time(tmp_path, shapes, count):
    np.savez(tmp_path / "a.npz", **{name: values(*shape) for name, shape in shapes.items()})
    frames = FrameSet.load(tmp_path)
    assert len(frames) == count
    assert frames.shape(0) == (6, 8)


@pytest.mark.parametrize(("listed", "last"), [(range(5), True), (range(4), False)])
def test_a_table_that_counts_along_the_last_axis(tmp_path, listed, last):
    """All places of the last axis and no more of the first: the frames lie along the last."""
    stack = values(6, 8, 5)
    np.savez(tmp_path / "a.npz", dark=stack)
    rows = [f"a.npz#dark[{i}],bias" for i in listed]
    (tmp_path / "frames.csv").write_text("\n".join(["file,kind", *rows]) + "\n")
    frames = FrameSet.load(tmp_path)
    np.testing.assert_array_equal(frames.read(3), stack[..., 3] if last else stack[3])
    assert ("stack_axis_assumed" in words(frames)) == last


@pytest.mark.parametrize("top", [127, 255, 1023, 4095, 5000, 65535])
@pytest.mark.parametrize("magic", ["P5", "P2"])
def test_pgm_gives_the_stored_numbers(tmp_path, top, magic):
    pixels = RNG.integers(0, top + 1, (6, 8))
    head = f"{magic} # a comment\n8 6\n# another\n{top}\n".encode()
    body = (
        pixels.astype(np.uint8 if top < 256 else ">u2").tobytes()
        if magic == "P5"
        else " ".join(map(str, pixels.ravel())).encode()
    )
    for name in ("bias_0.pgm", "bias_1.pgm"):
        (tmp_path / name).write_bytes(head + body)
    frames = FrameSet.load(tmp_path)
    np.testing.assert_array_equal(frames.read(0), pixels)
    assert frames.bit_depth == {127: 7, 1023: 10, 4095: 12, 255: 8}.get(top, 16)
    (tmp_path / "bias_1.pgm").write_bytes(head + body[: len(body) // 2])
    with pytest.raises(InputError, match=r"truncated|outside"):
        frames.read(1)


def png(path, pixels, colour, interlaced=False):
    """Written by the text of the PNG specification, every row with the filter Paeth but the first."""
    channels = {0: 1, 4: 2}[colour]
    data = np.zeros((*pixels.shape, channels), ">u2")
    data[..., 0] = pixels
    if channels > 1:
        data[..., 1] = 65535
    rows, before = b"", np.zeros(data[0].nbytes, int)
    for row in data:
        raw = np.frombuffer(row.tobytes(), np.uint8).astype(int)
        size = 2 * channels
        left, corner = np.r_[np.zeros(size, int), raw[:-size]], np.r_[np.zeros(size, int), before[:-size]]
        p = left + before - corner
        a, b, c = abs(p - left), abs(p - before), abs(p - corner)
        guess = np.where((a <= b) & (a <= c), left, np.where(b <= c, before, corner))
        rows += b"\4" + ((raw - guess) % 256).astype(np.uint8).tobytes()
        before = raw

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 16, colour, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("colour", [0, 4])
def test_deep_gray_png_keeps_its_bits(tmp_path, colour):
    pixels = RNG.integers(0, 65536, (7, 9))
    png(tmp_path / "a.png", pixels, colour)
    np.testing.assert_array_equal(PixelReader(tmp_path).read("a.png"), pixels)


def ser(path, frames, bits, mark=0, colour=0, order="<"):
    head = b"LUCAM-RECORDER" + struct.pack(
        "<7i", 0, colour, mark, frames.shape[2], frames.shape[1], bits, len(frames)
    )
    path.write_bytes(head.ljust(178, b"\0") + frames.astype("u1" if bits <= 8 else order + "u2").tobytes())


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("mark", [0, 1])
def test_ser_video(tmp_path, bits, order, mark):
    frames = np.clip(RNG.normal(0.4 * 2**bits, 5, (3, 12, 20)), 0, 2**bits - 1).astype(np.uint16)
    ser(tmp_path / "bias_1.ser", frames, bits, mark, colour=11, order=order)
    read = FrameSet.load(tmp_path)
    assert [(r.kind, r.bayer) for r in read.records] == [("bias", "BGGR")] * 3
    assert read.bit_depth == bits
    for i in range(3):
        np.testing.assert_array_equal(read.read(i), frames[i])


def xisf(path, pixels, kind="UInt16", packed=None, keywords=()):
    data = pixels.tobytes()
    size, item = len(data), pixels.dtype.itemsize
    if packed == "zlib+sh":
        data = np.frombuffer(data, np.uint8).reshape(-1, item).T.tobytes()
    data = zlib.compress(data) if packed else data
    channels = pixels.shape[0] if pixels.ndim == 3 else 1
    words = "".join(f'<FITSKeyword name="{k}" value="{v}" comment="{c}"/>' for k, v, c in keywords)
    packing = (
        f' compression="{packed}:{size}{":" + str(item) if packed == "zlib+sh" else ""}"' if packed else ""
    )
    text = (
        f'<?xml version="1.0"?><xisf version="1.0" xmlns="http://www.pixinsight.com/xisf"><Image '
        f'geometry="{pixels.shape[-1]}:{pixels.shape[-2]}:{channels}" sampleFormat="{kind}" '
        f'location="attachment:4096:{len(data)}"{packing}>{words}</Image></xisf>'
    ).encode()
    path.write_bytes((b"XISF0100" + struct.pack("<II", len(text), 0) + text).ljust(4096, b"\0") + data)


@pytest.mark.parametrize("packed", [None, "zlib", "zlib+sh"])
def test_xisf(tmp_path, packed):
    pixels = values(6, 8)
    keywords = [("IMAGETYP", "'Dark Frame'", ""), ("EXPTIME", "500", "[ms]"), ("CCD-TEMP", "-10.", "")]
    xisf(tmp_path / "a.xisf", pixels, packed=packed, keywords=keywords)
    frames = FrameSet.load(tmp_path)
    (record,) = frames.records
    assert (record.kind, record.exposure_s, record.temperature_c) == ("dark", 0.5, -10.0)
    np.testing.assert_array_equal(frames.read(0), pixels)


def test_colour_and_other_xisf(tmp_path):
    cube = values(3, 6, 8)
    xisf(tmp_path / "bias_0.xisf", cube)
    frames = FrameSet.load(tmp_path)
    np.testing.assert_array_equal(frames.read(0), cube[1])
    assert "colour_planes" in words(frames)
    xisf(tmp_path / "bias_0.xisf", cube, packed="lz4")
    with pytest.raises(InputError, match=r"bias_0\.xisf.*lz4.*FITS"):
        FrameSet.load(tmp_path).read(0)


@pytest.mark.parametrize("ending", ["xisf", "ser", "avi", "mat", "heic"])
def test_formats_that_hold_nothing_are_named_with_the_way_out(tmp_path, ending):
    for name in ("bias_0", "flat_1s_0"):
        (tmp_path / f"{name}.{ending}").write_bytes(b"0" * 1000)
    with pytest.raises(InputError, match=rf"bias_0\.{ending}.*(FITS|truncated)"):
        FrameSet.load(tmp_path)


def one(pixels, kind="dark"):
    return FrameSet.from_arrays([FrameRecord(0, "x", kind, 1.0)], [pixels])


def test_values_that_are_no_dn_are_refused():
    fractions = RNG.normal(0.1, 0.01, (6, 8)).astype(np.float32)
    with pytest.raises(InputError, match=r"fractions between 0 and 1.*65535"):
        one(fractions, "flat").read(0)
    one(fractions * 65535).read(0)
    one(fractions, "image").read(0)
    wrapped = np.mod(np.rint(RNG.normal(0, 10, (40, 50))), 65536).astype(np.uint16)
    with pytest.raises(InputError, match="wrapped around"):
        one(wrapped).read(0)
    hot = np.full((40, 50), 100, np.uint16)
    hot[0, :10] = 65535  # half a per cent of the pixels saturate
    one(hot).read(0)
    with pytest.raises(InputError, match="nothing subtracted"):
        one(np.array([[-3, 5], [4, 1]], np.int16)).read(0)


@pytest.mark.parametrize("shape", [(1, 50), (50, 1)])
def test_a_single_line_is_refused_with_the_way_out(shape):
    with pytest.raises(InputError, match=r"single line.*successive lines"):
        one(np.full(shape, 100, np.uint16)).read(0)


def bias(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    fits.PrimaryHDU(values(6, 8), fits.Header({"IMAGETYP": "bias"})).writeto(path)


def test_subfolders_and_other_formats_beside_fits_are_read(tmp_path):
    bias(tmp_path / "1.fits")
    bias(tmp_path / "darks" / "2.fits")
    tifffile.imwrite(tmp_path / "flat_1s_3.tif", values(6, 8))
    Image.fromarray(values(6, 8).astype(np.uint8)).save(tmp_path / "1.png")  # the preview of 1.fits
    (tmp_path / "film.avi").write_bytes(b"x")
    bias(tmp_path / "other" / "4.fits")
    (tmp_path / "other" / "frames.csv").write_text("file,kind\n4.fits,bias\n")
    frames = FrameSet.load(tmp_path)
    assert sorted(r.file for r in frames.records) == ["1.fits", "darks/2.fits", "flat_1s_3.tif"]
    (said,) = [w for w in frames.warnings if w.startswith("files_left_out")]
    assert all(name in said for name in ("1.png", "film.avi", "other/4.fits"))


def test_one_fits_file_beside_many_others(tmp_path):
    for n in range(4):
        tifffile.imwrite(tmp_path / f"bias_{n}.tif", values(6, 8))
    bias(tmp_path / "last.fits")
    assert len(FrameSet.load(tmp_path)) == 5


def test_new_lines_of_a_descriptor_are_named(tmp_path):
    for n in range(3):
        Image.fromarray(values(6, 8)).save(tmp_path / f"{n}.png")
    text = ["v 4.0", "n 12 8 6", "d 1000000", "i 0.png", "dc 2000000", "i 1.png", "b 1000000 500", "i 2.png"]
    (tmp_path / "EMVA1288_Data.txt").write_text("\n".join(text))
    frames = FrameSet.load(tmp_path)
    assert [(r.file, r.kind) for r in frames.records] == [("0.png", "dark"), ("2.png", "flat")]
    (said,) = [w for w in frames.warnings if w.startswith("descriptor_lines_ignored")]
    assert "dc 2000000" in said


def test_a_table_that_lists_part_of_a_stack_along_its_last_axis(tmp_path):
    """A stack listed whole tells the axis of one of the same frames listed in part."""
    rng = np.random.default_rng(5)
    dark, flat = rng.integers(0, 4000, (24, 16, 10)), rng.integers(0, 4000, (24, 16, 8))
    np.savez(tmp_path / "all.npz", dark=dark.astype(np.uint16), flat=flat.astype(np.uint16))
    lines = [f"{i},all.npz#dark[{i}],dark,1" for i in range(10)] + [
        f"{10 + i},all.npz#flat[{i}],flat,1" for i in range(6)
    ]
    (tmp_path / "frames.csv").write_text("\n".join(["sequence,file,kind,exposure_s", *lines]) + "\n")
    frames = FrameSet.load(tmp_path)
    assert np.array_equal(frames.read(12), flat[:, :, 2])
    assert np.array_equal(frames.read(3), dark[:, :, 3])
