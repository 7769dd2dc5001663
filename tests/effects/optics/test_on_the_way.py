"""Flicker, dust, fringes and spikes against their laws in NumPy and SciPy."""

import numpy as np
import pytest
import torch


def flat(count=1, rows=60, columns=80, level=1000.0):
    return torch.full((count, 1, rows, columns), level)


@pytest.mark.parametrize(
    ("exposure_s", "left"), [(1e-5, 1.0), (0.005, 2 / np.pi), (0.01, 0.0), (0.015, 2 / (3 * np.pi))]
)
def test_exposure_averages_flicker(run_effect, exposure_s, left):
    """The mean of a sine over an exposure, by SciPy: at 100 Hz nothing is left of it after 10 ms."""
    from scipy.integrate import quad

    out = (
        run_effect(
            "lamp_flicker",
            flat(),
            depth=0.1,
            period_rows=20.0,
            frequency_hz=100.0,
            known={"exposure_s": exposure_s},
        )[0, 0, :, 0]
        .double()
        .numpy()
    )
    amplitude = np.abs(np.fft.rfft(out / 1000 - 1))[3] * 2 / 60  # three whole periods of 20 rows
    peak = abs(quad(lambda t: np.cos(2 * np.pi * 100 * t), -exposure_s / 2, exposure_s / 2)[0] / exposure_s)
    assert peak == pytest.approx(left, abs=1e-3)
    assert amplitude == pytest.approx(0.1 * left, abs=1e-4)


def test_flicker_is_in_the_light_alone_and_drifts(run_effect):
    assert bool((run_effect("lamp_flicker", flat(level=0.0), depth=0.5) == 0).all())
    out = run_effect("lamp_flicker", flat(50), depth=0.1)[:, 0]
    assert bool((out == out[:, :, :1]).all())  # along the rows
    levels = out[:, 0, 0].double() / 1000 - 1
    assert 0.05 < float(levels.std()) < 0.09  # 0.1 / sqrt(2) over uniform phases; 50 of them
    assert float(levels.abs().max()) <= 0.1 + 1e-6


def test_dust_shades_as_deep_and_wide_as_it_says(run_effect):
    """One speck of known place is fitted by SciPy; depths lie in [1/3, 1] and radii in [2/3, 3/2] of the parameters."""
    from scipy.optimize import curve_fit

    y, x = np.mgrid[:100, :120] + 0.5

    def shadow(_, row, column, depth, radius):
        return (1 - depth * np.exp(-((((y - row) ** 2 + (x - column) ** 2) / radius**2) ** 2))).ravel()

    met = 0
    for camera in range(12):
        out = (
            run_effect("dust", flat(1, 100, 120), depth=0.3, radius_px=8.0, specks=1, cameras=[camera])[0, 0]
            .double()
            .numpy()
            / 1000
        )
        row, column = np.unravel_index(out.argmin(), out.shape)
        if not (15 < row < 85 and 15 < column < 105):
            continue  # cut by the edge
        found, _ = curve_fit(shadow, None, out.ravel(), (row, column, 0.2, 8.0))
        assert shadow(None, *found) == pytest.approx(out.ravel(), abs=1e-4)
        assert 0.099 < found[2] < 0.301
        assert 8 * 2 / 3 - 0.01 < abs(found[3]) < 12.01
        met += 1
    assert met >= 4
    many = run_effect("dust", flat(2, 100, 120), depth=0.3, specks=30)
    assert bool((many[0] == many[1]).all())
    assert float(many.min()) < 900


def test_uneven_light_is_the_surface_that_its_parameters_say(run_effect):
    """A least squares fit by NumPy finds the four coefficients again; the mean of the frame is that without the effect."""
    given = {"row_slope": 0.02, "column_slope": -0.03, "row_bend": 0.04, "column_bend": -0.01}
    out = run_effect("uneven_light", flat(1, 101, 121), **given)[0, 0].double().numpy() / 1000
    y, x = np.mgrid[-1 + 1 / 101 : 1 - 1 / 101 : 101j, -1 + 1 / 121 : 1 - 1 / 121 : 121j]
    terms = np.stack([np.ones_like(x), y, x, y**2, x**2], -1).reshape(-1, 5)
    level, *found = np.linalg.lstsq(terms, out.ravel(), rcond=None)[0]
    np.testing.assert_allclose(found, list(given.values()), atol=2e-5)
    assert level == pytest.approx(1 - (0.04 - 0.01) / 3, abs=2e-5)
    assert out.mean() == pytest.approx(1, abs=1e-5)
    # along the middle row the terms of the columns have the mean 0
    assert out[50].mean() == pytest.approx(1 - 0.04 / 3, abs=1e-4)


def test_uneven_light_belongs_to_the_sensor_not_to_the_crop(run_effect):
    whole = run_effect("uneven_light", flat(1, 100, 120), row_slope=0.1, column_bend=0.1)
    part = run_effect(
        "uneven_light",
        flat(1, 100, 120)[..., 30:70, 5:45],
        window=(range(30, 70), range(5, 45)),
        resolution=(100, 120),
        row_slope=0.1,
        column_bend=0.1,
    )
    torch.testing.assert_close(part, whole[..., 30:70, 5:45])


def test_fringes_are_rings_of_rising_frequency(run_effect):
    """The phase is quadratic in the place: its second difference along rows and columns is 2 fringes / side^2 cycles."""
    out = (
        run_effect("fringing", flat(1, 200, 300), amplitude=0.02, fringes=4.0)[0, 0].double().numpy() / 1000
        - 1
    )
    assert np.abs(out).max() == pytest.approx(0.02, rel=1e-3)
    from scipy.optimize import least_squares

    y, x = (np.mgrid[:200, :300] + 0.5) / 300

    def left(q):
        return (np.cos(2 * np.pi * (4.0 * (x**2 + y**2) - q[0] * x - q[1] * y + q[2])) - out / 0.02).ravel()

    starts = [
        (a, b, c) for a in np.arange(-2, 11, 0.5) for b in np.arange(-2, 7, 0.5) for c in (0.0, 0.33, 0.67)
    ]
    best = min(starts, key=lambda q: np.square(left(q)[::37]).sum())
    assert np.abs(least_squares(left, best).fun).max() < 1e-3


@pytest.mark.parametrize(("blades", "spikes"), [(6, 6), (5, 10)])
def test_spikes_keep_the_light_and_have_their_number(run_effect, blades, spikes):
    light = torch.zeros(1, 1, 121, 121)
    light[0, 0, 60, 60] = 1e6
    out = (
        run_effect("star_burst", light, share=0.1, blades=blades, length_px=15.0, angle_deg=0.0)[0, 0]
        .double()
        .numpy()
    )
    assert out.sum() == pytest.approx(1e6, rel=1e-4)
    assert out[60, 60] > 0.9e6
    angle = 2 * np.pi * np.arange(720) / 720
    ring = out[np.rint(60 - 30 * np.sin(angle)).astype(int), np.rint(60 + 30 * np.cos(angle)).astype(int)]
    lit = ring > 0.3 * ring.max()
    rises = int(np.sum(lit & ~np.roll(lit, 1)))
    assert rises == spikes
    # along the rows: exp(-u / 15) / (1 + (u / 3)^2)
    along = out[60, 60 + np.array([10, 30])]
    expected = np.exp(-20 / 15) * (1 + (10 / 3) ** 2) / (1 + 10**2)
    assert along[1] / along[0] == pytest.approx(expected, rel=0.05)
