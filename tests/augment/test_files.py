"""Noisy copies: names, sizes, depth and channels stay; same seed, same bytes; a broken run goes on."""

import os
import struct
import sys
import zlib

import cv2
import numpy as np
import pytest
import tifffile
import torch
from click.testing import CliRunner
from PIL import Image, PngImagePlugin

from visaug import Camera, InputError
from visaug.app.cli.root import program
from visaug.augment import files
from visaug.augment.files import JOURNAL, augment_files
from visaug.augment.image_io import read_picture, write_picture

GAIN, READ_E = 2.0, 5.0


@pytest.fixture(scope="module")
def camera() -> Camera:
    return Camera.load(
        {
            "name": "plain",
            "resolution": [64, 64],
            "bit_depth": 16,
            "gain_e_per_dn": GAIN,
            "quantum_efficiency": 1.0,
            "exposure_s": 0.0,
            "read_noise": {"sigma_e": READ_E},
        }
    )


def pixels(dtype, channels: int, seed: int = 0, shape=(24, 40)) -> np.ndarray:
    top = np.iinfo(dtype).max
    # Mid-range, so that noise is seen everywhere.
    values = np.random.default_rng(seed).integers(top // 4, top // 2, (*shape, channels))
    return values[..., 0].astype(dtype) if channels == 1 else values.astype(dtype)


# Written and read by OpenCV, which the code under test does not use.
FORMATS = {
    "gray8.png": (np.uint8, 1),
    "gray16.png": (np.uint16, 1),
    "rgb8.png": (np.uint8, 3),
    "rgb16.png": (np.uint16, 3),
    "rgba8.png": (np.uint8, 4),
    "rgba16.png": (np.uint16, 4),
    "gray8.tif": (np.uint8, 1),
    "gray16.tiff": (np.uint16, 1),
    "rgb8.TIF": (np.uint8, 3),
    "rgb16.tif": (np.uint16, 3),
    "gray.jpg": (np.uint8, 1),
    "rgb.jpeg": (np.uint8, 3),
}


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "in"
    (root / "inner").mkdir(parents=True)
    for name, (dtype, channels) in FORMATS.items():
        assert cv2.imwrite(str(root / "inner" / name), pixels(dtype, channels))
    return root


def contents(folder):
    return {
        p.relative_to(folder).as_posix(): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file() and p.name != JOURNAL
    }


def test_names_sizes_depth_and_channels_stay(folder, camera, tmp_path):
    done = augment_files([folder], tmp_path / "out", camera, transfer="linear")
    assert (done.written, done.kept) == (len(FORMATS), 0)
    assert set(contents(tmp_path / "out")) == {f"inner/{name}" for name in FORMATS}
    for name, (dtype, channels) in FORMATS.items():
        before, after = (
            cv2.imread(str(root / "inner" / name), cv2.IMREAD_UNCHANGED)
            for root in (folder, tmp_path / "out")
        )
        assert after.shape == before.shape == ((24, 40) if channels == 1 else (24, 40, channels)), name
        assert after.dtype == dtype, name
        colours = 3 if channels == 4 else channels
        before, after = before.reshape(24, 40, channels), after.reshape(24, 40, channels)
        changed = (before[..., :colours] != after[..., :colours]).mean()
        assert changed > 0.2, name
        assert (before[..., colours:] == after[..., colours:]).all(), name


def test_noise_is_the_cameras(camera, tmp_path):
    """Mean kept, variance (mean electrons + read noise²) / gain² + rounding, within four standard errors."""
    level, n = 20000, 256
    cv2.imwrite(str(tmp_path / "flat.png"), np.full((n, n), level, np.uint16))
    augment_files([tmp_path / "flat.png"], tmp_path / "out", camera)
    noisy = cv2.imread(str(tmp_path / "out" / "flat.png"), cv2.IMREAD_UNCHANGED).astype(float)
    variance = (level * GAIN + READ_E**2) / GAIN**2 + 1 / 12
    assert abs(noisy.mean() - level) < 4 * (variance / n**2) ** 0.5
    assert abs(noisy.var() / variance - 1) < 4 * (2 / n**2) ** 0.5


def test_same_seed_same_bytes_whatever_the_order(folder, camera, tmp_path):
    augment_files([folder], tmp_path / "a", camera, seed=3)
    augment_files([folder], tmp_path / "b", camera, seed=3)
    augment_files([folder], tmp_path / "c", camera, seed=4)
    a, b, c = (contents(tmp_path / name) for name in "abc")
    assert len(a) >= len(FORMATS)
    assert a == b
    assert all(a[name] != c[name] for name in a)
    names = [folder / "inner" / name for name in FORMATS]
    augment_files(names[::-1], tmp_path / "d", camera, seed=3)
    augment_files(names[:1], tmp_path / "e", camera, seed=3)
    d, e = contents(tmp_path / "d"), contents(tmp_path / "e")
    assert e
    assert all(d[name] == content for name, content in e.items())


def test_same_seed_same_bytes_in_every_rank_of_a_job(camera, tmp_path, monkeypatch):
    """A run that a launcher began as rank 1 is resumed by any other; the random state of the caller stays."""
    png(tmp_path / "a.png")
    state = torch.random.get_rng_state()
    for rank in ("", "0", "1", "7"):
        monkeypatch.setenv("RANK", rank)
        augment_files([tmp_path / "a.png"], tmp_path / f"rank{rank}", camera)
    assert len({(tmp_path / f"rank{rank}" / "a.png").read_bytes() for rank in ("", "0", "1", "7")}) == 1
    assert torch.equal(torch.random.get_rng_state(), state)


def test_noise_differs_between_files_of_equal_content(camera, tmp_path):
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), pixels(np.uint16, 1))
    augment_files([tmp_path / "a.png", tmp_path / "b.png"], tmp_path / "out", camera)
    assert (tmp_path / "out" / "a.png").read_bytes() != (tmp_path / "out" / "b.png").read_bytes()


def test_interrupted_run_goes_on(folder, camera, tmp_path):
    augment_files([folder], tmp_path / "whole", camera)

    def stop(description, done, total):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        augment_files([folder], tmp_path / "parts", camera, progress=stop)
    assert len(contents(tmp_path / "parts")) == 5
    with open(tmp_path / "parts" / JOURNAL, "a") as journal:
        journal.write('{"name": "torn')
    done = augment_files([folder], tmp_path / "parts", camera)
    assert (done.written, done.kept) == (len(FORMATS) - 5, 5)
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
    assert augment_files([folder], tmp_path / "parts", camera).written == 0


def test_a_changed_copy_is_reported_and_made_anew_by_force_alone(camera, tmp_path):
    root, out = tmp_path / "in", tmp_path / "out"
    root.mkdir()
    for name in ("a.png", "b.png"):
        png(root / name)
    augment_files([root], out, camera)
    whole = contents(out)
    (out / "a.png").write_bytes(whole["a.png"][:-20])
    done = augment_files([root], out, camera)
    assert (done.written, done.kept, done.replaced, len(done.failed)) == (0, 1, 0, 1)
    assert "a.png: was changed since visaug wrote it" in done.failed[0]
    assert contents(out)["a.png"] == whole["a.png"][:-20]
    done = augment_files([root], out, camera, force=True)
    assert (done.written, done.kept, done.replaced) == (1, 1, 1)
    assert contents(out) == whole


def test_other_settings_or_another_original_are_done_anew(folder, camera, tmp_path):
    out = tmp_path / "out"
    augment_files([folder], out, camera)
    assert augment_files([folder], out, camera, seed=1).kept == 0
    assert augment_files([folder], out, camera.replace({"read_noise.sigma_e": 6.0}), seed=1).kept == 0
    augment_files([folder], out, camera, seed=1)
    cv2.imwrite(str(folder / "inner" / "gray8.png"), pixels(np.uint8, 1, seed=9, shape=(10, 12)))
    assert augment_files([folder], out, camera, seed=1).written == 1
    assert cv2.imread(str(out / "inner" / "gray8.png"), cv2.IMREAD_UNCHANGED).shape == (10, 12)


def test_a_broken_write_leaves_no_half_file(folder, camera, tmp_path, monkeypatch):
    def half(path, picture):
        path.write_bytes(b"half")
        raise OSError("disk is full")

    monkeypatch.setattr(files, "write_picture", half)
    with pytest.raises(OSError, match="full"):
        augment_files([folder], tmp_path / "out", camera)
    assert contents(tmp_path / "out") == {}


def test_output_inside_input_is_not_read_again(folder, camera):
    out = folder / "noisy"
    assert augment_files([folder], out, camera).written == len(FORMATS)
    assert augment_files([folder], out, camera).kept == len(FORMATS)


def test_copies_of_earlier_calls_are_passed_over_and_named(camera, tmp_path):
    root = tmp_path / "in"
    root.mkdir()
    png(root / "a.png")
    augment_files([root], root, camera, copies=2)  # beside the original
    again = augment_files([root], root, camera, copies=2)
    assert (again.written, again.kept, again.outputs) == (0, 2, [root])
    augment_files([root], root / "sub" / "noisy", camera)
    done = augment_files([root], tmp_path / "out", camera)
    assert set(contents(tmp_path / "out")) == {"a.png"}
    assert (set(done.outputs), done.again) == ({root, root / "sub" / "noisy"}, [])
    copies = augment_files([root / "sub" / "noisy"], tmp_path / "twice", camera)
    assert (copies.written, copies.outputs, copies.again) == (1, [], [root / "sub" / "noisy"])


def test_the_command_names_the_copies_that_it_passes_over(tmp_path):
    def said(output, *more):
        words = ["augment", str(root), "-o", str(output), "--camera", "sony_imx174", *more]
        return CliRunner().invoke(program, words, catch_exceptions=False).output

    root = tmp_path / "in"
    png(root / "a.png")
    said(root / "noisy")
    assert f"skipped copies of visaug augment in {root / 'noisy'}" in said(root / "noisy")
    (root / "notes.txt").touch()
    assert "copied 1 other file as it is\n" in said(tmp_path / "out", "--copy-labels")


def test_palette_transparency_and_compression(camera, tmp_path):
    gray = pixels(np.uint8, 1)
    Image.fromarray(gray).convert("P").save(tmp_path / "palette.png")
    Image.merge("LA", [Image.fromarray(gray)] * 2).save(tmp_path / "la.png")
    Image.fromarray(gray).save(tmp_path / "lzw.tif", compression="tiff_lzw")
    tifffile.imwrite(
        tmp_path / "planes.tif",
        pixels(np.uint16, 3).transpose(2, 0, 1),
        planarconfig="separate",
        photometric="rgb",
    )
    names = ["palette.png", "la.png", "lzw.tif", "planes.tif"]
    augment_files([tmp_path / name for name in names], tmp_path / "out", camera, force=True)
    shapes = {name: read_picture(tmp_path / "out" / name).pixels.shape for name in names}
    assert shapes == {
        "palette.png": (24, 40, 3),
        "la.png": (24, 40, 2),
        "lzw.tif": (24, 40, 1),
        "planes.tif": (24, 40, 3),
    }
    alpha = np.asarray(Image.open(tmp_path / "out" / "la.png"))[..., 1]
    assert (alpha == gray).all()


def bad_inputs():
    yield "holds no pictures", (lambda root: [root])
    yield "no such file", (lambda root: [root / "missing"])
    yield "not a picture", (lambda root: [touch(root / "a.txt")])
    yield "cannot be read", (lambda root: [touch(root / "a.png")])
    yield "cannot be read", (lambda root: [truncated(root / "t.png")])
    yield "int32", (lambda root: [tiff(root / "i.tif", np.zeros((4, 4), np.int32))])
    yield "2 pictures", (lambda root: [moving(root / "m.webp")])
    yield "animated", (lambda root: [moving(root / "m.png")])
    yield "shape", (lambda root: [array(root / "a.npy", np.zeros((3, 8, 8), np.float32))])
    yield "int64", (lambda root: [array(root / "a.npy", np.zeros((8, 8), np.int64))])
    yield "pages", (lambda root: [tiff(root / "p.tif", np.zeros((3, 4, 4), np.uint8))])
    yield "overwritten", (lambda root: [png(root / "out" / "a.png")])


def touch(path):
    path.write_bytes(b"nothing")
    return path


def png(path):
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), pixels(np.uint8, 1))
    return path


def moving(path):
    first, second = Image.new("RGB", (8, 8), "red"), Image.new("RGB", (8, 8), "blue")
    first.save(path, save_all=True, append_images=[second])
    return path


def array(path, values):
    np.save(path, values)
    return path


def truncated(path):
    whole = png(path).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    return path


def tiff(path, array):
    tifffile.imwrite(path, array, photometric="minisblack")
    return path


@pytest.mark.parametrize(("message", "make"), list(bad_inputs()))
def test_bad_input_is_one_clear_line(message, make, camera, tmp_path):
    inputs = make(tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        augment_files(inputs, tmp_path / "out", camera)
    assert "\n" not in str(caught.value)


def decisions():
    """(name, how it is written, transfer function): profiles and chunks made by Pillow, cv2 or by hand."""
    from PIL import ImageCms

    colour, gray = Image.fromarray(pixels(np.uint8, 3)), Image.fromarray(pixels(np.uint8, 1))
    srgb_profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 1

    def gamma(value):
        info = PngImagePlugin.PngInfo()
        info.add(b"gAMA", struct.pack(">I", value))
        return info

    yield "colour.jpg", lambda p: colour.save(p), "srgb"
    yield "colour.png", lambda p: colour.save(p), "srgb"
    yield "colour.webp", lambda p: colour.save(p), "srgb"
    yield "colour.tif", lambda p: colour.save(p), "srgb"
    yield "gray.jpg", lambda p: gray.save(p), "linear"
    yield "tagged_gray.jpg", lambda p: gray.save(p, exif=exif), "srgb"
    yield "profiled_gray.png", lambda p: gray.save(p, icc_profile=srgb_profile), "srgb"
    yield "linear_chunk.png", lambda p: colour.save(p, pnginfo=gamma(100000)), "linear"
    yield "gray_gamma.png", lambda p: gray.save(p, pnginfo=gamma(45455)), "srgb"
    yield "deep.png", lambda p: cv2.imwrite(str(p), pixels(np.uint16, 3)), "linear"
    yield (
        "deep_profiled.tif",
        lambda p: tifffile.imwrite(p, pixels(np.uint16, 3), photometric="rgb", iccprofile=srgb_profile),
        "srgb",
    )
    yield (
        "linear_profile.tif",
        lambda p: tifffile.imwrite(
            p, pixels(np.uint8, 3), photometric="rgb", iccprofile=profile(struct.pack(">4sII", b"curv", 0, 0))
        ),
        "linear",
    )
    yield "parametric.tif", lambda p: tifffile.imwrite(
        p, pixels(np.uint16, 3), photometric="rgb",
        iccprofile=profile(struct.pack(">4sIHHi", b"para", 0, 0, 0, int(2.2 * 65536))),
    ), "srgb"  # fmt: skip
    yield (
        "float.tif",
        lambda p: tifffile.imwrite(p, np.full((8, 8, 3), 0.2, np.float32), photometric="rgb"),
        "linear",
    )
    yield "array.npy", lambda p: np.save(p, pixels(np.uint8, 3)), "linear"


def profile(curve):
    """An ICC profile of one curve: header of 128 bytes, a table with one tag, its data."""
    return bytes(128) + struct.pack(">I4sII", 1, b"gTRC", 144, len(curve)) + curve


@pytest.mark.parametrize(("name", "make", "transfer"), list(decisions()), ids=lambda one: str(one)[:20])
def test_transfer_function_is_what_the_file_says(name, make, transfer, camera, tmp_path):
    make(tmp_path / name)
    assert read_picture(tmp_path / name).transfer == transfer
    done = augment_files([tmp_path / name], tmp_path / "out", camera)
    assert [kind for kind, _ in done.assumed] == [transfer]


@pytest.mark.parametrize(
    ("code", "transfer"),
    [
        (8, "linear"),
        (1, "srgb"),
        (13, "srgb"),
        (16, "srgb"),
        (18, "srgb"),
        (2, "linear"),
        (0, "linear"),
        (255, "linear"),
    ],
)
def test_what_a_cicp_chunk_says(code, transfer, tmp_path):
    """Of 16 bit, which are linear where nothing is stated; PQ and HLG (16 and 18) are not."""
    info = PngImagePlugin.PngInfo()
    info.add(b"cICP", bytes([9, code, 0, 1]))
    Image.fromarray(pixels(np.uint16, 1)).save(tmp_path / "a.png", pnginfo=info)
    assert read_picture(tmp_path / "a.png").transfer == transfer


def test_srgb_noise_follows_the_curve(camera, tmp_path):
    """At level 60 the curve's slope makes 8-bit noise sigma_light * slope; 65,536 pixels, 0.3 %; rounding adds 1/12."""
    level = 60
    faint = camera.replace({"gain_e_per_dn": 0.05})  # 3,277 e- at white
    Image.fromarray(np.full((256, 256, 3), level, np.uint8)).save(tmp_path / "a.png")
    augment_files([tmp_path / "a.png"], tmp_path / "out", faint)
    noisy = np.asarray(Image.open(tmp_path / "out" / "a.png")).astype(float)
    light = ((level / 255 + 0.055) / 1.055) ** 2.4
    full = 65535 * 0.05
    sigma = (light * full + READ_E**2) ** 0.5 / full * 1.055 / 2.4 * light ** (1 / 2.4 - 1) * 255
    assert noisy[..., 1].std() == pytest.approx((sigma**2 + 1 / 12) ** 0.5, rel=0.03)


def test_palettes_tags_and_white_is_zero_of_tiffs(camera, tmp_path):
    picture = Image.fromarray(np.full((16, 20, 3), (200, 90, 30), np.uint8))
    picture.quantize(4).save(tmp_path / "palette.tif")
    tags = [
        (274, 3, 1, 8, True),
        (33550, "d", 3, (0.5, 0.5, 0.0), True),
        (34735, "H", 4, (1, 1, 0, 0), True),
        (42113, "s", 0, "777", True),
    ]
    deep = pixels(np.uint16, 3)
    deep[:5] = 777
    tifffile.imwrite(
        tmp_path / "tagged.tif", deep, photometric="rgb", iccprofile=b"profile", extratags=tags,
        description="pose 12", software="renderer", resolution=(300, 200), resolutionunit=2, metadata=None,
    )  # fmt: skip
    tifffile.imwrite(tmp_path / "negative.tif", np.full((64, 64), 60000, np.uint16), photometric="miniswhite")
    names = ("palette.tif", "tagged.tif", "negative.tif")
    augment_files([tmp_path / name for name in names], tmp_path / "out", camera, force=True)
    colours = np.asarray(Image.open(tmp_path / "out" / "palette.tif").convert("RGB")).mean((0, 1))
    assert colours == pytest.approx([200, 90, 30], abs=2)
    with (
        tifffile.TiffFile(tmp_path / "tagged.tif") as before,
        tifffile.TiffFile(tmp_path / "out/tagged.tif") as after,
    ):
        old, new = before.pages[0].tags, after.pages[0].tags
        for code in (270, 274, 282, 283, 296, 305, 33550, 34735, 34675, 42113):
            assert new[code].value == old[code].value, code
        noisy = after.asarray()
    assert (noisy[:5] == 777).all()  # GDAL's no-data pixels hold no light
    assert (noisy[5:] != deep[5:]).mean() > 0.9
    negative = tifffile.imread(tmp_path / "out" / "negative.tif").astype(float)
    assert negative.mean() == pytest.approx(60000, abs=3)
    # 5,535 DN of light are 11,070 e-: 4,096 pixels, relative standard error 1.1 %; 5 of them.
    assert negative.std() == pytest.approx((5535 * GAIN + READ_E**2) ** 0.5 / GAIN, rel=0.055)


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "packbits", "tiff_adobe_deflate", "group4"])
@pytest.mark.parametrize("white_is_zero", [True, False])
def test_tiffs_of_either_sense_are_read_alike_whatever_decodes_them(compression, white_is_zero, tmp_path):
    """tifffile decodes some compressions, Pillow and kornia the others; Pillow's own reading is the reference."""
    bits = np.random.default_rng(0).random((16, 24)) > 0.3
    words = pixels(np.uint8, 1, shape=(16, 24))
    deep = pixels(np.uint16, 1, shape=(16, 24))
    for picture in (bits, words, deep)[: 1 if compression == "group4" else 3]:
        sense = {262: 0 if white_is_zero else 1}
        Image.fromarray(picture).save(tmp_path / "a.tif", compression=compression, tiffinfo=sense)
        found = read_picture(tmp_path / "a.tif")
        write_picture(tmp_path / "b.tif", found)
        if picture.dtype == np.uint16:  # Pillow takes 16 bit as they are stored
            assert (found.pixels[..., 0] == (65535 - deep if white_is_zero else deep)).all()
        else:
            light = np.asarray(Image.open(tmp_path / "a.tif").convert("L"))
            assert (found.pixels[..., 0] == light).all()
            assert (np.asarray(Image.open(tmp_path / "b.tif")) == light).all()


@pytest.mark.parametrize("compression", ["raw", "tiff_lzw", "tiff_adobe_deflate", "jpeg"])
def test_ycbcr_tiffs_are_colours(compression, tmp_path):
    even = Image.new("RGB", (16, 16), (200, 50, 30)).convert("YCbCr")
    even.save(tmp_path / "a.tif", compression=compression)
    found = read_picture(tmp_path / "a.tif")
    assert (found.transfer, found.colours) == ("srgb", 3)
    assert np.abs(found.pixels.astype(int) - (200, 50, 30)).max() <= 3


def test_a_tiffs_palette_may_have_alpha(tmp_path):
    colours = Image.new("L", (16, 16), 90).convert("PA")
    colours.putalpha(Image.new("L", (16, 16), 128))
    colours.save(tmp_path / "a.tif")
    assert (read_picture(tmp_path / "a.tif").pixels == (90, 90, 90, 128)).all()


@pytest.mark.parametrize(
    ("nodata", "dtype"), [("-9999", np.uint8), ("0.5", np.uint8), ("nan", np.uint16), ("1e39", np.uint16)]
)
def test_no_data_that_no_pixel_can_hold_marks_none(nodata, dtype, camera, tmp_path, caplog):
    light = pixels(dtype, 1)
    tifffile.imwrite(tmp_path / "geo.tif", light, extratags=[(42113, 2, 0, nodata, True)])
    assert augment_files([tmp_path / "geo.tif"], tmp_path / "out", camera).written == 1
    found = read_picture(tmp_path / "geo.tif")
    assert found.keep is None
    assert (found.with_pixels(np.zeros_like(found.pixels)).pixels == 0).all()


def test_no_pixel_becomes_no_data_where_white_is_zero(tmp_path):
    stored = pixels(np.uint8, 1)
    stored[:4] = 7
    extra = [(42113, "s", 0, "7", True)]
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="miniswhite", extratags=extra)
    found = read_picture(tmp_path / "a.tif")
    every = np.arange(stored.size, dtype=np.uint8).reshape(found.pixels.shape)
    write_picture(tmp_path / "b.tif", found.with_pixels(every))
    again = tifffile.imread(tmp_path / "b.tif")
    assert ((again == 7) == (stored == 7)).all()
    assert (again[4:] == 255 - every[4:, :, 0]).mean() > 0.99


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_the_transparent_level_of_a_gray_png_of_few_bits(depth, tmp_path):
    top = 2**depth - 1
    chunks = {"IHDR": struct.pack(">IIBBBBB", 8, 1, depth, 0, 0, 0, 0), "tRNS": struct.pack(">H", top)}
    levels = [level % (top + 1) for level in range(8)]
    row = int("".join(f"{level:0{depth}b}" for level in levels), 2).to_bytes(depth, "big")
    chunks |= {"IDAT": zlib.compress(b"\0" + row), "IEND": b""}
    content = b"\x89PNG\r\n\x1a\n"
    for name, data in chunks.items():
        body = name.encode() + data
        content += struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))
    (tmp_path / "a.png").write_bytes(content)
    found = read_picture(tmp_path / "a.png").pixels[0]
    assert found[:, 0].tolist() == [level * 255 // top for level in levels]
    assert found[:, 1].tolist() == [0 if level == top else 255 for level in levels]


def test_xmp_stays(camera, tmp_path):
    note = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"/>'
    for name in ("a.jpg", "a.webp"):
        Image.fromarray(pixels(np.uint8, 3)).save(tmp_path / name, xmp=note)
        augment_files([tmp_path / name], tmp_path / "out", camera)
        assert Image.open(tmp_path / "out" / name).info["xmp"] == note


def test_floats_that_hold_whole_numbers_of_8_bit_are_refused(camera, tmp_path):
    values = pixels(np.uint8, 3)
    np.save(tmp_path / "a.npy", values.astype(np.float32))
    tifffile.imwrite(tmp_path / "b.tif", values.astype(np.float32), photometric="rgb")
    np.save(tmp_path / "mask.npy", (values > 90).astype(np.float32))  # whole too, and in [0, 1]
    done = augment_files([tmp_path], tmp_path / "out", camera)
    assert done.written == 1
    assert [line.split(": ")[-1] for line in done.failed] == [done.failed[0].split(": ")[-1]] * 2
    assert "divide by" in done.failed[0]


def test_tifffiles_description_of_another_layout_is_left_out(camera, tmp_path):
    values = pixels(np.uint8, 3)
    tifffile.imwrite(
        tmp_path / "planes.tif", np.moveaxis(values, -1, 0), photometric="rgb", planarconfig="separate"
    )
    tifffile.imwrite(tmp_path / "pixels.tif", values, photometric="rgb")
    augment_files([tmp_path], tmp_path / "out", camera)
    described = {}
    for name in ("planes", "pixels"):
        with tifffile.TiffFile(tmp_path / "out" / f"{name}.tif") as file:
            assert file.asarray().shape == values.shape
            described[name] = file.pages[0].description
    assert described == {"planes": "", "pixels": '{"shape": [24, 40, 3]}'}


def test_floating_point_pictures_stay_linear_light(camera, tmp_path):
    exr = pytest.importorskip("OpenEXR")
    light = np.full((32, 40, 3), 0.25, np.float32)
    light[:4] = 3.0  # brighter than white: saturates
    tifffile.imwrite(tmp_path / "a.tif", light, photometric="rgb")
    np.save(tmp_path / "b.npy", light[..., 0].astype(np.float64))
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    depth = np.random.default_rng(0).random((32, 40)).astype(np.float32)
    channels = {name: light[..., i].astype(np.float16) for i, name in enumerate("RGB")}
    exr.File(header, channels | {"Z": depth}).write(str(tmp_path / "c.exr"))
    done = augment_files([tmp_path / name for name in ("a.tif", "b.npy", "c.exr")], tmp_path / "out", camera)
    assert (done.written, done.clipped) == (3, 3)
    with exr.File(str(tmp_path / "out" / "c.exr"), separate_channels=True) as file:
        written = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    assert np.array_equal(written["Z"], depth)
    assert written["G"].dtype == np.float16
    full = 65535 * GAIN
    sigma = (0.25 * full + READ_E**2) ** 0.5 / full
    for noisy in (tifffile.imread(tmp_path / "out/a.tif"), np.load(tmp_path / "out/b.npy")):
        assert noisy.max() <= 1
        # A monochrome camera: one noise for all channels, 1,120 pixels; relative standard error 2.1 %; 5 of them.
        assert noisy[4:].std() == pytest.approx(sigma, rel=0.11)
        assert noisy[4:].mean() == pytest.approx(0.25, abs=5 * sigma / 1120**0.5)
    assert np.load(tmp_path / "out/b.npy").dtype == np.float64


def test_chunks_and_a_transparent_colour_of_a_png_stay(camera, tmp_path):
    from PIL import PngImagePlugin

    info = PngImagePlugin.PngInfo()
    info.add_text("Title", "a frame")
    key = (120, 121, 122)
    image = np.full((20, 20, 3), 121, np.uint8)
    image[:5] = key
    Image.fromarray(image).save(tmp_path / "a.png", pnginfo=info, dpi=(300, 300), transparency=key)
    deep = pixels(np.uint16, 3)
    assert cv2.imwrite(str(tmp_path / "b.png"), deep)
    content = (tmp_path / "b.png").read_bytes()
    text = b"tEXtTitle\0deep"
    chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
    (tmp_path / "b.png").write_bytes(content[:33] + chunk + content[33:])
    augment_files(
        [tmp_path / "a.png", tmp_path / "b.png"], tmp_path / "out", camera.replace({"gain_e_per_dn": 0.01})
    )
    with Image.open(tmp_path / "out" / "a.png") as made:
        assert made.info["transparency"] == key
        assert made.info["Title"] == "a frame"
        assert made.info["dpi"] == pytest.approx((300, 300), rel=0.01)
        transparent = (np.asarray(made) == key).all(-1)
    assert transparent[:5].all()
    assert not transparent[5:].any()  # noise makes no pixel transparent
    with Image.open(tmp_path / "out" / "b.png") as made:
        assert made.info["Title"] == "deep"


def test_a_damaged_picture_is_named_and_the_others_are_made(camera, tmp_path):
    root = tmp_path / "in"
    root.mkdir()
    for name in ("a.png", "c.png"):
        png(root / name)
    truncated(root / "b.png")
    touch(root / "notes.txt")
    touch(root / "clip.mp4")
    (tmp_path / "elsewhere").mkdir()
    png(tmp_path / "elsewhere" / "d.png")
    (root / "linked").symlink_to(tmp_path / "elsewhere")
    (root / "loop").symlink_to(root)
    done = augment_files([root], tmp_path / "out", camera)
    assert set(contents(tmp_path / "out")) == {"a.png", "c.png", "linked/d.png"}
    assert (done.written, len(done.failed)) == (3, 1)
    assert "b.png" in done.failed[0]
    assert done.skipped == {".txt": 1, ".mp4": 1}
    again = augment_files([root], tmp_path / "out", camera)
    assert (again.written, again.kept, len(again.failed)) == (0, 3, 1)
    assert augment_files([root], tmp_path / "two", camera, copies=2).failed == done.failed


def named_wrongly(path, values, form=".png"):
    """A picture of one format under the suffix of another."""
    path.parent.mkdir(exist_ok=True)
    assert cv2.imwrite(str(path.with_suffix(form)), values)
    path.with_suffix(form).rename(path)


def test_a_picture_that_does_not_fit_its_suffix_is_named_and_the_others_are_made(camera, tmp_path):
    root = tmp_path / "in"
    refused = {
        "gray16.webp": "is a PNG picture of 16 bit; expected a name ending in .png",
        "rgb16.webp": "is a PNG picture of 16 bit",
        "gray16.jpg": "is a PNG picture of 16 bit",
        "rgb16.bmp": "is a TIFF picture of 16 bit; expected a name ending in .tiff",
        "rgba.jpg": "cannot be written in the format of its suffix",
        "wide.webp": "cannot be written in the format of its suffix",
    }
    named_wrongly(root / "gray16.webp", pixels(np.uint16, 1))
    named_wrongly(root / "rgb16.webp", pixels(np.uint16, 3))
    named_wrongly(root / "gray16.jpg", pixels(np.uint16, 1))
    named_wrongly(root / "rgb16.bmp", pixels(np.uint16, 3), ".tiff")
    named_wrongly(root / "rgba.jpg", pixels(np.uint8, 4))
    named_wrongly(root / "wide.webp", pixels(np.uint8, 3, shape=(1, 16384)))  # WebP ends at 16383
    named_wrongly(root / "rgb.jpg", pixels(np.uint8, 3))
    cv2.imwrite(str(root / "z.jpg"), pixels(np.uint8, 3))
    done = augment_files([root], tmp_path / "out", camera)
    assert set(contents(tmp_path / "out")) == {"rgb.jpg", "z.jpg"}
    assert len(done.failed) == len(refused)
    for name, why in refused.items():
        assert any(line.startswith(f"{root / name}: {why}") for line in done.failed), name
    cv2.imwrite(str(tmp_path / "out" / "rgba.jpg"), pixels(np.uint8, 3))
    with pytest.raises(InputError, match=r"rgba\.jpg: exists, and visaug did not write it"):
        augment_files([root], tmp_path / "out", camera)


@pytest.mark.parametrize("link", ["../in/c.png", "../in/labels/c.txt"])
def test_an_original_is_not_overwritten_through_a_link(camera, tmp_path, link):
    root, out = tmp_path / "in", tmp_path / "out"
    for name in ("a.png", "b.png", "c.png"):
        png(root / name)
    (root / "labels").mkdir()
    (root / "labels" / "c.txt").write_text("0 0.5 0.5 0.2 0.2\n")
    out.mkdir()
    (out / "a.png").symlink_to(link)
    before = contents(root)
    with pytest.raises(InputError, match=r"in/(labels/)?c\.(png|txt): would be overwritten"):
        augment_files([root], out, camera, labels=True, force=True)
    assert contents(root) == before
    assert [path.name for path in out.iterdir()] == ["a.png"]


def test_labels_of_others_are_refused_before_any_work(camera, tmp_path):
    root, out = tmp_path / "in", tmp_path / "set" / "images"
    for number in range(3):
        png(root / f"{number}.png")
        (root / f"{number}.txt").write_text(f"{number}\n")
    labels = tmp_path / "set" / "labels"
    labels.mkdir(parents=True)
    (labels / "0.txt").write_text("0\n")  # the same labels do no harm
    (labels / "2.txt").write_text("of others\n")
    with pytest.raises(InputError) as told:
        augment_files([root], out, camera, labels=True)
    assert str(told.value).startswith(f"{labels / '2.txt'}: exists, and visaug did not write it")
    assert contents(tmp_path / "set") == {"labels/0.txt": b"0\n", "labels/2.txt": b"of others\n"}
    assert augment_files([root], out, camera, labels=True, force=True).written == 3
    (labels / "2.txt").write_text("changed since\n")
    with pytest.raises(InputError, match=r"set/labels/2\.txt: was changed since visaug wrote it"):
        augment_files([root], out, camera, labels=True, seed=1)
    assert augment_files([root], out, camera, labels=True, force=True).kept == 3
    assert contents(tmp_path / "set")["labels/2.txt"] == b"2\n"


def test_a_name_that_is_not_utf8_gets_a_copy(camera, tmp_path):
    root, name = tmp_path / "in", os.fsdecode(b"caf\xe9.png")
    png(root / "a.png")
    try:
        (root / "a.png").rename(root / name)
    except OSError:
        pytest.skip("the file system takes UTF-8 alone")
    (root / "notes").write_text("carried")
    (root / "notes").rename(root / os.fsdecode(b"\xe9.json"))
    for written, kept in ((1, 0), (0, 1)):
        done = augment_files([root], tmp_path / "out", camera, labels=True)
        assert (done.written, done.kept) == (written, kept)
    assert set(contents(tmp_path / "out")) == set(contents(root))
    assert (tmp_path / "out" / name).read_bytes() != (root / name).read_bytes()


def test_copies_keep_their_names_and_bytes_when_there_are_more(camera, tmp_path):
    png(tmp_path / "a.png")
    two = augment_files([tmp_path / "a.png"], tmp_path / "out", camera, copies=2)
    first = contents(tmp_path / "out")
    assert set(first) == {"a_1.png", "a_2.png"}
    assert first["a_1.png"] != first["a_2.png"]
    three = augment_files([tmp_path / "a.png"], tmp_path / "out", camera, copies=3)
    assert (two.written, three.written, three.kept) == (2, 1, 2)
    assert {name: contents(tmp_path / "out")[name] for name in first} == first


def test_a_share_of_the_copies_is_the_original_and_each_has_one_camera(camera, tmp_path):
    original = png(tmp_path / "a.png").read_bytes()
    loud = camera.replace({"read_noise.sigma_e": 4000.0})
    done = augment_files([tmp_path / "a.png"], tmp_path / "out", [camera, loud], copies=60, p=0.5)
    clean = [content == original for content in contents(tmp_path / "out").values()]
    assert done.written == 60
    assert 15 < sum(clean) < 45  # binomial, 60 x 0.5: standard deviation 3.9; 3.9 of them
    before = cv2.imread(str(tmp_path / "a.png"), cv2.IMREAD_UNCHANGED).astype(float)
    spread = [
        (cv2.imread(str(path), cv2.IMREAD_UNCHANGED) - before).std()
        for path in (tmp_path / "out").glob("*.png")
        if path.read_bytes() != original
    ]
    strong = sum(one > 3 for one in spread)  # 4,000 e- are 7.8 levels of 8 bit
    assert 0 < strong < len(spread)


def test_no_data_of_floats_stays_and_all_else_gets_noise(camera, tmp_path):
    light = np.random.default_rng(0).random((64, 64), dtype=np.float32)
    light[:6] = -9999
    tifffile.imwrite(tmp_path / "geo.tif", light, extratags=[(42113, 2, 0, "-9999", True)])
    done = augment_files([tmp_path / "geo.tif"], tmp_path / "out", camera)
    noisy = tifffile.imread(tmp_path / "out" / "geo.tif")
    assert (noisy[:6] == -9999).all()
    assert (noisy[6:] != light[6:]).mean() > 0.9
    assert (done.like_labels, done.clipped) == ({}, 0)


def test_no_data_of_words_does_not_count_as_light(camera, tmp_path):
    light = pixels(np.uint16, 1) // 16
    light[:6] = 65535
    tifffile.imwrite(tmp_path / "geo.tif", light, extratags=[(42113, 2, 0, "65535", True)])
    augment_files([tmp_path / "geo.tif"], tmp_path / "out", camera, bits=12)
    noisy = tifffile.imread(tmp_path / "out" / "geo.tif")
    assert (noisy[:6] == 65535).all()
    assert (noisy[6:] != light[6:]).mean() > 0.2


@pytest.mark.parametrize("dtype", [">u2", ">f4"])
def test_arrays_of_either_byte_order(camera, tmp_path, dtype):
    values = pixels(np.uint16, 1)
    values = values / 65535 if dtype == ">f4" else values
    made = {}
    for order in (np.dtype(dtype), np.dtype(dtype).newbyteorder()):
        np.save(tmp_path / "a.npy", values.astype(order))
        augment_files([tmp_path / "a.npy"], tmp_path / order.str, camera)
        made[order.str] = np.load(tmp_path / order.str / "a.npy")
    assert [one.dtype.str for one in made.values()] == list(made)
    first, second = made.values()
    assert (first == second).all()
    assert (first != np.load(tmp_path / "a.npy")).mean() > 0.2


def test_bits_of_16_bit_words(camera, tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((128, 128), 1000, np.uint16))
    png(tmp_path / "b.png")
    done = files.augment_files([tmp_path / "a.png", tmp_path / "b.png"], tmp_path / "out", camera, bits=12)
    assert len(done.failed) == 1
    assert "12 bit are given for an image of uint8" in done.failed[0]
    noisy = cv2.imread(str(tmp_path / "out" / "a.png"), cv2.IMREAD_UNCHANGED).astype(float)
    full = 65535 * GAIN
    sigma = (1000 / 4095 * full + READ_E**2) ** 0.5 / full * 4095
    assert noisy.std() == pytest.approx((sigma**2 + 1 / 12) ** 0.5, rel=0.03)  # 0.6 %; 5 of them
    with pytest.raises(InputError, match="value 1000"):
        augment_files([tmp_path / "a.png"], tmp_path / "out2", camera, bits=9)


def test_labels_go_where_ultralytics_looks_for_them(camera, tmp_path):
    (tmp_path / "set" / "labels").mkdir(parents=True)
    png(tmp_path / "set" / "images" / "a.png")
    (tmp_path / "set" / "labels" / "a.txt").write_text("0 0.5 0.5 0.2 0.2\n")
    png(tmp_path / "set" / "images" / "b.png")
    done = augment_files([tmp_path / "set"], tmp_path / "noisy", camera, copies=2, labels=True)
    made = contents(tmp_path / "noisy")
    assert {name for name in made if name.endswith(".txt")} == {"labels/a_1.txt", "labels/a_2.txt"}
    assert made["labels/a_2.txt"] == b"0 0.5 0.5 0.2 0.2\n"
    assert done.unlabelled == 2
    png(tmp_path / "flat" / "c.png")
    (tmp_path / "flat" / "c.txt").write_text("1 0.1 0.1 0.1 0.1\n")
    augment_files([tmp_path / "flat"], tmp_path / "noisy2", camera, labels=True)
    assert contents(tmp_path / "noisy2")["c.txt"] == b"1 0.1 0.1 0.1 0.1\n"


def test_openexr_without_its_package_is_one_clear_line(camera, tmp_path, monkeypatch):
    touch(tmp_path / "a.exr")
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(InputError, match=r"pip install 'visaug\[exr\]'"):
        augment_files([tmp_path / "a.exr"], tmp_path / "out", camera)


def test_the_seed_chooses_the_specimen_that_all_copies_share(tmp_path):
    content = {"resolution": [24, 40], "bit_depth": 16, "gain_e_per_dn": 1.0, "quantum_efficiency": 1.0}
    camera = Camera.load({**content, "exposure_s": 0.0, "dsnu": {"pixel_e": 141.0}})
    flat = np.full((24, 40), 20_000, np.uint16)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), flat)
    made = {}
    for seed in (0, 1):
        augment_files(
            [tmp_path],
            tmp_path / f"noisy{seed}",
            camera,
            seed=seed,
            exclude=["noisy*"],
            fixed_pattern="camera",
        )
        for name in ("a.png", "b.png"):
            copy = cv2.imread(str(tmp_path / f"noisy{seed}" / name), cv2.IMREAD_UNCHANGED)
            made[seed, name] = copy.astype(float).ravel()
    # shot noise of 141 e- and a pattern as strong: of one specimen half of the variance is shared
    same = np.corrcoef(made[1, "a.png"], made[1, "b.png"])[0, 1]
    other = np.corrcoef(made[0, "a.png"], made[1, "a.png"])[0, 1]
    assert same == pytest.approx(1 / 2, abs=0.13)  # four standard errors of 960 pixels
    assert abs(other) < 0.13
