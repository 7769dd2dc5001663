"""Frames that are cut at 0, or whose noise is finer than the converter's steps, and what looks like structure by chance."""

import numpy as np
import pytest

from visaug.characterization import characterize, tukey
from visaug.characterization.result import Characterization
from visaug.characterization.still import describe
from visaug.frames import FrameRecord, FrameSet
from visaug.statistics.findings import Estimate

SHAPE = (48, 56)
SATURATION_E = 900.0


def bias_frames(rng, sigma_dn, level_dn, spread_dn=0.0, n=12):
    pattern = level_dn + spread_dn * rng.standard_normal(SHAPE)
    values = np.rint(pattern + sigma_dn * rng.standard_normal((n, *SHAPE)))
    return [FrameRecord(i, f"{i}", "bias") for i in range(n)], np.clip(values, 0, 4095).astype(np.uint16)


def measured(*frames):
    return characterize(FrameSet.from_arrays(*frames, bit_depth=12))


@pytest.mark.parametrize(
    ("sigma", "level", "spread"),
    [(0.3, 20.5, 0.0), (0.25, 20.2, 0.15), pytest.param(0.4, 20.0, 0.3, marks=pytest.mark.slow)],
)
def test_noise_of_a_third_of_a_dn_is_covered(sigma, level, spread):
    """Three sets each: two or more miss at 95 % once in 140. A Tukey-lambda law in place of the normal one is 30 % off at
    3.3 standard deviations, which is what sets of the first kind show.
    """
    hits = 0
    for seed in range(3):
        found = measured(*bias_frames(np.random.default_rng([seed, 7]), sigma, level, spread))[
            "read_noise.sigma_dn"
        ]
        hits += found.low <= sigma <= found.high
        assert found.value == pytest.approx(sigma, rel=0.1)
    assert hits >= 2


def test_no_pattern_is_no_pattern():
    """Pixels without offsets of their own, a fifth of them cut: the interval begins at 0, and is not wide."""
    found = measured(*bias_frames(np.random.default_rng(3), 5.0, 4.0))["dsnu.pixel_dn"]
    assert found.low == 0.0
    assert found.high < 1.0


def test_dark_frames_that_are_all_0_tell_no_black_level():
    result = measured(*bias_frames(np.random.default_rng(4), 0.1, 0.1))
    assert "at most 0.5 DN" in result.not_determined["black_level_dn"]
    assert "read_noise.sigma_dn" in result.not_determined
    assert sum(w.startswith("clipped_at_zero") for w in result.warnings) == 1


def test_a_camera_file_has_no_black_level_below_0():
    """Frames of a black level of 0 DN give an estimate on either side of 0."""
    found = {
        "gain_e_per_dn": Estimate(2.0, 1.9, 2.1, "e-/DN", ""),
        "black_level_dn": Estimate(-0.05, -0.1, 0.01, "DN", ""),
    }
    assert Characterization(found, {}, resolution=(8, 8)).camera.to_dict().get("black_level_dn", 0.0) == 0.0


def test_a_black_level_holds_the_pattern_that_was_drawn():
    """Half of the pixels cut, offsets of 6 DN: the mean of 2688 offsets is known to 0.12 DN, which no number of frames
    makes smaller. 6 sets: 3 or more misses at 95 % once in 450.
    """
    misses = 0
    for seed in range(6):
        found = measured(*bias_frames(np.random.default_rng([seed, 8]), 6.0, 3.0, 6.0, n=8))["black_level_dn"]
        assert found.high - found.low > 4 * 0.116
        misses += not found.low <= 3.0 <= found.high
    assert misses <= 2


def test_a_normal_law_has_two_shapes():
    assert tukey.hold_both_gaussians((0.130, 0.125, 0.136)) == (0.130, 0.125, 0.14)
    assert tukey.hold_both_gaussians((0.1, 0.09, 0.11)) == (0.1, 0.09, 0.11)
    x = np.linspace(-4, 4, 17)
    law = tukey.law(np.nan)
    assert law.phi(x) == pytest.approx(np.exp(-0.5 * x**2), abs=1e-6)


@pytest.mark.parametrize("lines", [48, 63])
def test_white_profiles_have_structure_once_in_a_hundred(lines):
    """1 % of 300 profiles: more than 9 once in 1000 draws."""
    rng = np.random.default_rng(lines)
    false = sum(describe(rng.standard_normal(lines))[-1].size > 0 for _ in range(300))
    assert false <= 9
    pairs = 2.5 * (-1.0) ** np.arange(lines) + rng.standard_normal(lines)
    assert describe(pairs)[-1].tolist() == [pytest.approx(0.5, abs=0.02)]


def test_saturated_flats_are_no_quiet_flats():
    """Flats at the full well have lost the shot noise that dark frames have: they do not tell that dark frames flicker."""
    rng = np.random.default_rng(5)
    rows = [("bias", 0.0, None, 0.0)] * 4 + [("dark", 0.01, None, 0.0)] * 4
    rows += [("flat", 0.01, m / 0.5, m) for m in (60.0, 150.0, 300.0, 450.0, 600.0, 1400.0) for _ in range(3)]
    frames = []
    for _, exposure, _, mean in rows:
        electrons = np.minimum(rng.poisson(mean + 40.0 * (exposure > 0), SHAPE), SATURATION_E)
        frames.append(np.rint((electrons + 1.5 * rng.standard_normal(SHAPE)) / 0.5 + 100).astype(np.uint16))
    records = [FrameRecord(i, f"{i}", kind, t, 20.0, 0.0, p) for i, (kind, t, p, _) in enumerate(rows)]
    result = measured(records, frames)
    assert "dark_frames_noisier" not in {w.word for w in result.warning_details}
    assert result["gain_e_per_dn"].value == pytest.approx(0.5, rel=0.05)
