"""Steps, derivatives, references and refits against linear algebra that is done by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from benchmark.effects import BY_NAME
from tests.diagnosis.small import SENSOR, Hidden, frame_set
from visaug.diagnosis.candidates.climb import newton
from visaug.diagnosis.fitting import fit
from visaug.diagnosis.fitting.fit import NOISY, bias_level, followed, refit, settled
from visaug.diagnosis.fitting.parameters import (
    Coordinate,
    base_coordinates,
    effect_coordinates,
    intervals,
    moved,
)
from visaug.diagnosis.fitting.reference import (
    MORE_PAIRS,
    MOST_PAIRS,
    PAIRS,
    USES,
    Null,
    Reference,
    SimulatedStatistics,
    derivatives,
    is_far,
    make_reference,
)
from visaug.diagnosis.fitting.robust import added_by_noise, adjust, misfit
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.spread import by_threads


def test_adjust_solves_the_linear_problem_and_ignores_outliers():
    rng = np.random.default_rng(0)
    slopes = rng.normal(size=(200, 3)) * 10
    truth = np.array([0.3, -0.2, 0.1])
    residual = slopes @ truth + rng.normal(size=200)
    wide = np.full(3, 100.0)
    step = adjust(residual[None], slopes, np.ones(200), wide)[0]
    # standard error 1/(10 sqrt(200)) = 0.007: five of them
    np.testing.assert_allclose(step, truth, atol=0.036)
    residual[:20] += 1000
    np.testing.assert_allclose(adjust(residual[None], slopes, np.ones(200), wide)[0], truth, atol=0.06)


def test_noise_of_slopes_does_not_shorten_a_step():
    """Two coordinates with nearly the same effect, which only the last two statistics separate.

    A seventh of the moments that separate them is noise. Means of 2,000 draws have a standard error of 0.0012.
    """
    rng, truth, sigma = np.random.default_rng(0), np.array([0.1, -0.1]), 0.4
    half = np.r_[np.zeros(398), 10.0, -10.0]
    slopes = np.column_stack([5 + half, 5 - half])
    noise, wide = np.full(2, 400 * sigma**2), np.full(2, 100.0)
    steps: dict[bool, list[np.ndarray]] = {True: [], False: []}
    for _ in range(2000):
        noisy = slopes + rng.normal(0, sigma, slopes.shape)
        residual = (slopes @ truth + rng.normal(size=400))[None]
        for subtracted, found in steps.items():
            found.append(adjust(residual, noisy, np.ones(400), wide, noise=noise if subtracted else None)[0])
    free, short = (np.mean(steps[key], axis=0) for key in (True, False))
    np.testing.assert_allclose(free, truth, atol=0.006)
    np.testing.assert_allclose(short, truth * 400 / (400 + 64), atol=0.006)


def test_a_number_that_few_statistics_tell_is_fitted_beside_one_that_all_tell():
    """A black level moves what thousands of pixels say to a hundredth of a DN, the share of missing codes one count."""
    slopes = np.column_stack([np.full(800, 5e3), np.r_[3.3, np.zeros(799)]])
    residual = slopes @ np.array([0.02, 0.4])
    step = adjust(residual[None], slopes, np.ones(800), np.array([30.0, 1.5]))[0]
    expected = 0.4 * 3.3**2 / (3.3**2 + 1 / 1.5**2)  # least squares with the prior
    assert step[0] == pytest.approx(0.02, rel=1e-6)
    assert step[1] == pytest.approx(expected, rel=1e-3)


class Wavering:
    """Sets of 401 statistics: the first answers the black level, the others are drawn anew wherever that moves."""

    statistics = ()

    def __init__(self):
        self.asked = []

    def simulated(self, jobs, report):
        self.asked += [number for _, number in jobs]
        return [
            np.array([self._set(camera.values()["black_level_dn"], number) for camera, number in jobs])
        ] * 3

    @staticmethod
    def _set(level, number):
        return np.r_[level, np.random.default_rng([number, round(1e6 * level)]).normal(size=400)]


def test_what_answers_by_chance_has_hardly_a_derivative(stated):
    free = [c for c in base_coordinates(stated, frame_set(0), True) if c.path == "black_level_dn"]
    lab = Wavering()
    sets = lab.simulated([(stated, k) for k in range(12)], None)
    lab.asked.clear()
    (slopes, *_), _ = derivatives(lab, stated, free, sets, lambda *_: None)
    assert slopes[0, 0] == pytest.approx(1.0)
    # The difference of two unit normals over a step of four: 0.35, and the mean of four of them 0.18. Beyond three standard
    # errors, as all statistics tell them, are 0.3 % of 400 by chance: 1.2 expected, more than seven once in 10,000 runs.
    assert np.count_nonzero(slopes[1:, 0]) <= 7
    assert max(lab.asked) == MORE_PAIRS - 1
    sure = Wavering()
    sure._set = lambda level, number: np.r_[level, np.zeros(400)]
    same = sure.simulated([(stated, k) for k in range(12)], None)
    sure.asked.clear()
    derivatives(sure, stated, free, same, lambda *_: None)
    assert max(sure.asked) == PAIRS - 1  # without noise two simulations are enough


def test_a_step_of_the_gain_leaves_noise_in_dn_also_where_it_is_made_again_with_a_wider_step(stated):
    """Read noise in DN, and the log variance of shot noise at a level in DN, among 400 statistics that are noise.

    Noise and levels are held in DN, so that the derivatives are 0 and -1, exactly.
    """
    free = base_coordinates(stated, frame_set(0), True)
    gain = [c.path for c in free].index("gain_e_per_dn")

    class Shot(Wavering):
        def simulated(self, jobs, report):
            return [np.array([self._of(camera.values(), number) for camera, number in jobs])] * 3

        @staticmethod
        def _of(values, number):
            g, level_dn = (
                values["gain_e_per_dn"],
                1000 * values["quantum_efficiency"] / values["gain_e_per_dn"],
            )
            exact = [values["read_noise.sigma_e"] / g, np.log(level_dn / g)]
            return np.r_[exact, np.random.default_rng([number, round(1e6 * g)]).normal(size=400)]

    lab = Shot()
    sets = lab.simulated([(stated, k) for k in range(12)], None)
    (slopes, *_), _ = derivatives(lab, stated, free, sets, lambda *_: None)
    assert slopes[:2, gain] == pytest.approx([0.0, -1.0], abs=1e-9)


def test_a_number_that_the_frames_do_not_tell_has_the_width_of_its_prior(stated):
    """Two numbers; statistics answer the first alone."""
    rng = np.random.default_rng(0)
    free = [
        c
        for c in base_coordinates(stated, frame_set(0), True)
        if c.path in ("read_noise.sigma_e", "quantum_efficiency")
    ]
    slopes = np.column_stack([np.full(50, 20.0), np.zeros(50)])
    sample = SimulatedStatistics(rng.normal(size=(200, 50)), slopes, np.zeros(50))
    reference = Reference(stated, tuple(free), sample, sample, sample)
    assert reference.undetermined[0] < 0.01
    assert reference.undetermined[1] == pytest.approx(free[1].prior)
    found = intervals(free, stated, reference.null_steps, reference.undetermined)
    (known, *bounds), (unknown, low, high) = (found[c.path] for c in free)
    # 50 statistics of standard deviation 1 that answer by 20: 1.96 / (20 sqrt(50)), to 4 standard errors of 200 sets
    assert np.log(np.divide(bounds, known)) == pytest.approx([-0.0139, 0.0139], rel=0.2)
    assert np.log(np.divide((low, high), unknown)) == pytest.approx(
        [-1.96 * free[1].prior, 1.96 * free[1].prior]
    )


def test_the_derivative_of_a_bit_is_that_of_its_law(stated):
    """A bit flips with the black level as the normal distribution of a pixel says, which bends within its width.

    A difference of 1 DN would be a third short at a width of 1.02 DN. The standard error of two simulations is 3 %.
    """
    sigma_e, gain = 2.5, 2.45
    camera = stated.replace(
        {
            "gain_e_per_dn": gain,
            "black_level_dn": 121.5,
            "read_noise.sigma_e": sigma_e,
            "read_noise.shape": 0.14,
            "dark_current.a_e_per_s": 0.0,
            **{f"dsnu.{part}": 0.0 for part in ("column_e", "row_e", "pixel_e")},
        }
    )
    lab = Laboratory(frame_set(0), camera, spread=by_threads())
    free = base_coordinates(camera, lab.frames, lab.calibrated)
    sets = lab.simulated([(camera, k) for k in range(PAIRS)])
    (slopes, *_), _ = derivatives(lab, camera, free, sets, lambda *_: None)
    codes, width = np.arange(90, 150), sigma_e / gain
    set_codes = codes[codes >> 1 & 1 > 0]

    def share(black):
        return (norm.cdf(set_codes + 0.5, black, width) - norm.cdf(set_codes - 0.5, black, width)).sum()

    law = (share(121.5 + 1e-4) - share(121.5 - 1e-4)) / 2e-4
    bit = next(i for i, s in enumerate(lab.statistics) if s.name == "dark: bit 1 set")
    assert slopes[bit, 0] == pytest.approx(law, rel=0.15)


def test_the_derivative_of_the_black_level_is_not_that_of_another_level(stated):
    """Bit 1 of codes under a noise of 1.0 DN answers with the other sign 2 DN further; a reference nearby has the first one."""
    dark = dict.fromkeys(("dark_current.a_e_per_s", "dsnu.column_e", "dsnu.row_e", "dsnu.pixel_e"), 0.0)
    narrow = stated.replace({"read_noise.sigma_e": 2.5, "gain_e_per_dn": 2.45, **dark})
    at, there = (narrow.replace({"black_level_dn": black}) for black in (121.5, 123.5))
    lab = Laboratory(frame_set(0), narrow, spread=by_threads())
    free = base_coordinates(narrow, lab.frames, lab.calibrated)
    known = make_reference(lab, at, free, 2, lambda *_: None)
    reused, anew = (
        make_reference(lab, there, free, 2, lambda *_: None, known=reference) for reference in (known, None)
    )
    bit = next(i for i, s in enumerate(lab.statistics) if s.name == "dark: bit 1 set")
    level = bias_level(lab.statistics)
    for reference in (known, reused, anew):
        (black,) = (k for k, c in enumerate(reference.coordinates) if c.path == "black_level_dn")
        assert reference.slopes[level, black] == pytest.approx(1.0, abs=0.02)
        sign = 1 if reference is known else -1
        assert sign * reference.slopes[bit, black] > 0.1


def test_a_wider_step_does_not_move_a_dark_level_by_more_than_its_bits_are_linear_over(stated):
    """Dark current of 10 e-/s whose derivative is taken for noise: four steps move 2 s darks by 2.6 DN.

    Their bit 2, of 8 DN, would answer with half of its slope at a width of 2.1 DN. The standard error is 2 %.
    """
    rate, sigma_e, gain, black = 10.0, 2.5, 2.45, 123.0
    camera = stated.replace(
        {
            "gain_e_per_dn": gain,
            "black_level_dn": black,
            "read_noise.sigma_e": sigma_e,
            "read_noise.shape": 0.14,
            "dark_current.a_e_per_s": rate,
            "dark_current.b_per_c": 0.0,
            **{f"dsnu.{part}": 0.0 for part in ("column_e", "row_e", "pixel_e")},
        }
    )
    lab = Laboratory(frame_set(0), camera, spread=by_threads())
    (own,) = (c for c in base_coordinates(camera, lab.frames, lab.calibrated) if "a_e_per_s" in c.path)
    sets = lab.simulated([(camera, k) for k in range(MOST_PAIRS)])
    found, _ = derivatives(lab, camera, [own], sets, lambda *_: None)
    (slopes, *_), _ = derivatives(lab, camera, [own], sets, lambda *_: None, (found, np.array([1e9])))
    codes, records = np.arange(80, 190), [lab.frames.records[i] for i in lab.folds.find]
    set_codes = codes[codes >> 2 & 1 > 0]
    electrons = rate * np.array([[r.exposure_s] for r in records if r.kind in ("bias", "dark")])

    def share(electrons):
        width, level = np.sqrt(sigma_e**2 + electrons) / gain, black + electrons / gain
        each = norm.cdf(set_codes + 0.5, level, width) - norm.cdf(set_codes - 0.5, level, width)
        return each.sum(1).mean()

    law = (share(1.001 * electrons) - share(0.999 * electrons)) / 0.002
    bit = next(i for i, s in enumerate(lab.statistics) if s.name == "dark: bit 2 set")
    assert slopes[bit, 0] == pytest.approx(law, rel=0.15)


def test_coordinates_round_trip(stated):
    free = base_coordinates(stated, frame_set(0), True)
    same = moved(stated, free, [c.read(stated) for c in free])
    for path, value in stated.values().items():
        assert same.values()[path] == pytest.approx(value, rel=1e-9)


def test_a_black_level_far_from_the_file_is_found(stated):
    """60 DN off, two standard deviations of its prior; the mean of 12 bias frames is known to 0.05 DN with its pattern."""
    off = stated.replace({"black_level_dn": stated.values()["black_level_dn"] + 60})
    lab = Laboratory(frame_set(5), off)
    coordinates = base_coordinates(off, lab.frames, True)
    reference = make_reference(lab, off, coordinates, 16, lambda *_: None)
    fitted = refit(lab, reference, lambda *_: None)
    assert fitted.camera.values()["black_level_dn"] == pytest.approx(120, abs=1)


@pytest.mark.parametrize("read_e", [0.14, 0.3])
def test_a_black_level_is_found_where_rounding_is_more_than_noise(stated, read_e):
    """0.2 and 0.4 DN of noise: the level rises in steps of a DN. With its pattern the mean is known to 0.2 DN."""
    off = stated.replace({"black_level_dn": 130.0, "read_noise.sigma_e": read_e})
    lab = Laboratory(frame_set(0, sensor=replace(SENSOR, read_e=read_e)), off, spread=by_threads())
    reference = make_reference(lab, off, base_coordinates(off, lab.frames, True), 40, lambda *_: None)
    level = bias_level(lab.statistics)
    assert level is not None
    assert reference.slopes[level, 0] == pytest.approx(1, rel=0.05)
    fitted = refit(lab, reference, lambda *_: None)
    assert fitted.camera.values()["black_level_dn"] == pytest.approx(120, abs=0.6)


def test_a_set_does_not_widen_its_own_measure():
    """One of 20 sets is 6 standard deviations of the others off: told as 6, not as the 3.5 that it makes of itself."""
    rng = np.random.default_rng(5)
    residuals = rng.normal(size=(20, 1))
    residuals -= residuals.mean(0)
    residuals[7] = 6 * np.sqrt(np.mean(np.delete(residuals, 7, 0) ** 2) * 19 / 18)
    null = Null(residuals, np.full(1, 1e-9), np.zeros((1, 1)), np.ones(1))
    assert null.largest[7] == pytest.approx(6)
    assert abs(residuals[7, 0]) / null.scale[0] < 4


def test_the_black_level_leaves_where_the_full_well_cuts(stated):
    """In DN: else a fit that moves one would have to move the other to one part in 100 000."""
    free = base_coordinates(stated, frame_set(0), True)
    at = [c.read(stated) for c in free]
    there = moved(
        stated, free, [x + 7.0 * (c.path == "black_level_dn") for x, c in zip(at, free, strict=True)]
    )
    before, after = (c.values() for c in (stated, there))
    assert after["black_level_dn"] == before["black_level_dn"] + 7.0
    cut = [v["full_well_e"] / v["gain_e_per_dn"] + v["black_level_dn"] for v in (before, after)]
    assert cut[1] == pytest.approx(cut[0], rel=1e-12)
    assert any(c.path == "full_well_e" for c in free)


def test_a_refit_may_begin_elsewhere(stated):
    lab = Laboratory(frame_set(5), stated, 0)
    free = [c for c in base_coordinates(stated, lab.frames, True) if c.path == "quantum_efficiency"]
    reference = make_reference(lab, stated, free, 24, lambda *_: None)
    known = reference.null_steps.std()
    begin = moved(stated, free, [c.read(stated) + 40 * known for c in free])
    here, there = refit(lab, reference, lambda *_: None), refit(lab, reference, lambda *_: None, begin)
    apart = [free[0].read(f.camera) for f in (here, there)]
    assert abs(apart[0] - apart[1]) < 0.5 * known
    assert there.misfit == pytest.approx(here.misfit, rel=0.01)


def test_a_fit_beside_lost_bits_leaves_what_chance_leaves(stated):
    """Lost bits answer a small step by chance: a mean that few common random numbers follow leaves five times the variance."""
    hidden = BY_NAME["bit_truncation"].at(2)
    off = stated.with_effect("bit_truncation", bits=2)
    off = off.replace({"read_noise.sigma_e": 0.9 * off.values()["read_noise.sigma_e"]})
    lab = Laboratory(frame_set(5, [hidden]), off)
    free = [
        c
        for c in base_coordinates(off, lab.frames, True)
        if c.path in ("black_level_dn", "read_noise.sigma_e")
    ]
    sets = 30
    followed = refit(lab, make_reference(lab, off, free, sets, lambda *_: None), lambda *_: None)
    anew = settled(lab, followed, sets, lambda *_: None)

    def left(fitted):
        scale = fitted.reference.scale
        return float(np.mean((fitted.residual[scale > 0] / scale[scale > 0]) ** 2))

    assert not is_far(followed.reference, followed.camera)
    assert followed.noise > 1 > NOISY > anew.noise
    assert left(followed) > 2
    assert left(anew) == pytest.approx(1 + 1 / sets, abs=0.25)
    assert anew.reference.is_erratic
    assert not followed.reference.is_erratic
    beside = make_reference(lab, anew.camera, free, 2, lambda *_: None, known=anew.reference)
    assert beside.is_erratic


def test_a_reference_that_was_begun_goes_on_where_it_was(stated, tmp_path, monkeypatch):
    lab = Laboratory(frame_set(5), stated, 0)
    free = [c for c in base_coordinates(stated, lab.frames, True) if c.path == "quantum_efficiency"]
    few, many = (make_reference(lab, stated, free, n, lambda *_: None) for n in (4, 9))
    told = []
    monkeypatch.setenv("VISAUG_CACHE", str(tmp_path))
    again = make_reference(lab, stated, free, 9, lambda *tick: told.append(tick[1:]), begun=few)
    for use in USES:
        assert np.array_equal(getattr(again, use).sets, getattr(many, use).sets)
        assert np.array_equal(getattr(again, use).slopes, getattr(many, use).slopes)
    assert told == [(n, 9) for n in range(5, 10)]


def test_a_fit_that_takes_the_bias_level_for_an_outlier_begins_again(stated, monkeypatch):
    """Rows of the lower half lie 4 e- low: bits of the dark frames hold the black level where it was.

    Which of the minima near the two starts a fit reaches is decided by rounding, so by the processor: none is worse than the
    first, and of four sets one at least is better.
    """

    def lower_half(x, strength, moment):
        return x - strength * (np.arange(len(x))[:, None] >= len(x) // 2)

    better = []
    for seed in (5, 6, 7, 8):
        lab = Laboratory(frame_set(seed, (Hidden("lower half", "voltage", lower_half, 4.0),)), stated)
        free = base_coordinates(stated, lab.frames, True)
        reference = make_reference(lab, stated, free, 24, lambda *_: None)
        level = bias_level(lab.statistics)
        again = refit(lab, reference, lambda *_: None)
        with monkeypatch.context() as once:
            once.setattr(fit, "OFF_BLACK", np.inf)
            held = refit(lab, reference, lambda *_: None)
        assert again.misfit <= held.misfit
        if abs(held.z[level]) > 10 and again.misfit < held.misfit:
            assert abs(again.z[level]) < abs(held.z[level])
            better.append(seed)
    assert better


@pytest.mark.parametrize(
    ("deviation", "misfits", "ends"),
    [(-12.0, (2.0, 1.0), -1.5), (-12.0, (1.0, 2.0), 0.0), (12.0, (2.0, 1.0), 1.5), (-4.0, (2.0, 1.0), 0.0)],
)
def test_a_fit_begins_again_at_the_bias_level_and_the_better_one_is_kept(
    stated, monkeypatch, deviation, misfits, ends
):
    """A deviation of 12 is beyond `OFF_BLACK`, one of 4 is not."""
    coordinates = (Coordinate("black_level_dn", False, 1.0, 5.0),)

    def descended(lab, reference, report, begin, iterations, known=None):
        camera, own = (stated, misfits[0]) if begin is None else (begin, misfits[1])
        z, residual = np.array([deviation]), np.array([np.sign(deviation) * 1.5])
        return SimpleNamespace(reference=reference, camera=camera, z=z, residual=residual, misfit=own)

    monkeypatch.setattr(fit, "_descended", descended)
    monkeypatch.setattr(fit, "_black_level", lambda lab, reference: fit._BlackLevel(0, 0))
    fitted = refit(None, SimpleNamespace(coordinates=coordinates), lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    moved_by = fitted.camera.values()["black_level_dn"] - stated.values()["black_level_dn"]
    assert moved_by == pytest.approx(ends, abs=1e-9)


def test_noise_of_derivatives_does_not_shorten_the_step():
    """Derivatives of size 1 under noise of three times their size: the step is told within a fifth (4 standard errors)."""
    rng = np.random.default_rng(5)
    count, twins, truth = 20000, 6, 2.0
    design = 1.0 + 3.0 * rng.standard_normal((1, twins, count))
    left = truth + rng.standard_normal((twins, count))
    step = newton(design, left, np.array([100.0]))
    assert step[0] == pytest.approx(truth, rel=0.2)
    whole, pull = design.mean(1)[0], left.mean(0)
    assert whole @ pull / (whole @ whole) < 0.5 * truth  # what products of the same twins give


class Bent:
    """Sets of 60 statistics: the first is the DN at which the well cuts, the others answer the quantum efficiency."""

    statistics = ()

    def __init__(self, free, given, truth):
        self.free, self.at = free, np.array([c.read(given) for c in free])
        self.measured = [SimpleNamespace(values=self._set(truth, 0))] * 3

    def finding(self, jobs, report=None):
        return np.array([self._set(camera, number) for camera, number in jobs])

    def simulated(self, jobs, report=None):
        return [self.finding(jobs)] * 3

    def _set(self, camera, number):
        well, efficiency = np.array([c.read(camera) for c in self.free]) - self.at
        noise = np.random.default_rng(number).normal(size=60)
        return np.r_[well / self.free[0].step, np.full(59, 400 * efficiency)] + noise


def test_a_well_that_was_held_for_another_number_is_tried_by_itself(stated):
    """Derivatives of another number that are an eighth of what they should be make every step too long: the well's are shortened.

    The well belongs 5 steps further, each a standard deviation; what stays is the noise of one set, 3.3 of them (1 in 1000).
    """
    paths = ("full_well_e", "quantum_efficiency")
    by_path = {c.path: c for c in base_coordinates(stated, frame_set(0), True)}
    free = [by_path[path] for path in paths]
    truth = moved(stated, free, [c.read(stated) + s for c, s in zip(free, (5 * free[0].step, 0.02))])
    lab = Bent(free, stated, truth)
    sets = lab.finding([(stated, k) for k in range(1, 31)])
    slopes = np.zeros((60, 2))
    slopes[0, 0], slopes[1:, 1] = 1 / free[0].step, 50
    reference = Reference(stated, tuple(free), *[SimulatedStatistics(sets, slopes, np.zeros(60))] * 3)
    fitted = refit(lab, reference, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert abs(fitted.z[0]) < 3.3


class Straight(Bent):
    """Sets of 60 unit normals whose mean the quantum efficiency moves by 400; counts the sets that are simulated."""

    def __init__(self, free, given, off):
        self.free, self.at, self.sets = free, free.read(given), 0
        self.given = self.finding([(given, k) for k in range(30)])
        self.measured = [SimpleNamespace(values=self.given.mean(0) + 400 * off)] * 3

    def finding(self, jobs, report=None):
        self.sets += len(jobs)
        return super().finding(jobs)

    def _set(self, camera, number):
        return np.random.default_rng(number).normal(400 * (self.free.read(camera) - self.at), 1, 60)


def straight(stated, off: float, slope: float = 400.0) -> tuple[Straight, Reference]:
    """Sets whose truth is `off` from the camera file, and a reference with a derivative."""
    (free,) = [c for c in base_coordinates(stated, frame_set(0), True) if c.path == "quantum_efficiency"]
    lab = Straight(free, stated, off)
    sample = SimulatedStatistics(lab.given, np.full((60, 1), slope), np.ones(60))
    lab.sets = 0
    return lab, Reference(stated, (free,), *[sample] * 3)


@pytest.mark.parametrize(("errors", "sets"), [(0.3, 0), (0.6, 0), (1.0, 10), (20.0, 10)])
def test_a_step_that_promises_little_is_taken_by_the_derivatives_alone(stated, errors, sets):
    """In standard errors of the mean; their square over 2 is the log likelihood, of which 0.25 is simulated: 4 sets and 6."""
    off = errors / np.sqrt(60) / 400
    lab, reference = straight(stated, off)
    fitted = refit(lab, reference, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert lab.sets == sets
    (free,) = reference.coordinates
    assert free.read(fitted.camera) - free.read(stated) == pytest.approx(off, rel=0.01)


def test_a_start_that_leads_to_a_known_fit_is_not_followed(stated):
    """The first step from it is exact here; 4 sets are simulated at the start alone, and 10 more towards another minimum."""
    lab, reference = straight(stated, off=0.02)
    (free,), known = reference.coordinates, refit(lab, reference, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    begin, elsewhere = (moved(stated, [free], [free.read(stated) + x]) for x in (-0.02, -0.05))
    for fit_known, sets in ((known, 4), (replace(known, camera=elsewhere), 14)):
        lab.sets = 0
        again = refit(lab, reference, lambda *_: None, begin, known=fit_known)  # pyrefly: ignore[bad-argument-type]
        assert (again is fit_known) is (sets == 4)
        assert lab.sets == sets
    assert free.read(again.camera) == pytest.approx(free.read(stated) + 0.02, abs=1e-3)


@pytest.mark.parametrize(("errors", "ends"), [(1.5, True), (3.0, False)])
def test_a_fit_ends_at_a_small_promise_that_is_not_kept(stated, errors, ends):
    """A derivative of the wrong sign promises 1.1 and 4.5 in log likelihood; 2 sides of a step are 8 sets."""
    off = errors / np.sqrt(60) / 400
    lab, reference = straight(stated, off, slope=-400.0)
    fitted = refit(lab, reference, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert (lab.sets == 8) is ends
    (free,) = reference.coordinates
    assert (
        abs(free.read(fitted.camera) - free.read(stated)) < 0.02 * off
    )  # such a step is not made without sets either


class Alike:
    """Sets of 402 statistics that two numbers move alike, but for the last two; each set answers by slopes of its own."""

    statistics = ()
    ALIKE, APART, WAVERS = 5.0, 3.0, 0.6

    def __init__(self, free, given):
        self.free, self.at, self.asked = free, np.array([c.read(given) for c in free]), []
        half = np.r_[np.zeros(400), self.APART, -self.APART]
        self.slopes = np.column_stack([np.full(402, self.ALIKE) + half, np.full(402, self.ALIKE) - half])

    def simulated(self, jobs, report=None):
        self.asked += [number for _, number in jobs]
        return [np.array([self._set(camera, number) for camera, number in jobs])] * 3

    def _set(self, camera, number):
        rng = np.random.default_rng(number)
        own = self.slopes + rng.normal(0, self.WAVERS, self.slopes.shape)
        return own @ (np.array([c.read(camera) for c in self.free]) - self.at) + rng.normal(size=402)


def test_two_numbers_that_the_frames_hardly_tell_apart_have_their_true_intervals(stated):
    """Only 2 of 402 statistics determine their difference; the noise of two derivatives carries as much apparent information.

    The standard deviation is that of least squares with the true derivatives; one of 400 sets is known to 3.5 %. The noise that
    16 simulations leave is a tenth of the information; it widens the estimate by its half.
    """
    by_path = {c.path: c for c in base_coordinates(stated, frame_set(0), True)}
    free = [by_path[path] for path in ("quantum_efficiency", "read_noise.sigma_e")]
    lab = Alike(free, stated)
    sets = lab.simulated([(stated, k) for k in range(400)])
    lab.asked.clear()
    slopes, noise = derivatives(lab, stated, free, sets, lambda *_: None)
    assert max(lab.asked) == MOST_PAIRS - 1
    sample = SimulatedStatistics(sets[0], slopes[0], np.zeros(402))
    reference = Reference(stated, tuple(free), sample, sample, sample, noise=noise)
    design = lab.slopes * [c.prior for c in free]
    exact = np.sqrt(np.diag(np.linalg.inv(design.T @ design + np.eye(2)))) * [c.prior for c in free]
    spread = np.hypot(reference.spread_steps.std(0, ddof=1), reference.undetermined)
    assert spread == pytest.approx(1.05 * exact, rel=0.1)
    # with the other parameter fixed, all statistics determine it, and two simulations are enough
    lab.asked.clear()
    alone = Alike(free[:1], stated)
    alone.slopes = alone.slopes[:, :1]
    derivatives(alone, stated, free[:1], alone.simulated([(stated, k) for k in range(40)]), lambda *_: None)
    assert max(alone.asked[40:]) == PAIRS - 1


def test_a_bent_answer_is_no_noise(stated):
    """One of two numbers that are hard to tell apart is answered by its square too, which cancels in the mean of both sides."""
    by_path = {c.path: c for c in base_coordinates(stated, frame_set(0), True)}
    free = [by_path[path] for path in ("quantum_efficiency", "read_noise.sigma_e")]
    lab = Alike(free, stated)
    lab.WAVERS, bend = 0.0, 40 / free[0].step

    def bent(camera, number):
        moves = np.array([c.read(camera) for c in free]) - lab.at
        return lab.slopes @ moves + bend * moves[0] ** 2 + np.random.default_rng(number).normal(size=402)

    lab._set = bent
    sets = lab.simulated([(stated, k) for k in range(60)])
    lab.asked.clear()
    slopes, noise = derivatives(lab, stated, free, sets, lambda *_: None)
    np.testing.assert_allclose(slopes[0], lab.slopes, atol=1e-6)
    assert noise == pytest.approx([0, 0], abs=1e-6)
    assert max(lab.asked) == MORE_PAIRS - 1


def test_a_number_at_its_bound_is_held_there_and_the_others_are_fitted_beside_it(stated):
    """Coupling to diagonal neighbours cannot be negative; where it would be, the share alone is fitted: exact least squares."""
    camera = stated.with_effect("interpixel_crosstalk")
    by_path = {c.path: c for c in effect_coordinates(camera, "interpixel_crosstalk")}
    free = [by_path[f"interpixel_crosstalk.{key}"] for key in ("share", "diagonal")]
    assert free[1].read(camera) == 0.0
    rng = np.random.default_rng(0)
    slopes = np.column_stack([rng.normal(40, 5, 60), rng.normal(40, 5, 60)])
    left = slopes @ np.array([0.3, -0.2])

    class Lab(Bent):
        def _set(self, at, number):
            moves = np.array([c.read(at) for c in self.free]) - self.at
            return slopes @ moves + np.random.default_rng(number).normal(size=60)

    lab = Lab(free, camera, camera)
    sets = lab.finding([(camera, k) for k in range(30)])
    (answers, *_), _ = derivatives(lab, camera, free, [sets] * 3, lambda *_: None)
    np.testing.assert_allclose(answers, slopes, rtol=1e-6)  # both steps of the bounded one go upwards
    lab.measured = [SimpleNamespace(values=sets.mean(0) + left)] * 3
    reference = Reference(camera, tuple(free), *[SimulatedStatistics(sets, slopes, np.zeros(60))] * 3)
    fitted = refit(lab, reference, lambda *_: None)  # pyright: ignore[reportArgumentType]
    assert free[1].read(fitted.camera) == 0.0
    alone = adjust(left[None], slopes[:, :1], reference.scale, reference.priors[:1])[0, 0]
    assert free[0].read(fitted.camera) - free[0].read(camera) == pytest.approx(alone, abs=1e-5)


class Redrawn(Bent):
    """Sets of 60 statistics that follow the quantum efficiency; half of their variance is drawn anew wherever it moves."""

    def __init__(self, free, given, truth, seed):
        self.seed = seed
        super().__init__(free, given, truth)

    def _set(self, camera, number):
        (efficiency,) = np.array([c.read(camera) for c in self.free]) - self.at
        shared = np.random.default_rng([self.seed, number]).normal(size=60)
        anew = np.random.default_rng([self.seed, number, round(1e9 * abs(efficiency)), 1]).normal(size=60)
        return np.full(60, 400 * efficiency) + np.sqrt(0.5) * (shared + anew)


def test_the_noise_of_following_the_mean_is_part_of_a_fits_error(stated):
    """6 differences of sets, each with a variance of 1 per statistic: 1 / (400 sqrt(60 x 6)) for the mean of 60 statistics.

    The mean of 30 estimates of a standard deviation from 6 values, each known to 32 %, is known to 6 %: three times that, and
    the few per cent by which 6 values underestimate it.
    """
    free = [c for c in base_coordinates(stated, frame_set(0), True) if c.path == "quantum_efficiency"]
    truth = moved(stated, free, [free[0].read(stated) + 2 * free[0].step])
    errors = []
    for seed in range(30):
        lab = Redrawn(free, stated, truth, seed)
        sets = lab.finding([(stated, k) for k in range(60)])
        samples = [SimulatedStatistics(sets, np.full((60, 1), 400.0), np.zeros(60))] * 3
        fitted = refit(lab, Reference(stated, tuple(free), *samples), lambda *_: None)  # pyrefly: ignore[bad-argument-type]
        errors.append(float(np.asarray(fitted.simulation_error)[0]))
        assert fitted.noise == pytest.approx(
            1 / 6, rel=0.5
        )  # in variances of a set; of 60 statistics, known to 8 %
    assert np.mean(errors) == pytest.approx(1 / (400 * np.sqrt(360)), rel=0.25)


@pytest.mark.parametrize("size", [0.0, 1.0, 2.0, 4.0, 8.0])
def test_what_noise_adds_to_the_objective_function_is_its_expected_value(size):
    """The expected value by Gauss-Hermite quadrature; the fourth order is 1 % at a tenth of a standard deviation."""
    points, weights = np.polynomial.hermite_e.hermegauss(40)
    sigma, noise = 2.0, 0.2
    around = size * sigma + noise * points
    scale = np.array([sigma])
    expected = sum(
        w * misfit(np.array([x]), scale) for x, w in zip(around, weights / weights.sum(), strict=True)
    )
    more = added_by_noise(np.array([size * sigma]), scale, np.array([noise**2]))
    assert expected - misfit(np.array([size * sigma]), scale) == pytest.approx(more, rel=0.02)


class Anew(Straight):
    """Sets of 6,400 statistics that a step of the efficiency moves little, and of whose variance it draws 7 % anew."""

    SLOPE, COUNT, SHARE = 1.0, 6400, 0.07

    def __init__(self, free, given, off, seed):
        self.free, self.at, self.sets, self.seed = free, free.read(given), 0, seed
        self.given = self.finding([(given, k) for k in range(60)])
        truth = moved(given, [free], [self.at + off])
        self.measured = [SimpleNamespace(values=self._set(truth, 1000))] * 3

    def share(self, step):
        return self.SHARE

    def _set(self, camera, number):
        step = self.free.read(camera) - self.at
        place = round(1e9 * step) % 2**32
        kept, own = (
            np.random.default_rng([self.seed, number, k]).normal(size=self.COUNT) for k in (0, place + 1)
        )
        share = self.share(step)
        return self.SLOPE * step + np.sqrt(1 - share) * kept + np.sqrt(share) * own


class AnewFarAway(Anew):
    """70 % drawn anew from two standard errors on, and little nearby: the start of a fit has no such noise."""

    SHARE = 0.7

    def share(self, step):
        return self.SHARE * min((step * np.sqrt(self.COUNT) / 2) ** 2, 1.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_fit_that_noise_of_few_simulations_held_is_followed(stated, seed):
    """10 standard errors gain 50 in log likelihood. Noise of 16 simulations takes some 0.7 x 6400 x 0.7 / 16 / 2 = 98, of 4 more.

    It is subtracted for 16, but for some 10 by chance. The estimate has the error of one set and that of 16 simulations and
    of the reference: 4 of them are a false alarm of 1 in 10,000 for each seed.
    """
    error = 1 / np.sqrt(Anew.COUNT)
    (free,) = [c for c in base_coordinates(stated, frame_set(0), True) if c.path == "quantum_efficiency"]
    lab = AnewFarAway(free, stated, 10 * error, seed)
    sample = SimulatedStatistics(lab.given, np.full((Anew.COUNT, 1), Anew.SLOPE), np.zeros(Anew.COUNT))
    reference = Reference(stated, (free,), *[sample] * 3)
    held = refit(lab, reference, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert abs(free.read(held.camera) - lab.at) < error
    end = followed(lab, held, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert free.read(end.camera) - lab.at == pytest.approx(10 * error, abs=4 * 1.05 * error)
    lab.sets = 0
    again = followed(lab, end, lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    assert again is end
    assert lab.sets == 0


@pytest.mark.parametrize(("share", "sets"), [(0.004, 6), (0.0055, 8), (0.02, 26), (0.5, 6)])
def test_the_mean_where_a_fit_ends_is_followed_until_its_noise_takes_little(stated, monkeypatch, share, sets):
    """Of 640 statistics 6 sets leave 640 x 2 x share / 6 / 2 in log likelihood: 0.43, 0.59, 2.1, and 53, which is simulated anew.

    More sets are to leave 0.5. A variance of 6 values in 640 statistics is known to 3 %, and their
    scale, of 60 sets, to as much.
    """
    monkeypatch.setattr(Anew, "COUNT", 640)
    monkeypatch.setattr(Anew, "SHARE", share)
    (free,) = [c for c in base_coordinates(stated, frame_set(0), True) if c.path == "quantum_efficiency"]
    lab = Anew(free, stated, 0.1, 0)
    reference = Reference(
        stated, (free,), *[SimulatedStatistics(lab.given, np.ones((640, 1)), np.zeros(640))] * 3
    )
    lab.sets = 0
    there = moved(stated, [free], [free.read(stated) + 0.1])
    (mean, *_), noise, _ = fit._means_at(lab, reference, there, np.arange(6))  # pyrefly: ignore[bad-argument-type]
    count = lab.sets
    assert count == pytest.approx(sets, abs=0.15 * sets if sets > 6 else 0)
    assert noise == pytest.approx(2 * share / count, rel=0.15)
    own = lab.finding([(there, k) for k in range(200)]).mean(0)
    assert ((mean - own) ** 2).mean() == pytest.approx(
        (1 - share) * (1 / 60 - 1 / 200) + share * (2 / count - 1 / 60 - 1 / 200), rel=0.2
    )


class Valley(Bent):
    """Sets of 60 statistics: half of them keep the black level at a square of the efficiency, half hardly tell how far along it."""

    def _set(self, camera, number):
        black, efficiency = np.array([c.read(camera) for c in self.free]) - self.at
        far = 20 * efficiency
        noise = np.random.default_rng(number).normal(size=60)
        return np.r_[np.full(30, 5 * (black - far**2)), np.full(30, far)] + noise


def test_a_fit_follows_a_curved_valley_to_its_end(stated):
    """A step along the tangent of 3 in `far` leaves 9 DN of black level, 45 standard deviations each, and all is worse than before.

    A mean of 30 statistics tells `far` to 0.18; three of these are allowed.
    """
    by_path = {c.path: c for c in base_coordinates(stated, frame_set(0), True)}
    free = [by_path["black_level_dn"], by_path["quantum_efficiency"]]
    truth = moved(stated, free, [free[0].read(stated) + 9.0, free[1].read(stated) + 0.15])
    lab = Valley(free, stated, truth)
    sets = lab.finding([(stated, k) for k in range(60)])
    slopes = np.zeros((60, 2))
    slopes[:30, 0], slopes[30:, 1] = 5.0, 20.0
    samples = [SimulatedStatistics(sets, slopes, np.zeros(60))] * 3
    fitted = refit(lab, Reference(stated, tuple(free), *samples), lambda *_: None)  # pyrefly: ignore[bad-argument-type]
    far = 20 * (free[1].read(fitted.camera) - free[1].read(stated))
    assert far == pytest.approx(3.0, abs=0.55)
