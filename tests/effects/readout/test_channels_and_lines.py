"""Readout channels, defective lines, correlated rows and a second gain against their laws in NumPy.

Statistical tests allow 5 standard errors on fixed seeds: a right program fails one of some twenty comparisons with a probability
of 1e-5.
"""

import numpy as np
import pytest
import torch

from visaug.effects import FrameSummary, catalogue


def frames(count, rows, columns, level=0.0):
    return torch.full((count, 1, rows, columns), level)


@pytest.mark.parametrize(("layout", "channels"), [("interleaved", 2), ("interleaved", 5), ("blocks", 4)])
def test_channels_have_their_own_line(run_effect, layout, channels):
    """A line of V against the light for each channel, with slopes and offsets of rms `gain` and `offset_e`."""
    given = {"layout": layout, "channels": channels, "offset_e": 3.0, "gain": 0.01}
    dark, lit = (
        run_effect("column_parity", frames(1, 4, 60, v), **given)[0, 0].double().numpy()
        for v in (0.0, 1000.0)
    )
    assert np.ptp(dark, axis=0).max() == 0
    column = np.arange(60)
    own = column % channels if layout == "interleaved" else column * channels // 60
    for values, rms in ((dark[0], 3.0), ((lit - dark)[0] / 1000 - 1, 0.01)):
        levels = np.array([values[own == k][0] for k in range(channels)])
        assert values == pytest.approx(levels[own], abs=1e-6)
        assert len(np.unique(levels.round(6))) == channels
        assert levels.mean() == pytest.approx(0, abs=1e-4 * rms + 1e-6)
        assert np.sqrt((levels**2).mean()) == pytest.approx(rms, rel=1e-3)


def dark_columns(channels: int, offset_e: float, seed: int, first: int = 40) -> FrameSummary:
    """A window, from column `first` on, of a mean dark frame whose columns scatter by 0.5 e-."""
    rng = np.random.default_rng(seed)
    columns = first + np.arange(96)
    levels = np.linspace(-1, 1, channels)
    profile = offset_e * (levels / levels.std())[columns % channels] + 0.5 * rng.standard_normal(96)
    none = np.zeros(0)
    return FrameSummary(
        profile + 0.1 * rng.standard_normal((64, 96)),
        np.arange(64) / 64,
        columns / 200,
        none,
        np.zeros((0, 64)),
    )


@pytest.mark.parametrize("channels", [2, 4, 8])
def test_a_look_at_the_dark_frame_finds_the_channels(channels):
    """Offsets of 1.5 e-: the rms over n channels has an error of 0.5 / sqrt(96) e-, 5 of which are allowed."""
    (point,) = catalogue()["column_parity"].looks(dark_columns(channels, 1.5, 3))
    assert point["channels"] == channels
    assert point["offset_e"] == pytest.approx(1.5, abs=0.26)
    assert point["gain"] > 0  # a fit that starts at 0 stays there


def test_a_look_at_columns_without_channels_finds_none():
    """False-alarm rate 1e-3 at most, in each of 40 frames: two or more with a probability of 8e-4."""
    found = [catalogue()["column_parity"].looks(dark_columns(2, 0.0, seed)) for seed in range(40)]
    assert sum(map(bool, found)) < 2


def test_noisy_pixels_stay_noisy(run_effect):
    """The variance of each pixel over 400 frames is chi-square about its own, which the next 400 frames have too."""
    stack = (
        run_effect("read_noise_nonuniformity", frames(800, 20, 25), excess_e=2.0, spread=0.7)[:, 0]
        .double()
        .numpy()
    )
    first, second = np.log(stack[:400].var(0)), np.log(stack[400:].var(0))
    own = np.cov(first.ravel(), second.ravel())
    assert own[0, 1] == pytest.approx((2 * 0.7) ** 2, rel=5 * np.sqrt(2 / 500))  # var ln s^2
    assert own[0, 0] - own[0, 1] == pytest.approx(2 / 400, abs=0.1)
    # ln s = ln 2 - spread^2 + spread z
    assert first.mean() / 2 == pytest.approx(np.log(2.0) - 0.49, abs=5 * 0.7 / np.sqrt(500) + 0.01)


@pytest.mark.parametrize("shape", ["columns", "rows"])
@pytest.mark.parametrize("kind", ["dead", "bright", "unstable"])
def test_defective_lines(run_effect, shape, kind):
    given = {"density": 0.1, "level_e": 20.0, "kind": kind, "shape": shape}
    size = (3, 4000) if shape == "columns" else (4000, 3)
    first, then = run_effect("line_defects", frames(2, *size, 100.0), **given)[:, 0].double().numpy()
    assert np.ptp(first, axis=0 if shape == "columns" else 1).max() == 0
    first, then = (frame[0] if shape == "columns" else frame[:, 0] for frame in (first, then))
    hit = first != 100
    assert hit.mean() == pytest.approx(0.1, abs=5 * np.sqrt(0.09 / 4000))
    assert np.array_equal(hit, then != 100)  # the same lines in each frame
    if kind == "dead":
        assert np.all(first[hit] == 0)
    elif kind == "bright":
        assert np.array_equal(first, then)
        assert first[hit].mean() - 100 == pytest.approx(20, rel=5 / np.sqrt(hit.sum()))
    else:
        assert first[hit].std() == pytest.approx(20, rel=5 / np.sqrt(2 * hit.sum()))
        assert abs(np.corrcoef(first[hit], then[hit])[0, 1]) < 5 / np.sqrt(hit.sum())


def test_clusters_are_squares(run_effect):
    """Dead pixels are those that a square of three pixels reaches, as SciPy dilates the single ones."""
    from scipy.ndimage import binary_dilation

    given = {"density": 0.002, "kind": "dead", "shape": "clusters"}
    seeds, clusters = (
        (run_effect("line_defects", frames(1, 80, 90, 100.0), size_px=size, **given)[0, 0] == 0).numpy()
        for size in (1, 3)
    )
    corner = np.zeros((5, 5), bool)
    corner[2:, 2:] = True  # a square below and right of the seed
    assert seeds.sum() > 5
    assert np.array_equal(clusters, binary_dilation(seeds, corner))


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_rows_have_their_spectrum(run_effect, exponent):
    out = (
        run_effect("correlated_row_noise", frames(600, 256, 2), sigma_e=2.0, exponent=exponent)[:, 0]
        .double()
        .numpy()
    )
    assert np.ptp(out, axis=2).max() == 0
    rows = out[..., 0]
    assert np.mean(rows**2) == pytest.approx(
        4.0, rel=0.3 if exponent == 1 else 0.5
    )  # few modes hold most of the power
    # windowed, so that a strong low frequency does not leak into the high ones
    power = (np.abs(np.fft.rfft((rows - rows.mean(1, keepdims=True)) * np.hanning(256))) ** 2).mean(0)[4:100]
    slope = np.polyfit(np.log(np.arange(4, 100)), np.log(power), 1)[0]
    assert slope == pytest.approx(-exponent, abs=0.1)
    along = run_effect("correlated_row_noise", frames(1, 4, 64), direction="columns")[0, 0]
    assert bool((along == along[:1]).all())
    assert float(along.std()) > 0


def test_slanted_wave_is_one_peak(run_effect):
    """cos 60 deg / 8 cycles/px down, sin 60 deg / 8 across; a peak of the padded spectrum is found to 0.002 cycles/px."""
    image = (
        run_effect("slanted_interference", frames(2, 64, 96), amplitude_e=3.0, period_px=8.0, angle_deg=60.0)[
            :, 0
        ]
        .double()
        .numpy()
    )
    spectrum = np.abs(np.fft.fft2(image[0], (512, 512)))
    row, column = np.unravel_index(spectrum[:256].argmax(), (256, 512))
    found = np.fft.fftfreq(512)[[row, column]]
    assert found == pytest.approx([np.cos(np.pi / 3) / 8, np.sin(np.pi / 3) / 8], abs=0.002)
    assert image.std() == pytest.approx(3 / np.sqrt(2), rel=0.03)
    assert abs(np.corrcoef(image[0].ravel(), image[1].ravel())[0, 1]) < 0.999  # another phase


def test_second_channel_takes_over_at_the_seam(run_effect):
    given = {"noise_e": 20.0, "gain": 0.05, "offset_e": 7.0, "seam_e": 1000.0}
    below, above = (
        run_effect("dual_gain", frames(1, 100, 100, v), **given).double() for v in (999.0, 3000.0)
    )
    assert bool((below == 999).all())
    assert float(above.mean()) == pytest.approx(3000 + 0.05 * 2000 + 7, abs=5 * 20 / 100)
    assert float(above.std()) == pytest.approx(20, rel=5 / np.sqrt(2 * 1e4))
