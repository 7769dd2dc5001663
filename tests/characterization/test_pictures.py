import numpy as np
import pytest

from visaug.characterization import characterize
from visaug.frames import FrameRecord, FrameSet


def pictures(n=3, slope=0.5, floor=4.0, row=0.0, seed=0):
    """Smooth steps with edges and a textured corner, under noise of variance floor + slope * level."""
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(n):
        clean = np.repeat(np.linspace(20, 180, 8), 32)[None] + 0.05 * np.arange(192)[:, None]
        clean[:64, :64] += 40 * rng.random((64, 64)) * (np.indices((64, 64)).sum(0) % 3 > 0)
        noisy = clean + rng.normal(0, 1, clean.shape) * np.sqrt(floor + slope * clean)
        frames.append(np.rint(noisy + rng.normal(0, row, (192, 1))).clip(0, 255).astype(np.uint8))
    return FrameSet.from_arrays([FrameRecord(i, f"{i}.png", "image") for i in range(n)], frames)


def test_noise_level_function_of_flat_regions():
    """Bootstrap intervals of 95 %; twice their half width off by chance less than once in 10,000."""
    result = characterize(pictures())
    slope, floor = result["image.noise_slope_dn"], result["image.noise_floor_dn2"]
    assert abs(slope.value - 0.5) < slope.high - slope.low
    assert abs(floor.value - 4.0 - 1 / 12) < floor.high - floor.low
    assert slope.high - slope.low < 0.15
    curve = result.curves["noise_level"]
    expected = np.sqrt(4 + 0.5 * curve["level_dn"] + 1 / 12)
    np.testing.assert_allclose(curve["noise_dn"], expected, rtol=0.06)
    assert result.plot_noise_level().axes


@pytest.mark.parametrize("row", [0.0, 3.0])
def test_row_noise_of_flat_regions(row):
    result = characterize(pictures(row=row, slope=0.1))
    found = result["image.row_noise_dn"]
    assert found.value == pytest.approx(row, abs=0.5)
    assert result["image.column_noise_dn"].value < 0.6


def test_what_pictures_cannot_tell_is_listed():
    result = characterize(pictures(1))
    assert {"gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "dsnu.pixel_e"} <= set(
        result.not_determined
    )
    assert any(w.startswith("pictures_alone") for w in result.warnings)


def test_pictures_without_a_flat_region_are_named():
    texture = np.random.default_rng(1).integers(0, 2, (64, 64)).repeat(4, 0).repeat(4, 1) * 200 + 20
    frames = FrameSet.from_arrays([FrameRecord(0, "t", "image")], texture[None].astype(np.uint8))
    result = characterize(frames)
    assert any(w.startswith("no_flat_regions") for w in result.warnings)
    assert "image.noise_dn" in result.not_determined
