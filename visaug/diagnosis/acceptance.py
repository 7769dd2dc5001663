"""Acceptance tests: an effect must remove the residuals of the statistics that it shifts, and lower the error.

Terms: a residual is measured minus modelled, per statistic, after the refit. The shift of an effect is the change of the mean
of each statistic that it causes. The tolerance of an effect's form is the residual that may stay because a real effect does
not have exactly the form of the catalogue's. Discovery frames select effects, hold-out frames confirm them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.comparison import Error, is_clear
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.parameters import Coordinate
from visaug.diagnosis.robust import p_value, standardised
from visaug.diagnosis.spread import Scatter, covered, moves_are_there, scatters_so
from visaug.fingerprint import Statistic

# Least share of the statistics that an effect shifts whose residual it must remove, as a mean over views
COVERED = 0.8
# Least share of the deviating statistics that an effect must shift: agreement with a single number is a
# coincidence
FEW = 0.1
# Least residual along an effect's shift, in standard deviations, where no single statistic deviates
FAINT = 3.0
# Largest share of the error that may stay with an accepted effect; another effect may cause most of it
REMAINING = 0.98
SHARE = 0.01  # least reduction of the error by a further effect,
# Or, where the error is above the first, a reduction by the second as a share of it
LITTLE, NEARLY_ALL = 0.002, 0.75
WIDE = 3.0  # width of an interval of the error above which the error is uninformative,
GONE = 0.2  # unless the error is at most this share of the error before
# Increase of the error that is tolerated where the error cannot show an effect, as a share of its interval,
NOISE = 0.25
RISE = 0.05  # and at most this
BY_CHANCE = 5.0  # standard deviations: a bound on the largest of several hundred statistics under the null
OFF = 4.0  # standard deviations from which a statistic counts as shifted, or as deviating
WORSE = 0.15  # largest number of statistics that may get worse, as a share of those that are explained
FORM = 0.15  # tolerance of an effect's form in one statistic, relative to what the effect explains there,
REST = 0.2  # and in all statistics together, where the form differs more
# Largest residual that may stay in a view: a share of the one before, and at least so many standard deviations.
OWED, OWED_LEAST = 0.5, 10.0
FAR_OUT = 30.0  # standard deviations above which a view that becomes consistent is evidence for the effect
POOREST = 0.75  # as COVERED, in the view where the share is smallest
LENIENT = 1.5  # factor to which these shares are known from few simulated sets
IN_ORDER = 2.0  # standard deviations within which a statistic counts as consistent,
DISTURBED = 5.0  # and beyond which an effect must not shift it,
# If all such residuals together exceed this share of what the effect explains: forms differ by less
UNDONE = 0.05
# Least share of these statistics whose mean residual must not grow, however large the effect's own variance,
NEARER = 0.6
FURTHER = 1.2  # by more than this factor
MEAN = 0.2  # standard error of the mean of a hundred simulated sets, in standard deviations of that variance
SEEN_AGAIN = 2.0  # standard deviations along an effect's shift from which the hold-out frames confirm it,
TIMES = 2.0  # and the largest ratio between residual and shift
SAME_WAY = 0.3  # cosine between the shifts of two effects above which they compete for the same residuals
# Least share of an effect's squared shift where earlier effects' forms leave less than the noise,
ELSEWHERE = 0.8
MOSTLY = 0.5  # or where the camera with the effect is adequate


@dataclass(frozen=True)
class State:
    """State of the search.

    Attributes:
        fitted: the fitted camera.
        accepted: names of the effects added so far.
        allowance, whole_allowance: tolerance of their forms, per statistic of the discovery frames and of all frames.
        moves, confirm_moves: shift by the last effect of each statistic of the discovery and of the hold-out frames; None
            where the difference of the fits before and after is used.
        scatters: accepted effects whose strength is estimated from the variance that they cause and not from a mean shift;
            that strength is not a fitted parameter.
    """

    fitted: Fitted
    accepted: tuple[str, ...]
    allowance: np.ndarray
    whole_allowance: np.ndarray
    moves: np.ndarray | None = None
    confirm_moves: np.ndarray | None = None
    scatters: tuple[Scatter, ...] = ()

    @classmethod
    def plain(cls, fitted: Fitted) -> "State":
        """The state of a camera without added effects."""
        return cls(fitted, (), np.zeros(len(fitted.residual)), np.zeros(len(fitted.whole_residual)))

    def with_effect(
        self,
        effect: str,
        fitted: Fitted,
        moves: np.ndarray | None = None,
        confirm_moves: np.ndarray | None = None,
    ) -> "State":
        """The state with one more effect, whose form adds its tolerance."""
        before = self.fitted
        return State(
            fitted,
            (*self.accepted, effect),
            np.hypot(self.allowance, FORM * _explained(before.residual, fitted.residual)),
            np.hypot(self.whole_allowance, FORM * _explained(before.whole_residual, fitted.whole_residual)),
            moves,
            confirm_moves,
            self.scatters,
        )

    @property
    def numbers(self) -> tuple[tuple[Coordinate, ...], np.ndarray, np.ndarray]:
        """All fitted parameters and their uncertainty.

        Returns the coordinates, their steps in refits of (R,) simulated sets (R, coordinates), and the standard deviation
        (coordinates,) of what the frames do not determine.
        """
        reference = self.fitted.reference
        scattering = [c for s in self.scatters for c in s.strengths]
        steps = np.hstack([reference.null_steps, *(s.steps for s in self.scatters)])
        untold = np.concatenate([reference.untold, np.zeros(len(scattering))])
        return (*reference.coordinates, *scattering), steps, untold

    @property
    def scatters_last(self) -> bool:
        """Whether the strength of the last effect is estimated from the variance that it causes."""
        return any(s.effect == self.accepted[-1] for s in self.scatters)

    @property
    def z(self) -> np.ndarray:
        """Standardised residuals of the discovery frames, with the tolerance of the accepted effects' forms in the denominator."""
        return _allowed(self.fitted.residual, self.fitted.reference.null_scale, self.allowance)

    @property
    def whole_z(self) -> np.ndarray:
        """Standardised residuals of all frames together."""
        return _allowed(
            self.fitted.whole_residual, self.fitted.reference.whole_null.scale, self.whole_allowance
        )

    @property
    def p_value(self) -> float:
        """Probability, for a complete camera, of a largest residual in all frames at least as large as this one."""
        return p_value(float(np.abs(self.whole_z).max()), self.fitted.reference.largest)


def _explained(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Reduction of each absolute residual; 0 where an effect overshoots, which is no matter of its form."""
    return np.maximum(np.abs(before) - np.abs(after), 0.0)


def _allowed(residual: np.ndarray, scale: np.ndarray, allowance: np.ndarray) -> np.ndarray:
    return standardised(residual, np.where(scale > 0, np.hypot(scale, allowance), 0.0))


def explains(statistics: Sequence[Statistic], before: State, after: State) -> bool:
    """Whether the effect removes the residuals of the statistics that it shifts: of most of them, and by most of their size.

    A very strong effect whose form is not exactly the catalogue's leaves small residuals in many statistics; then their norm
    must be within the tolerance of the form.

    A wrong effect may lower the error, but leaves residuals in statistics that it shifts, or creates new ones. An effect with
    a large variance of its own (two extremely hot pixels) is consistent with any residual; it must not increase the mean
    residuals, and what varies together in its simulated sets must deviate together (`scatters_so`).
    """
    moves = moves_of(before, after)
    if not scatters_so(before.fitted, after.fitted, moves, after.allowance):
        return False
    if after.scatters_last and not moves_are_there(before.fitted, after.fitted, moves):
        return False
    if not _seen(before, after, moves).any():
        return _explains_the_faint(before, after, moves)
    return _brings_back(statistics, before, after, 1.0)


def may_explain(statistics: Sequence[Statistic], before: State, after: State) -> bool:
    """Whether it is possible, by few simulated sets, that the effect explains the residuals that it shifts.

    Not defined for effects that are estimated from their variance, which need more sets. True for an effect that shifts no
    deviating statistic.
    """
    nothing_seen = not _seen(before, after, moves_of(before, after)).any()
    return nothing_seen or _brings_back(statistics, before, after, LENIENT)


def _seen(before: State, after: State, moves: np.ndarray) -> np.ndarray:
    """(statistics,) whether a statistic deviates and the effect shifts it."""
    return _shifted(before, after, moves) & (np.abs(before.z) > OFF)


def _shifted(before: State, after: State, moves: np.ndarray) -> np.ndarray:
    """(statistics,) whether the effect shifts a statistic beyond its noise.

    A shift that the nuisance parameters can follow, and that the refit with the effect has absorbed, does not count: smear raises
    the level of every flat as quantum efficiency does, so a deviation of that level is not the effect's to remove.
    """
    null, scale = before.fitted.reference.null, before.fitted.reference.null_scale
    changed = np.abs(standardised(before.fitted.residual - after.fitted.residual, scale)) > OFF
    return (np.abs(standardised(moves, scale)) > OFF) & ((np.abs(null.beyond(moves)) > OFF) | changed)


def _brings_back(statistics: Sequence[Statistic], before: State, after: State, lenient: float) -> bool:
    """Whether the residuals of the shifted statistics are removed, every limit relaxed by a factor."""
    scale, moves = before.fitted.reference.null_scale, moves_of(before, after)
    seen, moved = _seen(before, after, moves), np.abs(standardised(moves, scale)) > OFF
    was, now = np.abs(before.z), np.abs(after.z)
    if seen.sum() < FEW * np.count_nonzero(was > OFF) / lenient:
        return False
    views = np.array([s.view for s in statistics])
    back = now <= lenient * np.maximum(OFF, 0.3 * was)
    shares = _by_view(back, seen, views)
    covered = lenient * np.mean([share.mean() for share in shares])
    poorest = lenient * min((share.mean() for share in shares if len(share) > 2), default=1.0)
    worsened = (now > lenient * OFF) & (now > 1.5 * was)
    few = covered >= COVERED and poorest >= POOREST and worsened.sum() <= lenient * WORSE * seen.sum() + 1
    little = np.linalg.norm(now[seen | worsened]) <= lenient * REST * np.linalg.norm(was[seen])
    nearer = np.abs(after.fitted.residual) < np.maximum(FURTHER * np.abs(before.fitted.residual), OFF * scale)
    stays = np.abs(after.fitted.residual - before.fitted.residual) < MEAN * after.fitted.reference.null_scale
    only_moved = moved & (np.abs(after.fitted.residual) > 0.5 * np.abs(moves))
    disturbed = (was < IN_ORDER) & (now > DISTURBED) & only_moved
    if np.linalg.norm(now[disturbed]) > lenient * UNDONE * np.linalg.norm(was[seen]):
        return False
    kept = lenient * np.mean([share.mean() for share in _by_view(nearer | stays, seen, views)]) >= NEARER
    return bool((kept or after.scatters_last) and (few or little))


def moves_of(before: State, after: State) -> np.ndarray:
    """(statistics,) shift by the last effect; for an effect that cannot be removed, the difference of the fits before and after."""
    return before.fitted.residual - after.fitted.residual if after.moves is None else after.moves


def _by_view(which: np.ndarray, seen: np.ndarray, views: np.ndarray) -> list[np.ndarray]:
    """The values of the selected statistics, one array for each view."""
    return [which[seen & (views == view)] for view in dict.fromkeys(views[seen])]


def _explains_the_faint(before: State, after: State, moves: np.ndarray) -> bool:
    """Whether the residual along the effect's shift is removed, where no single shifted statistic deviates.

    The largest residual must be removed too, and few others may exist: beside an unknown strong effect a faint one cannot be
    identified. An effect without a mean shift must give the largest residual a variance that covers it.
    """
    scale = before.fitted.reference.null_scale
    # The effect's own shift where the refit compensates it; the difference of the fits where the refit follows it far.
    ways = [
        (off, left)
        for way in (moves, before.fitted.residual - after.fitted.residual)
        for off, left in [_along(before, after, way)]
        if off > FAINT
    ]
    worst = int(np.abs(before.z).argmax())
    if ways:
        gone = abs(after.z[worst]) <= max(BY_CHANCE, 0.3 * abs(before.z[worst]))
        others = (np.abs(before.z) > OFF) & ~covered(before.fitted, after.fitted)
        alone = FEW * np.count_nonzero(others) <= 1
        return bool(alone and gone and any(abs(left) < 0.5 * off for off, left in ways))
    return bool(after.fitted.reference.null_scale[worst] > 1.3 * scale[worst])


def _along(before: State, after: State, moves: np.ndarray) -> tuple[float, float]:
    """Residual of each state along a shift, in standard deviations, where the camera's parameters cannot reproduce it."""
    along = before.fitted.reference.null.beyond(moves)
    length = max(float(np.linalg.norm(along)), 1e-9)
    return float(before.z @ along) / length, float(after.z @ along) / length


def owes(statistics: Sequence[Statistic], before: State, after: State) -> bool:
    """Whether a view that the effect shifts deviates almost as much as before, without tolerance for the effect's form.

    Used where no further effect was found: of two effects that shift one view, the first alone leaves the other's part. An
    effect that makes a whole view consistent which deviated far keeps its name, whatever else deviates: real cameras lack
    several effects.
    """
    was, now = (
        np.abs(standardised(s.fitted.residual, s.fitted.reference.null_scale)) for s in (before, after)
    )
    seen = _shifted(before, after, moves_of(before, after)) & (was > OFF)
    views = np.array([s.view for s in statistics])
    moved_views = [views == view for view in dict.fromkeys(views[seen])]
    if any(_is_in_order(before, after, view) for view in moved_views):
        return False
    furthest = [(was[view].max(), now[view].max()) for view in moved_views]
    return any(left > max(OWED * off, OWED_LEAST) for off, left in furthest)


def _is_in_order(before: State, after: State, view: np.ndarray) -> bool:
    """Whether an effect makes a view consistent that deviated far, by its mean shift and not by its variance alone."""
    own, scale = (state.fitted.reference.null_scale[view] for state in (after, before))
    was, left = (state.fitted.residual[view] for state in (before, after))
    off = np.abs(standardised(was, scale)).max()
    back = np.abs(standardised(left, scale)).max() < 0.3 * off
    return bool(off > FAR_OUT and back and np.abs(standardised(left, own)).max() <= BY_CHANCE)


def acts_elsewhere(
    statistics: Sequence[Statistic], before: State, after: State, completes: bool = False
) -> bool:
    """Whether a further effect shifts statistics that the earlier effects leave consistent.

    Otherwise it may absorb what their forms leave. The shift must exceed the noise, which excludes effects that only add
    variance, and what the earlier effects' forms leave in the same view: if a veil leaves residuals of 20 standard deviations
    beside edges, 4 in a mirrored scene are no evidence for a ghost.

    Args:
        completes: whether no residual beyond the tolerance of forms is left with the effect.
    """
    moves, scale = moves_of(before, after), before.fitted.reference.null_scale
    form = standardised(before.allowance, scale)
    squares = before.fitted.reference.null.beyond(moves) ** 2 / (1 + form**2)
    rest = left_in_view(statistics, standardised(after.fitted.residual, scale), form >= 1)
    elsewhere = (form < 1) & (np.abs(standardised(moves, scale)) > rest)
    share = MOSTLY if completes else ELSEWHERE
    return bool(squares[elsewhere].sum() > max(share * squares.sum(), FAINT**2))


def left_in_view(statistics: Sequence[Statistic], left: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(statistics,) root mean square residual of the shifted statistics of each view; 0 in views without any."""
    views = np.array([s.view for s in statistics])
    rest = np.zeros(len(left))
    for view in dict.fromkeys(views[moved]):
        rest[views == view] = np.sqrt(np.mean(left[(views == view) & moved] ** 2))
    return rest


def says_the_same(before: State, one: np.ndarray, other: np.ndarray) -> bool:
    """Whether the shifts (statistics,) of two effects are parallel; otherwise neither excludes the other."""
    a, b = (standardised(moves, before.fitted.reference.null_scale) for moves in (one, other))
    return bool(a @ b > SAME_WAY * np.linalg.norm(a) * np.linalg.norm(b))


def is_there_again(before: State, after: State) -> bool:
    """Whether the residual of the hold-out frames along the effect's shift is about as large as that shift.

    This tests the direction of the shift alone, without the noise of the difference of two refits.
    """
    if after.confirm_moves is None:
        return False
    null = before.fitted.reference.confirm_null
    along = null.beyond(after.confirm_moves)
    length = float(np.linalg.norm(along))
    off = float(standardised(before.fitted.confirm_residual, null.scale) @ along) / max(length, 1e-9)
    return bool(off > SEEN_AGAIN and length / TIMES < off < length * TIMES)


def is_anothers(before: State, after: State) -> np.ndarray:
    """(statistics,) whether a statistic deviates far, before and after, and the last effect does not shift it."""
    scale = before.fitted.reference.null_scale
    off = (before.fitted.residual, after.fitted.residual, moves_of(before, after))
    was, left, moves = (np.abs(standardised(each, scale)) for each in off)
    return (was > FAR_OUT) & (left > FAR_OUT) & (moves < OFF)


def disturbs_nothing(before: State, after: State) -> bool:
    """Whether all statistics that were consistent stay consistent."""
    return not bool(((np.abs(before.z) < IN_ORDER) & (np.abs(after.z) > DISTURBED)).any())


def improves(
    before: tuple[Error | None, Error | None],
    after: tuple[Error | None, Error | None],
    first: bool,
    beyond_chance: bool = False,
    has_a_case: bool = False,
    there_again: bool = False,
    in_order: bool = True,
    falls_where_it_acts: bool = False,
) -> bool:
    """Whether the effect lowers the error significantly on the discovery frames, and lowers it on the hold-out frames.

    The error is a mean over all statistics, so noise hides the reduction by a faint effect, which acts in few of them. Then
    the reduction in those must be significant, and the error must not increase by more than its standard deviation or 0.05.
    Where the noise is as large as the excess, the error is uninformative and significance alone decides. Beside another
    deviation a hundred times as large the error can fall only slightly: then its decrease must be significant where the
    effect acts, and the hold-out frames must confirm it.

    A further effect must remove a share of the first excess, or almost all that is left beside a very strong effect, or gain
    enough likelihood in statistics that earlier effects do not shift (`has_a_case`); otherwise it may absorb what their forms
    leave. A first effect whose variance covers what it explains has no error to lower; it must leave all consistent
    statistics consistent (cosmic rays cover the residuals of hot pixels, but not their repetition in all frames). A second
    effect of that kind is not accepted. If the excess was clear before and the error is undetermined after, the variance
    belongs to another effect, with two exceptions: the error itself has nearly vanished (ten hot pixels of a heavy-tailed
    distribution could have been any others), or the effect has a case of its own, is confirmed, and disturbs nothing.

    Args:
        before, after: errors on the discovery and on the hold-out frames.
        first: whether it is the first effect.
        beyond_chance: whether it removes significantly more than the best effect removes under the null.
        has_a_case: whether it gains enough likelihood where the earlier effects shift almost nothing.
        there_again: see `is_there_again`; confirms an effect with a case of its own.
        in_order: see `disturbs_nothing`.
        falls_where_it_acts: whether the effect is confirmed and the error falls significantly without the statistics of
            `is_anothers`.
    """
    (found_before, confirmed_before), (found, confirmed) = before, after
    if found is None or found_before is None:
        return first and in_order
    if (has_a_case or (first and beyond_chance)) and not is_clear(found_before):
        return True
    is_wide = is_clear(found_before) and found.high - found.low > WIDE
    if is_wide and found.value > GONE * found_before.value and not (has_a_case and there_again and in_order):
        return False
    if not first:
        taken = found_before.value - found.value
        all_that_is_left = found_before.value > LITTLE and taken > NEARLY_ALL * found_before.value
        if taken < SHARE and not all_that_is_left and not has_a_case:
            return False
    beside_more = first and has_a_case and falls_where_it_acts
    if found.value > REMAINING * found_before.value + _noise(found, beyond_chance) and not beside_more:
        return False
    if found.high >= found_before.value and not beyond_chance:
        return False
    if confirmed is None or confirmed_before is None or not is_clear(confirmed):
        return True  # too few frames, or a variance that covers them: no contradiction
    falls = confirmed.value < confirmed_before.value + _noise(confirmed, beyond_chance)
    return falls or (has_a_case and there_again)


def _noise(error: Error, beyond_chance: bool) -> float:
    """Increase of the error that is possible by chance where the explained part is significant."""
    return min(NOISE * (error.high - error.low), RISE) if beyond_chance else 0.0
