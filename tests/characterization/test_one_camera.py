"""Frames that are not of one camera, one gain or one light; in plain NumPy, which shares nothing with the package."""

import numpy as np
import pytest
from scipy import stats

from visaug.characterization import characterize
from visaug.characterization.alarms import all_warnings
from visaug.characterization.alike import merged_groups
from visaug.characterization.exchangeable import chosen, contrasts, dependence, frame_variances, residuals_of
from visaug.characterization.facts import look
from visaug.characterization.moments import measure
from visaug.frames import FrameRecord, FrameSet

SHAPE = (64, 88)
GAIN, READ, PRNU, DSNU, BLACK, EFFICIENCY = (
    0.6,
    6.0,
    0.015,
    2.0,
    140.0,
    0.5,
)  # e-/DN, e-, share, e-, DN, e-/photon
LEVELS = (200, 500, 900, 1500, 2000)  # e-
RIGHT = {"gain_e_per_dn": GAIN, "read_noise.sigma_e": READ, "prnu.pixel": PRNU, "dsnu.pixel_e": DSNU}
NEW = {"frames_dependent", "photon_transfer_scattered", "gain_uneven", "photons_contradicted", "code_gaps"}


def taken(
    seed, n=5, biases=10, levels=LEVELS, gain=lambda k: GAIN, light=lambda k: 1.0, black=BLACK, change=None
):
    """Rows (kind, electrons, frame); `gain` and `light` by the number of the frame, `change` acts on DN."""
    rng = np.random.default_rng(seed)
    prnu, dsnu = rng.normal(0, PRNU, SHAPE), rng.normal(0, DSNU, SHAPE)
    rows = []
    for e in [0.0] * biases + [float(e) for e in levels for _ in range(n)]:
        k = len(rows)
        electrons = rng.poisson(e * light(k) * (1 + prnu)) + dsnu + rng.normal(0, READ, SHAPE)
        dn = np.clip(np.rint(black + electrons / gain(k)), 0, 4095)
        rows.append(
            ("flat" if e else "bias", e, dn if change is None else np.clip(np.rint(change(dn)), 0, 4095))
        )
    return rows


def frame_set(rows, photons=True):
    records = [
        FrameRecord(i, f"{i}", kind, 0.02 if e else 0.0, 20.0, 0.0, e / EFFICIENCY if e and photons else None)
        for i, (kind, e, _) in enumerate(rows)
    ]
    return FrameSet.from_arrays(records, [np.asarray(row[2], np.uint16) for row in rows], bit_depth=12)


def measured(rows, photons=True):
    return characterize(frame_set(rows, photons))


def spoiled(result, word):
    return {name for w in result.warning_details if w.word == word for name in w.spoils}


def said(result):
    return {w.word for w in result.warning_details} & NEW


def covered(result, name, true):
    """An interval twice as wide as the 95 % one misses once in 10,000."""
    e = result[name]
    return e.low - (e.value - e.low) <= true <= e.high + (e.high - e.value)


def averaged(rows, share):
    """Each frame mixed with the one before, as cameras that average over time give them."""
    made, before = [], None
    for kind, e, dn in rows:
        old = dn if before is None or before[:2] != (kind, e) else before[2]
        before = (kind, e, share * old + (1 - share) * dn)
        made.append((kind, e, np.rint(before[2])))
    return made


def test_sound_frames_are_silent():
    """The stated rates of the four checks together are below 1 %; the seed is fixed."""
    result = measured(taken(1))
    assert not said(result)
    assert all(covered(result, name, true) for name, true in RIGHT.items())


@pytest.mark.parametrize(
    "rows",
    [
        [a if i % 2 else b for i, (a, b) in enumerate(zip(taken(2), taken(3)))],
        [(kind, e, dn[::-1] if i % 2 else dn) for i, (kind, e, dn) in enumerate(taken(4))],
        [
            (kind, e, np.roll(dn, 2, 0) if e and i % 3 == 0 else dn)
            for i, (kind, e, dn) in enumerate(taken(5))
        ],
        averaged(taken(6), 0.25),
        averaged(taken(7, n=2), 0.4),
    ],
    ids=["two cameras", "upside down", "shifted", "averaged over time", "averaged over time, pairs of flats"],
)
def test_frames_that_depend_on_each_other_spoil_what_rests_on_their_differences(rows):
    result = measured(rows)
    wrong = {
        name for name, true in RIGHT.items() if name in result.parameters and not covered(result, name, true)
    }
    assert wrong, "the fault is strong enough to matter"
    assert wrong <= spoiled(result, "frames_dependent")


def test_the_warning_tells_averaging_from_two_patterns():
    text = next(
        w.text for w in measured(averaged(taken(8), 0.3)).warning_details if w.word == "frames_dependent"
    )
    assert "follow each other" in text
    mixed = [a if i % 2 else b for i, (a, b) in enumerate(zip(taken(9), taken(10)))]
    text = next(w.text for w in measured(mixed).warning_details if w.word == "frames_dependent")
    assert "have another pattern" in text


@pytest.mark.parametrize("n", [3, 4, 7])
def test_one_frame_of_each_level_that_moved_is_named(n):
    rows = [
        (kind, e, np.roll(dn, 5, 1) if e and (i - 10) % n == 1 else dn)
        for i, (kind, e, dn) in enumerate(taken(25, n))
    ]
    result = measured(rows)
    assert not covered(result, "prnu.pixel", PRNU)
    assert "prnu.pixel" in spoiled(result, "frames_dependent")


@pytest.mark.parametrize("n", [3, 4, 10])
def test_variance_of_each_frame_and_its_error(n):
    """The variance of 300 estimates is known to 8 %; the mean deviates by more than 4 errors once in 10,000."""
    rng = np.random.default_rng(26)
    true = np.linspace(1, 2, n)
    found, errors = [], []
    for _ in range(300):
        x = rng.normal(0, 1, (n, 1500)) * np.sqrt(true)[:, None]
        variances, error = frame_variances(x - x.mean(0))
        found.append(variances)
        errors.append(error / np.median(variances))
    assert (np.abs(np.mean(found, 0) - true) < 4 * np.std(found, 0) / np.sqrt(300)).all()
    even = rng.normal(0, 1, (300, n, 1500))
    spread = np.std([frame_variances(x - x.mean(0))[0][0] for x in even])
    assert spread == pytest.approx(np.mean(errors), rel=0.2)


def test_a_lamp_that_flickers_makes_no_frames_depend_on_each_other():
    rng = np.random.default_rng(11)
    change = rng.normal(1, 0.03, 99)
    result = measured(taken(12, light=lambda k: change[k]))
    assert "frames_dependent" not in said(result)
    assert covered(result, "gain_e_per_dn", GAIN)


@pytest.mark.parametrize("n", [4, 5, 9])
def test_contrasts_see_neither_the_pattern_nor_the_variances(n):
    basis = contrasts(n)
    assert len(basis) == n * (n - 3) // 2
    assert np.abs(np.einsum("kij,lij->kl", basis, basis) - np.eye(len(basis))).max() < 1e-12
    assert np.abs(basis.sum(2)).max() < 1e-12
    assert np.abs(np.einsum("kii->ki", basis)).max() == 0


@pytest.mark.parametrize(("n", "law"), [(4, "normal"), (9, "heavy"), (5, "uneven"), (5, "of two variances")])
def test_law_of_independent_frames(n, law):
    """150 probabilities are uniform: a Kolmogorov test at 1e-4; the seed is fixed."""
    rng = np.random.default_rng(13)
    shape = (48, 64)

    def frames():
        x = rng.normal(0, 1, (n, *shape))
        if law == "heavy":
            u = rng.random((n, *shape))
            x = u**-0.15 - (1 - u) ** -0.15
        if law == "uneven":
            x = x * np.exp(rng.normal(0, 0.4, shape))
        if law == "of two variances":
            x[::2] *= 1.3
        return x + rng.normal(0, 3, shape)

    def one():
        dn = np.rint(300 + 8 * frames()).astype(np.uint16)
        made = FrameSet.from_arrays([FrameRecord(i, f"{i}", "bias") for i in range(n)], dn)
        (group,) = merged_groups(made, look(made))
        indices = chosen(group.indices)
        residuals = residuals_of(made, indices, measure(made, group).shape)
        return 1.0 if residuals is None else dependence(residuals, indices).probability

    assert stats.kstest([one() for _ in range(150)], "uniform").pvalue > 1e-4


@pytest.mark.parametrize("factor", [1.3, 1.6, 2.0])
@pytest.mark.parametrize("photons", [True, False])
def test_a_gain_that_alternates_from_frame_to_frame_is_named(factor, photons):
    levels = (200, 500, 800, 1100)
    result = measured(taken(14, 6, levels=levels, gain=lambda k: GAIN * factor ** (k % 2)), photons)
    assert "photon_transfer_scattered" in said(result)
    unknown = spoiled(result, "photon_transfer_scattered") | set(result.not_determined)
    assert {"gain_e_per_dn", "read_noise.sigma_e"} <= unknown


@pytest.mark.parametrize("change", [0.01, 0.04])
def test_a_gain_that_alternates_by_little_is_covered(change):
    result = measured(taken(15, 6, gain=lambda k: GAIN * (1 + change * (-1) ** k)))
    assert covered(result, "gain_e_per_dn", GAIN)
    assert covered(result, "quantum_efficiency", EFFICIENCY)


@pytest.mark.parametrize("change", [0.02, 0.05, 0.3])
def test_light_that_alternates_is_covered(change):
    levels = (200, 500, 900, 1300)
    result = measured(taken(16, 6, levels=levels, light=lambda k: 1 + change * (-1) ** k))
    for name, true in (RIGHT | {"quantum_efficiency": EFFICIENCY}).items():
        assert covered(result, name, true), name


@pytest.mark.parametrize(
    ("gain", "where"),
    [
        (np.where(np.arange(SHAPE[1]) < 44, 0.52, 0.68), "over the frame"),
        (np.where(np.arange(SHAPE[1]) % 2, 0.52, 0.68), "at the places of a 2 x 2"),
    ],
)
def test_pixels_of_two_gains_are_named(gain, where):
    text = next(
        w.text for w in measured(taken(17, gain=lambda k: gain)).warning_details if w.word == "gain_uneven"
    )
    assert where in text


def test_shading_that_the_camera_corrects_is_named():
    y, x = np.linspace(-1, 1, SHAPE[0])[:, None], np.linspace(-1, 1, SHAPE[1])
    falloff = 1 - 0.25 * (x**2 + y**2)
    correct = lambda dn: (dn - BLACK) / falloff + BLACK  # noqa: E731
    result = measured(taken(18, levels=(200, 400, 700, 1100), light=lambda k: falloff, change=correct))
    assert "gain_e_per_dn" in spoiled(result, "gain_uneven")
    assert "gain_uneven" not in said(measured(taken(19, light=lambda k: falloff)))


@pytest.mark.parametrize("codes", [100, 220])
def test_codes_of_a_square_root_are_named(codes):
    """Steps that grow as the noise of light add a constant share to the gain."""
    square = lambda dn: (np.rint((codes - 1) * np.sqrt(dn / 4095)) / (codes - 1)) ** 2 * 4095  # noqa: E731
    result = measured(taken(20, change=square))
    assert {"gain_e_per_dn", "quantum_efficiency"} <= spoiled(result, "code_gaps")


def test_one_number_of_photons_for_all_flats_is_not_used():
    rows = taken(21)
    records = [
        FrameRecord(i, f"{i}", kind, 0.02 if e else 0.0, 20.0, 0.0, 777.0 if e else None)
        for i, (kind, e, _) in enumerate(rows)
    ]
    result = characterize(
        FrameSet.from_arrays(records, [np.asarray(row[2], np.uint16) for row in rows], bit_depth=12)
    )
    assert "photons_contradicted" in said(result)
    assert "quantum_efficiency" in result.not_determined
    assert covered(result, "gain_e_per_dn", GAIN)


@pytest.mark.parametrize("black", [0.0, 3.0])
def test_dark_frames_cut_at_zero(black):
    result = measured(taken(22, biases=16, levels=(300, 600, 1000, 1600, 2000), black=black))
    true = RIGHT | {"quantum_efficiency": EFFICIENCY, "black_level_dn": black}
    assert {
        name for name in true if name not in result.parameters or not covered(result, name, true[name])
    } == set()


def test_those_who_compare_hear_of_it():
    words = {w.split(":")[0] for w in all_warnings(frame_set(averaged(taken(23), 0.3)))}
    assert "frames_dependent" in words
    gain = np.where(np.arange(SHAPE[1]) < 44, 0.52, 0.68)
    assert "gain_uneven" in {w.split(":")[0] for w in all_warnings(frame_set(taken(24, gain=lambda k: gain)))}
