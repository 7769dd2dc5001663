"""The measured component of unknown cause against NumPy: its law, its file, and images.

Statistical tests allow five standard errors on fixed seeds: of some 400 comparisons right code fails one with probability 2e-4.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from visaug import simulate
from visaug.augment import SensorNoise
from visaug.camera import Camera, fast
from visaug.camera.sharing import add_camera
from visaug.core.errors import InputError
from visaug.core.sampling import Stream
from visaug.effects import Unexplained
from visaug.effects.testing import check_effect
from visaug.frames import FrameRecord, FrameSet

ROWS, COLUMNS, FRAMES = 31, 40, 4000
RNG = np.random.default_rng(5)
PATTERN = RNG.normal(0, 3, (ROWS, COLUMNS))
CONTENT = {
    "resolution": [ROWS, COLUMNS],
    "gain_e_per_dn": 0.05,
    "black_level_dn": 9000.0,
    "full_well_e": 2000.0,
}


def power_of(count: int) -> np.ndarray:
    """A spectrum that falls, with a line at 5 cycles; as of real records, alike at k and at count - k."""
    frequency = np.abs(np.fft.fftfreq(count, 1 / count))
    return 4.0 / (1 + frequency) + np.where(frequency == 5, 20.0, 0.0)


def camera_with(folder: Path, **arrays: np.ndarray) -> Camera:
    folder.mkdir(exist_ok=True, parents=True)
    np.savez(folder / "measured.npz", **arrays)
    content = {**CONTENT, "effects": [{"name": "unexplained", "map": "measured.npz"}]}
    (folder / "camera.yaml").write_text(yaml.safe_dump(content))
    return Camera.load(folder / "camera.yaml")


def dark_e(camera: Camera, count: int = FRAMES, rows=range(ROWS), columns=range(COLUMNS)) -> np.ndarray:
    """Dark frames (count, rows, columns) in electrons; the camera has no other noise, codes are 0.05 e- wide."""
    stream = Stream(list(range(count)), [7] * count, 1, (rows, columns))
    dn = camera.expose(torch.zeros(count, 1, len(rows), len(columns)), stream)
    return (dn[:, 0].double().numpy() - 9000) * 0.05


class Measured(Unexplained):
    """Load maps that repeat over any sensor, so that the laws are tested on an effect that acts."""

    def apply(self, signal, p, stream, context):
        return super().apply(signal, p, stream, self._measured(context))

    def moments(self, mean, p, context):
        return super().moments(mean, p, self._measured(context))

    @staticmethod
    def _measured(context):
        rows, columns = context.resolution
        arrays = {
            "map_e": np.random.default_rng(1).normal(0, 2, (rows, columns)),
            "row_power_e2": power_of(rows),
            "column_power_e2": 0.5 * power_of(columns),
            "level_e": np.array([0.0, 500.0, 2000.0]),
            "variance_e2": np.array([0.0, 30.0, 50.0]),
        }
        maps = {f"unexplained.{k}": torch.from_numpy(v.astype(np.float32)) for k, v in arrays.items()}
        return replace(context, maps=maps)


def test_the_laws_of_effects_hold_with_a_file():
    check_effect(Measured)


def test_the_pattern_is_that_of_the_file(tmp_path: Path):
    frames = dark_e(camera_with(tmp_path, map_e=PATTERN), 3)
    for frame in frames:
        np.testing.assert_allclose(frame, PATTERN, atol=0.026)  # half a code


@pytest.mark.parametrize(("name", "axis", "count"), [("row", 1, ROWS), ("column", 2, COLUMNS)])
def test_lines_have_the_spectrum_of_the_file(tmp_path: Path, name, axis, count):
    """Periodograms of 4000 frames: a mean of exponential variables, known to 1.6 % (2.2 % at 0 and at half a cycle a line)."""
    power = power_of(count)
    frames = dark_e(camera_with(tmp_path, **{f"{name}_power_e2": power}))
    lines = frames.mean(3 - axis)
    np.testing.assert_allclose(
        frames, np.expand_dims(lines, 3 - axis).repeat(frames.shape[3 - axis], 3 - axis)
    )
    found = (np.abs(np.fft.fft(lines)) ** 2).mean(0) / count
    np.testing.assert_allclose(found, power, rtol=5 * np.sqrt(2 / FRAMES), atol=0.05**2)
    assert lines.var() == pytest.approx(power.mean(), rel=5 * np.sqrt(2 / FRAMES))
    # new in every frame: products of consecutive frames have mean 0
    products = (lines[1:] * lines[:-1]).mean(1)
    assert abs(products.mean()) < 5 * products.std() / np.sqrt(FRAMES)


@pytest.mark.parametrize(
    ("level", "variance"), [(-50.0, 1.0), (0.0, 1.0), (250.0, 5.5), (500.0, 10.0), (900.0, 10.0)]
)
def test_the_variance_follows_the_curve(run_effect, level, variance):
    """200 000 pixels: a variance known to 0.32 %. np.interp is the law."""
    arrays = {"level_e": np.array([0.0, 500.0]), "variance_e2": np.array([1.0, 10.0])}
    assert variance == np.interp(level, *arrays.values())
    maps = {f"unexplained.{k}": torch.from_numpy(v.astype(np.float32)) for k, v in arrays.items()}

    class Here(Unexplained):
        def apply(self, signal, p, stream, context):
            return super().apply(signal, p, stream, replace(context, maps=maps))

    noise = Here()(torch.full((400, 500), level)).double() - level
    assert float(noise.var()) == pytest.approx(variance, rel=5 * np.sqrt(2 / 200_000))
    assert float(noise.mean()) == pytest.approx(0, abs=5 * np.sqrt(variance / 200_000))


def test_a_window_shows_its_part_of_rows_and_map(tmp_path: Path):
    camera = camera_with(
        tmp_path, map_e=PATTERN, row_power_e2=power_of(ROWS), column_power_e2=power_of(COLUMNS)
    )
    whole, part = dark_e(camera, 4), dark_e(camera, 4, range(9, 20), range(12, 37))
    np.testing.assert_array_equal(whole[:, 9:20, 12:37], part)


def test_a_plan_is_simulated_with_it(tmp_path: Path):
    camera = camera_with(tmp_path, map_e=PATTERN, row_power_e2=power_of(ROWS))
    records = [FrameRecord(i, f"{i}.npy", "bias", 0.0, 20.0, 0.0) for i in range(3)]
    plan = FrameSet.from_arrays(records, np.zeros((3, ROWS, COLUMNS), np.uint16), bit_depth=16)
    frames = (simulate(camera, plan).read_many(range(3)).astype(float) - 9000) * 0.05
    rows = (frames - PATTERN).mean(2)
    np.testing.assert_allclose(frames, PATTERN + rows[:, :, None], atol=0.051)
    assert (np.abs(np.diff(rows, axis=0)).max(1) > 0.5).all()


def test_images_get_the_measured_row_noise(tmp_path: Path):
    """The same draws with and without the component; spectra of 2000 images, known to 3.2 % at most."""
    camera = camera_with(tmp_path / "a", row_power_e2=power_of(ROWS))
    plain = camera.without_effect("unexplained")
    images = torch.full((2000, 1, ROWS, COLUMNS), 0.5)
    noise = SensorNoise(camera, seed=3)
    draws = noise.draw(len(images))
    with torch.no_grad():
        change = noise.apply_draws(images, draws) - SensorNoise(plain, fast=False).apply_draws(images, draws)
    rows = change[:, 0].double().numpy().mean(2) * 2000.0  # of 2000 electrons at image value 1
    found = (np.abs(np.fft.fft(rows)) ** 2).mean(0) / ROWS
    np.testing.assert_allclose(found, power_of(ROWS), rtol=5 * np.sqrt(2 / len(images)), atol=0.05**2)


def test_the_fast_path_leaves_it_to_the_exact_chain(tmp_path: Path):
    camera = camera_with(tmp_path, row_power_e2=power_of(ROWS))
    plain = camera.without_effect("unexplained")
    assert fast.suits(plain, plain.arrays())
    assert not fast.suits(camera, camera.arrays())
    images = torch.rand(2, 1, ROWS, COLUMNS, generator=torch.Generator().manual_seed(1))
    one, other = (SensorNoise(camera, seed=3, fast=fast_too) for fast_too in (True, False))
    draws = one.draw(2)
    assert torch.equal(one.apply_draws(images, draws), other.apply_draws(images, draws))


def test_twice_the_strength_is_twice_the_component(tmp_path: Path):
    """Rows of a bright image, relative to the signal; a curve that rises stays where the signal is."""
    camera = camera_with(
        tmp_path, row_power_e2=power_of(ROWS), level_e=[0.0, 2000.0], variance_e2=[0.0, 400.0]
    )
    images = torch.full((500, 1, ROWS, COLUMNS), 0.5)
    spread = []
    for strength in (1.0, 2.0):
        noise, plain = (
            SensorNoise(one, seed=3, strength=strength, fast=False)
            for one in (camera, camera.without_effect("unexplained"))
        )
        draws = noise.draw(len(images))
        change = (noise.apply_draws(images, draws) - plain.apply_draws(images, draws))[:, 0].double()
        rows = change.mean(2, keepdim=True)
        spread.append((float(rows.std()), float((change - rows).std())))
    # the same random numbers; the variance of pixels is taken at their own signal, whose shot noise differs
    assert spread[1][0] == pytest.approx(2 * spread[0][0], rel=0.02)
    assert spread[1][1] == pytest.approx(2 * spread[0][1], rel=0.02)


def test_a_camera_that_moves_finds_its_file(tmp_path: Path, monkeypatch):
    camera = camera_with(tmp_path / "a", map_e=PATTERN)
    camera.save(tmp_path / "b" / "copy.yaml")
    content = yaml.safe_load((tmp_path / "a" / "camera.yaml").read_text())
    content |= {"name": "measured one", "assumed": [*CONTENT, "unexplained"], "source": {}}
    (tmp_path / "a" / "camera.yaml").write_text(yaml.safe_dump(content))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    added = add_camera(tmp_path / "a" / "camera.yaml")
    (tmp_path / "a" / "measured.npz").rename(tmp_path / "elsewhere.npz")
    assert torch.equal(Camera.load(added).maps["unexplained.map_e"], camera.maps["unexplained.map_e"])
    (tmp_path / "elsewhere.npz").rename(tmp_path / "a" / "measured.npz")
    again = Camera.load(tmp_path / "b" / "copy.yaml")
    assert torch.equal(again.maps["unexplained.map_e"], camera.maps["unexplained.map_e"])


@pytest.mark.parametrize(
    ("arrays", "problem"),
    [
        ({}, "holds no array"),
        ({"map": PATTERN}, "holds map; expected some of map_e"),
        ({"map_e": PATTERN[1:]}, r"map_e has shape \(30, 40\); expected \(31, 40\)"),
        ({"row_power_e2": power_of(COLUMNS)}, "row_power_e2 has shape"),
        ({"column_power_e2": -power_of(COLUMNS)}, "column_power_e2 holds negative values"),
        ({"map_e": PATTERN * np.nan}, "map_e holds values that are not finite"),
        ({"level_e": np.arange(3.0)}, "level_e and variance_e2 do not match"),
        ({"level_e": np.zeros(2), "variance_e2": np.ones(2)}, "level_e does not rise"),
        ({"map_e": np.array("a")}, "map_e holds values that are not finite numbers"),
    ],
)
def test_a_file_that_means_nothing_is_refused(tmp_path: Path, arrays, problem):
    with pytest.raises(InputError, match=rf"measured\.npz: effects\.0\.map: .*{problem}"):
        camera_with(tmp_path, **arrays)


def test_a_missing_or_torn_file_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match=r"effects\.0\.map: is missing; expected the file"):
        Camera.load({**CONTENT, "effects": [{"name": "unexplained"}]})
    with pytest.raises(InputError, match=r"nowhere\.npz: effects\.0\.map: no such file"):
        Camera.load({**CONTENT, "effects": [{"name": "unexplained", "map": "nowhere.npz"}]})
    (tmp_path / "torn.npz").write_bytes(b"PK\x03\x04 torn")
    with pytest.raises(InputError, match=r"torn\.npz: effects\.0\.map: cannot be read"):
        Camera.load({**CONTENT, "effects": [{"name": "unexplained", "map": str(tmp_path / "torn.npz")}]})
