"""Readout, converter and fixed patterns as their equations have them, written out anew in NumPy."""

import numpy as np
import pytest
import torch

from visaug.core.sampling import Stream
from visaug.effects.readout.coloured import coloured

BLACK_DN, TOP_DN, E_PER_DN, FULL_WELL_E = 240.0, 65535.0, 0.2, 11000.0  # of the bench `run_effect`


def flat(value, rows=6, columns=10):
    return torch.full((1, 1, rows, columns), value)


def codes(rows=64, columns=64):
    return torch.arange(rows * columns, dtype=torch.float32).view(1, 1, rows, columns)


def test_odd_rows_are_raised_and_even_ones_lowered_by_half_of_the_difference(run_effect):
    out = run_effect("row_parity", flat(1000.0), offset_e=3.0, gain=0.02)[0, 0].numpy()
    np.testing.assert_allclose(out[1::2], 1000 * 1.01 + 1.5, rtol=1e-6)
    np.testing.assert_allclose(out[::2], 1000 * 0.99 - 1.5, rtol=1e-6)


@pytest.mark.parametrize("direction", ["columns", "rows"])
def test_taps_meet_at_the_seam(run_effect, direction):
    """Of 10 lines a seam at 0.5 lies between two; at 0.55 it halves line 5, which has the mean of both sides."""
    for seam, expected in (
        (0.5, [948.0] * 5 + [1052.0] * 5),
        (0.55, [948.0] * 5 + [1000.0] + [1052.0] * 4),
    ):
        light = flat(1000.0, 10, 10)
        out = run_effect("tap_mismatch", light, offset_e=4.0, gain=0.1, seam=seam, direction=direction)
        lines = out[0, 0].numpy() if direction == "columns" else out[0, 0].numpy().T
        np.testing.assert_allclose(lines, np.tile(expected, (10, 1)), rtol=1e-5)


def test_a_banding_is_a_wave_and_its_harmonic(run_effect):
    """Sine series of 64 rows: periods of 8 and 4 rows, the phase of the harmonic twice that of the wave."""
    settings = {"amplitude_e": 3.0, "period_rows": 8.0, "second_harmonic": 0.5}
    out = run_effect("periodic_banding", flat(0.0, 64, 5), **settings)[0, 0].double().numpy()
    np.testing.assert_array_equal(out, np.tile(out[:, :1], (1, 5)))
    wave = 2j * np.fft.rfft(out[:, 0]) / 64  # of a sin(2 pi k / n + p): a exp(ip) at its frequency
    expected = np.zeros(33)
    expected[[8, 16]] = 3.0, 1.5
    np.testing.assert_allclose(np.abs(wave), expected, atol=1e-4)
    assert wave[16] / 1.5 == pytest.approx((wave[8] / 3) ** 2, abs=1e-4)


@pytest.mark.parametrize(
    ("full_scale", "scale_e"), [("full_well", FULL_WELL_E), ("converter", (TOP_DN - BLACK_DN) * E_PER_DN)]
)
def test_a_response_bends_as_its_polynomial_and_goes_on_straight(run_effect, full_scale, scale_e):
    x, quadratic, cubic = np.array([0.0, 0.25, 0.5, 1.0, 1.5]), -0.03, 0.02
    light = torch.tensor(x * scale_e, dtype=torch.float64).view(1, 1, 1, 5)
    out = run_effect("nonlinearity", light, quadratic=quadratic, cubic=cubic, full_scale=full_scale)
    expected = x + quadratic * x**2 + cubic * x**3
    expected[-1] = 1.5 + quadratic + cubic + 0.5 * (2 * quadratic + 3 * cubic)  # the tangent at 1
    np.testing.assert_allclose(out.flatten().numpy() / scale_e, expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("level", "code"),
    [
        (-1.0, 0.0),
        (-0.5, BLACK_DN / 2),
        (0.0, BLACK_DN),
        (0.3, round(BLACK_DN + 0.3 * (TOP_DN - BLACK_DN))),
        (1.0, TOP_DN),
    ],
)
def test_a_dead_pixel_has_the_code_of_its_level(run_effect, level, code):
    out = run_effect("dead_pixels", codes(), density=1.0, level=level, spread=0.0)
    assert set(out.flatten().tolist()) == {code}


@pytest.mark.parametrize("pattern", ["random", "even"])
def test_a_missing_code_becomes_the_next_lower_one_that_exists(run_effect, pattern):
    """Of 4096 codes a quarter is missing: 5 standard deviations of the random share are 0.034."""
    out = run_effect("missing_codes", codes(), density=0.25, pattern=pattern).flatten().numpy()
    exists = np.unique(out)
    wanted = np.arange(4096)
    np.testing.assert_array_equal(out, exists[np.searchsorted(exists, wanted, side="right") - 1])
    missing = np.setdiff1d(wanted, exists)
    assert exists[0] == 0
    assert len(missing) / 4096 == pytest.approx(0.25, abs=0.034)
    gaps = np.diff(missing)
    assert (set(gaps) == {4}) == (pattern == "even")


@pytest.mark.parametrize(("mode", "added"), [("cut", 0), ("round", 4)])
def test_lost_bits_are_cut_or_rounded(run_effect, mode, added):
    out = run_effect("bit_truncation", codes(), bits=3.0, mode=mode).flatten().numpy()
    np.testing.assert_array_equal(out, (np.arange(4096) + added) // 8 * 8)


@pytest.mark.parametrize(("name", "unit"), [("dsnu", "_e"), ("prnu", "")])
@pytest.mark.parametrize(("part", "along"), [("column", 0), ("row", 1)])
def test_a_part_of_a_pattern_lies_along_its_own_lines(run_effect, name, unit, part, along):
    """300 lines tell a standard deviation to 4 %: 20 % are 5 standard errors."""
    parts = {f"{other}{unit}": 0.0 for other in ("column", "row", "pixel")} | {f"{part}{unit}": 0.01}
    out = run_effect(name, torch.ones(1, 1, 300, 300, dtype=torch.float64), **parts)[0, 0].numpy() - 1
    assert np.ptp(out, axis=along).max() < 1e-6
    assert out.mean(along).std() == pytest.approx(0.01, rel=0.2)


@pytest.mark.parametrize("exponent", [0.6, 1.2])
def test_flicker_noise_falls_as_the_power_of_the_frequency(run_effect, exponent):
    """Pixel by pixel along the rows. A fit to 1000 bins of 20 frames tells the exponent to 0.01."""
    settings = {"sigma_e": 1.0, "exponent": exponent, "direction": "rows", "clamp": "frame"}
    noise = run_effect("flicker_noise", torch.zeros(20, 1, 64, 64), **settings).double().flatten(1).numpy()
    power = (np.abs(np.fft.rfft(noise)) ** 2).mean(0)
    k = np.arange(4, 1004)
    slope = np.polyfit(np.log(k), np.log(power[k]), 1)[0]
    assert slope == pytest.approx(-exponent, abs=0.05)


@pytest.mark.parametrize(
    ("exponent", "clamp", "direction"),
    [
        (1.0, "none", "rows"),
        (0.5, "frame", "rows"),
        (1.6, "none", "columns"),
        (1.9, "frame", "columns"),
        (2.0, "none", "rows"),
    ],
)
def test_a_window_of_a_sequence_has_the_law_of_the_whole_record(run_effect, exponent, clamp, direction):
    """Variance, and squares of differences over so many pixels of the readout, of 600 frames, from the power of all frequencies.

    Each is within 5 standard errors, as the frames tell them: a false alarm in 6e4 runs of all 30.
    """
    lines, across = 60, 48  # of the readout, and pixels of each
    count = lines * across * (1 if clamp == "frame" else 2)
    k = np.arange(1, count // 2 + 1)
    power = k**-exponent * np.where(k < count // 2, 2.0, 0.5)
    power /= power.sum()
    covariance = {d: float(power @ np.cos(2 * np.pi * k * d / count)) for d in (1, 5, 48, 96, 440)}
    window, shape = (range(20, 30), range(across)), (10, across)
    turned = direction == "columns"
    noise = run_effect(
        "flicker_noise",
        torch.zeros(600, 1, *(shape[::-1] if turned else shape)),
        sequence=True,
        window=window[::-1] if turned else window,
        resolution=(across, lines) if turned else (lines, across),
        exponent=exponent,
        clamp=clamp,
        direction=direction,
    ).double()
    along = (noise.transpose(-1, -2) if turned else noise).flatten(1).numpy()
    found = [(along**2).mean(1) - 1]
    for d, expected in covariance.items():
        found.append(((along[:, d:] - along[:, :-d]) ** 2).mean(1) - 2 * (1 - expected))
    for each in found:
        assert abs(each.mean()) < 5 * each.std(ddof=1) / np.sqrt(len(each))


def test_a_window_of_a_sequence_costs_no_whole_frame(monkeypatch, run_effect):
    drawn = []
    ordinary = Stream.normal
    monkeypatch.setattr(
        Stream, "normal", lambda self, vary="pixel": drawn.append(self.window) or ordinary(self, vary)
    )
    place = {"window": (range(4, 20), range(10, 40)), "resolution": (400, 300)}
    frames = torch.zeros(2, 1, 16, 30)
    in_part = run_effect("flicker_noise", frames, sequence=True, **place)
    again = [run_effect("flicker_noise", frames[:1], keys=[key], sequence=True, **place) for key in (1, 2)]
    assert torch.allclose(in_part, torch.cat(again), atol=1e-6)
    assert {len(rows) for rows, _ in drawn} == {32}
    run_effect("flicker_noise", frames, **place)  # of images each crop has its part of the frame
    assert len(drawn[-1][0]) == 800


@pytest.mark.parametrize("name", ["black_level_drift", "light_drift"])
def test_a_drift_with_memory_keeps_its_variance(run_effect, name):
    """First-order autoregression: of 4000 frames the variance is known to 3 %, the correlation to 0.014."""
    strength = {"black_level_drift": "sigma_e", "light_drift": "sigma"}[name]
    frames = torch.ones(4000, 1, 1, 1, dtype=torch.float64)
    out = run_effect(name, frames, sequence=True, correlation=0.5, **{strength: 0.1}).flatten().numpy() - 1
    assert out.var() / 0.01 == pytest.approx(1, abs=0.15)
    assert np.corrcoef(out[1:], out[:-1])[0, 1] == pytest.approx(0.5, abs=0.07)


def test_noise_after_the_gain_is_in_dn(run_effect):
    """3 DN at 0.2 e-/DN are 0.6 e-. 40 000 pixels tell a standard deviation to 0.35 %: 2 % are more than 5 standard errors."""
    out = run_effect("read_noise", torch.zeros(1, 1, 200, 200), sigma_e=0.0, shape=0.14, after_gain_dn=3.0)
    assert float(out.std()) == pytest.approx(3.0 * E_PER_DN, rel=0.02)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0])
def test_coloured_records_have_variance_1(exponent):
    """The mean power of 4000 independent records is within 5 standard errors of 1: a false alarm in 2e6."""
    white = torch.randn(4000, 1, 64, generator=torch.Generator().manual_seed(5))
    power = coloured(white, torch.full((1, 1, 1, 1), exponent)).square().mean(-1).flatten().double().numpy()
    assert abs(power.mean() - 1) < 5 * power.std(ddof=1) / np.sqrt(len(power))
    assert 5 * power.std(ddof=1) / np.sqrt(len(power)) < 0.15
