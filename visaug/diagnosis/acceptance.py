"""When an effect is accepted: it brings back what it moves, and the error falls."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.comparison import Error, is_clear
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.parameters import Coordinate
from visaug.diagnosis.robust import p_value, standardised
from visaug.diagnosis.spread import Scatter, moves_are_there, scatters_so
from visaug.fingerprint import Statistic

COVERED = 0.8  # share of the statistics an effect moves that it must bring back, mean over views
FEW = 0.1  # share of the statistics that are off which an effect must move: one that fits a single number is a coincidence
FAINT = 3.0  # standard deviations along an effect's moves that count where no single statistic stands out
REMAINING = 0.98  # share of the error that an accepted effect may leave; another effect may hold most of it
SHARE = 0.01  # error that a further effect must take away,
LITTLE, NEARLY_ALL = 0.002, 0.75  # or, where more than so little is left, this share of it
WIDE = 3.0  # an interval of the error that says nothing,
GONE = 0.2  # unless the error itself is no more than so much of what it was
NOISE = 0.25  # of its interval, a standard deviation: so much may an error rise that cannot show an effect,
RISE = 0.05  # and no more than this
BY_CHANCE = 5.0  # standard deviations that one of many hundred statistics may be off
OFF = 4.0  # standard deviations from which a statistic counts as moved, or as off
WORSE = 0.15  # statistics that may go off, as a share of those that it explains
FORM = 0.15  # what a real effect's form may leave over in a statistic, relative to the effect itself,
REST = 0.2  # and in all together, where the form is not nearly the catalogue's
OWED, OWED_LEAST = (
    0.5,
    10.0,
)  # share of the furthest statistic of a view, and standard deviations, that no explanation leaves
FAR_OUT = 30.0  # standard deviations from which a view that is in order afterwards speaks for the effect
POOREST = 0.75  # the same share in the view that it explains least
LENIENT = 1.5  # factor to which these are known from few simulated sets
IN_ORDER = 2.0  # standard deviations within which a statistic was in order,
DISTURBED = 5.0  # and to which an effect must not move it off,
UNDONE = 0.05  # if all such are more than so much of all that it is seen in: no form differs by more
NEARER = 0.6  # share of the same statistics whose mean must not go further off, however wide the effect's own spread,
FURTHER = 1.2  # by more than this factor
MEAN = 0.2  # standard deviations of that spread to which the mean of a hundred simulated sets is known
SEEN_AGAIN = 2.0  # standard deviations along an effect's moves from which it is seen again,
TIMES = 2.0  # and by what factor these may differ from the moves
SAME_WAY = 0.3  # cosine between the moves of two effects from which they say the same
ELSEWHERE = 0.8  # share of an effect's moves, squared, that lies where no form of the effects before it leaves as much as noise,
MOSTLY = 0.5  # or where the camera holds with it


@dataclass(frozen=True)
class State:
    """Where the search stands.

    Attributes:
        fitted: the fitted camera.
        accepted: the effects that it has gained.
        allowance, whole_allowance: what their forms may leave over, per statistic of the discovery frames and of all frames.
        moves, confirm_moves: how far the last of them moves each statistic of the discovery and of the hold-out frames; None
            where the refits before and after tell it.
        scatters: of accepted effects whose strength their scatter tells, not their moves; that strength is no free number.
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
        """Of a camera that has gained nothing."""
        return cls(fitted, (), np.zeros(len(fitted.residual)), np.zeros(len(fitted.whole_residual)))

    def with_effect(
        self,
        effect: str,
        fitted: Fitted,
        moves: np.ndarray | None = None,
        confirm_moves: np.ndarray | None = None,
    ) -> "State":
        """With one effect more, of whose moves a share is the form's."""
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
        """All numbers that were fitted, and their uncertainty.

        (R, numbers) how far simulated sets of the camera take them; (numbers,) standard deviation of what the frames leave open.
        """
        reference = self.fitted.reference
        scattering = [c for s in self.scatters for c in s.strengths]
        steps = np.hstack([reference.null_steps, *(s.steps for s in self.scatters)])
        untold = np.concatenate([reference.untold, np.zeros(len(scattering))])
        return (*reference.coordinates, *scattering), steps, untold

    @property
    def scatters_last(self) -> bool:
        """Whether the last effect is one that scatters more than it moves."""
        return any(s.effect == self.accepted[-1] for s in self.scatters)

    @property
    def z(self) -> np.ndarray:
        """Residuals of the discovery frames in standard deviations, the forms of accepted effects allowed for."""
        return _allowed(self.fitted.residual, self.fitted.reference.null_scale, self.allowance)

    @property
    def whole_z(self) -> np.ndarray:
        """The same of all frames together."""
        return _allowed(
            self.fitted.whole_residual, self.fitted.reference.whole_null.scale, self.whole_allowance
        )

    @property
    def p_value(self) -> float:
        """That a camera lacking nothing leaves as large a residual somewhere in all frames together."""
        return p_value(float(np.abs(self.whole_z).max()), self.fitted.reference.largest)


def _explained(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """How much nearer each residual has come: where an effect overshoots, its form is no excuse."""
    return np.maximum(np.abs(before) - np.abs(after), 0.0)


def _allowed(residual: np.ndarray, scale: np.ndarray, allowance: np.ndarray) -> np.ndarray:
    return standardised(residual, np.where(scale > 0, np.hypot(scale, allowance), 0.0))


def explains(statistics: Sequence[Statistic], before: State, after: State) -> bool:
    """Whether the effect brings back what it moves: most of the statistics in which it is seen, by most of their distance.

    Of a very strong effect whose form is not quite the catalogue's many statistics stay off, each by a little: then all
    of them together must be no more than a form leaves over.

    An effect of another name may lower the error; but what it moves then stays off, or goes off where it was not. One whose own
    spread covers anything (two pixels, enormously hot) must not take the means further off, and what it scatters together must be
    off together (`scatters_so`).
    """
    moves = moves_of(before, after)
    if not scatters_so(before.fitted, after.fitted, moves, after.allowance):
        return False
    if after.scatters_last and not moves_are_there(before.fitted, after.fitted, moves):
        return False
    if not _seen(before, moves).any():
        return _explains_the_faint(before, after, moves)
    return _brings_back(statistics, before, after, 1.0)


def may_explain(statistics: Sequence[Statistic], before: State, after: State) -> bool:
    """Whether a state that is known from few simulated sets leaves it open that the effect explains what it moves.

    Not to be asked of an effect that scatters more than it moves, which needs more sets; of one that moves nothing that stands out
    nothing is said.
    """
    nothing_seen = not _seen(before, moves_of(before, after)).any()
    return nothing_seen or _brings_back(statistics, before, after, LENIENT)


def _seen(before: State, moves: np.ndarray) -> np.ndarray:
    """(statistics,) where an effect is seen: off, and moved."""
    return (np.abs(standardised(moves, before.fitted.reference.null_scale)) > OFF) & (np.abs(before.z) > OFF)


def _brings_back(statistics: Sequence[Statistic], before: State, after: State, lenient: float) -> bool:
    """Whether what an effect moves comes back; no limit is missed by more than a factor."""
    scale, moves = before.fitted.reference.null_scale, moves_of(before, after)
    seen, moved = _seen(before, moves), np.abs(standardised(moves, scale)) > OFF
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
    """How far the last effect moves each statistic; where it cannot be taken away, by what the refits leave without and with it."""
    return before.fitted.residual - after.fitted.residual if after.moves is None else after.moves


def _by_view(which: np.ndarray, seen: np.ndarray, views: np.ndarray) -> list[np.ndarray]:
    """Of the statistics that are seen, one array for each view."""
    return [which[seen & (views == view)] for view in dict.fromkeys(views[seen])]


def _explains_the_faint(before: State, after: State, moves: np.ndarray) -> bool:
    """Whether what was off along the effect's moves is gone, where no single statistic stands out that it moves far.

    What is furthest off must be gone too, and not much else be off: beside a strong effect that no one knows, a faint one is a
    guess. An effect that moves nothing on the average must give that statistic a spread which covers it.
    """
    scale = before.fitted.reference.null_scale
    # by the effect itself, where the camera's own numbers hide it; by the refit, where they follow it far
    ways = [
        (off, left)
        for way in (moves, before.fitted.residual - after.fitted.residual)
        for off, left in [_along(before, after, way)]
        if off > FAINT
    ]
    worst = int(np.abs(before.z).argmax())
    if ways:
        gone = abs(after.z[worst]) <= max(BY_CHANCE, 0.3 * abs(before.z[worst]))
        alone = FEW * np.count_nonzero(np.abs(before.z) > OFF) <= 1
        return bool(alone and gone and any(abs(left) < 0.5 * off for off, left in ways))
    return bool(after.fitted.reference.null_scale[worst] > 1.3 * scale[worst])


def _along(before: State, after: State, moves: np.ndarray) -> tuple[float, float]:
    """Standard deviations that each state is off along some moves, as far as the camera's own numbers cannot make them."""
    along = before.fitted.reference.null.beyond(moves)
    length = max(float(np.linalg.norm(along)), 1e-9)
    return float(before.z @ along) / length, float(after.z @ along) / length


def owes(statistics: Sequence[Statistic], before: State, after: State) -> bool:
    """Whether a view that an effect moves is nearly as far off as before, nothing allowed for the effect's form.

    To be asked where nothing more was found: of two effects that move one view the first leaves the other's share. One that brings
    a whole view from far out to order keeps its name whatever else is off: real cameras lack more than one effect.
    """
    scale = before.fitted.reference.null_scale
    was, now = (
        np.abs(standardised(s.fitted.residual, s.fitted.reference.null_scale)) for s in (before, after)
    )
    seen = (np.abs(standardised(moves_of(before, after), scale)) > OFF) & (was > OFF)
    views = np.array([s.view for s in statistics])
    moved_views = [views == view for view in dict.fromkeys(views[seen])]
    if any(_is_in_order(before, after, view) for view in moved_views):
        return False
    furthest = [(was[view].max(), now[view].max()) for view in moved_views]
    return any(left > max(OWED * off, OWED_LEAST) for off, left in furthest)


def _is_in_order(before: State, after: State, view: np.ndarray) -> bool:
    """Whether all statistics of a view that was far out are in order with an effect: brought back, not only covered."""
    own, scale = (state.fitted.reference.null_scale[view] for state in (after, before))
    was, left = (state.fitted.residual[view] for state in (before, after))
    off = np.abs(standardised(was, scale)).max()
    back = np.abs(standardised(left, scale)).max() < 0.3 * off
    return bool(off > FAR_OUT and back and np.abs(standardised(left, own)).max() <= BY_CHANCE)


def acts_elsewhere(
    statistics: Sequence[Statistic], before: State, after: State, completes: bool = False
) -> bool:
    """Whether a further effect moves what the effects before it leave alone, so that it cannot mop up what their forms leave.

    And moves it by more than noise: one that only brings a spread, wherever that fits, has no case of its own. And by more than
    their forms leave in the same view: of a veil that stays 20 standard deviations off beside edges, 4 of a mirrored scene are no
    ghost.

    Args:
        completes: whether nothing stands out any more with the effect, beyond what forms may leave.
    """
    moves, scale = moves_of(before, after), before.fitted.reference.null_scale
    form = standardised(before.allowance, scale)
    squares = before.fitted.reference.null.beyond(moves) ** 2 / (1 + form**2)
    rest = left_in_view(statistics, standardised(after.fitted.residual, scale), form >= 1)
    elsewhere = (form < 1) & (np.abs(standardised(moves, scale)) > rest)
    share = MOSTLY if completes else ELSEWHERE
    return bool(squares[elsewhere].sum() > max(share * squares.sum(), FAINT**2))


def left_in_view(statistics: Sequence[Statistic], left: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(statistics,) root mean square that effects leave of what they move in the view of each; 0 in views that they do not move."""
    views = np.array([s.view for s in statistics])
    rest = np.zeros(len(left))
    for view in dict.fromkeys(views[moved]):
        rest[views == view] = np.sqrt(np.mean(left[(views == view) & moved] ** 2))
    return rest


def says_the_same(before: State, one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two effects' moves (statistics,) go the same way: else both may be there, the one no reason against the other."""
    a, b = (standardised(moves, before.fitted.reference.null_scale) for moves in (one, other))
    return bool(a @ b > SAME_WAY * np.linalg.norm(a) * np.linalg.norm(b))


def is_there_again(before: State, after: State) -> bool:
    """Whether the hold-out frames are off along the effect's own moves, by about as much as it moves them.

    A question to these moves alone: all the rest of an error wavers as the refits before and after waver.
    """
    if after.confirm_moves is None:
        return False
    null = before.fitted.reference.confirm_null
    along = null.beyond(after.confirm_moves)
    length = float(np.linalg.norm(along))
    off = float(standardised(before.fitted.confirm_residual, null.scale) @ along) / max(length, 1e-9)
    return bool(off > SEEN_AGAIN and length / TIMES < off < length * TIMES)


def is_anothers(before: State, after: State) -> np.ndarray:
    """(statistics,) what is far out, stays so and is not moved by the last effect: it says nothing about that effect."""
    scale = before.fitted.reference.null_scale
    off = (before.fitted.residual, after.fitted.residual, moves_of(before, after))
    was, left, moves = (np.abs(standardised(each, scale)) for each in off)
    return (was > FAR_OUT) & (left > FAR_OUT) & (moves < OFF)


def disturbs_nothing(before: State, after: State) -> bool:
    """Whether all that was in order stays so."""
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
    """Whether the error falls beyond chance on the discovery frames, and falls on the hold-out frames.

    The error is a mean over all that was measured, so the noise of the rest hides what a faint effect takes away in a few
    statistics: then what is taken away must be beyond chance, and the error not rise by more than a standard deviation, or 0.05.
    Where that noise is as large as the whole excess, the error says nothing, and chance alone decides. Beside what is a hundred
    times as far off it can only fall by little: then it must surely fall, and the effect be there on the hold-out frames.

    A further effect must take a share of the first excess, or nearly all that is left beside a very strong one, or have a case
    of its own (`has_a_case`): what the form of an effect before it leaves is not mopped up by another name.
    A first effect whose own spread covers what it explains has no error to lower, and must leave in order what was (tracks of
    cosmic rays cover whatever hot pixels do, but not that all frames show the same); a second one then has no case. Where the
    excess was clear and nothing can be said of the error any more, the spread is that of another effect; not so where the error is
    gone all the same: ten pixels, hot by a law with a long tail, could have been any others, but they are what was measured. Nor
    where the effect has a case of its own, is there again and leaves in order what was: then it is that other effect.

    Args:
        before, after: errors on the discovery and on the hold-out frames.
        first: whether it is the first effect.
        beyond_chance: whether what the effect takes away is more than any effect takes away by chance.
        has_a_case: whether it gains enough, beyond chance, where the effects before it move next to nothing.
        there_again: see `is_there_again`; with a case of its own it is confirmed by that.
        in_order: see `disturbs_nothing`.
        falls_where_it_acts: whether the effect is seen again, and the error surely falls without what is another's, see
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
        return True  # too few frames, or an effect whose spread covers them, to object
    falls = confirmed.value < confirmed_before.value + _noise(confirmed, beyond_chance)
    return falls or (has_a_case and there_again)


def _noise(error: Error, beyond_chance: bool) -> float:
    """By how much an error may rise by chance where what is explained cannot be chance."""
    return min(NOISE * (error.high - error.low), RISE) if beyond_chance else 0.0
