"""Measured maps: prnu.map and dsnu.map."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from astropy.io import fits

from visaug.camera import Camera
from visaug.errors import InputError
from visaug.sampling import Stream

ROWS, COLUMNS = 40, 60


@pytest.fixture
def pattern() -> np.ndarray:
    return np.random.default_rng(3).normal(0, 5, (ROWS, COLUMNS)).astype(np.float32)


def write(path: Path, pattern: np.ndarray) -> None:
    if path.suffix == ".npy":
        np.save(path, pattern)
    elif path.suffix == ".tif":
        tifffile.imwrite(path, pattern)
    else:
        fits.PrimaryHDU(pattern).writeto(path)


def camera_at(folder: Path, **parts) -> Camera:
    lines = [f"{part}: {{map: {name}}}" for part, name in parts.items()]
    head = f"resolution: [{ROWS}, {COLUMNS}]\ngain_e_per_dn: 0.01\nblack_level_dn: 5000\n"
    folder.mkdir(exist_ok=True)
    (folder / "camera.yaml").write_text(head + "\n".join(lines))
    return Camera.load(folder / "camera.yaml")


def exposed(camera: Camera, photons: float, rows=range(ROWS), columns=range(COLUMNS)) -> np.ndarray:
    """One frame in e-, black level off."""
    stream = Stream([1], [2], 1, (rows, columns))
    frame = camera.expose(torch.full((1, 1, len(rows), len(columns)), photons), stream)
    return (frame[0, 0].double().numpy() - 5000) * 0.01


@pytest.mark.parametrize("suffix", [".npy", ".tif", ".fits"])
def test_a_dark_frame_shows_the_measured_offsets(tmp_path: Path, pattern, suffix):
    write(tmp_path / f"map{suffix}", pattern)
    camera = camera_at(tmp_path, dsnu=f"map{suffix}")
    np.testing.assert_allclose(exposed(camera, 0.0), pattern, atol=0.0051)  # half a DN


def test_a_window_shows_its_part_of_the_map(tmp_path: Path, pattern):
    write(tmp_path / "map.npy", pattern)
    camera = camera_at(tmp_path, dsnu="map.npy")
    seen = exposed(camera, 0.0, range(7, 20), range(30, 55))
    np.testing.assert_allclose(seen, pattern[7:20, 30:55], atol=0.0051)


def test_the_measured_response_scales_the_light(tmp_path: Path):
    """At most 360 electrons, 1200 pixels of each kind: means within 5 standard errors."""
    response = np.where(np.arange(COLUMNS) % 2, 0.2, -0.2)[None, :].repeat(ROWS, 0).astype(np.float32)
    write(tmp_path / "k.npy", response)
    frame = exposed(camera_at(tmp_path, prnu="k.npy"), 300.0)
    for parity, mean in ((0, 240.0), (1, 360.0)):
        assert frame[:, parity::2].mean() == pytest.approx(mean, abs=5 * np.sqrt(360 / 1200))


def test_the_map_takes_the_place_of_the_drawn_pattern(tmp_path: Path, pattern):
    write(tmp_path / "map.npy", pattern)
    camera = camera_at(tmp_path, dsnu="map.npy").replace({"dsnu.pixel_e": 100.0})
    np.testing.assert_allclose(exposed(camera, 0.0), pattern, atol=0.0051)


def test_a_saved_copy_elsewhere_finds_the_map(tmp_path: Path, pattern):
    write(tmp_path / "map.npy", pattern)
    camera = camera_at(tmp_path, dsnu="map.npy")
    camera.replace({"black_level_dn": 100.0}).save(tmp_path / "deep" / "er" / "copy.yaml")
    assert torch.equal(Camera.load(tmp_path / "deep" / "er" / "copy.yaml").maps["dsnu"], camera.maps["dsnu"])


def test_bad_maps_are_refused_with_their_key(tmp_path: Path, pattern):
    with pytest.raises(InputError, match=r"dsnu\.map.*no such file"):
        camera_at(tmp_path / "a", dsnu="missing.npy")
    write(tmp_path / "a" / "small.npy", pattern[:-1])
    with pytest.raises(InputError, match=r"small\.npy: dsnu\.map: is 39 x 60; expected 40 x 60"):
        camera_at(tmp_path / "a", dsnu="small.npy")
    pattern[3, 3] = np.nan
    write(tmp_path / "a" / "hole.npy", pattern)
    with pytest.raises(InputError, match=r"hole\.npy: prnu\.map.*finite"):
        camera_at(tmp_path / "a", prnu="hole.npy")
    (tmp_path / "a" / "torn.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(InputError, match=r"torn\.npy"):
        camera_at(tmp_path / "a", dsnu="torn.npy")
