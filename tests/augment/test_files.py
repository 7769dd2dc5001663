"""Noisy copies: names, sizes, depth and channels stay; same seed, same bytes; a broken run goes on."""

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from visaug import Camera, InputError
from visaug.augment import files
from visaug.augment.files import JOURNAL, augment_files
from visaug.augment.pictures import read_picture

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
    assert a == b
    assert all(a[name] != c[name] for name in a)
    names = [folder / "inner" / name for name in FORMATS]
    augment_files(names[::-1], tmp_path / "d", camera, seed=3)
    augment_files(names[:1], tmp_path / "e", camera, seed=3)
    d, e = contents(tmp_path / "d"), contents(tmp_path / "e")
    assert all(d[name] == content for name, content in e.items())


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
    augment_files([tmp_path / name for name in names], tmp_path / "out", camera)
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
    yield "no picture", (lambda root: [touch(root / "a.txt")])
    yield "cannot be read", (lambda root: [touch(root / "a.png")])
    yield "cannot be read", (lambda root: [truncated(root / "t.png")])
    yield "int32", (lambda root: [tiff(root / "i.tif", np.zeros((4, 4), np.int32))])
    yield "2 pictures", (lambda root: [moving(root / "m.webp")])
    yield "animated", (lambda root: [moving(root / "m.png")])
    yield "shape", (lambda root: [array(root / "a.npy", np.zeros((3, 8, 8), np.float32))])
    yield "int64", (lambda root: [array(root / "a.npy", np.zeros((8, 8), np.int64))])
    yield "pages", (lambda root: [tiff(root / "p.tif", np.zeros((3, 4, 4), np.uint8))])
    yield "as .*would", (lambda root: [png(root / "x" / "a.png"), png(root / "y" / "a.png")])
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
