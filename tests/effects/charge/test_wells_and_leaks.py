"""Full wells, waiting rows, jumping leaks and eclipsed suns against their laws in NumPy and SciPy.

Statistical tests allow 5 standard errors on fixed seeds: a right program fails one of some twenty comparisons with a probability
of 1e-5.
"""

import numpy as np
import pytest
import torch
from scipy import special, stats

WELL = {"full_well_e": 10_000.0}


def charge(level, rows=60, columns=80, count=1):
    return torch.full((count, 1, rows, columns), float(level))


def test_wells_are_half_normal(run_effect):
    full = (
        run_effect("saturation_nonuniformity", charge(50_000, 100, 100, 2), known=WELL, spread=0.03)[:, 0]
        .double()
        .numpy()
    )
    assert np.array_equal(full[0], full[1])
    lacks = 1 - full[0].ravel() / 10_000
    assert stats.kstest(lacks, stats.halfnorm(scale=0.03).cdf).pvalue > 1e-6
    below = run_effect("saturation_nonuniformity", charge(5000), known=WELL, spread=0.03)
    assert bool((below == 5000).all())


def test_soft_knee(run_effect):
    """The response is the integral of a logistic function of the distance to the full well; at the well it lacks k ln 2."""
    levels = torch.linspace(5000, 15_000, 400).view(1, 1, 1, -1)
    out = (
        run_effect("saturation_nonuniformity", levels, known=WELL, spread=0.0, knee=0.02)
        .flatten()
        .double()
        .numpy()
    )
    slope = np.gradient(out, levels.flatten().double().numpy())
    expected = special.expit((10_000 - levels.flatten().double().numpy()) / 200)
    assert slope[1:-1] == pytest.approx(expected[1:-1], abs=0.01)
    at_well = float(
        run_effect("saturation_nonuniformity", charge(10_000, 1, 1), known=WELL, spread=0.0, knee=0.02)
    )
    assert at_well == pytest.approx(10_000 - 200 * np.log(2), abs=0.01)


@pytest.mark.parametrize("first", ["top", "bottom"])
def test_rows_that_wait_collect_more(run_effect, first):
    known = {"exposure_s": 1e-3}
    out = run_effect(
        "parasitic_light", charge(1000, 50, 4), known=known, share=0.01, readout_s=0.02, first=first
    )
    waited = 0.02 * np.arange(50) / 50  # s
    expected = 1000 * (1 + 0.01 * (waited if first == "top" else waited[::-1]) / 1e-3)
    assert out[0, 0].mean(1).numpy() == pytest.approx(expected, rel=1e-5)
    assert bool((run_effect("parasitic_light", charge(0), share=0.01) == 0).all())


def test_leaks_jump_by_exposure_and_temperature(run_effect):
    given = {"density": 1.0, "amplitude_e_per_s": 40.0, "duty": 0.3, "kept": 0.8, "sequence": True}
    known = {"exposure_s": 0.5, "temperature_c": 30.0}
    jumps = (
        run_effect("dark_current_rts", charge(0, 100, 100, 12), known=known, **given)[:, 0].double().numpy()
    )
    mean = 40 * 0.5 * np.exp(0.077 * 10)
    upper = jumps.max(0)
    seen = upper > 0
    assert np.all((jumps == 0) | np.isclose(jumps, upper))  # two levels
    assert jumps.mean() / (0.3 * mean) == pytest.approx(1, abs=0.1)
    assert stats.kstest(upper[seen], stats.expon(scale=mean).cdf).pvalue > 1e-6
    state = (jumps > 0) - 0.3
    # of the autocovariance 0.21 kept^k; 10 000 pixels
    for k in (1, 3):
        assert (state[k:] * state[:-k]).mean() == pytest.approx(0.21 * 0.8**k, abs=0.0105)


def test_the_sun_turns_black(run_effect):
    levels = torch.tensor([5000.0, 9000.0, 20_000.0, 100_000.0, 3e6]).view(1, 1, 1, -1)
    out = run_effect("black_sun", levels, known=WELL, share=0.01, onset=2.0).flatten().tolist()
    assert out == pytest.approx([5000, 9000, 10_000, 10_000 - 0.01 * 80_000, 0])


def test_hotter_pixels_are_softer(run_effect):
    """ln of the rate at two temperatures, pixel by pixel: a line of slope 1 - s (T2 - T1) in the rate at 20 C."""
    given = {"density": 0.2, "rate_e_per_s": 100.0, "b_per_c": 0.1, "softer_per_c": 0.01}
    rates = []
    for celsius in (20.0, 50.0, -30.0):
        out = run_effect(
            "hot_pixels", charge(0, 100, 100), known={"temperature_c": celsius, "exposure_s": 1.0}, **given
        )
        rates.append(out[0, 0].double().numpy())
    hot = rates[0] > 1
    assert hot.mean() > 0.15
    for rate, away in ((rates[1], 30.0), (rates[2], -50.0)):
        expected = 100 * (rates[0][hot] / 100) ** (1 - 0.01 * away) * np.exp(0.1 * away)
        assert rate[hot] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("beta", [1.0, 0.6])
def test_small_packets_lose_more(run_effect, beta):
    """A single packet of N after one transfer lacks share (N / 1000)^(beta - 1) N."""
    for electrons in (100.0, 1000.0, 9000.0):
        image = torch.zeros(1, 1, 30, 4)
        image[0, 0, 9] = electrons  # ten transfers to the top
        out = run_effect(
            "charge_transfer_inefficiency", image, share_per_transfer=1e-3, density_exponent=beta
        )
        share = 1e-3 * (electrons / 1000) ** (beta - 1)
        assert float(out[0, 0, 9, 0]) == pytest.approx(electrons * (1 - share) ** 10, rel=1e-5)
