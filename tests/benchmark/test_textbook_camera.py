"""The textbook camera follows photon transfer, its noises have the moments of theory, its effects their laws.

Seeds are fixed. Unless it says otherwise a test allows four standard errors of what it estimates, so right code would
fail it at six seeds in a hundred thousand.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from benchmark import commands, judge
from benchmark.camera import Shot
from benchmark.textbook import chain, draws, sets
from benchmark.textbook.cameras import CAMERAS, plan
from benchmark.textbook.effect import Moment
from benchmark.textbook.targets import targets

CAMERA = CAMERAS[4]  # the smallest
EVEN = replace(CAMERA, prnu=(0.0, 0.0, 0.0), dsnu_e=(0.0, 0.0, 0.0), dark_e_per_s=0.0)
EVERY = {**chain.LIGHT, **chain.SENSOR}
SHOTS = {
    "bias": Shot("bias", 1e-5, CAMERA.celsius),
    "dark": Shot("dark", CAMERA.dark_s[-1], CAMERA.dark_c[-1]),
    "flat": Shot(
        "flat", CAMERA.integration_s, CAMERA.celsius, photons=0.7 * CAMERA.well_e / CAMERA.efficiency
    ),
    "spot": Shot("scene", CAMERA.integration_s, CAMERA.celsius, target="spot"),
}


def made(name: str, frames: int = 70, camera=EVEN, **numbers):
    """An effect of given numbers, in a specimen drawn with seed 3."""
    return EVERY[name](numbers, camera, np.random.default_rng(3), frames)


def at(shot: str = "flat", index: int = 0, charge_e: np.ndarray | None = None) -> Moment:
    return Moment(index, SHOTS[shot], np.zeros(CAMERA.shape) if charge_e is None else charge_e)


def test_photon_transfer():
    """Var = (mean - pedestal) / K + (read / K)^2 + 1/12 in DN, K in e-/DN (EMVA 1288, linear model): slope and intercept."""
    levels_e = np.array([0.01, 0.1, 0.3, 0.6, 0.9]) * EVEN.well_e
    shots = [replace(SHOTS["flat"], photons=level / EVEN.efficiency) for level in levels_e for _ in range(2)]
    frames = chain.take(EVEN, shots, {}, {}, np.random.default_rng(7)).astype(float)
    a, b = frames[::2], frames[1::2]
    means = (a + b).mean((1, 2)) / 2 - EVEN.pedestal_dn
    variances = (a - b).var((1, 2)) / 2
    expected = (levels_e + EVEN.read_e**2) / EVEN.e_per_dn**2 + 1 / 12
    assert np.all(np.abs(means - levels_e / EVEN.e_per_dn) < 4 * np.sqrt(expected / (2 * a[0].size)))
    errors = expected * np.sqrt(2 / a[0].size)
    (slope, intercept), covariance = np.polyfit(means, variances, 1, w=1 / errors, cov="unscaled")
    assert slope == pytest.approx(1 / EVEN.e_per_dn, abs=4 * np.sqrt(covariance[0, 0]))
    floor = (EVEN.read_e / EVEN.e_per_dn) ** 2 + 1 / 12
    assert intercept == pytest.approx(floor, abs=4 * np.sqrt(covariance[1, 1]))


@pytest.mark.parametrize("number", [0, 3, 4])
def test_bias_frames_have_the_variance_of_read_noise_and_rounding(number):
    camera = replace(CAMERAS[number], prnu=(0.0, 0.0, 0.0), dsnu_e=(0.0, 0.0, 0.0))
    frames = chain.take(camera, [plan(camera)[0]] * 8, {}, {}, np.random.default_rng(5)).astype(float)
    kurtosis = float(stats.tukeylambda.stats(camera.tail, moments="k")) + 3
    expected = (camera.read_e / camera.e_per_dn) ** 2 + 1 / 12
    error = expected * np.sqrt((kurtosis - 1) / frames.size)
    assert frames.var() == pytest.approx(expected, abs=4 * error)


def test_dark_frames_have_the_mean_of_a_exp_bT_t():
    shot = SHOTS["dark"]
    camera = replace(EVEN, dark_e_per_s=CAMERA.dark_e_per_s)
    dark = chain.take(camera, [shot] * 4, {}, {}, np.random.default_rng(6))
    expected = CAMERA.dark_e_per_s * np.exp(CAMERA.dark_per_c * shot.celsius) * shot.seconds
    error = np.sqrt((expected + CAMERA.read_e**2) / dark.size)
    assert (dark.mean() - CAMERA.pedestal_dn) * CAMERA.e_per_dn == pytest.approx(expected, abs=4 * error)


def test_catalogue_is_complete_and_every_effect_has_numbers_and_a_place():
    from visaug.effects import catalogue

    assert len(draws.CATALOGUED) == 29
    assert set(draws.CATALOGUED) <= set(catalogue())
    assert not set(draws.UNKNOWN) & set(catalogue())
    assert set(EVERY) == {*draws.CATALOGUED, *draws.UNKNOWN}
    assert set(sets.LOOKS) == set(draws.UNKNOWN)


@pytest.mark.parametrize("name", EVERY)
def test_effect_changes_what_it_is_given_and_a_seed_gives_the_same_frames(name):
    """Nothing but the effect may change: its own methods, on arrays that it would meet. Frames of a seed repeat."""
    numbers = draws.numbers_of(name, CAMERA, np.random.default_rng(2))
    scenes = targets(CAMERA, np.random.default_rng(2))
    effect = EVERY[name](numbers, CAMERA, np.random.default_rng(3), 70)
    charge = np.random.default_rng(4).poisson(0.5 * CAMERA.efficiency * scenes["spot"] + 50).astype(float)
    whole = np.arange(charge.size).reshape(charge.shape) * 5 % 65536
    places = ("light", "photo", "dark", "expected", "collected", "voltage", "amplified")
    given: dict[str, np.ndarray] = dict.fromkeys(places, charge)
    given |= {"well": np.minimum(charge, CAMERA.well_e), "converter": whole + 0.25, "code": whole}
    changed = []
    for index in range(3):
        for place, x in given.items():
            kept = x.copy()
            out = getattr(effect, place)(x.copy(), Moment(index, SHOTS["dark"], charge))
            assert out.shape == x.shape
            assert np.isfinite(out).all()
            changed.append(not np.array_equal(out, kept))
    assert any(changed)

    short = list(SHOTS.values())
    first, again = (
        chain.take(CAMERA, short, scenes, {name: numbers}, np.random.default_rng(8)) for _ in range(2)
    )
    assert first.dtype == np.uint16
    assert np.array_equal(first, again)


@pytest.mark.parametrize("law", ["cos4", "poly"])
def test_vignetting_loses_its_share_in_the_corner(law):
    light = made("vignetting", corner_loss=0.15, law=law, centre=[0.0, 0.0]).light(np.ones(EVEN.shape), at())
    assert light[0, 0] == pytest.approx(0.85)
    assert light[EVEN.rows // 2, EVEN.columns // 2] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("law", ["exponential", "lorentz"])
def test_glare_keeps_the_light_of_a_flat(law):
    effect = made("veiling_glare", share=0.05, scale_px=20, law=law)
    assert effect.light(np.full(EVEN.shape, 100.0), at()) == pytest.approx(100.0)


def test_row_noise_has_its_variance_along_rows_only():
    """Chi square of 4800 rows; right code fails at one seed in ten thousand."""
    effect = made("row_noise", sigma_e=2.0)
    stack = np.array([effect.voltage(np.zeros(EVEN.shape), at()) for _ in range(50)])
    assert np.ptp(stack, axis=2).max() == 0
    rows = stack[:, :, 0]
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], rows.size) / rows.size * 4.0
    assert low < (rows**2).mean() < high


def test_clock_induced_charge_has_its_mean():
    bias = [SHOTS["bias"]] * 10
    frames = chain.take(EVEN, bias, {}, {"clock_induced_charge": {"mean_e": 4.0}}, np.random.default_rng(2))
    error = np.sqrt((4.0 + EVEN.read_e**2) / frames.size)
    assert (frames.mean() - EVEN.pedestal_dn) * EVEN.e_per_dn == pytest.approx(4.0, abs=4 * error)


def test_lag_gives_back_what_it_caught():
    """Of 7.4e5 electrons caught, each Poisson draw of the release adds its own scatter, and so does the capture's."""
    effect = made("image_lag", share=0.01, slow=0.2, release_fast=0.9, release_slow=0.3)
    full, empty = np.full(EVEN.shape, 6000.0), np.zeros(EVEN.shape)
    caught = (full - effect.well(effect.collected(full, at()), at())).sum()
    assert caught == pytest.approx(0.01 * full.sum(), abs=4 * np.sqrt(0.01 * full.sum()))
    given = sum(effect.collected(empty, at()).sum() for _ in range(40))
    assert given == pytest.approx(caught, abs=4 * np.sqrt(caught))


def test_moving_charge_makes_none():
    charge = np.full(EVEN.shape, 100.0)
    charge[40:44, 60:64] = 3 * EVEN.well_e
    effect = made("brighter_fatter", variance_loss_at_80pct=0.1, v_over_h=1.3)
    assert effect.collected(charge, at()).sum() == pytest.approx(charge.sum(), rel=1e-9)
    bloomed = made("blooming", drained=0.0, up=0.4).collected(charge, at())
    assert bloomed.sum() == pytest.approx(charge.sum(), rel=1e-9)
    assert bloomed.max() <= EVEN.well_e
    coupled = made("interpixel_crosstalk", h=0.01, v=0.008, d=0.001).well(charge, at())
    assert coupled.sum() == pytest.approx(charge.sum(), rel=1e-9)


def test_brighter_fatter_takes_its_share_of_a_flats_variance():
    """The same 25 flats before and after know the share to 2e-4; beyond first order, and at the borders, it is 5 % of it less."""
    effect = made("brighter_fatter", variance_loss_at_80pct=0.1, v_over_h=1.3)
    flats = np.random.default_rng(9).poisson(0.8 * EVEN.well_e, (25, *EVEN.shape)).astype(float)
    moved = np.array([effect.collected(flat, at()) for flat in flats])
    assert 1 - moved.var() / flats.var() == pytest.approx(0.1, rel=0.1)


def test_codes_go_missing_and_bits_are_cut():
    """The share of 65536 scattered codes has a standard error of 7e-4."""
    code = np.arange(2**EVEN.bits)
    scatter = made("missing_codes", law="scatter", fraction=0.035, key=5).code(code, at())
    assert np.mean(scatter != code) == pytest.approx(0.035, abs=4 * 7.2e-4)
    carries = made("missing_codes", law="sar", fraction=1 / 32, key=5).code(code, at())
    assert np.array_equal(np.flatnonzero(carries != code), code[31:-1:32])
    assert np.array_equal(np.unique(made("bit_truncation", bits=2).code(code, at())), code[::4])


def test_an_echo_repeats_the_signal_and_a_droop_follows_the_rows():
    charge = np.zeros(EVEN.shape)
    charge[30, 40] = 1000.0
    echo = made("own_video_echo", share=-0.01, delay_px=7).voltage(charge, at(charge_e=charge)) - charge
    assert echo[30, 47] == pytest.approx(-10.0)
    assert np.count_nonzero(echo) == 1
    lit = np.zeros(EVEN.shape)
    lit[30] = 1000.0
    droop = made("own_row_droop", k=0.01, recover_rows=2.0).voltage(np.zeros(EVEN.shape), at(charge_e=lit))
    assert np.all(droop[:30] == 0)
    assert droop[32, 0] / droop[30, 0] == pytest.approx(np.exp(-1))
    assert droop[:, 0].sum() == pytest.approx(-10.0)


def test_recipes_ask_for_each_effect_once_and_for_a_pair():
    recipes = list(sets.recipes(5, 2))
    assert len({recipe.identity for recipe in recipes}) == len(recipes) == 1 + 29 + 1 + 6
    expected = [recipe.expect for recipe in recipes if recipe.kind == "textbook"]
    assert sorted(map(len, expected)) == [0, *[1] * 29, 2]
    assert {recipe.expect[0] for recipe in recipes if recipe.kind == "foreign"} == set(draws.UNKNOWN)


def test_sets_are_written_for_one_of_five_cameras_and_judged(tmp_path):
    assert commands.PEERS["textbook"] is sets
    wanted = {"own_adc_step"}
    assert sets.write_sets(11, 7, wanted, tmp_path / "sets", tmp_path / "sets_answers") == 1
    frames = np.load(tmp_path / "sets" / "textbook-own_adc_step-11" / "frames.npz")["frames"]
    assert frames.shape == (len(plan(CAMERAS[2])), *CAMERAS[2].shape)
    written = tmp_path / "sets" / "textbook-own_adc_step-11"
    assert "own_" not in (written / "camera.yaml").read_text() + (written / "frames.csv").read_text()
    answer = json.loads((tmp_path / "sets_answers" / "textbook-own_adc_step-11.json").read_text())
    assert "step_dn=" in answer["hidden"][0][2]

    def verdict(accepted, axis=None, grows=("signal",)):
        unexplained = axis and {"axis": list(axis), "grows_with": list(grows)}
        result = {"diagnosis": {"accepted": accepted, "unexplained": unexplained, "error": {"after": 0.5}}}
        judged = judge.verdict(answer, result)
        return judged["right"], judged["wrong"]

    assert verdict([], ("level", "time")) == (True, False)
    assert verdict([], ("row",)) == (False, False)
    assert verdict([], ("level",), ()) == (False, False)
    assert verdict(["nonlinearity"]) == (False, True)
