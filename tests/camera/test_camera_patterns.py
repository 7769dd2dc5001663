"""Accurate fixed patterns: what is put in is found, what is drawn is like what was measured."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from visaug.camera import Camera
from visaug.camera.patterns import FixedPatternLaw, LineLaw, Mixture, fit_mixture, fit_pattern, fit_profile
from visaug.core.errors import InputError

LEVELS = Mixture(np.array([0.75, 0.2, 0.05]), np.array([1.0, 6.0, 11.0]), np.full(3, 0.45))
WHITE = np.ones(300)


def autocorrelation(profile: np.ndarray, lag: int) -> float:
    centred = profile - profile.mean()
    return float((centred[lag:] * centred[:-lag]).mean() / profile.var())


def test_the_mixtures_law_against_scipy():
    x = np.linspace(-2, 14, 200)
    expected = sum(w * stats.norm.cdf(x, m, 0.45) for w, m in zip(LEVELS.weights, LEVELS.means))
    np.testing.assert_allclose(LEVELS.cdf(x), expected, atol=1e-12)
    p = np.array([0.01, 0.4, 0.7, 0.8, 0.9, 0.97, 0.999])
    np.testing.assert_allclose(LEVELS.cdf(LEVELS.quantile(p)), p, atol=2e-4)
    assert LEVELS.mean == pytest.approx(2.5)
    assert LEVELS.variance == pytest.approx(7.75 + 0.45**2)


def test_levels_are_found():
    """Three levels 5 e- apart and 0.45 e- wide: counts, places and widths within 5 standard errors of 1280
    lines.
    """
    rng = np.random.default_rng(0)
    level = rng.choice(3, 1280, p=LEVELS.weights)
    found = fit_mixture(LEVELS.means[level] + 0.45 * rng.standard_normal(1280))
    order = np.argsort(found.means)
    np.testing.assert_allclose(found.weights[order], np.bincount(level) / 1280, atol=0.01)
    counts = np.bincount(level)
    for k in range(3):
        assert found.means[order[k]] == pytest.approx(LEVELS.means[k], abs=5 * 0.45 / np.sqrt(counts[k]))
        assert found.deviations[order[k]] == pytest.approx(0.45, rel=5 / np.sqrt(2 * counts[k]))


def test_one_gaussian_is_taken_for_one():
    found = fit_mixture(np.random.default_rng(1).normal(2, 3, 1000))
    assert len(found.weights) == 1
    assert found.means[0] == pytest.approx(2, abs=0.5)
    assert found.deviations[0] == pytest.approx(3, rel=0.12)


def test_a_constant_profile_is_no_trouble():
    profile = fit_profile(np.full(64, 3.0))
    np.testing.assert_allclose(profile.draw(64, np.random.default_rng(0)), 3.0, atol=1e-6)


def test_drawn_profiles_have_the_measured_ones_levels_spectrum_and_trend():
    """A known law -> a sensor -> a fitted law -> 30 sensors of it, which must be like the first one."""
    rng = np.random.default_rng(2)
    frequency = np.linspace(0, 0.5, 641)
    spectrum = 1 / (1 + (frequency / 0.01) ** 2) + 0.3
    spectrum[80] += 60  # a period of 16 columns
    truth = LineLaw(LEVELS, np.array([0, -0.5, 0.4, -0.1]), 0.7 * spectrum / spectrum.mean())
    measured = truth.draw(1280, rng)
    fitted = fit_profile(measured)
    drawn = [fitted.draw(1280, rng) for _ in range(30)]

    assert np.mean(drawn) == pytest.approx(measured.mean(), rel=0.1)
    assert np.mean([d.std() for d in drawn]) == pytest.approx(measured.std(), rel=0.1)
    for lag in (1, 2, 4, 8, 16):  # the last two are half a period and a whole one
        mean = np.mean([autocorrelation(d, lag) for d in drawn])
        assert mean == pytest.approx(autocorrelation(measured, lag), abs=0.1)
    gap = [((d > 2.8) & (d < 4.2)).mean() for d in drawn]  # between the levels at 1 and 6 there is nothing
    assert np.mean(gap) < 0.005
    left = measured[:250].mean() - measured[250:].mean()
    assert np.mean([d[:250].mean() - d[250:].mean() for d in drawn]) == pytest.approx(left, abs=0.6)
    assert left > 1.0
    assert not np.allclose(drawn[0], drawn[1])


def test_a_profile_can_be_drawn_at_another_length():
    """White noise through three levels has the mixture's moments at any length; 5 standard errors of 20,000
    lines.
    """
    profile = LineLaw(LEVELS, np.zeros(1), WHITE)
    drawn = np.concatenate([profile.draw(200, np.random.default_rng(seed)) for seed in range(100)])
    assert drawn.mean() == pytest.approx(LEVELS.mean, abs=5 * np.sqrt(LEVELS.variance / 20_000))
    assert drawn.std() == pytest.approx(np.sqrt(LEVELS.variance), rel=0.05)


def test_a_master_bias_is_parted_into_columns_rows_and_pixels():
    """As eq. 14 of the paper parts it; pixels within 5 standard errors, read noise of 100 averaged frames
    taken off.
    """
    rng = np.random.default_rng(3)
    shape = (400, 500)
    columns, rows = rng.normal(2, 2.8, 500), rng.normal(0, 0.6, 400)
    master = (
        columns[None] + rows[:, None] + 1.1 * rng.standard_normal(shape) + 0.237 * rng.standard_normal(shape)
    )
    law = fit_pattern(master, noise_e=0.237)
    assert law.pixel_e == pytest.approx(1.1, rel=5 / np.sqrt(2 * 200_000))
    assert np.sqrt(law.columns.mixture.variance) == pytest.approx(columns.std(), rel=0.03)
    assert np.sqrt(law.rows.mixture.variance) == pytest.approx(rows.std(), rel=0.03)
    assert law.columns.mixture.mean == pytest.approx(master.mean(), rel=0.01)


def test_a_drawn_pattern_is_a_map_of_a_camera(tmp_path: Path):
    law = FixedPatternLaw(
        LineLaw(LEVELS, np.zeros(1), WHITE),
        LineLaw(Mixture(np.ones(1), np.zeros(1), np.ones(1)), np.zeros(1), WHITE),
        1.1,
    )
    pattern = law.draw((40, 60), seed=7)
    np.testing.assert_array_equal(pattern, law.draw((40, 60), seed=7))
    assert not np.array_equal(pattern, law.draw((40, 60), seed=8))
    np.save(tmp_path / "dsnu.npy", pattern)
    text = "resolution: [40, 60]\ngain_e_per_dn: 1\ndsnu: {map: dsnu.npy}\n"
    (tmp_path / "camera.yaml").write_text(text)
    np.testing.assert_array_equal(Camera.load(tmp_path / "camera.yaml").maps["dsnu"].numpy(), pattern)


@pytest.mark.parametrize("bad", [np.zeros((8, 400)), np.zeros(400), np.full((64, 64), np.nan)])
def test_what_is_no_master_bias_is_refused(bad):
    with pytest.raises(InputError, match="master bias"):
        fit_pattern(bad)


def test_a_real_sensors_pattern(shared_data: Path):
    """The dark stack of the EMVA 1288 reference CCD: its DSNU is published as 0.15493 DN, 0.5518 e-, all
    parts together.
    """
    folder = shared_data / "emva1288_ccd12"
    names = _dark_stack((folder / "EMVA1288_Data.txt").read_text())
    stack = np.stack([np.asarray(Image.open(folder / name), np.float64) for name in names])
    gain, master = 3.56164, stack.mean(0)
    noise_e = np.sqrt(stack.var(0, ddof=1).mean() / len(stack)) * gain
    law = fit_pattern((master - master.mean()) * gain, noise_e)
    parts = law.columns.mixture.variance + law.rows.mixture.variance + law.pixel_e**2
    assert np.sqrt(parts) == pytest.approx(0.5518, rel=0.15)
    measured = (master - master.mean()).mean(0) * gain
    drawn = [law.columns.draw(640, np.random.default_rng(seed)) for seed in range(20)]
    assert np.mean([d.std() for d in drawn]) == pytest.approx(measured.std(), rel=0.2)
    for lag in (1, 2, 3):
        mean = np.mean([autocorrelation(d, lag) for d in drawn])
        assert mean == pytest.approx(autocorrelation(measured, lag), abs=0.12)
    assert np.mean([d[:10].mean() for d in drawn]) == pytest.approx(
        measured[:10].mean(), rel=0.3
    )  # the dark edge


def _dark_stack(descriptor: str) -> list[str]:
    stacks: list[list[str]] = []
    for line in descriptor.splitlines():
        words = line.split()
        if words[:1] in (["b"], ["d"]):
            stacks.append([words[0]])
        elif words[:1] == ["i"]:
            stacks[-1].append(words[1].replace("\\", "/"))
    (names,) = [stack[1:] for stack in stacks if stack[0] == "d" and len(stack) > 3]
    return names
