"""Release 4: laws against plain NumPy, the split under row noise against the truth, operating points, the sheet."""

import json

import numpy as np
import pytest

from visaug.characterization import characterize
from visaug.characterization.emva_curves import high_pass, pattern_curves
from visaug.characterization.moments import measure
from visaug.characterization.nonuniformity import corrected_split, not_white, release_4
from visaug.characterization.points import OperatingPoint, operating_points
from visaug.frames import FrameRecord, FrameSet
from visaug.report import sheet_json, write_sheet

H, W = 64, 80
GAIN, EFFICIENCY, DARK_E, ROW_E, BLACK = 0.5, 0.6, 6.0, 1.5, 60  # DN/e-, e-/photon, e-, e-, DN
PHOTONS = (60, 200, 500, 1000, 2000, 3000, 4000, 5000, 6000, 7500, 9000, 11000, 13000, 14500)
MOSAIC = {"R": 0.5, "G1": 1.0, "G2": 1.0, "B": 0.7}


def sensor_frames(rng, row_e=ROW_E, levels=PHOTONS, stack=20, prnu=0.01):
    """An EMVA sweep of pairs at one exposure, with stacks of dark and half-bright frames, 12 bits."""
    pattern = 1 + prnu * rng.standard_normal((H, W))

    def shot(photons):
        electrons = rng.poisson(photons * EFFICIENCY * pattern)
        rows = row_e * rng.standard_normal((H, 1))
        noisy = electrons + rows + DARK_E * rng.standard_normal((H, W))
        return np.clip(np.rint(GAIN * noisy + BLACK), 0, 4095).astype(np.uint16)

    rows = [("dark", None, shot(0)) for _ in range(stack)]
    for p in levels:
        rows += [("flat", float(p), shot(p)) for _ in range(stack if p == 7500 else 2)]
    return rows


def frame_set(rows, **more):
    records = [FrameRecord(i, f"{i}", k, 0.01, 20.0, 0.0, p, **more) for i, (k, p, _) in enumerate(rows)]
    return FrameSet.from_arrays(records, [f for _, _, f in rows], bit_depth=12)


@pytest.fixture(scope="module")
def measured():
    frames = frame_set(sensor_frames(np.random.default_rng(41)))
    return frames, characterize(frames)


def test_figures_follow_from_their_definitions(measured):
    _, result = measured
    p = {name: e.value for name, e in result.parameters.items()}
    k, r = p["emva.system_gain_dn_per_e"], p["emva4.responsivity_dn_per_photon"]
    assert r == pytest.approx(GAIN * EFFICIENCY, rel=0.01)
    assert p["emva4.inverse_gain_e_per_dn"] == pytest.approx(1 / k)
    assert p["emva4.snr_max"] == pytest.approx(np.sqrt(p["emva.saturation_e"]))
    assert p["emva4.snr_max_db"] == pytest.approx(20 * np.log10(p["emva4.snr_max"]))
    assert p["emva4.snr_max_bit"] == pytest.approx(np.log2(p["emva4.snr_max"]))
    assert p["emva4.inverse_snr_max"] == pytest.approx(1 / p["emva4.snr_max"])
    threshold = p["emva4.absolute_sensitivity_threshold_photons"]
    assert threshold == pytest.approx((p["emva.dark_noise_dn"] + k / 2) / r)
    assert p["emva4.absolute_sensitivity_threshold_e"] == pytest.approx(p["emva.dark_noise_dn"] / k + 0.5)
    assert p["emva4.dynamic_range"] == pytest.approx(p["emva.saturation_photons"] / threshold)
    assert p["emva4.dynamic_range_db"] == pytest.approx(20 * np.log10(p["emva4.dynamic_range"]))
    assert "emva4.doubling_temperature_c" in result.not_determined
    # Near the truth: dark noise of pixels and rows and of the converter; the signal at which the SNR is 1.
    dark_e = np.sqrt(DARK_E**2 + ROW_E**2 + 1 / 12 / GAIN**2)
    assert threshold == pytest.approx((dark_e + 0.5) / EFFICIENCY, rel=0.03)
    for name, e in result.parameters.items():
        if name.startswith("emva4"):
            assert e.low <= e.value <= e.high, name


def test_doubling_temperature_from_the_law_of_dark_current():
    from visaug.characterization.emva import derived
    from visaug.statistics.findings import Findings

    found = Findings()
    found.add("dark_current.b_per_c", (0.1, 0.08, 0.125), "1/degC", "darks")
    derived(found, None)
    e = found.parameters["emva4.doubling_temperature_c"]
    assert (e.value, e.low, e.high) == pytest.approx((6.931, 5.545, 8.664), abs=1e-3)


def test_split_under_row_noise(measured):
    """Truth: no DSNU at all. The standard's row part is the row noise of a stack of 20, 1.5 e- / sqrt(20)."""
    frames, result = measured
    dark = measure(frames, next(g for g in frames.groups() if g.kind == "dark"))
    assert not_white(dark) == ["row"]
    standard, right = release_4(dark), corrected_split(dark)
    row = (GAIN * ROW_E) ** 2 / dark.n
    assert standard["row"] == pytest.approx(row, rel=0.6)  # of 64 rows; 0.6 is 3.4 standard deviations
    assert standard["pixel"] < 0
    for name in ("row", "column", "pixel"):  # within 4 standard deviations of 0, of (H - 1) and so on degrees
        error = {"row": row * np.sqrt(2 / 63), "column": 0.01 / 64, "pixel": 0.005}[name]
        assert abs(right[name]) < 4 * error + 1e-3, name
    assert result["emva4.dsnu_row_e"].value == pytest.approx(np.sqrt(standard["row"]) / GAIN, rel=0.02)
    assert result["emva4_corrected.dsnu_row_e"].value < 0.5 * result["emva4.dsnu_row_e"].value
    warning = next(w for w in result.warnings if w.startswith("emva4_split"))
    assert "row means" in warning
    assert "negative variance of pixel" in warning


def test_no_correction_where_noise_is_white():
    """The test of whiteness has a false-alarm rate of 0.1 % for each of two directions of two stacks."""
    frames = frame_set(sensor_frames(np.random.default_rng(43), row_e=0.0, levels=(500, 2000, 7500), stack=8))
    result = characterize(frames)
    assert not any(name.startswith("emva4_corrected") for name in result.parameters)
    # 1 % within 4 standard deviations, 0.01 / sqrt(2 * 60 * 76) = 1 % of it, and the noise that is taken off
    assert result["emva4.prnu_highpass"].value == pytest.approx(0.01, rel=0.08)


def test_high_pass_keeps_white_patterns_and_takes_shading_away():
    rng = np.random.default_rng(44)
    white = rng.standard_normal((200, 240))
    assert high_pass(white).var() == pytest.approx(1.0, rel=0.03)  # 4.4 standard deviations of 46000 pixels
    y, x = np.mgrid[:200, :240] / 200
    shaded = white + 40 * x * y + 30 * y**2
    assert high_pass(shaded).var() == pytest.approx(high_pass(white).var(), rel=0.02)


def test_arrays_of_the_plots_are_those_of_plain_numpy():
    rng = np.random.default_rng(45)
    values = 5 + 0.3 * rng.standard_normal((40, 64)) + 0.5 * np.cos(2 * np.pi * 8 * np.arange(64) / 64)
    c = pattern_curves(values, 0.01)
    amplitude = np.sqrt(
        np.mean([np.abs(np.fft.fft(row - values.mean())) ** 2 / 64 for row in values], axis=0)
    )
    np.testing.assert_allclose(c["horizontal_amplitude"], amplitude[:33])
    assert c["horizontal_frequency"][c["horizontal_amplitude"].argmax()] == 8 / 64
    assert c["count"].sum() == values.size
    deviation = np.abs(values - values.mean())
    for x, percent in zip(c["beyond"][::40], c["percent_beyond"][::40]):
        assert percent == pytest.approx(100 * (deviation >= x).mean())


def test_every_filter_and_colour_is_an_operating_point(tmp_path):
    rng = np.random.default_rng(46)
    rows = sensor_frames(rng, row_e=0.0, levels=(1000, 3000, 7500), stack=4)
    tiles = np.array(list(MOSAIC.values())).reshape(2, 2)
    cfa = np.tile(tiles, (H // 2, W // 2))
    coloured = [
        (k, p, f if p is None else np.rint((f - float(BLACK)) * cfa + BLACK).astype(np.uint16))
        for k, p, f in rows
    ]
    points = operating_points(frame_set(coloured, bayer="RGGB"))
    assert [p.name for p in points] == [f"colour {c}" for c in MOSAIC]
    for point in points:
        share = MOSAIC[point.name.split()[1]]
        found = point.result["emva4.responsivity_dn_per_photon"].value
        assert found == pytest.approx(share * GAIN * EFFICIENCY, rel=0.02)
    records = [
        FrameRecord(
            i, str(i), k, 0.01, 20.0, 0.0, p, filter=None if p is None else f"{450 + 100 * (i % 2)} nm"
        )
        for i, (k, p, _) in enumerate(rows)
    ]
    by_filter = operating_points(FrameSet.from_arrays(records, [f for _, _, f in rows], bit_depth=12))
    assert sorted(p.name for p in by_filter) == ["450 nm", "550 nm"]


def test_the_sheet_holds_every_figure_and_plot(measured, tmp_path):
    frames, result = measured
    points = [OperatingPoint("one operating point", result)]
    page = write_sheet(tmp_path / "sheet.html", points, frames).read_text()
    for plot in (
        *("Sensitivity", "Photon transfer", "SNR", "Deviation from linearity", "Dark current from the mean"),
        *(f"{w} spectrogram, {d}" for w in ("DSNU", "PRNU") for d in ("horizontal", "vertical")),
        *(f"{w} profile, {d}" for w in ("DSNU", "PRNU") for d in ("horizontal", "vertical")),
        *(f"{w} histogram{a}" for w in ("DSNU", "PRNU") for a in ("", ", accumulated")),
    ):
        assert f"<figcaption>{plot}</figcaption>" in page, plot
    for name in ("1/K", "SNR max", "DR", "high-pass", "of a normal pattern", "Split with the temporal noise"):
        assert name in page
    assert 'src="http' not in page
    content = json.loads(json.dumps(sheet_json(points), allow_nan=False))
    (point,) = content["operating_points"]
    assert "emva4.snr_max" in point["parameters"]
    assert point["curves"]["emva4_sweep"]["photons"][:3] == list(PHOTONS[:3])


def test_the_split_by_release_4_is_exact_for_a_sensor_that_is_not_square():
    """Expected mean squares of independent rows, columns and pixels on 4 x 7 pixels, in 3 frames of white noise of 0.6 DN^2."""
    from visaug.characterization.moments import GroupMoments
    from visaug.characterization.nonuniformity import release_4
    from visaug.frames import Group

    height, width, row, column, pixel, left = 4, 7, 0.5, 0.3, 2.0, 0.6 / 3
    lines = {
        n: np.sqrt(variance * n / 2) * np.eye(n)[:2].T @ [1, -1]  # of this variance about a mean of 0
        for n, variance in ((height, row + (pixel + left) / width), (width, column + (pixel + left) / height))
    }
    moments = GroupMoments(
        group=Group("flat", 0.01, 20.0, 0.0, None, None, None, (0, 1, 2)),
        n=3,
        shape=(height, width),
        frame_means=np.zeros(3),
        row_means=lines[height],
        column_means=lines[width],
        row_variances=np.full(height, 0.6),
        spatial_variance=row + column + pixel + left,
        temporal=None,
        clipped_low=0.0,
        clipped_high=0.0,
        columns_by_frame=np.zeros((3, width)),
        rows_by_frame=np.zeros((3, height)),
    )
    expected = {"total": row + column + pixel, "row": row, "column": column, "pixel": pixel}
    assert release_4(moments) == pytest.approx(expected)
