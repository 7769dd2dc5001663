"""Measured maps: prnu.map, dsnu.map and those of further effects."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
import yaml
from astropy.io import fits

from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug.core.sampling import Stream
from visaug.pictures.part import with_a_well

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


def with_effects(folder: Path, *entries: str) -> Camera:
    head = f"resolution: [{ROWS}, {COLUMNS}]\ngain_e_per_dn: 0.01\nblack_level_dn: 5000\nexposure_s: 2\n"
    (folder / "camera.yaml").write_text(f"{head}effects: [{', '.join(entries)}]\n")
    return Camera.load(folder / "camera.yaml")


def test_a_measured_structure_adds_to_the_drawn_pattern(tmp_path: Path, pattern):
    """A profile of columns, (1, columns), holds for every row."""
    write(tmp_path / "columns.npy", pattern[:1])
    camera = with_effects(tmp_path, "{name: fixed_pattern_structure, amplitude_e: 0, map: columns.npy}")
    np.testing.assert_allclose(exposed(camera, 0.0), pattern[:1].repeat(ROWS, 0), atol=0.0051)
    drawn = camera.replace({"dsnu.pixel_e": 2.0})
    plain = exposed(drawn.without_effect("fixed_pattern_structure"), 0.0)
    np.testing.assert_allclose(exposed(drawn, 0.0) - plain, pattern[:1].repeat(ROWS, 0), atol=0.0102)


@pytest.mark.parametrize(
    ("effect", "photons", "electrons"),
    [
        ("{name: vignetting, map: half.npy}", 300.0, (300.0, 150.0)),
        ("{name: amplifier_glow, map: half.npy, b_per_c: 0}", 0.0, (2.0, 1.0)),  # e-/s, for 2 s
        ("{name: dark_current_nonuniformity, map: half.npy}", 0.0, (200.0, 100.0)),
    ],
)
def test_a_measured_profile_takes_the_place_of_the_law(tmp_path: Path, effect, photons, electrons):
    """Means of 1200 pixels with shot noise, within 5 standard errors; other seeds fail once in a million."""
    half = np.where(np.arange(ROWS) < ROWS // 2, 1.0, 0.5)[:, None].astype(np.float32)
    write(tmp_path / "half.npy", half)
    camera = with_effects(tmp_path, effect).replace({"dark_current.b_per_c": 0.0})
    if "dark_current" in effect:
        camera = camera.replace({"dark_current.a_e_per_s": 100.0})
    frame = exposed(camera, photons)
    for part, mean in zip((frame[: ROWS // 2], frame[ROWS // 2 :]), electrons):
        assert part.mean() == pytest.approx(mean, abs=5 * np.sqrt(mean / part.size))


def test_maps_of_further_effects_move_with_the_camera(tmp_path: Path, pattern):
    write(tmp_path / "map.npy", np.abs(pattern))
    camera = with_effects(tmp_path, "{name: amplifier_glow, map: map.npy}", "{name: row_noise}")
    camera.without_effect("row_noise").save(tmp_path / "deep" / "copy.yaml")
    again = Camera.load(tmp_path / "deep" / "copy.yaml")
    assert torch.equal(again.maps["amplifier_glow"], torch.from_numpy(np.abs(pattern)))
    assert camera.without_effect("amplifier_glow").maps == {}


def test_maps_that_mean_nothing_are_refused(tmp_path: Path, pattern):
    write(tmp_path / "map.npy", pattern)
    with pytest.raises(InputError, match=r"effects\.0\.map.*not a parameter|not a parameter.*row_noise"):
        with_effects(tmp_path, "{name: row_noise, map: map.npy}")
    with pytest.raises(InputError, match=r"map\.npy: effects\.1\.map: holds negative"):
        with_effects(tmp_path, "{name: row_noise}", "{name: vignetting, map: map.npy}")
    with pytest.raises(InputError, match=r"effects\.0\.map: 3 is not a file"):
        with_effects(tmp_path, "{name: vignetting, map: 3}")


def test_every_pixel_has_its_measured_read_noise(tmp_path: Path):
    """Standard deviations of 0, 3 and 9 e- by column over 300 frames of 40 rows: a variance known to 1.3 %, five of these."""
    sigma = np.broadcast_to(np.array([0.0, 3.0, 9.0], np.float32)[np.arange(COLUMNS) % 3], (ROWS, COLUMNS))
    write(tmp_path / "sigma.npy", sigma)
    camera = camera_at(tmp_path, read_noise="sigma.npy")
    stream = Stream(list(range(300)), [2] * 300, 1, (range(ROWS), range(COLUMNS)))
    frames = (camera.expose(torch.zeros(300, 1, ROWS, COLUMNS), stream)[:, 0].double().numpy() - 5000) * 0.01
    variances = frames.var(0, ddof=1).mean(0)
    assert (frames[:, :, 0::3] == 0).all()
    for first, expected in ((1, 9.0), (2, 81.0)):
        np.testing.assert_allclose(variances[first::3], expected, rtol=5 * 0.0129 * 1.05)
    with pytest.raises(InputError, match=r"negative"):
        write(tmp_path / "below.npy", sigma - 1)
        camera_at(tmp_path, read_noise="below.npy")


@pytest.mark.parametrize("part", ["prnu", "dsnu", "read_noise", "dark_current_nonuniformity"])
def test_a_camera_saved_elsewhere_finds_its_maps(tmp_path: Path, pattern, part):
    np.save(tmp_path / "map.npy", np.abs(pattern))
    entry = {"map": "map.npy"}
    base = part in ("prnu", "dsnu", "read_noise")
    content = {part: entry} if base else {"effects": [{"name": part, **entry}]}
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    (tmp_path / "map.npy").rename(tmp_path / "a" / "map.npy")
    head = {"resolution": [ROWS, COLUMNS], "gain_e_per_dn": 0.01, "black_level_dn": 5000}
    (tmp_path / "a" / "camera.yaml").write_text(yaml.safe_dump(head | content))
    camera = Camera.load(tmp_path / "a" / "camera.yaml")
    camera.save(tmp_path / "b" / "camera.yaml")
    again = Camera.load(tmp_path / "b" / "camera.yaml")
    assert torch.equal(again.maps[part], camera.maps[part])


def test_a_camera_of_other_content_keeps_its_maps_whatever_the_working_folder(tmp_path, pattern, monkeypatch):
    """Also that of pictures, which gets a full well; a map of another camera lies in the working folder."""
    np.save(tmp_path / "map.npy", pattern)
    camera = camera_at(tmp_path, dsnu="map.npy")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    np.save("map.npy", pattern + 100)
    named = camera.with_content(camera.to_dict() | {"name": "other"})
    for other in (named, with_a_well(camera), camera.replace({"exposure_s": 2.0})):
        assert torch.equal(other.maps["dsnu"], camera.maps["dsnu"])
        assert other.folder == camera.folder
    smaller = camera.to_dict() | {"resolution": [ROWS, COLUMNS - 1]}
    with pytest.raises(InputError, match=r"dsnu\.map: is 40 x 60; expected 40 x 59"):
        camera.with_content(smaller)
