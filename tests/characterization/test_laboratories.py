"""Frames as laboratories have them: the figure is right, left open, or a warning names what it spoils."""

import numpy as np
import pytest

import visaug
from visaug.characterization import characterize
from visaug.characterization.clipped import cut_mean
from visaug.characterization.facts import temporal_variances
from visaug.characterization.mosaic import find_mosaic
from visaug.frames import FrameRecord, FrameSet

SHAPE = (72, 88)


class Camera:
    """NumPy camera; a frame is what it says on the tin. `gain` in e-/DN, `read` in e-."""

    def __init__(self, gain=0.5, read=3.0, black=120.0, bits=12, dark=0.0, seed=0, bend=0.0):
        self.gain, self.read, self.black, self.bits, self.dark, self.bend = (
            gain,
            read,
            black,
            bits,
            dark,
            bend,
        )
        self.rng = np.random.default_rng(seed)
        self.response = 1 + 0.012 * self.rng.standard_normal(SHAPE)

    def take(
        self, photons=0.0, exposure_s=0.01, temperature_c=20.0, light: float | np.ndarray = 1.0, sigma_e=None
    ):
        mean = 0.5 * photons * self.response * light + self.dark * exposure_s * 2 ** (
            (temperature_c - 20) / 7
        )
        e = self.rng.poisson(mean * np.ones(SHAPE)).astype(float)
        e *= 1 + self.bend * e
        noise = (self.read if sigma_e is None else sigma_e) * self.rng.standard_normal(SHAPE)
        return np.clip(np.rint((e + noise) / self.gain + self.black), 0, 2**self.bits - 1).astype(np.uint16)

    def set(self, levels=(60, 240, 700, 1100, 1500), exposures=None, n=4, calibrated=True, **light):
        rows = [("bias", 0.0, 20.0, None, self.take(0, 0)) for _ in range(12)]
        for level, exposure in zip(levels, exposures or [0.01] * len(levels)):
            photons = float(level) if calibrated else None
            rows += [("flat", exposure, 20.0, photons, self.take(level, exposure, **light)) for _ in range(n)]
        return rows


def measured(rows, bits: int | None = 12, **told):
    records = [
        FrameRecord(i, f"{i}", kind, exposure, temperature, 0.0, photons, **told)
        for i, (kind, exposure, temperature, photons, _) in enumerate(rows)
    ]
    return characterize(FrameSet.from_arrays(records, [r[-1] for r in rows], bit_depth=bits))


def covers(result, **truth):
    """An interval twice as wide as the 95 % one misses once in 10,000."""
    for name, true in truth.items():
        e = result[name.replace("__", ".")]
        assert e.low - (e.value - e.low) <= true <= e.high + (e.high - e.value), f"{name}: {e} for {true}"


def words(result):
    return {w.word for w in result.warning_details}


def test_lamp_levels_at_one_exposure_are_levels():
    """One group of all levels would tell a sixth of the gain, under light that falls off by 20 %."""
    falloff = 1 + 0.2 * np.linspace(-1, 1, SHAPE[1])
    result = measured(Camera().set(calibrated=False, light=falloff))
    covers(result, gain_e_per_dn=0.5, read_noise__sigma_e=3.0)


def test_falling_light_still_tells_the_gain():
    camera = Camera(seed=1)
    falloff = 1 + 0.2 * np.linspace(-1, 1, SHAPE[1])
    rows = [("bias", 0.0, 20.0, None, camera.take(0, 0)) for _ in range(12)]
    rows += [("flat", 0.01, 20.0, None, camera.take(1500 * 0.88**k, light=falloff)) for k in range(14)]
    covers(measured(rows), gain_e_per_dn=0.5)


@pytest.mark.parametrize("bits", [10, 14])
def test_bits_are_where_flats_pile_up(bits):
    """Files of 16 bits do not tell: a flat beyond the top does."""
    camera = Camera(gain=2000 / 2**bits, bits=bits)
    result = measured(camera.set(levels=(60, 240, 700, 1100, 1500, 6000)), bits=None)
    assert result.to_camera_dict()["bit_depth"] == bits
    assert "bit_depth_assumed" not in words(result)
    unsaturated = measured(camera.set(), bits=None)
    assert "bit_depth_assumed" in words(unsaturated)
    assert "bit_depth" in unsaturated.to_camera_dict()["assumed"]


def test_words_at_the_top_of_16_bits_are_read_as_the_converters():
    rows = [(*row[:4], row[4] << 2) for row in Camera(bits=14, gain=0.12).set()]
    result = measured(rows, bits=None)
    assert "bits_at_top_assumed" in words(result)
    covers(result, gain_e_per_dn=0.12, read_noise__sigma_e=3.0)


@pytest.mark.parametrize("black", [0.0, 4.0])
def test_frames_cut_at_0_spoil_neither_gain_nor_efficiency(black):
    """Read noise of 6 DN: half, or a quarter, of the bias frames' pixels are 0."""
    result = measured(Camera(gain=0.9, read=5.4, black=black, bits=16, seed=2).set())
    covers(result, gain_e_per_dn=0.9, quantum_efficiency=0.5, read_noise__sigma_e=5.4)
    spoiled = next(w.spoils for w in result.warning_details if w.word == "clipped_at_zero" and w.spoils)
    assert "emva.system_gain_dn_per_e" in spoiled
    assert "gain_e_per_dn" not in spoiled


def test_dark_current_of_longer_flats_is_no_light():
    """Flats of 1 to 5 s, bias frames only: 15 e-/s would raise the efficiency by a tenth."""
    camera = Camera(dark=15.0, seed=3)
    rows = camera.set(levels=(80, 300, 500, 800, 1200), exposures=[1.0, 3.0, 2.0, 4.0, 5.0])
    result = measured(rows)
    covers(result, quantum_efficiency=0.5, prnu__pixel=0.012)
    exposed_alike = camera.set(levels=(200, 400, 600, 800, 1000), exposures=[1.0, 2.0, 3.0, 4.0, 5.0])
    warned = measured(exposed_alike).warning_details  # light and dark current grow alike: nothing tells them
    assert any(w.word == "dark_exposure" and "quantum_efficiency" in w.spoils for w in warned)


@pytest.mark.parametrize(("sigma_dn", "black", "determined"), [(0.25, 40.1, True), (0.12, 40.5, False)])
def test_noise_below_half_a_dn_is_measured_or_left_open(sigma_dn, black, determined):
    result = measured(Camera(gain=8, read=8 * sigma_dn, black=black, seed=4).set(
        levels=(400, 1500, 5000, 15000, 30000)))  # fmt: skip
    covers(result, gain_e_per_dn=8.0)
    assert "coarse_converter" in words(result)
    assert ("read_noise.sigma_e" in result.parameters) == determined
    if determined:
        covers(result, read_noise__sigma_e=8 * sigma_dn)
    else:
        assert "at most" in result.not_determined["read_noise.sigma_e"]


def test_a_bent_response_gives_the_slope_at_zero_and_says_so():
    result = measured(Camera(bend=-4e-5, seed=5).set(n=8))
    covers(result, gain_e_per_dn=0.5)
    assert "photon_transfer_bent" in words(result)
    assert result["photon_transfer.curvature_per_dn"].high < 0


def test_each_frame_counts_with_its_own_temperature():
    camera = Camera(dark=30.0, seed=6)
    rows = camera.set()
    for k in range(30):
        exposure, temperature = 0.5 + k // 6, round(18 + 0.1 * k, 2)
        rows.append(("dark", exposure, temperature, None, camera.take(0, exposure, temperature)))
    result = measured(rows)
    assert "temperature_drift" in words(result)
    b = np.log(2) / 7
    covers(result, dark_current__b_per_c=b, dark_current__a_e_per_s=30 * np.exp(-20 * b))


def test_a_log_that_wanders_splits_no_group():
    rng = np.random.default_rng(7)
    rows = Camera(seed=7).set(calibrated=False, exposures=[0.1, 0.3, 0.9, 1.4, 2.0])
    rows = [(k, t * (1 + 2e-5 * rng.standard_normal()), T + 0.06 * rng.standard_normal(), p, f)
            for k, t, T, p, f in rows]  # fmt: skip
    result = measured(rows)
    assert "few_frames" not in words(result)
    covers(result, gain_e_per_dn=0.5)


def test_averages_among_raw_frames_are_left_out():
    camera = Camera(seed=8)
    master = np.rint(np.mean([camera.take(0, 0) for _ in range(9)], axis=0)).astype(np.uint16)
    result = measured([("bias", 0.0, 20.0, None, master), *camera.set()])
    assert any(w.startswith("master_frame: frames 0 ") for w in result.warnings)
    covers(result, read_noise__sigma_e=3.0)


def test_frames_of_another_setting_are_left_out():
    one, two = Camera(seed=9), Camera(gain=0.1, black=300, bits=16, seed=10)
    rows = [*one.set(n=5), *two.set(n=3)]
    count = len(one.set(n=5))
    records = [
        FrameRecord(i, f"{i}", r[0], r[1], r[2], 0.0, r[3], setting="GAIN=0" if i < count else "GAIN=200")
        for i, r in enumerate(rows)
    ]
    result = characterize(FrameSet.from_arrays(records, [r[-1] for r in rows], bit_depth=16))
    assert "settings_mixed" in words(result)
    covers(result, gain_e_per_dn=0.5)


def test_a_mosaic_is_measured_by_colour():
    colours = np.tile([[0.6, 1.0], [1.0, 0.45]], (SHAPE[0] // 2, SHAPE[1] // 2))
    rows = Camera(seed=11).set(light=colours)
    result = measured(rows)
    assert "mosaic" in words(result)
    covers(result, prnu__pixel=0.012, quantum_efficiency=0.5)
    covers(result.planes["00"], quantum_efficiency=0.3)
    assert set(measured(rows, bayer="RGGB").planes) == {"R", "Gr", "Gb", "B"}
    columns = np.tile([0.97, 1.03], (SHAPE[0], SHAPE[1] // 2))  # a converter for odd and one for even columns
    assert "mosaic" not in words(measured(Camera(seed=12).set(light=columns)))


def test_pixels_of_their_own_noise_are_no_heavy_tails(tmp_path):
    """Log sigma spreads by 0.4; every pixel is normal."""
    sigma = 3 * np.exp(0.4 * np.random.default_rng(13).standard_normal(SHAPE) - 0.16)
    camera = Camera(gain=0.4, seed=13)
    rows = [("bias", 0.0, 20.0, None, camera.take(0, 0, sigma_e=sigma)) for _ in range(16)]
    result = measured(rows + [r for r in camera.set(sigma_e=sigma) if r[0] == "flat"])
    assert "read_noise.shape" in result.not_determined
    covers(result, read_noise__spread=0.4, read_noise__sigma_e=float(np.sqrt((sigma**2).mean())))
    found = result.maps["read_noise"]
    assert np.corrcoef(np.log(found).ravel(), np.log(sigma).ravel())[0, 1] > 0.8
    assert np.sqrt((found**2).mean()) == pytest.approx(np.sqrt((sigma**2).mean()), rel=0.03)  # electrons
    result.save_camera(tmp_path / "a" / "camera.yaml", tmp_path / "maps")
    named = visaug.Camera.load(tmp_path / "a" / "camera.yaml")
    np.testing.assert_array_equal(named.maps["read_noise"], found)
    assert np.log(found).std() == pytest.approx(0.4, rel=0.06)  # no wider by what 16 frames tell of a pixel
    # K is known to 1.2 % a pixel, as large as K itself; 6336 pixels. The map spreads as K does.
    assert np.corrcoef(named.maps["prnu"].ravel(), camera.response.ravel())[0, 1] == pytest.approx(
        0.7, abs=0.1
    )
    assert float(named.maps["prnu"].std()) == pytest.approx(0.012, rel=0.15)
    # No pixel has an offset of its own; the mean of 16 frames keeps 0.75 e- of noise in each.
    assert float(named.maps["dsnu"].std()) < 0.3
    alike = measured(Camera(seed=14).set())
    assert "read_noise.shape" in alike.parameters


@pytest.mark.parametrize("spread", [0.0, 0.15])
def test_the_map_of_dark_current_is_as_wide_as_the_pixels(spread, tmp_path):
    """The frames tell the rate of a pixel to about 5 %. Of equal pixels there is no map; 6336 others tell 0.15 to 1 %."""
    rates = 60 * (1 + spread * np.random.default_rng(15).standard_normal(SHAPE))
    camera = Camera(dark=rates, seed=15)
    rows = camera.set()
    for temperature in (20.0, 10.0):
        for exposure in (1.0, 4.0):
            frames = [camera.take(0, exposure, temperature) for _ in range(4)]
            rows += [("dark", exposure, temperature, None, frame) for frame in frames]
    result = measured(rows)
    assert 0.02 < result.dark_current_error / 60 < 0.08
    result.save_camera(tmp_path / "camera.yaml", tmp_path / "maps")
    named = visaug.Camera.load(tmp_path / "camera.yaml")
    assert ("dark_current_nonuniformity" in named.effect_names) == bool(spread)
    if spread:
        factor = np.load(tmp_path / "maps" / "dark_current_nonuniformity.npy")
        assert factor.std() == pytest.approx(spread, rel=0.05)
        assert np.corrcoef(factor.ravel(), rates.ravel())[0, 1] > 0.9


def test_the_camera_holds_what_was_measured_and_lists_what_was_not():
    camera = Camera(dark=25.0, seed=15)
    rows = []
    for kind, t, T, p, frame in camera.set():
        rows.append((kind, t, T, p, frame))
    for exposure in (0.5, 2.0, 4.0):
        rows += [("dark", exposure, 20.0, None, camera.take(0, exposure)) for _ in range(4)]
    rng = np.random.default_rng(15)
    rows = [(*r[:4], (r[4] + np.rint(4 * rng.standard_normal((SHAPE[0], 1)))).clip(0).astype(np.uint16))
            for r in rows]  # fmt: skip
    result = measured(rows)
    content = result.to_camera_dict()
    row = next(e for e in content["effects"] if e["name"] == "row_noise")
    assert row["sigma_e"] == pytest.approx(2.0, rel=0.1)  # 4 DN; known to 3 %
    law = content["dark_current"]
    assert law["a_e_per_s"] * np.exp(law["b_per_c"] * 20) == pytest.approx(25, rel=0.1)
    assert {"dark_current.a_e_per_s", "dark_current.b_per_c"} <= set(content["assumed"])
    assert result.camera.values()["row_noise.sigma_e"] == row["sigma_e"]


def test_temporal_variance_of_single_frames():
    """Known to 2.5 % each for 80 x 80 pixels: 6 standard errors."""
    rng = np.random.default_rng(16)
    sigmas = np.array([3.0, 3.0, 1.0, 3.0, 2.0])
    pattern = 30 * rng.standard_normal((80, 80))
    frames = [200 + pattern + s * rng.standard_normal((80, 80)) for s in sigmas]
    found = temporal_variances(FrameSet.from_arrays([FrameRecord(i, f"{i}", "bias") for i in range(5)],
                                                    frames), range(5))  # fmt: skip
    np.testing.assert_allclose(found, sigmas**2, atol=1.5)


@pytest.mark.parametrize(
    ("sigma", "spread", "within"), [(0.2, 0.05, 0.01), (0.65, 0.4, 0.003), (2.1, 1.3, 1e-3)]
)
def test_mean_of_rounded_values_is_that_of_the_staircase(sigma, spread, within):
    """Against the sum over codes for a normal law; shape 0.1349 is within 0.002 of it."""
    from scipy import stats

    from visaug.characterization.rounded import RoundedFit

    fit = RoundedFit(np.log(sigma), 0.1349, 0.0, np.log(spread), np.zeros((4, 4)))
    x, mean = cut_mean(fit, spread**2)
    codes = np.arange(1, 40)
    for level in (-0.4 * sigma, 0.0, 0.3, 2.5, 2.62):
        expected = stats.norm.sf((codes - 0.5 - level) / np.hypot(sigma, spread)).sum()
        assert np.interp(level, x, mean) == pytest.approx(expected, abs=within)


def test_no_mosaic_without_flats():
    frames = FrameSet.from_arrays([FrameRecord(0, "0", "bias")], np.ones((1, 4, 4), np.uint16))
    assert find_mosaic(frames, []) is None
