"""Limits of absent effects, from residuals whose law is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from visaug.diagnosis import verdicts
from visaug.diagnosis.candidates.signatures import MORE, Signatures
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.criterion import ODDS
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


def course(strengths, shifts, variances=None, ways=None) -> StrengthCurve:
    shifts, own = np.array(shifts, float), np.array(strengths, float)
    variances = np.zeros_like(shifts) if variances is None else variances
    ways = np.zeros((len(own), 2)) if ways is None else np.array(ways)
    return StrengthCurve("row_noise.sigma_e", own, shifts, variances, shifts, False, ways, ways)


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


def test_an_effect_of_variance_alone_is_shown_by_the_largest_residual():
    """Residuals of variance 1 + v x^2 exceed the limit of 4 with 95 % where 4 / sd is the quantile of 52.5 %."""
    known = Sight(**{**vars(sight(*PLAIN)), "largest": 4.0})
    added = np.array([[0, 0, 100.0, 0, 0, 0]])
    random = course([1.0], [np.zeros(6)], added)
    limit, _ = random.limit(known)
    sd = 4 / norm.ppf(1 - POWER / 2)
    assert limit == pytest.approx(np.sqrt(sd**2 - 1) / 10, rel=0.15)


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


def test_limits_are_simulated_with_random_numbers_that_no_signature_has(monkeypatch, stated):
    """A signature of a random effect matches sets of its own random numbers whatever its strength."""
    asked = []

    def simulated(lab, reference, trials, numbers, report):
        asked.append(numbers)
        far = np.full((len(trials), 6), 1e3)  # far from the limit, so that every round is asked for
        return Signatures(tuple(trials), far, np.zeros_like(far))

    monkeypatch.setattr(verdicts, "simulated", simulated)
    setting = SimpleNamespace(
        first=SimpleNamespace(camera=stated),
        lab=SimpleNamespace(whole_of=lambda values: values),
        signs=SimpleNamespace(trials=(Trial("row_noise", (("row_noise.sigma_e", 1.0),)),)),
        report=None,
    )
    one = course([1.0], [np.array([0, 0, 4.0, 0, 0, 0])])
    verdicts._completed(setting, setting.first, sight(*PLAIN), {"row_noise": one}, ["gain_e_per_dn", "a"])  # pyrefly: ignore[bad-argument-type]
    assert asked
    assert min(min(numbers) for numbers in asked) >= MORE
    assert len({k for numbers in asked for k in numbers}) == sum(map(len, asked))


def test_limits_hold_for_the_camera_that_was_found():
    """What was found can hide others, as lost bits do: they are simulated beside it, else with the camera as given."""
    given, found = object(), object()
    setting = SimpleNamespace(first=given)
    for accepted, known in (((), given), (("bit_truncation",), found)):
        state = SimpleNamespace(accepted=accepted, fitted=SimpleNamespace(reference=found))
        assert verdicts._found(setting, SimpleNamespace(state=state)) is known  # pyrefly: ignore[bad-argument-type]
