"""Gain, exposure and strength: what they do to brightness and noise, against the linear model of EMVA 1288.

False alarms: bounds are five standard errors or more, below 1e-5 for each test.
"""

import json
import math

import numpy as np
import pytest
import torch

from visaug import Camera, VISNoise
from visaug.augment import SensorNoise, draws_from_json, draws_to_json

SIGMA_E, GAIN, BLACK, BITS = 4.3, 0.8, 70, 14
CONTENT = {
    "resolution": [48, 64],
    "bit_depth": BITS,
    "gain_e_per_dn": GAIN,
    "gain_db": 4,
    "black_level_dn": BLACK,
    "quantum_efficiency": 0.55,
    "read_noise": {"sigma_e": SIGMA_E},
}
RANGE_DN = 2**BITS - 1 - BLACK
SIDE = 300
ERROR = 5 * (2 / SIDE**2) ** 0.5  # of a variance, five standard errors


def camera(**changes) -> Camera:
    return Camera.load({**CONTENT, **changes})


def moments(level: float, fast: bool, cam: Camera | None = None, **options) -> tuple[float, float]:
    """Mean and variance of an even image."""
    noisy = VISNoise(cam or camera(), fast=fast, seed=3, **options)(torch.full((1, 1, SIDE, SIDE), level))
    return noisy.double().mean().item(), noisy.double().var().item()


def theory(level: float, full_e: float, sigma_e: float = SIGMA_E, exposure: float = 1.0) -> float:
    """Variance of an even image, 1 being `full_e` electrons: shot noise, read noise and rounding to DN."""
    electrons = level * full_e * exposure
    return (electrons + sigma_e**2) / (full_e * exposure) ** 2 + 1 / 12 / (RANGE_DN * exposure) ** 2


@pytest.fixture(params=[True, False], ids=["fast", "exact"])
def fast(request):
    return request.param


@pytest.mark.parametrize("gain_db", [4.0, 16.0, -2.0])
def test_gain_changes_the_noise_and_not_the_brightness(gain_db, fast):
    full_e = RANGE_DN * GAIN * 10 ** ((4 - gain_db) / 20)
    mean, variance = moments(0.35, fast, gain_db=gain_db)
    expected = theory(0.35, full_e)
    assert abs(mean - 0.35) < 5 * expected**0.5 / SIDE
    assert variance == pytest.approx(expected, rel=ERROR)


@pytest.mark.parametrize("exposure", [0.02, 0.3])
def test_a_short_exposure_is_brightened_again(exposure, fast):
    full_e = RANGE_DN * GAIN
    mean, variance = moments(0.6, fast, exposure=exposure)
    expected = theory(0.6, full_e, exposure=exposure)
    assert abs(mean - 0.6) < 5 * expected**0.5 / SIDE
    assert variance == pytest.approx(expected, rel=ERROR)


def test_a_kept_black_level_is_not_brightened(fast):
    mean, _ = moments(0.0, fast, exposure=0.5, black_level="keep")
    assert mean == pytest.approx(BLACK / (2**BITS - 1), rel=0.02)


@pytest.mark.parametrize("strength", [0.5, 3.0, 8.0])
@pytest.mark.parametrize("level", [0.1, 0.6])
def test_strength_is_the_factor_of_the_deviation(strength, level, fast):
    """Quantisation stays, here 1e-4 of the noise; the third moment is a Poisson's of fewer electrons."""
    full_e = RANGE_DN * GAIN
    mean, variance = moments(level, fast, strength=strength)
    rounding = 1 / 12 / RANGE_DN**2
    expected = strength**2 * (theory(level, full_e) - rounding) + rounding
    assert abs(mean - level) < 5 * expected**0.5 / SIDE
    assert variance == pytest.approx(expected, rel=ERROR)


def test_strength_keeps_shot_noise_poisson():
    """Skewness of a Poisson count of mean m is m^-1/2; its standard error is sqrt(6/N)."""
    flat = torch.full((1, 1, 500, 500), 0.2)
    cam = camera(read_noise={"sigma_e": 0.01}, gain_e_per_dn=0.05)
    noise = VISNoise(cam, strength=4.0, seed=1)(flat).double().flatten()
    skewness = ((noise - noise.mean()) ** 3).mean() / noise.std() ** 3
    electrons = 0.2 * RANGE_DN * 0.05 / 16
    assert skewness.item() == pytest.approx(electrons**-0.5, abs=5 * (6 / 500**2) ** 0.5)


@pytest.mark.parametrize(
    "part",
    [
        {"prnu": {"column": 0.004, "row": 0.003, "pixel": 0.006}},
        {"dsnu": {"column_e": 30.0, "row_e": 25.0, "pixel_e": 60.0}},
        {"effects": [{"name": "row_noise", "sigma_e": 40.0}]},
        {"effects": [{"name": "row_parity", "offset_e": 40.0, "gain": 0.01}]},
        {"effects": [{"name": "tap_mismatch", "offset_e": 40.0, "gain": 0.01}]},
        {"effects": [{"name": "column_parity", "offset_e": 40.0, "gain": 0.01, "channels": 4}]},
    ],
    ids=lambda part: part["effects"][0]["name"] if "effects" in part else next(iter(part)),
)
def test_fixed_patterns_and_effects_follow_the_strength(part, fast):
    """The pattern with the same random numbers is twice as large; temporal noise is averaged over 200 frames."""
    cam = camera(read_noise={"sigma_e": 0.5}, gain_e_per_dn=40.0, **part)
    flat = torch.full((200, 1, 24, 20), 0.5)
    patterns = []
    for strength in (1.0, 2.0):
        noise = SensorNoise(cam, fixed_pattern="camera", seed=8, strength=strength, fast=fast)
        draws = noise.draw(200)
        if "effects" in part:  # temporal ones too: one frame's
            draws["keys"] = draws["keys"][:1].expand(200)
        patterns.append((noise.apply_draws(flat, draws).mean(0) - 0.5).flatten())
    ratio = (patterns[0] @ patterns[1]) / (patterns[0] @ patterns[0])
    assert ratio.item() == pytest.approx(2, rel=0.05)


def test_the_seam_of_two_gains_stays_at_its_brightness():
    seam = 0.5 * RANGE_DN * 40.0
    two = {"name": "dual_gain", "noise_e": 0.0, "gain": 0.2, "seam_e": seam}
    cam = camera(read_noise={"sigma_e": 0.5}, gain_e_per_dn=40.0, effects=[two])
    flats = torch.tensor([0.4, 0.6]).view(2, 1, 1, 1).expand(2, 1, 64, 64)
    for strength in (1.0, 2.0):
        low, high = SensorNoise(cam, strength=strength, seed=1)(flats).mean((1, 2, 3)).tolist()
        assert low == pytest.approx(0.4, rel=0.005)
        assert high == pytest.approx(0.62, rel=0.005)


def test_no_strength_is_identity():
    images = torch.rand(2, 3, 8, 8)
    assert torch.equal(VISNoise(camera(), strength=0)(images), images)
    SensorNoise(camera(), strength=0)(images).zero_()  # is a copy
    assert images.max() > 0


def test_ranges_are_drawn_uniformly_stored_and_replayed(fast):
    noise = VISNoise(
        camera(randomize={"gain_db": {"std": 2}}), gain_db=(6, 18), exposure=(0.1, 0.5), fast=fast
    )
    draws = noise.sensor.draw(2000)
    for name, low, high in (("gain_db", 6, 18), ("exposure", 0.1, 0.5)):
        drawn = draws[name]
        assert drawn.min() >= low
        assert drawn.max() <= high
        error = 5 * (high - low) / math.sqrt(12 * 2000)
        assert drawn.mean().item() == pytest.approx((low + high) / 2, abs=error)
    images = torch.rand(3, 1, 20, 20)
    noisy = noise(images)
    text = json.dumps(draws_to_json(noise._params))
    assert {"gain_db", "exposure"} <= json.loads(text).keys()
    assert torch.equal(noise(images, params=draws_from_json(json.loads(text))), noisy)


def test_a_number_is_a_range_of_no_width():
    draws = SensorNoise(camera(), gain_db=9, exposure=0.25).draw(4)
    assert draws["gain_db"].tolist() == [9.0] * 4
    assert draws["exposure"].tolist() == [0.25] * 4


@pytest.mark.parametrize("strength", [0.25, 0.5, 3.0])
@pytest.mark.parametrize("black_level", ["subtract", "keep"])
def test_strength_keeps_the_brightness_of_a_given_number_of_photons(strength, black_level, fast):
    cam = camera(full_well_e=9000)
    options = {"full_scale_photons": 7000.0, "black_level": black_level}
    mean, variance = moments(0.35, fast, cam, **options)
    own_mean, own_variance = moments(0.35, fast, cam, strength=strength, **options)
    assert own_mean == pytest.approx(mean, abs=5 * max(variance, own_variance) ** 0.5 / SIDE * 2**0.5)
    per_dn = 1 / (2**BITS - 1) if black_level == "keep" else 1 / min(RANGE_DN, 9000 / GAIN)
    rounding = per_dn**2 / 12  # of the converter, which strength leaves as it is
    grown = strength**2 * (variance - rounding) + rounding
    assert own_variance == pytest.approx(grown, rel=2**0.5 * ERROR)


def test_a_measured_factor_of_the_dark_current_follows_the_strength(tmp_path):
    """As the drawn one does: the mean stays, the scatter grows."""
    factors = np.random.default_rng(5).normal(1, 0.1, (48, 64)).astype(np.float32)
    np.save(tmp_path / "k.npy", factors)
    effects = [{"name": "dark_current_nonuniformity", "map": str(tmp_path / "k.npy")}]
    dark = {"a_e_per_s": 4000.0, "b_per_c": 0.0}
    cam = camera(read_noise={}, dark_current=dark, exposure_s=1.0, effects=effects)
    plain = camera(read_noise={}, dark_current=dark, exposure_s=1.0)
    for strength in (0.5, 1.0, 2.0):
        with_map, without = (
            SensorNoise(one, strength=strength, seed=1)(torch.full((200, 1, 48, 64), 0.2)).mean(0)[0].double()
            for one in (cam, plain)
        )
        seen = (with_map - without) * RANGE_DN * GAIN / 4000
        expected = torch.from_numpy(factors).double() - 1
        # 200 frames of 6,600 e-: an error of 0.2 % of the dark current, below which 0.1 is seen to a few per cent
        assert float((seen * expected).mean() / expected.square().mean()) == pytest.approx(strength, rel=0.05)
        assert abs(float(seen.mean() - strength * expected.mean())) < 2e-3
