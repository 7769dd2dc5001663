"""Which physical effect is missing: fit, name, add, refit, until nothing is missing or nothing known explains the rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from visaug.camera import Camera
from visaug.cluster import connected
from visaug.comparison import Laboratory, is_clear, places
from visaug.comparison.spread import by_ray
from visaug.diagnosis import cache
from visaug.diagnosis.acceptance import (
    OFF,
    State,
    acts_elsewhere,
    disturbs_nothing,
    explains,
    improves,
    is_there_again,
    moves_of,
    owes,
    says_the_same,
)
from visaug.diagnosis.adding import SETS_AFTER, Adding
from visaug.diagnosis.candidates import Trial, looked, trials
from visaug.diagnosis.chance import Chance, chance
from visaug.diagnosis.errors import Errors
from visaug.diagnosis.fit import (
    FAR,
    Fitted,
    Reference,
    Report,
    is_far,
    p_value,
    refit,
    standardised,
)
from visaug.diagnosis.naming import CLOSE, CLOSE_SHARE, SIGNIFICANT, candidates, decided, is_beyond, rivals
from visaug.diagnosis.parameters import base_coordinates
from visaug.diagnosis.rank import Refined, Signatures, signatures
from visaug.diagnosis.ranking import Ranking
from visaug.diagnosis.residue import describe
from visaug.diagnosis.result import Diagnosis, Step
from visaug.diagnosis.spread import COVERS, only_covers, recurs_so
from visaug.effects import catalogue, load_file
from visaug.errors import InputError
from visaug.fingerprint import Statistic
from visaug.frames import FrameSet

SETS = 200  # simulated sets of the camera file
MOST = 4  # effects that are added one after the other
DECISIVE = 10.0  # in log likelihood: a rival so far behind is not accepted though the first be refused
SURE = 10.0  # in log likelihood: what an effect must gain that lowers no error beside others, or is far behind its rivals
TRACE = 0.03  # error beside an accepted effect that is a finding, if it is surely so much
STANDS_OUT = 30.0  # standard deviations from which what is left is worth another start
STAYS = 0.2  # error that surely stays beside a name that explains nothing
APART = 10.0  # standard deviations of what no accepted effect acts on, from which it is a finding however small the error
MUCH = 0.1  # error beside an accepted effect that is a finding, if it may be so much; and if it surely is, though the camera holds


def diagnose(
    camera: Camera,
    frames: FrameSet,
    effects: Sequence[str | Path] = (),
    without: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
    sets: int = SETS,
    cluster: str | None = None,
) -> Diagnosis:
    """Which effect the camera lacks, as far as the frames tell.

    Args:
        camera: the model, as its file has it.
        frames: measured bias, dark, flat or scene frames.
        effects: files with effects of one's own, to be tried beside the catalogue's.
        without: effects of the catalogue that are not tried.
        seed: of all simulations: the same seed gives the same answer.
        progress: called with (description, done, total).
        sets: simulated sets of the camera; fewer are faster and less sure.
        cluster: address of a Ray cluster that does the simulations, or `local`; None for the threads of this machine.

    Raises:
        InputError: frames of which nothing is known, too few frames, unknown effects.
    """
    for file in effects:
        load_file(file)
    for name in without:
        if name not in catalogue():
            raise InputError(f"{name!r} is no effect", field="without", expected="a name of `visaug effects`")
    left_out, report = frozenset(without), progress or (lambda *_: None)
    if cluster is None:
        return _Search(Laboratory(frames, camera, seed), camera, left_out, report, sets).run()
    with connected(cluster) as ray:
        lab = Laboratory(frames, camera, seed, spread=by_ray(ray))
        return _Search(lab, camera, left_out, report, sets).run()


Standing = list[tuple[Refined, State]]  # candidates with the state that each would give, the accepted first


@dataclass(frozen=True)
class _Accepted:
    """An effect that was accepted, the state with it, and what stood beside (simulated too) and behind it."""

    refined: Refined
    state: State
    standing: Standing
    others: list[Refined]


class _Search:
    def __init__(self, lab: Laboratory, camera: Camera, without: frozenset[str], report: Report, sets: int):
        self.lab, self.given, self.without, self.report, self.sets = lab, camera, without, report, sets
        self.calibrated = all(r.photons is not None for r in lab.frames.records if r.kind == "flat")
        if len(self.lab.folds.find) < 2:
            raise InputError(
                f"{len(lab.frames)} frames are too few",
                field="frames",
                expected="at least 4 under some conditions",
            )
        self.walk: list[State] = []  # the refitted camera, and after each effect added
        self.steps: list[Step] = []  # the same, as it is told
        self.stood: list[Standing] = []  # of every effect added

    def run(self) -> Diagnosis:
        first = self.first = self._reference()
        fitted = cache.settled(self.lab, refit(self.lab, first, self.report), SETS_AFTER, self.report)
        self.signs = self._signatures(first)
        self.adding = Adding(self.lab, first, self.signs.trials, self.report)
        self.errors = Errors(self.lab, first, fitted)
        self.ranking = Ranking(self.errors.distance)
        p_given = p_value(self._largest_as_given(first), first.largest_as_given)
        state = refitted = State.plain(fitted)
        by_chance = chance(self.lab, self.signs, state)
        p_before = by_chance.p_value
        self._stand(state)
        nearest: str | None = None
        p_after = p_before
        while p_after <= SIGNIFICANT and len(state.accepted) < MOST:
            found, nearest = self._add(state, by_chance)
            if found is None:
                break
            self._stand(found)
            state = self._reconsidered(refitted, found)
            by_chance = chance(self.lab, self.signs, state)
            p_after = by_chance.p_value
        while state.accepted and self._is_no_explanation(p_after <= SIGNIFICANT):
            nearest = state.accepted[-1]
            self._stand(self.walk[-2])
            state = self.walk[-1]
            p_after = chance(self.lab, self.signs, state).p_value
        missing = bool(p_after <= SIGNIFICANT)
        significant = p_given <= SIGNIFICANT or p_before <= SIGNIFICANT
        excess = bool(state.accepted) or (significant and is_clear(self.steps[-1].error))
        residue = None
        if missing and self._is_worth_telling(state):
            residue = describe(self._of_all, state.whole_z, nearest)
        elif self._is_far_off(state):
            residue = describe(self._of_all, _plain_z(state))
        return Diagnosis(
            camera=state.fitted.camera,
            accepted=state.accepted,
            error_after=self.steps[-1].error if excess else None,
            p_value_before=p_before,
            p_value_after=p_after,
            adequate_before=p_before > SIGNIFICANT,
            adequate_after=not missing,
            where=places(self.errors.distance, self.lab.statistics, self._z_as_given(first)),
            ranking=self.ranking.ranked,
            steps=tuple(self.steps) if excess else (),
            frames=self._sequence_numbers(),
            ambiguous=tuple(
                pair for pair in self.ranking.ambiguous if set(pair["effects"]) & set(state.accepted)
            ),
            unexplained=residue,
            form=self._form(state),
            cannot_show=self._cannot_show(first),
        )

    @property
    def _of_all(self) -> tuple[Statistic, ...]:
        """Statistics of all frames together."""
        return self.lab.measured[2].statistics

    def _reference(self) -> Reference:
        coordinates = base_coordinates(self.given, self.lab.frames, self.calibrated)
        return cache.reference(self.lab, self.given, coordinates, self.sets, self.report)

    def _signatures(self, reference: Reference) -> Signatures:
        """Of every trial; kept by effect, so that one effect more or less costs no other."""
        of: dict[str, list[Trial]] = {}
        for trial in trials(reference.camera, self.without):
            of.setdefault(trial.effect, []).append(trial)
        if not of:
            return signatures(self.lab, reference, (), self.report)
        prefix = cache.key(self.lab, reference.camera, "signatures", self.sets)
        names = {
            effect: f"{prefix}-{cache.digest(cache.source_of(effect), tried)}" for effect, tried in of.items()
        }
        found = {effect: kept for effect, name in names.items() if (kept := cache.load(name)) is not None}
        missing = [trial for effect, tried in of.items() if effect not in found for trial in tried]
        made = signatures(self.lab, reference, missing, self.report)
        paths = [c.path for c in reference.coordinates]
        for effect in {trial.effect: None for trial in missing}:
            own = [i for i, trial in enumerate(missing) if trial.effect == effect]
            found[effect] = {
                "values": made.values[own],
                "variances": made.variances[own],
                "following": np.array(
                    [[dict(made.trials[i].following).get(p, 0.0) for p in paths] for i in own]
                ),
            }
            cache.keep(names[effect], found[effect])
        return Signatures(
            tuple(
                replace(
                    trial, following=tuple(zip(paths, map(float, way), strict=True)) if np.any(way) else ()
                )
                for effect, tried in of.items()
                for trial, way in zip(tried, found[effect]["following"], strict=True)
            ),
            np.concatenate([found[effect]["values"] for effect in of]),
            np.concatenate([found[effect]["variances"] for effect in of]),
        )

    @cached_property
    def _seen(self) -> Signatures:
        """Of trials that come from a look at the frames: made for the measurement, so no part of chance."""
        tried = looked(self.lab, self.first.camera, self.without)
        return signatures(self.lab, self.first, tried, self.report)

    def _largest_as_given(self, first: Reference) -> float:
        return float(np.abs(self._z_as_given(first)).max())

    def _z_as_given(self, first: Reference) -> np.ndarray:
        return standardised(self.lab.measured[0].values - first.mean, first.scale)

    def _stand(self, state: State) -> None:
        """Takes a state in the place of those with as many effects or more."""
        place = len(state.accepted)
        action = f"add {state.accepted[-1]}" if place else "refit"
        self.walk[place:] = [state]
        self.steps[place:] = [Step(action, self.errors.told(state.fitted))]

    def _add(self, state: State, by_chance: Chance) -> tuple[State | None, str | None]:
        """The state with one more effect; None, with the nearest effect's name, where none explains what it moves.

        Where the camera with an effect that was found from one start does not hold, the other start has its say too.
        """
        nearest: str | None = None
        standings = self.ranking.standings()
        accepted: list[_Accepted] = []
        for fitted in self._starts(state):
            if accepted and fitted is self._unfitted:
                break  # it comes last where it is there for want of anything else
            found = candidates(self.lab, self.signs + self._seen, fitted, state, self.without, self.report)
            if not found:
                continue
            if fitted is state.fitted:
                self.ranking.rank(state, found)
                nearest = found[0].effect if found[0].gain > 3 else None
            if accepted and found[0].effect == accepted[0].refined.effect:
                break  # no other start is needed to find it again
            one = self._accepted(state, found, by_chance)
            if one is not None:
                accepted.append(one)
                if one.state.p_value > SIGNIFICANT:
                    break
        if not accepted:
            return None, nearest
        best = decided(state, [(one.refined, one.state) for one in accepted])[0][1]
        chosen = next(one for one in accepted if one.state is best)
        standing = [r for r, _ in chosen.standing]
        self.ranking.restore(standings)
        self.ranking.rank(state, standing + chosen.others)
        self.ranking.accept(
            best, chosen.refined.effect, self.steps[-1].error and self.errors.told(best.fitted)
        )
        self.ranking.note_ambiguous(standing, self.report)
        self.stood.append(chosen.standing)
        return best, None

    def _reconsidered(self, plain: State, state: State) -> State:
        """The state with a rival in the place of the effect before the last, where beside the last it says more, or is simpler.

        While another effect is not there yet a wrong name can fit better: a ghost took what a charge transfer left of a veil. And
        the last may be that rival itself, which needs no other beside it: a blur took most of what blooms, and all of it blooms.
        """
        if len(state.accepted) < 2:
            return state
        (own, with_own), *others = self.stood[-2]
        for rival, alone in others:
            far_behind = rival.gain < (1 - CLOSE_SHARE) * own.gain
            if rival.effect == state.accepted[-1] and not far_behind and self._holds(alone):
                self._stand(alone)
                self.ranking.rename(own.effect, rival.effect)
                self.ranking.accept(alone, rival.effect, self.steps[-1].error)
                self.stood[-2:] = [[(rival, alone), (own, with_own)]]
                return alone
            is_base = any(catalogue()[r.effect].base for r in (own, rival))
            if rival.effect in state.accepted or far_behind or is_base:
                continue
            swapped = self.adding.swapped(state, own, rival)
            (best, _), _ = decided(plain, [(own, state), (rival, swapped)])
            if best.effect == rival.effect:
                self._stand(alone)
                self._stand(swapped)
                self.ranking.rename(own.effect, rival.effect)
                for effect in swapped.accepted[-2:]:
                    self.ranking.accept(swapped, effect, self.steps[-1].error)
                return swapped
        return state

    def _holds(self, state: State) -> bool:
        """Whether a camera leaves no more than chance would."""
        return chance(self.lab, self.signs, state).p_value > SIGNIFICANT

    def _accepted(self, state: State, found: list[Refined], by_chance: Chance) -> "_Accepted | None":
        """The first of the candidates that explains what it moves and improves the camera, its rivals simulated.

        Where one that is nearly as likely makes the camera hold and the first does not, it is that one: else a second effect would
        be looked for in what a wrong name leaves. Of those further behind, which no simulation could bring to the front, each that
        gains much is asked by itself if all rivals are refused: what these say wrongly is no reason against other moves.
        """
        close = rivals(self.lab, found, state, by_chance)
        simulated = [(r, self.adding.where_promising(state, r)) for r in close]
        ordered = decided(state, [(r, after) for r, after in simulated if after is not None])
        behind = [r for r in found if r.effect not in {other.effect for other in close}]
        refused: list[tuple[Refined, np.ndarray]] = []
        accepted = [pair for pair in ordered if self._is_acceptable(state, pair, refused, by_chance)]
        if accepted:
            best = first = accepted[0]
            alike = [pair for pair in accepted if pair[0].gain > first[0].gain - CLOSE]
            if len(alike) > 1:
                best = next((pair for pair in alike if self._holds(pair[1])), first)
            place = next(i for i, pair in enumerate(ordered) if pair is first)
            least = best[0].gain - DECISIVE
            nothing = [replace(r, gain=min(r.gain, least)) for r, after in simulated if after is None]
            standing = [best, *(pair for pair in ordered[place:] if pair is not best)]
            return _Accepted(*best, standing, [*nothing, *behind])
        refused += [(r, _moves_of(state, r)) for r, after in simulated if after is None]
        for r in behind:
            is_said = self._is_said(state, r, _moves_of(state, r), refused)
            if r.gain > SURE and not is_said and is_beyond(self.lab, by_chance, state, r):
                after = self.adding.where_promising(state, r)
                if after is None:
                    refused.append((r, _moves_of(state, r)))
                elif self._is_acceptable(state, (r, after), refused, by_chance):
                    others = [other for other in behind if other is not r]
                    return _Accepted(r, after, [(r, after)], others)
        return None

    def _is_acceptable(
        self,
        state: State,
        candidate: tuple[Refined, State],
        refused: list[tuple[Refined, np.ndarray]],
        by_chance: Chance,
    ) -> bool:
        """Whether a simulated candidate is accepted; if not it joins the refused, with what it moves."""
        r, after = candidate
        moves = moves_of(state, after)
        accepted = (
            not self._is_said(state, r, moves, refused)
            and explains(self.lab.statistics, state, after)
            and recurs_so(state.fitted, after.fitted, np.abs(state.z) > OFF, self.lab.confirming)
            and self._improves(state, after, r.gain, by_chance)
        )
        if not accepted:
            refused.append((r, moves))
        return accepted

    @staticmethod
    def _is_said(
        state: State, candidate: Refined, moves: np.ndarray, refused: Sequence[tuple[Refined, np.ndarray]]
    ) -> bool:
        """Whether one that was refused says the same as a candidate with these moves, and more."""
        return any(
            candidate.gain < other.gain - DECISIVE and says_the_same(state, moves, others)
            for other, others in refused
        )

    def _starts(self, state: State) -> list[Fitted]:
        """Cameras from which effects are tried: the refitted one; where that lies far off, first the one given.

        A strong effect bends the fit until the effect's own signature is no longer recognised there. Where it stands far out all
        the same, a full well may be off from where no climb leads: the camera given is tried too if nothing else is accepted.
        """
        if state.accepted:
            return [state.fitted]
        if is_far(self.first, state.fitted.camera, 0.5 * FAR):
            return [self._unfitted, state.fitted]
        stands_out = float(np.abs(state.z).max()) > STANDS_OUT
        return [state.fitted, self._unfitted] if stands_out else [state.fitted]

    @cached_property
    def _unfitted(self) -> Fitted:
        return Fitted.unfitted(self.lab, self.first)

    def _improves(self, before: State, after: State, gain: float, by_chance: Chance) -> bool:
        both = ((before.fitted, after.fitted), (after.fitted, before.fitted))
        pairs = [(self.errors.found(x, y), self.errors.confirmed(x, y)) for x, y in both]
        # by the refit, where the camera's own numbers follow the effect far; by the effect itself, where they hide it
        taken = [before.fitted.whole_residual - after.fitted.whole_residual]
        taken += [] if after.moves is None else [self.lab.whole_of(after.moves)]
        beyond = any(by_chance.p_value_of(way) <= SIGNIFICANT for way in taken)
        # no statistic stands out any more; asked after every effect that would be by chance too often, so only of a second one
        completes = len(before.accepted) == 1 and after.p_value > SIGNIFICANT
        has_a_case = beyond and (gain > SURE or completes) and acts_elsewhere(before, after)
        again, in_order = is_there_again(before, after), disturbs_nothing(before, after)
        return improves(pairs[0], pairs[1], not before.accepted, beyond, has_a_case, again, in_order)

    def _is_worth_telling(self, state: State) -> bool:
        """Whether what is left is more than a small share of what was: beside an accepted effect a trace is no finding.

        Unless it stands far out where no accepted effect acts: it is a trace of their error, and none of their forms.
        """
        error = self.errors.found(state.fitted)
        if not state.accepted or error is None or error.low > TRACE or error.high > MUCH:
            return True
        scale = state.fitted.reference.whole_null.scale
        elsewhere = state.whole_allowance < scale
        return bool(np.abs(state.whole_z[elsewhere]).max(initial=0.0) > APART)

    def _is_no_explanation(self, missing: bool) -> bool:
        """Whether the last effect explains nothing: much surely stays, under a spread or, beside a rest, where the effect acts."""
        error = self.steps[-1].error
        before, state = self.walk[-2:]
        if error is None or error.low <= STAYS:
            return False
        if missing and owes(self.lab.statistics, before, state):
            return True
        without, with_it = before.fitted, state.fitted
        was, now = self.errors.found(without, with_it), self.errors.found(with_it, without)
        hardly_falls = was is not None and now is not None and now.value > COVERS * was.value
        return hardly_falls and only_covers(without, with_it, np.abs(before.z) > OFF)

    def _is_far_off(self, state: State) -> bool:
        """Whether the error surely stays large though the camera holds: a spread that covers anything explains little.

        Nor does a form that is far from the catalogue's, which the effect's own allowance would hide. Not where nothing stands out:
        of faint effects the error is mostly noise.
        """
        error = self.steps[-1].error
        return bool(state.accepted) and error is not None and error.low > MUCH and _stands_out(state)

    def _form(self, state: State) -> str | None:
        """What the forms of accepted effects leave over, in words."""
        if not state.accepted or not _stands_out(state):
            return None
        plain = np.abs(_plain_z(state))
        i = int(plain.argmax())
        s = self._of_all[i]
        return (
            f"What is left belongs to the form of {' and '.join(state.accepted)}, which is not quite the catalogue's: "
            f"most of all {s.name} of {s.frames} ({s.view.replace('_', ' ')}), {plain[i]:.1f} standard deviations off."
        )

    def _cannot_show(self, first: Reference) -> tuple[str, ...]:
        seen: dict[str, float] = {}
        for trial, signature, variance in zip(
            self.signs.trials, self.signs.values, self.signs.variances, strict=True
        ):
            z = np.abs(standardised(signature, first.null_scale)) + standardised(
                np.sqrt(variance), first.null_scale
            )
            seen[trial.effect] = max(seen.get(trial.effect, 0.0), float(z.max()))
        return tuple(effect for effect, z in seen.items() if z < 3)

    def _sequence_numbers(self) -> dict[str, list[int]]:
        records, folds = self.lab.frames.records, self.lab.folds
        return {
            name: [records[i].sequence for i in getattr(folds, name)] for name in ("fit", "select", "confirm")
        }


def _moves_of(state: State, candidate: Refined) -> np.ndarray:
    """How far a candidate that was not simulated in full moves each statistic of the frames that find."""
    return state.fitted.residual - candidate.residual


def _plain_z(state: State) -> np.ndarray:
    """What is left in all frames in standard deviations, nothing allowed for forms."""
    return standardised(state.fitted.whole_residual, state.fitted.reference.whole_null.scale)


def _stands_out(state: State) -> bool:
    """Whether some statistic is further off than a camera that lacks nothing would leave it, nothing allowed for forms."""
    largest = float(np.abs(_plain_z(state)).max())
    return largest > float(np.quantile(state.fitted.reference.largest, 1 - SIGNIFICANT))
