"""When an effect is accepted: the error must fall on both sorts of frames, and a further one must take its share."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.diagnosis.residuals import spread, state
from visaug.comparison import Error
from visaug.diagnosis.acceptance import (
    State,
    _along,
    acts_elsewhere,
    disturbs_nothing,
    explains,
    improves,
    is_anothers,
    is_there_again,
    may_explain,
    owes,
    says_the_same,
)
from visaug.fingerprint import Statistic


def at(value: float, half: float = 0.01) -> Error:
    return Error(value, value - half, value + half)


@pytest.mark.parametrize(
    ("before", "after", "first", "accepted"),
    [
        ((at(1.0), at(1.0)), (at(0.1), at(0.1)), True, True),
        ((at(1.0), at(1.0)), (at(0.995), at(0.9)), True, False),  # within chance on the discovery frames
        ((at(1.0), at(1.0)), (at(0.1), at(1.2)), True, False),  # the hold-out frames disagree
        ((at(1.0), at(1.0)), (at(0.1), at(7.0, 2.0)), True, True),  # these are too unclear to disagree
        (
            (at(1.0, 1e-4), at(1.0)),
            (at(0.985, 1e-4), at(0.9)),
            True,
            False,
        ),  # beyond chance, but next to nothing
        ((at(0.001, 1e-5), at(0.001)), (at(0.0, 1e-5), at(0.0)), False, False),  # a trace is mopped up
        (
            (at(0.008, 1e-4), at(0.008)),
            (at(0.006, 1e-4), at(0.006)),
            False,
            False,
        ),  # a part of little is, too
        ((at(0.008, 1e-4), at(0.008)), (at(0.0005, 1e-4), at(0.0)), False, True),  # faint beside a strong one
        ((at(0.3), at(0.3)), (at(0.0), at(0.0)), False, True),
        ((None, None), (None, None), True, True),
        ((None, None), (None, None), False, False),
        ((at(1.0), None), (at(0.2), None), True, True),  # no frames to confirm on
    ],
)
def test_improves(before, after, first, accepted):
    assert improves(before, after, first) is accepted


def test_a_faint_effect_is_hidden_by_the_noise_of_the_rest():
    before, after = (at(0.05, 0.4), None), (at(-0.1, 0.4), None)
    assert not improves(before, after, True)
    assert improves(before, after, True, beyond_chance=True)
    assert not improves(after, before, True, beyond_chance=True)


def test_an_error_that_cannot_show_an_effect_may_rise_by_a_standard_deviation():
    """But not because an effect has so wide a spread that nothing can be said."""
    before, after = (at(0.003, 0.1), at(-0.02, 0.1)), (at(0.005, 0.1), at(-0.01, 0.1))
    assert improves(before, after, True, beyond_chance=True)
    assert not improves(before, after, True)
    assert not improves(before, (at(0.005, 0.1), at(0.04, 0.1)), True, beyond_chance=True)
    assert not improves(before, (at(0.1, 0.4), at(-0.01, 0.1)), True, beyond_chance=True)


@pytest.mark.parametrize(
    ("beyond_chance", "has_a_case", "there_again", "in_order", "accepted"),
    [
        (True, True, True, True, True),
        (True, False, True, True, False),
        (True, True, False, True, False),  # the hold-out frames show nothing along its moves
        (True, True, True, False, False),  # tracks of cosmic rays in the place of hot pixels
    ],
)
def test_a_wide_spread_is_refused_but_of_an_effect_that_is_there_again(
    beyond_chance, has_a_case, there_again, in_order, accepted
):
    before, after = (at(0.7, 0.3), at(0.6, 0.7)), (at(0.4, 2.0), None)
    assert improves(before, after, True, beyond_chance, has_a_case, there_again, in_order) is accepted


def test_an_error_that_is_noise_alone_has_no_say():
    before, after = (at(-12.0, 14.0), None), (at(-7.0, 7.0), None)
    assert improves(before, after, True, beyond_chance=True)
    assert not improves(before, after, True)


def test_an_explanation_after_which_nothing_can_be_said_of_a_clear_error_is_none():
    """A pixel or two, enormously hot, in place of a dark current that differs from pixel to pixel."""
    after = (at(0.6, 4.0), at(1.8, 4.0))
    assert not improves((at(0.98, 0.02), at(0.98, 0.05)), after, True, beyond_chance=True)
    assert improves(
        (at(0.98, 2.0), at(0.98, 2.0)), after, True, beyond_chance=True
    )  # it was not clear before


def test_an_error_that_is_gone_needs_no_narrow_interval():
    """Ten hot pixels whose rates have a long tail: another ten would differ by all they add, but these are explained."""
    before = (at(0.98, 0.02), at(0.98, 2.0))
    assert improves(before, (at(0.05, 3.0), at(-7.0, 16.0)), True, beyond_chance=True)
    assert not improves(before, (at(0.3, 3.0), at(-7.0, 16.0)), True, beyond_chance=True)


def test_what_lowers_no_error_needs_a_case_for_a_second_name():
    before, after = (at(0.0018), at(0.0009)), (at(-0.001), at(-0.0005))
    assert not improves(before, after, False, beyond_chance=True)
    assert improves(before, after, False, beyond_chance=True, has_a_case=True)


def test_a_case_of_its_own_is_confirmed_where_the_effect_itself_is_seen_again():
    """However the rest of the error wavers; but an error that rises is no confirmation of what has no case."""
    before, after = (at(0.05), at(0.01, 0.07)), (at(-0.02), at(0.08, 0.07))
    assert not improves(before, after, False, beyond_chance=True, has_a_case=True)
    assert improves(before, after, False, beyond_chance=True, has_a_case=True, there_again=True)
    assert not improves(before, after, False, beyond_chance=True, there_again=True)


def test_a_case_of_its_own_counts_where_the_error_is_noise_alone():
    before, after = (at(-0.3, 0.6), at(0.1, 3.0)), (at(-0.2, 0.6), at(0.2, 3.0))
    assert not improves(before, after, False, beyond_chance=True)
    assert improves(before, after, False, beyond_chance=True, has_a_case=True)


def accepted(before, after, moves) -> bool:
    statistics = [SimpleNamespace(view=f"view {i}") for i in range(len(before))]
    return explains(statistics, state(before), state(after, np.array(moves, float)))  # type: ignore[arg-type]


def test_a_faint_effect_must_bring_back_what_is_furthest_off():
    assert accepted([3.5, 3.5, 2.0], [0.5, 0.5, 0.5], [3, 3, 1.5])
    assert not accepted([3.5, 3.5, 38.0], [0.5, 0.5, 38.0], [3, 3, 0])
    assert accepted([3.5, 3.5, 4.1], [0.5, 0.5, 4.1], [3, 3, 0])  # as one of a thousand is by chance


def test_a_faint_effect_counts_where_the_cameras_own_numbers_follow_it_far():
    """Charge in every frame moves the level one way, the black level takes it back the other: only the refit tells what is gone."""
    assert accepted([3.9, 3.6], [1.0, 0.5], [0.2, -8.0])
    assert not accepted([3.9, 3.6], [3.6, 3.3], [0.2, -8.0])  # hardly any of it is


def test_a_faint_effect_is_no_guess_where_much_is_off():
    """A refit may bring back what is off, with an effect that moves nothing of it."""
    few, many = [30.0] * 5, [30.0] * 20
    assert accepted([3.5, 3.5, *few], [0.5, 0.5, *[1.0] * 5], [3, 3, *[0] * 5])
    assert not accepted([3.5, 3.5, *many], [0.5, 0.5, *[1.0] * 20], [3, 3, *[0] * 20])


def test_what_the_cameras_own_numbers_undo_does_not_count():
    """Charge in every frame moves the level far, which the black level takes back, and the skewness, which nothing does."""
    moves = np.array([60.0, 3.5])
    before, after = state([0.5, 3.5]), state([0.5, 0.5], moves)
    statistics = [SimpleNamespace(view="level"), SimpleNamespace(view="tails")]
    assert not explains(statistics, before, state([-59.5, 0.0], moves))  # type: ignore[arg-type]
    assert _along(before, after, moves)[0] == pytest.approx((0.5 * 60 + 3.5 * 3.5) / 60.1, abs=0.01)
    black = np.array([[50.0], [0.0]])
    for s in (before, after):
        reference = s.fitted.reference
        reference.null = replace(reference.null, slopes=black, priors=np.array([30.0]))
    assert _along(before, after, moves) == pytest.approx((3.5, 0.5), abs=0.01)
    assert explains(statistics, before, after)  # type: ignore[arg-type]


def test_a_strong_effect_need_not_bring_back_what_the_cameras_own_numbers_follow():
    """Smear raises the level of flats, which the quantum efficiency takes back: what a drifting lamp leaves there is not its."""
    moves = np.array([8.0, 8.0, 19.0, 12.0, 9.0])
    left = [8.4, -5.0, 0.0, 0.5, 0.0]
    before, after = state([8.4, -5.0, 19.0, 12.0, 9.0]), state(left, moves)
    statistics = [SimpleNamespace(view=view) for view in ("level", "level", "scene", "scene", "scene")]
    assert not explains(statistics, before, after)  # type: ignore[arg-type]
    assert owes(statistics[:2], state([8.4, 40.0]), state([8.4, 40.0], moves[:2]))  # type: ignore[arg-type]
    efficiency = np.array([[50.0], [50.0], [0.0], [0.0], [0.0]])
    for s in (before, after):
        reference = s.fitted.reference
        reference.null = replace(reference.null, slopes=efficiency, priors=np.array([30.0]))
    assert explains(statistics, before, after)  # type: ignore[arg-type]


def test_a_strong_effect_must_bring_back_what_it_moves():
    assert accepted([20, 30, 40], [1, 2, 39], [20, 30, 0])
    assert not accepted([20, 30, 40], [1, 29, 39], [20, 30, 0])  # half of it stays
    assert not accepted([20, 0, 0], [0, 9, 9], [20, 9, 9])  # as much goes off as comes back


@pytest.mark.parametrize(
    ("left", "may", "does"),
    [
        ([30, 28, 25, 31, 20, 22], False, False),  # none comes back
        ([12, 12, 11, 13, 9, 9], True, False),  # not quite by what is asked
        ([30, 28, 25, 5, 1, 1], False, False),
        ([8, 8, 7, 8, 1, 1], True, True),
    ],
)
def test_from_few_sets_only_what_misses_a_limit_by_far_is_refused(left, may, does):
    before, moves = [30.0, 28.0, 25.0, 31.0, 20.0, 22.0], np.full(6, 20.0)
    views = [SimpleNamespace(view=f"view {i}") for i in range(6)]
    after = state(left, moves)
    assert may_explain(views, state(before), after) is may  # type: ignore[arg-type]
    assert explains(views, state(before), after) is does  # type: ignore[arg-type]
    unseen = state(left, np.zeros(6))
    assert may_explain(views, state(before), unseen)  # type: ignore[arg-type]


def test_a_spread_that_covers_anything_is_no_explanation():
    """Two pixels, enormously hot: every residual is small in standard deviations that they bring, and the means go further off."""
    before, moves = [20.0, 30.0, 40.0], np.array([60.0, 90.0, 30.0])
    after = spread(state([-45.0, -70.0, 10.0], moves), 100.0)
    views = [SimpleNamespace(view=f"view {i}") for i in range(3)]
    assert not explains(views, state(before), after)  # type: ignore[arg-type]
    after.fitted.residual[:] = [-15.0, -20.0, 10.0]
    assert explains(views, state(before), after)  # type: ignore[arg-type]


@pytest.mark.parametrize(("others", "is_accepted"), [(5, True), (20, False)])
def test_deviations_that_the_effects_own_variance_covers_are_no_others(others, is_accepted):
    """A cosmic-ray track makes twenty statistics of its frame deviate; the mean of simulated tracks shifts none far."""
    before, left, rest = [50.0] * 20, [30.0] * 20, [9.0] * others
    after = spread(state([*left, *rest], np.zeros(20 + others)), np.repeat([30.0, 1.0], [20, others]))
    views = [SimpleNamespace(view=f"view {i}") for i in range(20 + others)]
    assert explains(views, state([*before, *rest]), after) is is_accepted  # type: ignore[arg-type]


def test_a_strong_effect_of_another_form_leaves_many_statistics_off_each_by_a_little():
    """A gamma distribution of dark current in place of the catalogue's: the skewness stays off, beside a spread that comes back."""
    before = [200.0, 150.0, 26.0, 25.0, 34.0]
    moves = [200.0, 150.0, 14.0, 17.0, 20.0]
    assert accepted(before, [1.0, 2.0, 12.0, 9.0, 15.0], moves)
    assert not accepted(before, [1.0, 60.0, 12.0, 9.0, 15.0], moves)  # more than a form leaves over
    assert not accepted([b / 4 for b in before], [1.0, 15.0, 12.0, 9.0, 15.0], [m / 4 for m in moves])


def test_a_mean_may_go_a_little_further_off_where_the_effect_draws_it_anew():
    after = spread(state([23.0, -34.0, 46.0], np.array([-12.0, 25.0, 15.0])), 15.0)
    views = [SimpleNamespace(view=f"view {i}") for i in range(3)]
    assert explains(views, state([20.0, -30.0, 40.0]), after)  # type: ignore[arg-type]
    after.fitted.residual[:] = [26.0, -40.0, 55.0]
    assert not explains(views, state([20.0, -30.0, 40.0]), after)  # type: ignore[arg-type]


def test_a_drift_need_not_bring_the_means_nearer():
    """Its simulated sets lie all around the camera's: their mean stays where it was, but for the noise of a hundred of them."""
    before, moves = [20.0, -30.0, 40.0], np.array([-12.0, 25.0, 15.0])
    after = spread(state([22.0, -33.0, 39.0], moves), 25.0)
    views = [SimpleNamespace(view=f"view {i}") for i in range(3)]
    assert explains(views, state(before), after)  # type: ignore[arg-type]


def test_what_was_in_order_must_not_be_moved_away():
    """Crosstalk taken for brighter-fatter: all edges come back, and their growth with the level goes off."""
    back = [20.0] * 8
    assert accepted([*back, 0.5], [*[0.5] * 8, 0.5], [*back, 8])
    assert not accepted([*back, 0.5], [*[0.5] * 8, -7.5], [*back, 8])
    assert accepted([*back, 0.5], [*[0.5] * 8, -7.5], [*back, 300])  # the camera's numbers had covered it
    assert accepted(
        [*back, 0.5], [*[0.5] * 8, -7.5], [*back, 0]
    )  # another effect's, which the refit no longer hides


def test_a_little_that_goes_off_beside_much_that_comes_back_is_the_form():
    """1/f noise whose frames do not move as a whole: all rows come back, and frame means are predicted to drift a little."""
    back = [60.0] * 8
    assert accepted([*back, 0.5], [*[0.5] * 8, -7.5], [*back, 8])
    assert not accepted([*back, 0.5, 0.5], [*[0.5] * 8, -7.5, 7.5], [*back, 8, -8])


def test_a_single_number_among_many_is_a_coincidence():
    many = [30.0] * 20
    assert not accepted([140, *many], [0, *many], [140, *[0] * 20])
    assert accepted([140, 20, 20, *many], [0, 0, 0, *many], [140, 20, 20, *[0] * 20])


def test_a_second_effect_that_moves_what_the_first_leaves_alone_has_a_case():
    apart = [Statistic(view, "", "", ()) for view in ("codes", "rows", "columns")]
    first = State(
        state([0.0, 4.0, 4.0]).fitted,
        ("bit_truncation",),
        np.array([50.0, 0.0, 0.0]),
        np.array([50.0, 0.0, 0.0]),
    )
    assert acts_elsewhere(apart, first, state([0.0, 0.0, 0.0], np.array([1.0, 4.0, 4.0])))
    assert acts_elsewhere(
        apart, first, state([0.0, 0.0, 0.0], np.array([20.0, 4.0, 4.0]))
    )  # its share of a form's fifty is nothing
    assert not acts_elsewhere(apart, first, state([0.0, 4.0, 4.0], np.array([60.0, 0.3, 0.0])))
    assert not acts_elsewhere(
        apart, first, state([0.0, 4.0, 4.0], np.array([0.0, 0.3, 0.3]))
    )  # it only brings a spread
    shared = state([0.0, 0.0, 0.0], np.array([150.0, 4.0, 1.0]))  # two thirds of it elsewhere
    assert not acts_elsewhere(apart, first, shared)
    assert acts_elsewhere(
        apart, first, shared, completes=True
    )  # smear along the columns beside a blur of all edges
    assert not acts_elsewhere(
        apart, first, state([0.0, 0.0, 0.0], np.array([600.0, 4.0, 1.0])), completes=True
    )


@pytest.mark.parametrize(("rest", "has"), [(20.0, False), (1.0, True)])
def test_what_forms_leave_in_a_view_is_more_than_a_little_beside_it(rest, has):
    """Two statistics of a mirrored scene 4 off beside a veil: a ghost, but not where the veil's form leaves 20 in such scenes."""
    scene = [Statistic("scene", "", "", ())] * 4
    explained = np.array([500.0, 500.0, 0.0, 0.0])
    veil = State(state([rest, rest, 4.0, 4.0]).fitted, ("veiling_glare",), explained, explained)
    ghost = state([rest, rest, 0.0, 0.0], np.array([0.0, 0.0, 4.0, 4.0]))
    assert acts_elsewhere(scene, veil, ghost) is has
    assert acts_elsewhere([*scene[:2], *[Statistic("mirrored", "", "", ())] * 2], veil, ghost)


@pytest.mark.parametrize(
    ("off", "moves", "again"),
    [
        ([3.0, 3.0, 0.0], [3.0, 3.0, 0.0], True),
        ([3.0, 3.0, 9.0], [3.0, 3.0, 0.0], True),  # the rest has no say
        ([0.0, 0.0, 9.0], [3.0, 3.0, 0.0], False),
        ([-3.0, -3.0, 0.0], [3.0, 3.0, 0.0], False),
        ([3.0, 3.0, 0.0], [30.0, 30.0, 0.0], False),  # it would move them ten times as far
        ([1.0, 1.0, 0.0], [1.0, 1.0, 0.0], False),  # too faint to tell
    ],
)
def test_seen_again(off, moves, again):
    assert is_there_again(state(off), state([0.0, 0.0, 0.0], np.array(moves))) is again


def test_two_effects_that_move_different_statistics_do_not_say_the_same():
    before = state([9.0, 9.0, 9.0, 9.0])
    drift, crosstalk, blur = np.array([[9.0, 0, 0, 1], [0, 9.0, 8.0, 0], [0, 7.0, 9.0, 3.0]])
    assert not says_the_same(before, crosstalk, drift)
    assert says_the_same(before, crosstalk, blur)


def test_where_an_effect_overshoots_its_form_is_no_excuse():
    """An allowance is a share of how much nearer a residual came."""
    z = state([100.0, 100.0, 100.0, 0.0]).with_effect("blur", state([10.0, -10.0, -400.0, 50.0]).fitted).z
    assert z[:2] == pytest.approx([10 / np.hypot(1, 13.5), -10 / np.hypot(1, 13.5)])
    assert z[2:] == pytest.approx([-400.0, 50.0])


@pytest.mark.parametrize(
    ("left", "owed"),
    [
        ([5.0, 5.0, 600.0], False),  # the view that it does not move is another's
        ([5.0, 70.0, 600.0], True),
        ([5.0, -900.0, 600.0], True),  # further off than before
        ([5.0, 40.0, 600.0], False),  # a form that is not the catalogue's
    ],
)
def test_an_effect_owes_the_views_that_it_moves(left, owed):
    before, after = state([80.0, 100.0, 600.0]), state(left, np.array([80.0, 60.0, 0.0]))
    views = [SimpleNamespace(view=view) for view in ("codes", "codes", "scene")]
    assert owes(views, before, after) is owed  # type: ignore[arg-type]


@pytest.mark.parametrize(("rows", "wide", "owed"), [(2.0, 1.0, False), (40.0, 1.0, True), (40.0, 20.0, True)])
def test_a_view_brought_from_far_out_to_order_speaks_for_a_name_whatever_else_is_off(rows, wide, owed):
    """Noise that rows share on a real camera, whose seams and codes are off by other effects; covered is not brought back."""
    before, after = state([72.0, 43.0, 88.0]), state([rows, 43.0, 86.0], np.array([72.0, 5.0, 11.0]))
    after = spread(after, np.array([wide, 1.0, 1.0]))
    views = [SimpleNamespace(view=view) for view in ("temporal_lines", "seams", "codes")]
    assert owes(views, before, after) is owed  # type: ignore[arg-type]


def test_what_has_no_error_to_lower_leaves_in_order_what_was():
    before = state([500.0, 1.6, 0.0])
    assert disturbs_nothing(before, state([2.0, 4.0, 3.0]))
    assert not disturbs_nothing(before, state([2.0, 8.3, 3.0]))
    nothing = (None, None)
    assert not improves(nothing, nothing, True, in_order=False)


def test_beside_what_is_a_hundred_times_as_far_off_an_error_falls_by_little():
    """A veil beside what blooms: it must surely fall where the effect acts, and the effect be there again."""
    before, after = (at(1.0, 0.02), at(1.0, 0.02)), (at(1.01, 0.02), at(0.99, 0.02))
    case = {"beyond_chance": True, "has_a_case": True, "falls_where_it_acts": True}
    assert improves(before, after, True, **case)
    for lacking in case:
        assert not improves(before, after, True, **{**case, lacking: False})


def test_what_stays_far_out_and_is_not_moved_is_anothers():
    """Codes that never come beside bands of columns: one statistic 55 standard deviations off, whichever bands there are."""
    before = state([300.0, 20.0, 300.0, 300.0])
    after = state([310.0, 1.0, 20.0, 290.0], np.array([0.0, 19.0, 280.0, 10.0]))
    assert is_anothers(before, after).tolist() == [True, False, False, False]
