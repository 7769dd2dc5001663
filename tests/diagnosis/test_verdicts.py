"""Limits of absent effects, from residuals whose law is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from visaug.diagnosis import verdicts
from visaug.diagnosis.candidates.signatures import MORE, REDRAWN
from visaug.diagnosis.candidates.trials import Trial, leads
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.fitting.parameters import Coordinate
from visaug.diagnosis.fitting.reference import Null
from visaug.diagnosis.verdicts import POWER, Sight, StrengthCurve, _absorbing

COUNT = 200  # simulated sets
MATCH, LARGEST = 3.0, 50.0  # the largest residual shows nothing here


def sight(slopes: np.ndarray, priors: np.ndarray, statistics: int = 6) -> Sight:
    """Independent statistics of standard deviation 1."""
    residuals = np.random.default_rng(3).standard_normal((COUNT, statistics))
    null = Null(residuals, np.full(statistics, 0.1), slopes, priors)
    nothing = np.zeros(statistics)
    return Sight(null, np.array(["level"] * statistics), nothing, nothing, MATCH, LARGEST)


def course(strengths, shifts, specimens=None, ways=None) -> StrengthCurve:
    shifts, own = np.array(shifts, float), np.array(strengths, float)
    specimens = shifts[:, None] if specimens is None else np.array(specimens, float)
    ways = np.zeros((len(own), 2)) if ways is None else np.array(ways)
    variances = specimens.var(1)
    return StrengthCurve("row_noise.sigma_e", own, shifts, variances, specimens, shifts, False, ways, ways)


PLAIN = np.zeros((6, 0)), np.zeros(0)


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_the_limit_is_where_the_match_is_shown_with_95_per_cent(power):
    """A match of unit variance is shown from MATCH + 1.645; 200 sets tell a standard deviation to 5 %, here to three of these."""
    one = np.array([0, 0, 4.0, 0, 0, 0])
    limit, _ = course([1.0, 2.0], [one, 2**power * one]).limit(sight(*PLAIN))
    expected = ((MATCH + norm.ppf(POWER)) / 4) ** (1 / power)
    assert limit == pytest.approx(expected, rel=0.15)


def test_a_strength_that_was_simulated_and_is_not_shown_is_below_the_limit():
    """A shift that saturates: no power law leads from 1 to 4."""
    one = np.array([0, 0, 4.0, 0, 0, 0])
    limit, _ = course([1.0, 4.0], [0.5 * one, one]).limit(sight(*PLAIN))
    assert limit >= 4.0


@pytest.mark.parametrize("seen", [6, 5])
def test_an_effect_is_shown_where_95_per_cent_of_its_specimens_are(seen):
    """A normal residual of mean z exceeds 4 with 95 % from z = 5.645. One specimen of six that shows nothing is more than 5 %."""
    known = Sight(**{**vars(sight(*PLAIN)), "largest": 4.0, "match": 100.0})
    each = np.zeros((1, 6, 6))
    each[0, range(seen), range(seen)] = 10.0
    limit, _ = course([1.0], [each[0].mean(0)], each).limit(known)
    expected = (4 + norm.ppf(POWER)) / 10 if seen == 6 else np.inf
    assert limit == pytest.approx(expected, rel=0.1)


def test_noise_that_specimens_draw_again_shows_nothing():
    """The largest of many differences of two sets is beyond the largest of one set, and would be at a larger strength too."""
    known = Sight(**{**vars(sight(*PLAIN)), "largest": 4.0, "match": 4.0})
    noise = np.full((1, 6, 6), 0.95 * np.sqrt(REDRAWN) * 4.0)
    assert course([1.0], [np.zeros(6)], noise).limit(known)[0] == np.inf


@pytest.mark.parametrize(("left", "explains"), [(0.0, False), (2.0, False), (10.0, True)])
def test_an_effect_that_scatters_as_far_as_what_is_left_may_be_its_cause(left, explains):
    """A residual r of variance 1 + v gains (r^2 v / (1 + v) - log(1 + v)) / 2: 47 for r = 10 and v = 100, 0.3 for 2 and 25."""
    known = sight(*PLAIN)
    known = Sight(**{**vars(known), "residual": np.array([0, 0, left, 0, 0, 0])})
    assert (known.gain(np.array([0, 0, 100.0, 0, 0, 0])) > ODDS) is explains


@pytest.mark.parametrize("followed", [False, True])
def test_a_parameter_of_the_camera_that_does_the_same_is_what_it_cannot_be_separated_from(
    monkeypatch, followed
):
    """The shift lies along the slope of the first parameter, whose prior is wide, and not along that of the second.

    It is the same whether this parameter followed in the simulation, which leaves no shift, or not.
    """
    one = np.array([3.0, 0, 4.0, 0, 0, 0])
    slopes = np.column_stack([one, [0, 0, 0, 0, 1.0, 0]])
    wide = sight(slopes, np.array([100.0, 1.0]))
    effect = course([1.0], [0 * one], ways=[[-1.0, 0.0]]) if followed else course([1.0], [one])
    assert effect.limit(wide)[0] > 10
    coordinates = [SimpleNamespace(path=path) for path in ("black_level_dn", "gain_e_per_dn")]
    end = SimpleNamespace(
        state=SimpleNamespace(
            accepted=(), fitted=SimpleNamespace(reference=SimpleNamespace(coordinates=coordinates))
        )
    )
    for plausible, found in ((2.0, {"row_noise": ("black_level_dn",)}), (0.1, {})):
        monkeypatch.setattr(verdicts, "_plausible", lambda *_, most=plausible: most)
        assert _absorbing(end, wide, {"row_noise": effect}) == found  # pyrefly: ignore[bad-argument-type]


class Blind:
    """A laboratory in which no simulated set with an effect differs from one without, or each by as much."""

    def __init__(self, camera, shift: float):
        self.camera, self.shift, self.asked = camera, shift, []

    def moves(self, lab, reference, trials, numbers, report, word):
        self.asked.append((numbers, [trial.by_name["sigma_e"] for trial in trials]))
        return np.full((len(trials), len(numbers), 6), self.shift)

    def setting(self):
        reference = SimpleNamespace(camera=self.camera, null_scale=np.ones(6))
        trial = Trial("row_noise", (("row_noise.sigma_e", 1.0),))
        lab, signs = SimpleNamespace(whole_of=lambda values: values), SimpleNamespace(trials=(trial,))
        return SimpleNamespace(first=reference, lab=lab, signs=signs, report=None)


@pytest.mark.parametrize("specimens", [1, 2])
def test_limits_are_simulated_with_random_numbers_that_no_signature_has(monkeypatch, stated, specimens):
    """A signature of a random effect matches sets of its own random numbers whatever its strength."""
    lab = Blind(stated, 1e3)  # far from the limit, so that every round is asked for
    monkeypatch.setattr(verdicts, "moves_of", lab.moves)
    setting, one = lab.setting(), np.array([0, 0, 4.0, 0, 0, 0])
    known = {"row_noise": course([1.0], [one], [[one] * specimens])}
    verdicts._completed(setting, setting.first, sight(*PLAIN), known, ["gain_e_per_dn", "a"])  # pyrefly: ignore[bad-argument-type]
    asked = [numbers for numbers, tried in lab.asked if tried]
    assert len(asked) == verdicts.ROUNDS
    assert {len(numbers) for numbers in asked} == {MORE if specimens > 1 else 2}
    assert min(min(numbers) for numbers in asked) >= MORE
    assert len({k for numbers in asked for k in numbers}) == sum(map(len, asked))


def test_a_strength_at_which_nothing_is_shown_is_doubled(monkeypatch, stated):
    """No multiple of a shift of 0 is shown; trial values of row noise allow three doublings here."""
    lab = Blind(stated, 0.0)
    monkeypatch.setattr(verdicts, "moves_of", lab.moves)
    setting, nothing = lab.setting(), np.zeros(6)
    known = {"row_noise": course([0.1], [nothing], [[nothing] * 2])}
    after = verdicts._completed(setting, setting.first, sight(*PLAIN), known, ["gain_e_per_dn", "a"])  # pyrefly: ignore[bad-argument-type]
    tried = [of for _, each in lab.asked for of in each]
    np.testing.assert_allclose(tried, [0.2, 0.4, 0.8])
    assert after["row_noise"].limit(sight(*PLAIN), is_final=True)[0] == np.inf


def test_nothing_is_simulated_below_one_event(monkeypatch, stated):
    """A signature of many events matches far below one of them, where there is none in most sets."""
    lab = Blind(stated, 0.0)
    monkeypatch.setattr(verdicts, "moves_of", lab.moves)
    setting, one = lab.setting(), np.array([0, 0, 1e4, 0, 0, 0])
    known = {"row_noise": replace(course([0.1], [one], [[one] * 2]), least=0.05)}
    verdicts._completed(setting, setting.first, sight(*PLAIN), known, ["gain_e_per_dn", "a"])  # pyrefly: ignore[bad-argument-type]
    tried = [of for _, each in lab.asked for of in each]
    np.testing.assert_allclose(tried, [0.05, 0.1, 0.2])


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"prnu.column": 1e-6, "prnu.row": 0.003}, False),  # a trial of the rows
        ({"prnu.column": 0.003, "prnu.row": 1e-6}, True),
        ({"prnu.column": 0.001, "prnu.row": 0.001, "prnu.pixel": 0.003}, True),
        ({"row_noise.sigma_e": 0.001}, True),
        ({"saturation.full_well_e": 1e4}, True),
    ],
)
def test_a_trace_of_a_strength_beside_another_one_is_no_strength_of_its_own(values, expected):
    assert leads(Trial("prnu", tuple(values.items()))) is expected


@pytest.mark.parametrize(("factor", "step"), [(2.0, 0.06), (0.5, 0.015), (100.0, 0.2)])
def test_parameters_follow_an_effect_in_proportion_to_its_strength_within_their_priors(stated, factor, step):
    coordinates = (
        Coordinate("gain_e_per_dn", False, 0.01, 0.2),
        Coordinate("black_level_dn", False, 1.0, 5.0),
    )
    reference = SimpleNamespace(camera=stated, coordinates=coordinates, priors=np.array([0.2, 5.0]))
    trial = Trial("row_noise", (("row_noise.sigma_e", 0.01),), following=(("gain_e_per_dn", 0.03),))
    (gain, black) = verdicts._times(reference, trial, factor).following  # pyrefly: ignore[bad-argument-type, missing-attribute]
    assert gain == ("gain_e_per_dn", pytest.approx(step))
    assert black == ("black_level_dn", 0.0)


def test_limits_hold_for_the_camera_that_was_found():
    """What was found can hide others, as lost bits do: they are simulated beside it, else with the camera as given."""
    given, found = object(), object()
    setting = SimpleNamespace(first=given)
    for accepted, known in (((), given), (("bit_truncation",), found)):
        state = SimpleNamespace(accepted=accepted, fitted=SimpleNamespace(reference=found))
        assert verdicts._found(setting, SimpleNamespace(state=state)) is known  # pyrefly: ignore[bad-argument-type]
