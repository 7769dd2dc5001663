"""The independent camera obeys photon transfer, has the moments of theory, and its effects do what they say.

Tolerances are at least four standard errors of the estimate at hand; seeds are fixed.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from benchmark import cameras, effects, foreign, further
from benchmark.camera import Moment, Sensor, Shot, take
from benchmark.randomness import coloured, stream, tukey_lambda, tukey_lambda_std

LISTED = (*effects.KINDS, *further.KINDS)
EVERY = [(kind, form) for kind in LISTED for form in ("default", kind.other_form) if form]
EVERY += [(kind, "default") for kind in foreign.KINDS]
NAMES = [f"{kind.name}, {form}" for kind, form in EVERY]

PLAIN = Sensor(
    name="test", rows=64, columns=80, bits=14, efficiency=0.6, e_per_dn=0.8, pedestal_dn=100.0,
    well_e=11000.0, integration_s=0.01, celsius=20.0, read_e=3.0, tail=-0.1, dark_e_per_s=0.2, dark_per_c=0.1,
    prnu=(0.0, 0.0, 0.0), dsnu_e=(0.0, 0.0, 0.0),
)  # fmt: skip


def moment(
    name: str, form: str = "default", shot: Shot | None = None, sensor: Sensor = PLAIN, memory=None
) -> Moment:
    shot = shot or Shot("flat", sensor.integration_s, sensor.celsius, photons=1000)
    return Moment(
        sensor,
        shot,
        3,
        form,
        5,
        name,
        {} if memory is None else memory,
        sensor.thermal_e(shot.seconds, shot.celsius),
    )


def flats(sensor: Sensor, photons: float, count: int, seed: int = 1, hidden=()) -> np.ndarray:
    shot = Shot("flat", sensor.integration_s, sensor.celsius, photons=photons)
    return take(sensor, [shot] * count, {}, seed, hidden).astype(float)


@pytest.mark.parametrize("lam", [-0.23, -0.1, 0.0, 0.14])
def test_tukey_lambda_is_scipys(lam):
    draw = tukey_lambda(np.random.default_rng(1), lam, 2.0, (40_000,))
    scale = 2.0 / stats.tukeylambda.std(lam)
    assert tukey_lambda_std(lam) == pytest.approx(stats.tukeylambda.std(lam), rel=1e-6)
    assert stats.kstest(draw, stats.tukeylambda(lam, scale=scale).cdf).pvalue > 1e-3


def test_photon_transfer():
    """Var = gain * (mean - pedestal) + read^2 + 1/12 in DN (EMVA 1288, release 4, eq. 9)."""
    means, variances = [], []
    for photons in (100, 400, 1600, 6400, 12800):
        a, b = flats(PLAIN, photons, 2)
        means.append((a.mean() + b.mean()) / 2)
        variances.append((a - b).var() / 2)
    slope, intercept = np.polyfit(
        np.array(means) - PLAIN.pedestal_dn, variances, 1, w=1 / np.array(variances)
    )
    assert slope == pytest.approx(1 / PLAIN.e_per_dn, rel=0.04)
    assert intercept == pytest.approx((PLAIN.read_e / PLAIN.e_per_dn) ** 2 + 1 / 12, abs=6)
    expected = PLAIN.efficiency * 12800 / PLAIN.e_per_dn + PLAIN.pedestal_dn
    assert means[-1] == pytest.approx(expected, abs=4 * np.sqrt(variances[-1] / (2 * 64 * 80)) + 0.1)


def test_dark_current_doubles_and_grows_with_time():
    sensor = replace(PLAIN, dark_e_per_s=2.0)
    shots = [Shot("dark", seconds, celsius) for seconds, celsius in ((10, 20), (20, 20), (10, 27))]
    signal = (take(sensor, shots, {}, 3).mean((1, 2)) - sensor.pedestal_dn) * sensor.e_per_dn
    expected = np.array([20, 40, 20 * np.exp(0.7)]) * np.exp(2.0)
    assert signal == pytest.approx(expected, abs=4 * np.sqrt((expected[1] + 9) / 5120))


def test_fixed_patterns_have_their_sizes():
    sensor = replace(PLAIN, prnu=(0.0, 0.0, 0.02), dsnu_e=(0.0, 4.0, 0.0), rows=400)
    image = flats(sensor, 5000, 30).mean(0) * sensor.e_per_dn
    pixels = image - image.mean(1, keepdims=True) - image.mean(0, keepdims=True)
    noise = (3000 + sensor.read_e**2) / 30
    assert pixels.var() - noise == pytest.approx((0.02 * 3000) ** 2, rel=0.05)
    bias = take(sensor, [Shot("bias", 1e-5, 20)] * 8, {}, 1).mean((0, 2)) * sensor.e_per_dn
    assert bias.std() == pytest.approx(4.0, rel=0.15)


def test_well_clips_charge_and_converter_clips_codes():
    top = PLAIN.well_e / PLAIN.e_per_dn + PLAIN.pedestal_dn
    assert flats(PLAIN, 40_000, 1).mean() == pytest.approx(top, abs=1)
    small = replace(PLAIN, bits=12)
    assert flats(small, 40_000, 1).min() == 4095


def test_coloured_noise_has_its_slope_and_size():
    power = np.mean([np.abs(np.fft.rfft(coloured(stream(1, i), 4096, 1.0))) ** 2 for i in range(60)], axis=0)[
        1:-1
    ]
    slope = np.polyfit(np.log(np.arange(1, power.size + 1)), np.log(power), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.05)
    size = np.mean([coloured(stream(2, i), 4096, 1.0).var() for i in range(60)])
    assert size == pytest.approx(1.0, rel=0.2)


@pytest.fixture(scope="module")
def small():
    """A short plan on the smallest camera: one shot of everything that an effect could need."""
    number = 2
    sensor = cameras.sensor(number)
    plan = [Shot("bias", 1e-5, 20)] * 3 + [Shot("dark", 3.0, 34)] * 2
    plan += [Shot("flat", sensor.integration_s, 20, photons=0.7 * sensor.well_e / sensor.efficiency)] * 2
    for target in ("chart", "spot"):
        plan += [
            Shot("scene", sensor.integration_s, 20, target=target),
            Shot("dark", sensor.integration_s, 20),
        ]
    targets = cameras.targets(number)
    return sensor, plan, targets, take(sensor, plan, targets, 8)


@pytest.mark.parametrize(("kind", "form"), EVERY, ids=NAMES)
def test_zero_strength_is_identity_and_start_strength_is_not(small, kind, form):
    sensor, plan, targets, base = small
    assert np.array_equal(take(sensor, plan, targets, 8, [kind.at(0.0, form)]), base)
    strength = min(kind.start * 4, kind.largest)
    changed = take(sensor, plan, targets, 8, [kind.at(strength, form)])
    assert not np.array_equal(changed, base)
    assert np.array_equal(changed, take(sensor, plan, targets, 8, [kind.at(strength, form)]))


@pytest.mark.parametrize("kind", [k for k in LISTED if k.other_form], ids=lambda kind: kind.name)
def test_forms_differ(small, kind):
    sensor, plan, targets, _ = small
    strength = min(kind.start * 4, kind.largest)
    one, other = (
        take(sensor, plan, targets, 8, [kind.at(strength, f)]) for f in ("default", kind.other_form)
    )
    assert not np.array_equal(one, other)


def test_vignetting_loses_its_share_in_the_corner():
    loss = effects.BY_NAME["vignetting"].act(np.full((64, 80), 1000.0), 0.3, moment("vignetting"))
    assert loss.min() == pytest.approx(700, rel=0.03)
    assert loss.max() == pytest.approx(1000, rel=0.01)


@pytest.mark.parametrize("form", ["default", "exponential"])
def test_point_spread_has_its_width_and_keeps_the_light(form):
    light = np.zeros((65, 81))
    light[32, 40] = 1000.0
    act = effects.BY_NAME["point_spread"].act
    spread = act(light, 1.2, moment("point_spread", form, Shot("scene", 0.01, 20, target="x")))
    assert spread.sum() == pytest.approx(1000, rel=1e-3)
    variance = (spread.sum(0) * (np.arange(81) - 40) ** 2).sum() / spread.sum()
    assert variance == pytest.approx(1.2**2 + (1 / 12 if form == "default" else 0), rel=0.12)


@pytest.mark.parametrize("form", ["default", "slow traps"])
def test_lag_delays_charge_and_loses_none(form):
    memory: dict = {}
    act = effects.BY_NAME["image_lag"].act
    frames = [np.full((64, 80), 5000.0)] + [np.zeros((64, 80))] * 40
    out = [act(frame, 0.02, moment("image_lag", form, memory=memory)) for frame in frames]
    assert np.sum(out) == pytest.approx(5000 * 64 * 80, rel=1e-9)
    assert out[0].mean() == pytest.approx(4900, abs=1)


@pytest.mark.parametrize("name", ["interpixel_crosstalk", "brighter_fatter", "charge_transfer_inefficiency"])
@pytest.mark.parametrize("other", [False, True])
def test_sharing_moves_charge_and_makes_none(name, other):
    kind = effects.BY_NAME[name]
    charge = np.zeros((64, 80))
    charge[30:34, 30:34] = 8000.0
    act = kind.act(charge, kind.start, moment(name, kind.other_form if other else "default"))
    assert act.sum() == pytest.approx(charge.sum(), rel=1e-6)  # a trail's far end leaves the frame
    assert 0 < np.abs(act - charge).sum() < charge.sum()


def test_brighter_fatter_correlates_neighbours_in_proportion_to_the_level():
    kind = effects.BY_NAME["brighter_fatter"]
    found = []
    for photons in (2000, 12000):
        stack = flats(PLAIN, photons, 16, hidden=[kind.at(0.02)])
        noise = stack - stack.mean(0)
        noise -= noise.mean((1, 2), keepdims=True)
        found.append((noise[:, :, 1:] * noise[:, :, :-1]).mean() / noise.var())
    # a pixel gives k = 2 strength q / well of a surplus to each neighbour; the read noise is not shared
    charge = 0.6 * np.array([2000, 12000])
    k = 2 * 0.02 * charge / PLAIN.well_e
    expected = 2 * k / (1 - 8 * k) * charge / (charge + PLAIN.read_e**2)
    assert found == pytest.approx(expected, abs=4 / np.sqrt(stack.size))


def test_blooming_keeps_all_the_charge_when_none_is_drained():
    charge = np.full((64, 80), 100.0)
    charge[20:23, 30] = 60_000.0
    out = effects.BY_NAME["blooming"].act(charge, 1.0, moment("blooming"))
    assert out.sum() == pytest.approx(charge.sum(), rel=1e-9)
    assert out.max() <= PLAIN.well_e
    assert np.array_equal(np.flatnonzero((out != charge).any(0)), [30])


def test_smear_is_the_same_at_any_distance_and_worse_for_short_exposures():
    mean = np.zeros((64, 80))
    mean[10, 20] = 6400.0
    act = effects.BY_NAME["smear"].act
    added = [
        act(mean, 0.01, moment("smear", shot=Shot("scene", t, 20, target="x"))) - mean for t in (0.01, 0.02)
    ]
    thermal = PLAIN.thermal_e(0.01, 20)
    assert added[0][:, 20] == pytest.approx(1.0, abs=0.01 * thermal + 0.01)
    assert added[1][40, 20] == pytest.approx(0.5, abs=0.02)


def test_line_noise_has_its_size_along_its_line_only():
    rows = [
        effects.BY_NAME["row_noise"].act(np.zeros((4000, 6)), 2.0, moment("row_noise", form))
        for form in ("default", "Laplace")
    ]
    for image in rows:
        assert image.std() == pytest.approx(2.0, rel=0.06)
        assert np.ptp(image, axis=1).max() == 0


def test_clock_induced_charge_is_poisson():
    kind = effects.BY_NAME["clock_induced_charge"]
    shots = [Shot("bias", 1e-5, 20)] * 10
    signal = take(replace(PLAIN, e_per_dn=0.1, bits=16), shots, {}, 2, [kind.at(5.0)]) * 0.1 - 10.0
    assert signal.mean() == pytest.approx(5.0, abs=4 * np.sqrt(14 / signal.size))
    assert signal.var() == pytest.approx(5.0 + 9.0, rel=0.03)


def test_truncation_and_missing_codes():
    codes = np.arange(4096.0).reshape(64, 64)
    cut = effects.BY_NAME["bit_truncation"].act(codes, 2, moment("bit_truncation"))
    assert np.array_equal(np.unique(cut), np.arange(0, 4096, 4))
    gone = effects.BY_NAME["missing_codes"].act(codes, 0.1, moment("missing_codes"))
    assert 1 - np.unique(gone).size / 4096 == pytest.approx(0.1, abs=0.02)


def test_catalogue_names_and_order():
    assert len(effects.KINDS) == 29
    pair = [effects.BY_NAME["row_noise"].at(1.0), effects.BY_NAME["vignetting"].at(0.1)]
    assert [effect.name for effect in effects.in_order(pair)] == ["vignetting", "row_noise"]


def further_act(name, image, strength, form="default", **given):
    kind = next(kind for kind in further.KINDS if kind.name == name)
    return kind.act(image, strength, moment(name, form, **given))


def test_widths_of_codes_have_their_size_and_keep_the_gain():
    """A ramp of ten values a code: shares of the codes are widths; 4 standard errors of 3000 of them are 5 %."""
    ramp = (np.arange(200_000) / 40 + 0.0125)[None]
    found = further_act("code_widths", ramp, 0.3)
    assert np.array_equal(found, np.sort(found))
    widths = np.bincount(found[0].astype(int))[1:4500] / 40
    assert widths.mean() == pytest.approx(1, abs=1e-3)
    assert widths.std() == pytest.approx(
        0.3, rel=0.07
    )  # a threshold reaches 0.49 at most, which takes a little off
    even = np.bincount(further_act("code_widths", ramp, 0.3, "even and odd")[0].astype(int))[1:4500] / 40
    assert abs(even[::2].mean() - even[1::2].mean()) == pytest.approx(0.6, abs=0.05)


def test_further_noise_has_its_size():
    rows = further_act("correlated_row_noise", np.zeros((40_000, 2)), 2.0, "autoregression")
    assert rows.std() == pytest.approx(2.0, rel=0.1)
    assert (rows[1:] * rows[:-1]).mean() / rows.var() == pytest.approx(0.9, abs=0.02)
    for form in ("default", "few"):
        own = further_act("read_noise_nonuniformity", np.zeros((400, 500)), 2.0, form)
        assert own.var() == pytest.approx(4.0, rel=0.06)
    channels = further_act("column_parity", np.zeros((4, 400)), 3.0)
    assert channels.std() == pytest.approx(3.0, rel=0.01)
    bright = further_act("dual_gain", np.full((300, 300), 100 + 5000 / 0.8), 20.0)
    assert bright.std() * 0.8 == pytest.approx(20.0, rel=0.02)


def test_parasitic_light_is_a_ramp_that_short_exposures_show_more():
    lit = 1000.0
    for seconds in (0.01, 0.02):
        shot = Shot("flat", seconds, 20, photons=1000)
        mean = np.full((64, 8), lit + PLAIN.thermal_e(seconds, 20))
        more = further_act("parasitic_light", mean, 0.02, shot=shot) - mean
        assert more[0, 0] == 0
        assert more[-1, 0] == pytest.approx(0.02 * lit * 0.01 / seconds)


def test_a_glow_falls_with_the_distance_from_the_corner_of_the_frame():
    """At the brightest pixel and at the tenth along the edge, whose centres lie half a pixel inside the frame."""
    glow = effects.BY_NAME["amplifier_glow"].act(np.zeros((64, 80)), 20.0, moment("amplifier_glow"))
    glow = glow[
        :: 1 if glow[0].max() > glow[-1].max() else -1, :: 1 if glow[:, 0].max() > glow[:, -1].max() else -1
    ]
    first, tenth = np.log(glow[0, [0, 9]] / (20.0 * PLAIN.integration_s))
    assert tenth / first == pytest.approx(np.hypot(0.5, 9.5) / np.hypot(0.5, 0.5))
