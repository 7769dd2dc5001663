"""Checks of the measurement model: each fault is corrected or named with what it spoils; frames are plain NumPy."""

import re

import numpy as np
import pytest
from scipy import ndimage

from visaug.app.cli import main
from visaug.camera import Camera
from visaug.characterization import characterize
from visaug.characterization.alarms import all_warnings
from visaug.characterization.codes import _step
from visaug.characterization.defective import extremes
from visaug.characterization.facts import look
from visaug.characterization.in_time import _normal_gap, _Peaks, _peaks, _tail
from visaug.characterization.model_checks import CHECKS
from visaug.diagnosis.laboratory import Laboratory
from visaug.frames import FrameRecord, FrameSet

SHAPE = (72, 96)
GAIN, READ, PRNU, BLACK = 0.4, 4.0, 0.01, 100.0  # e-/DN, e-, share, DN
LEVELS = (100, 300, 600, 1000, 1400)  # e-
ALARMS = {word for check in CHECKS for word in check.words}


def taken(
    seed=0,
    levels=LEVELS,
    n=4,
    biases=10,
    light: float | np.ndarray = 1.0,
    read=READ,
    gain=GAIN,
    black=BLACK,
    change=None,
    charge=None,
):
    """Rows (kind, exposure, degC, photons, frame): bias frames and flats; `charge` acts on electrons, `change` on DN."""
    rng = np.random.default_rng(seed)
    prnu = rng.normal(0, PRNU, SHAPE)

    def frame(kind, mean_e):
        e = rng.poisson(mean_e * light * (1 + prnu)).astype(float)
        e = e if charge is None else charge(e, kind, rng)
        dn = np.clip(np.rint(black + (e + rng.normal(0, read, SHAPE)) / gain), 0, 4095)
        return dn if change is None else np.clip(np.rint(change(dn, kind, rng)), 0, 65535)

    rows = [("bias", 0.0, 20.0, None, frame("bias", 0)) for _ in range(biases)]
    return rows + [("flat", 0.01, 20.0, e / 0.6, frame("flat", e)) for e in levels for _ in range(n)]


def frame_set(rows, **told):
    records = [FrameRecord(i, f"{i}", k, t, c, 0.0, p, **told) for i, (k, t, c, p, _) in enumerate(rows)]
    return FrameSet.from_arrays(records, [np.asarray(r[-1], np.uint16) for r in rows])


def measured(rows, **told):
    return characterize(frame_set(rows, **told))


def alarms(result):
    return {w.word for w in result.warning_details} & ALARMS


def spoiled(result, word):
    return next(w.spoils for w in result.warning_details if w.word == word)


def covers(result, **truth):
    """An interval twice as wide as the 95 % one misses once in 10,000."""
    for name, true in truth.items():
        e = result[name.replace("__", ".")]
        assert e.low - (e.value - e.low) <= true <= e.high + (e.high - e.value), f"{name}: {e} for {true}"


RIGHT = {"gain_e_per_dn": GAIN, "read_noise__sigma_e": READ, "prnu__pixel": PRNU}


def test_sound_frames_are_silent():
    """The stated rates of all checks together are below 3 % for a set; the seed is fixed."""
    result = measured(taken())
    assert not alarms(result)
    covers(result, **RIGHT)


@pytest.mark.parametrize(
    ("where", "value", "kinds"),
    [
        ((40, 50), 4095, ("bias", "flat")),
        ((40, 50), 4095, ("flat",)),
        ((40, 50), 0, ("bias", "flat")),
        ((33, slice(None)), 4095, ("bias", "flat")),
        ((slice(20, 22), slice(None)), 0, ("bias", "flat")),
        ((slice(None), 7), 512, ("bias", "flat")),
    ],
)
def test_stuck_pixels_are_left_out_and_named(where, value, kinds):
    """Fails where one saturated pixel makes a level unusable, or a row of zeros counts as a pattern."""

    def stick(dn, kind, rng):
        if kind in kinds:
            dn[where] = value
        return dn

    result = measured(taken(1, change=stick))
    assert alarms(result) == {"stuck_pixels"}
    covers(result, **RIGHT, black_level_dn=BLACK)
    assert (result.maps["defects"][where] & 2).all()


def test_a_pixel_that_saturates_in_bright_flats_alone_leaves_the_levels_usable():
    def hot(dn, kind, rng):
        dn[10, 20] = min(dn[10, 20] + 2500, 4095)
        return dn

    result = measured(taken(2, change=hot))
    covers(result, **RIGHT)
    assert "5 levels" in result["gain_e_per_dn"].source


def test_covered_columns_are_cut():
    """Sixteen columns without light: a PRNU of columns of 0.3 where they count."""
    result = measured(taken(3, light=np.where(np.arange(SHAPE[1]) < 80, 1.0, 0.0)))
    assert alarms(result) == {"overscan"}
    covers(result, **RIGHT)
    assert result["prnu.column"].low < 0.001


def test_light_that_falls_off_is_no_overscan():
    y, x = np.linspace(-1, 1, SHAPE[0])[:, None], np.linspace(-1, 1, SHAPE[1])
    assert "overscan" not in alarms(measured(taken(4, light=np.maximum(1 - 0.55 * (x**2 + y**2), 0))))


@pytest.mark.parametrize("share", [0.005, 0.02])
def test_charge_that_neighbours_share_is_counted_by_covariance(share):
    """Variance alone makes the gain 4 % and 18 % too high (A. C. Moore et al. 2006)."""
    kernel = np.array([[0, share, 0], [share, 1 - 4 * share, share], [0, share, 0]])
    couple = lambda e, kind, rng: ndimage.convolve(e, kernel, mode="mirror")  # noqa: E731
    result = measured(taken(5, n=8, charge=couple))
    assert "correlated_noise" in alarms(result)
    covers(result, gain_e_per_dn=GAIN, read_noise__sigma_e=READ)
    assert "gain_e_per_dn" not in spoiled(result, "correlated_noise")
    assert "emva.system_gain_dn_per_e" in spoiled(result, "correlated_noise")
    (effect,) = (e for e in result.effects if e["name"] == "interpixel_crosstalk")
    assert effect["share"] == pytest.approx(share, rel=0.25)


@pytest.mark.parametrize(
    "smooth",
    [
        lambda a: ndimage.median_filter(a, 3),
        lambda a: ndimage.gaussian_filter(a, 0.6),
        lambda a: ndimage.uniform_filter1d(a, 2, axis=1),
    ],
)
def test_frames_that_were_smoothed_spoil_gain_and_read_noise_and_nothing_else_is_named(smooth):
    result = measured(taken(6, change=lambda dn, kind, rng: smooth(dn)))
    words = {w.word for w in result.warning_details}
    assert {"gain_e_per_dn", "read_noise.sigma_e"} <= set(spoiled(result, "correlated_noise"))
    assert not words & {"row_noise", "column_noise", "lamp_band", "structured_light"}


@pytest.mark.parametrize("scale", [2, 3, 10, 65535 / 4095, 1.6])
def test_scaled_codes_leave_read_noise_open_where_it_is_below_a_step(scale):
    """0.45 steps of noise: as if every DN were a code the read noise comes out 17 % too high."""
    rows = taken(
        7,
        (200, 600, 1200, 2400),
        gain=1.0,
        read=0.45,
        black=100.3,
        change=lambda a, *_: np.floor(a * scale + 1e-6),
    )
    result = measured(rows)
    assert alarms(result) == {"code_gaps"}
    covers(result, gain_e_per_dn=1 / scale)
    assert "read_noise.sigma_e" in result.not_determined


def test_scaled_codes_of_more_noise_than_a_step_count_with_their_own_rounding():
    """1 step of noise: rounding by steps of 16 DN makes 4 % of the read noise."""
    result = measured(taken(8, gain=1.0, read=1.0, black=100.0, change=lambda a, *_: a * 16 + 3))
    covers(result, gain_e_per_dn=1 / 16, read_noise__sigma_e=1.0)


def test_peaks_of_two_levels_are_no_gaps():
    counts = np.zeros(400, int)
    counts[[100, 101, 102, 130, 131, 132, 200, 201, 260, 261, 262]] = 50
    assert _step(counts) is None


@pytest.mark.parametrize("axis", [0, 1])
def test_lines_that_lack_bits_are_named(axis):
    def pack(dn, kind, rng):
        part = (slice(None, None, 2),) if axis == 0 else (slice(None), slice(None, None, 2))
        dn[part] = dn[part] // 16 * 16
        return dn

    result = measured(taken(9, change=pack))
    assert {"read_noise.sigma_e", "dsnu.column_e", "gain_e_per_dn"} <= set(spoiled(result, "bits_missing"))


@pytest.mark.parametrize("by", [-80, 30])
def test_another_black_level_of_the_flats_is_found_from_the_variance(by):
    result = measured(taken(10, n=6, change=lambda dn, kind, rng: dn + (by if kind == "flat" else 0)))
    assert "flat_pedestal" in alarms(result)
    covers(result, **RIGHT)


def test_two_levels_with_another_black_level_do_not_tell_the_gain():
    result = measured(
        taken(11, (100, 1000), n=6, change=lambda dn, kind, rng: dn + (60 if kind == "flat" else 0))
    )
    assert "gain_e_per_dn" in spoiled(result, "photon_transfer_bent")


def test_a_bend_lists_the_causes_and_what_the_frames_say_of_them():
    result = measured(
        taken(12, (300, 700, 1000, 1250, 1400), n=8, charge=lambda e, kind, rng: e - 6e-5 * e**2)
    )
    text = next(w.text for w in result.warning_details if w.word == "photon_transfer_bent")
    assert "charge sharing: ruled out" in text
    assert "nonlinear response: the signal bends too" in text


@pytest.mark.parametrize(
    "rows", [("RRGG", "RRGG", "GGBB", "GGBB"), ("GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG")]
)
def test_mosaics_of_other_periods_are_no_prnu(rows):
    tile = np.array([[{"R": 0.5, "G": 1.0, "B": 0.7}[c] for c in row] for row in rows])
    light = np.tile(tile, (SHAPE[0] // len(tile), SHAPE[1] // len(tile)))
    result = measured(taken(13, light=light))
    assert alarms(result) == {"periodic_response"}
    covers(result, gain_e_per_dn=GAIN, prnu__pixel=PRNU)


def test_odd_and_even_columns_are_no_mosaic():
    assert "periodic_response" not in alarms(measured(taken(14, light=1 + 0.1 * (np.arange(SHAPE[1]) % 2))))


def test_structured_light_spoils_prnu():
    y, x = np.indices(SHAPE)
    dust = 1 - 0.04 * sum(
        np.exp(-((y - r) ** 2 + (x - c) ** 2) / 18) for r, c in ((20, 30), (50, 70), (40, 12))
    )
    r4 = 1 - 0.3 * (((y - 36) / 48) ** 2 + ((x - 48) / 48) ** 2) ** 2
    for light in (dust, r4):
        result = measured(taken(15, light=light))
        assert "prnu.pixel" in spoiled(result, "structured_light")
        covers(result, gain_e_per_dn=GAIN)


@pytest.mark.parametrize("n", [2, 4])
def test_cosmic_rays_in_flats_are_left_out(n):
    """A track of five pixels in every second frame; with them the gain is up to a third too low."""

    def hit(dn, kind, rng):
        if kind == "flat" and rng.random() < 0.6:
            y, x = rng.integers(0, SHAPE[0]), rng.integers(0, SHAPE[1] - 5)
            dn[y, x : x + 5] += 1500
        return np.minimum(dn, 4095)

    result = measured(taken(16, (100, 300, 600, 800, 1000), n=n, change=hit))
    assert alarms(result) == {"cosmic_rays"}
    covers(result, **RIGHT)


def test_pixels_that_jump_by_themselves_are_no_cosmic_rays():
    """Random telegraph pixels in the high state in a fifth of the frames: their noise is the camera's."""

    def jump(dn, kind, rng):
        dn[5::12, 5::12] += 300 * (rng.random(dn[5::12, 5::12].shape) < 0.2)
        return dn

    assert "cosmic_rays" not in alarms(measured(taken(17, change=jump)))


@pytest.mark.parametrize("n", [2, 5])
def test_law_of_the_gap_between_the_two_greatest(n):
    """Against 200,000 draws: the share beyond the limit of 1 % is within five standard errors."""
    draws = np.sort(np.random.default_rng(0).standard_normal((200_000, n)), axis=1)
    share = float((draws[:, -1] - draws[:, -2] > _normal_gap(0.01, n)).mean())
    assert abs(share - 0.01) < 5 * np.sqrt(0.01 / 200_000)


def test_bands_of_a_lamp_are_taken_out_of_the_variance():
    """4 % of the light, phase by chance: 15 % of the variance of the brightest level."""

    def band(dn, kind, rng):
        phase = rng.random()
        wave = 1 + 0.04 * np.sin(2 * np.pi * (np.arange(SHAPE[0])[:, None] / 24 + phase))
        return BLACK + (dn - BLACK) * (wave if kind == "flat" else 1.0)

    result = measured(taken(18, n=8, change=band))
    assert "lamp_band" in alarms(result)
    covers(result, gain_e_per_dn=GAIN)


def test_a_stale_frame_is_left_out():
    rows = taken(19)
    rng = np.random.default_rng(20)

    def dark(mean_e):
        return np.rint(BLACK + (rng.poisson(mean_e, SHAPE) + rng.normal(0, READ, SHAPE)) / GAIN)

    for seconds, before in ((1.0, 0.4), (5.0, 40.0)):
        rows += [("dark", seconds, 20.0, None, dark(40 * seconds if k else before)) for k in range(6)]
    result = measured(rows)
    assert "stale_frame" in alarms(result)
    covers(result, emva__dark_current_mean_e_per_s=40.0, **RIGHT)


def test_flats_of_another_temperature_than_their_dark_frames():
    rows = [(k, 10.0, 20.0 if k == "flat" else -10.0, p, f) for k, _, _, p, f in taken(21)]
    assert {"prnu.pixel", "quantum_efficiency"} <= set(spoiled(measured(rows), "dark_temperature"))


def test_photons_per_area_are_said():
    rows = [(k, t, c, p and p / 1.2e-7, f) for k, t, c, p, f in taken(22)]
    assert "quantum_efficiency" in spoiled(measured(rows), "photons_implausible")


@pytest.mark.parametrize(("told", "word"), [("GRBG", True), ("RGGB", False)])
def test_a_pattern_that_the_flats_contradict(told, word):
    light = np.tile([[0.5, 1.0], [1.0, 0.7]], (SHAPE[0] // 2, SHAPE[1] // 2))
    assert ("mosaic_contradicted" in alarms(measured(taken(23, light=light), bayer=told))) == word


@pytest.mark.parametrize(("level", "warned"), [(1.0, True), (4.0, False)])
def test_fits_compressed_with_coarse_steps(tmp_path, level, warned):
    """Rounding at the noise adds a twelfth to the variance, at a quarter of it 0.5 %."""
    from astropy.io import fits

    for i, (kind, t, _, _, frame) in enumerate(taken(24, (300, 1000))):
        header = fits.Header([("IMAGETYP", kind), ("EXPTIME", t)])
        image = fits.CompImageHDU(
            frame.astype(np.float32), header, compression_type="RICE_1", quantize_level=level
        )
        image.writeto(tmp_path / f"{i:02d}.fits.fz")
    assert ("lossy_frames" in alarms(characterize(FrameSet.load(tmp_path)))) == warned


def test_the_first_line_says_what_the_frames_show(tmp_path, capsys):
    rows = taken(25, change=lambda dn, kind, rng: dn + rng.normal(0, 6, (SHAPE[0], 1)))
    frame_set(rows).save(tmp_path / "frames")
    page, camera = tmp_path / "r.html", tmp_path / "camera.yaml"
    main(["characterize", str(tmp_path / "frames"), "-o", str(camera), "--report", str(page)])
    first = capsys.readouterr().out.lstrip().splitlines()[0]
    assert re.match(r"This camera also has row noise, \S+ \[\S+, \S+\] e-: ", first)
    assert "written to " in first
    assert "written to camera.yaml" in page.read_text()


def test_those_who_compare_hear_the_same_alarms():
    frames = frame_set(taken(26, change=lambda dn, *_: ndimage.gaussian_filter(dn, 0.6)))
    assert [w.split(":")[0] for w in all_warnings(frames)].count("correlated_noise") == 1
    assert not frames.warnings


def test_python_users_hear_them_too():
    """`visaug.compare` itself warns; wrong code leaves it to the command."""
    frames = frame_set(taken(26, change=lambda dn, *_: ndimage.gaussian_filter(dn, 0.6)))
    camera = Camera.load({"resolution": list(SHAPE), "gain_e_per_dn": 0.4, "black_level_dn": 100})
    lab = Laboratory(frames, camera)
    assert any(w.startswith("correlated_noise:") for w in lab.warnings)


def test_full_flats_are_neither_stuck_nor_hit():
    """Flats beyond the converter's top, of which some have most pixels full: no pixel is stuck, none is hit. No chance is in
    it: nothing else reaches the top.
    """
    rows = taken(27)
    rng = np.random.default_rng(27)
    for mean, n in ((4096, 2), (5200, 2), (6000, 2)):
        rows += [
            ("flat", 0.01, 20.0, mean * GAIN / 0.6, np.clip(rng.normal(mean, 40, SHAPE).round(), 0, 4095))
            for _ in range(n)
        ]
    assert not alarms(measured(rows)) & {"stuck_pixels", "cosmic_rays"}


def dark_ladder(seed, rate, steps):
    """Dark frames of (degC, s), four of each, after flats; `rate` gives e-/s at a temperature."""
    rng = np.random.default_rng(seed)
    rows = taken(seed)
    for celsius, exposure in steps:
        e = rng.poisson(rate(celsius) * exposure, (4, *SHAPE)) + rng.normal(0, READ, (4, *SHAPE))
        rows += [("dark", exposure, celsius, None, np.rint(BLACK + frame / GAIN)) for frame in e]
    return [r for r in rows if r[0] != "bias"]


@pytest.mark.parametrize(("leak", "named"), [(0.0, False), (5.0, True)])
def test_a_light_leak_flattens_the_law_of_dark_current(leak, named):
    """20 e-/s that double every 7 degrees, with light of 5 e-/s. Fixed seed; b is known to 1 %, and 40 % apart."""
    result = measured(dark_ladder(28, lambda c: 20 * 2 ** ((c - 20) / 7) + leak,
                                  [(t, s) for t in (20.0, 0.0) for s in (0.1, 2.0, 8.0)]))  # fmt: skip
    spoils = [s for w in result.warning_details if w.word == "dark_current_flat" for s in w.spoils]
    assert ("dark_current.b_per_c" in spoils) == named
    assert ("emva.dark_current_mean_e_per_s" in spoils) == named


def test_compare_and_diagnose_hear_of_a_light_leak():
    rows = dark_ladder(
        28, lambda c: 20 * 2 ** ((c - 20) / 7) + 5, [(t, s) for t in (20.0, 0.0) for s in (0.1, 2.0, 8.0)]
    )
    assert "dark_current_flat" in {w.split(":")[0] for w in all_warnings(frame_set(rows))}


def test_two_settings_of_dark_frames_tell_no_law():
    """Black level, rate and its course are three unknowns: two temperatures of one exposure each leave the law open."""
    result = measured(dark_ladder(29, lambda c: 20 * 2 ** ((c - 20) / 7), [(20.0, 8.0), (0.0, 2.0)]))
    assert {"dark_current.a_e_per_s", "dark_current.b_per_c"} <= set(result.not_determined)


def test_averaged_flats_beside_raw_dark_frames_spoil_the_gain():
    """Averages of two have half the variance; the intercept tells them from raw ones at 10 standard errors."""
    rows, more = taken(47), taken(48)
    rows = [a if a[0] == "bias" else (*a[:4], (a[4] + b[4]) // 2) for a, b in zip(rows, more)]
    assert {"gain_e_per_dn", "read_noise.sigma_e"} <= set(spoiled(measured(rows), "flat_pedestal"))


def test_the_heaviest_tail_of_quiet_dark_frames_counts():
    """Dips of 8 and 20 standard deviations in groups of one noise: hits exceed three times the larger. Dips of noisy dark
    frames do not count, and 2 standard deviations are no tail.
    """

    def group(dip, noise=10.0):
        empty = np.zeros(SHAPE, np.float32)
        return _Peaks(empty, empty, empty, dip, noise, False), 4

    assert _tail([group(80.0), group(200.0, 10.5), group(900.0, 20.0)]) == 600.0
    assert _tail([group(20.0)]) == _tail([]) == 0.0


def test_stated_rates():
    """At most one sound set in a hundred for each check."""
    assert all(0 < check.false_alarms <= 0.01 for check in CHECKS)
    assert len(ALARMS) == sum(len(check.words) for check in CHECKS)


@pytest.mark.parametrize("whole", [True, False])
def test_one_pass_tells_levels_and_the_greatest_and_least_values_of_every_pixel(whole):
    """Against a sort of all frames; 35 pixels have one in the middle, 36 have two."""
    rng = np.random.default_rng(3)
    for shape in ((5, 7), (6, 6)):
        pixels = rng.integers(0, 9, (6, *shape)).astype(np.float32) + (0.0 if whole else 0.25)
        records = [
            FrameRecord(sequence=k, file=str(k), kind="flat", exposure_s=0.1, temperature_c=20.0)
            for k in range(6)
        ]
        frames = FrameSet.from_arrays(records, pixels)
        (group,) = frames.groups()
        seen = extremes(frames, look(frames), [group])
        assert seen is not None
        assert seen.levels[0].median == np.median([np.median(frame) for frame in pixels])
        if whole:
            bits = pixels.astype(int)
            moving = np.bitwise_or.reduce(bits, (0, 2)) & ~np.bitwise_and.reduce(bits, (0, 2))
            np.testing.assert_array_equal(seen.row_bits, moving)
        peaks = _peaks(frames, group)
        level = np.median(pixels[0])
        moved = np.array([frame + level - np.median(frame) for frame in pixels])
        ranked = np.sort(moved, 0)
        np.testing.assert_array_equal(peaks.first, ranked[-1])
        np.testing.assert_array_equal(peaks.second, ranked[-2])
        np.testing.assert_array_equal(
            np.take_along_axis(moved, peaks.frame[None].astype(int), 0)[0], ranked[-1]
        )
        assert peaks.dip == (ranked[1] - ranked[0]).max()


def test_the_greens_of_a_saturated_flat_are_no_stuck_pixels():
    """Half of the pixels are at the converter's top, far from the median of the frame."""
    light = np.tile([[0.5, 1.0], [1.0, 0.7]], (SHAPE[0] // 2, SHAPE[1] // 2))
    rows = taken(41, light=light, levels=(100, 300, 600, 1000, 1400, 1700))
    assert (np.asarray(rows[-1][-1]) == 4095).mean() > 0.4
    result = measured(rows, bayer="RGGB")
    assert "stuck_pixels" not in alarms(result)
    covers(result, gain_e_per_dn=GAIN)


PHOTON_MISTAKES = {
    "none": lambda photons: photons,
    "two levels exchanged": lambda photons: photons[[0, 3, 2, 1, 4]],
    "one level ten times": lambda photons: photons * np.array([1, 1, 10, 1, 1]),
    "a copied cell": lambda photons: photons[[0, 1, 2, 2, 4]],
}


@pytest.mark.parametrize("mistake", PHOTON_MISTAKES)
def test_photons_that_contradict_the_signals_are_said(mistake):
    """No warning where they agree. An efficiency is never below 0."""
    right = np.array(LEVELS) / 0.6
    stated = dict(zip(right.tolist(), PHOTON_MISTAKES[mistake](right).tolist(), strict=True))
    result = measured([(k, t, c, p and stated[p], f) for k, t, c, p, f in taken(42)])
    if mistake == "none":
        assert "photons_contradicted" not in alarms(result)
    else:
        spoils = spoiled(result, "photons_contradicted")
        assert {"quantum_efficiency", "emva.quantum_efficiency"} <= set(spoils)
    assert result["quantum_efficiency"].low >= 0


@pytest.mark.parametrize(("hits", "spoils"), [(1, False), (8, True)])
def test_many_cosmic_rays_spoil_figures_from_the_noise(hits, spoils):
    """Of 8 hits in each of 30 frames 0.12 % of the values are left out, and faint ends of as many are not."""

    def strike(dn, kind, rng):
        at = tuple(rng.integers(0, n, hits) for n in SHAPE)
        dn[at] += rng.exponential(600, hits) + 200
        return dn

    result = measured(taken(43, change=strike))
    assert ("gain_e_per_dn" in spoiled(result, "cosmic_rays")) is spoils
