"""Which physical effect is missing: fit, name, add, refit, until nothing is missing or nothing known explains the rest."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from visaug.camera import Camera
from visaug.cluster import connected
from visaug.comparison import Laboratory, is_clear, places
from visaug.comparison.spread import by_ray
from visaug.diagnosis import cache
from visaug.diagnosis.acceptance import State
from visaug.diagnosis.adding import SETS_AFTER, Adding
from visaug.diagnosis.candidates import looked, trials
from visaug.diagnosis.chance import Chance, chance
from visaug.diagnosis.choice import Accepted, Choice, Standing
from visaug.diagnosis.errors import Errors
from visaug.diagnosis.fit import Fitted, refit
from visaug.diagnosis.naming import CLOSE_SHARE, SIGNIFICANT, candidates, decided
from visaug.diagnosis.parameters import base_coordinates
from visaug.diagnosis.ranking import Ranking
from visaug.diagnosis.reference import FAR, Reference, Report, is_far
from visaug.diagnosis.refinement import Refined
from visaug.diagnosis.result import Diagnosis, Step
from visaug.diagnosis.robust import p_value, standardised
from visaug.diagnosis.signatures import Signatures, signatures
from visaug.diagnosis.telling import cannot_show, form, is_no_explanation, residue
from visaug.effects import catalogue, load_file
from visaug.errors import InputError
from visaug.fingerprint import Statistic
from visaug.frames import FrameSet

SETS = 200  # simulated sets of the camera file
MOST = 4  # effects that are added one after the other
STANDS_OUT = 30.0  # standard deviations from which what is left is worth another start


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
        seed: of all simulations: the same seed gives the same answer. (Other kinds of processors round sums in another way: there
            what lies on a knife edge may fall to the other side.)
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
            raise InputError(f"{name!r} is not an effect", field="without", expected="a name of `visaug effects`")
    left_out, report = frozenset(without), progress or (lambda *_: None)
    if cluster is None:
        lab = Laboratory(frames, camera, seed, report=report)
        found = _Search(lab, camera, left_out, report, sets).run()
    else:
        with connected(cluster) as ray:
            lab = Laboratory(frames, camera, seed, spread=by_ray(ray), report=report)
            found = _Search(lab, camera, left_out, report, sets).run()
    return replace(found, given=camera, frame_set=frames, seed=seed)


class _Search:
    def __init__(self, lab: Laboratory, camera: Camera, without: frozenset[str], report: Report, sets: int):
        self.lab, self.given, self.without, self.report, self.sets = lab, camera, without, report, sets
        if len(self.lab.folds.find) < 2:
            raise InputError(
                f"{len(lab.frames)} frames are too few",
                field="frames",
                expected="at least 4 under some conditions",
            )
        self.walk: list[State] = []  # the refitted camera, and after each effect added
        self.steps: list[Step] = []  # the same, as it is told
        self.stood: list[Standing] = []  # of every effect added
        self.refined: dict[str, Refined] = {}  # as the last step that tried it had it

    def run(self) -> Diagnosis:
        first = self.first = self._reference()
        fitted = cache.settled(self.lab, refit(self.lab, first, self.report), SETS_AFTER, self.report)
        tried = trials(first.camera, self.without)
        self.signs = cache.signatures(self.lab, first, tried, self.sets, self.report)
        self.adding = Adding(self.lab, first, self.signs.trials, self.report)
        self.errors = Errors(self.lab, first, fitted)
        self.choice = Choice(self.lab, self.signs, self.adding, self.errors)
        self.ranking = Ranking(self.errors.distance, self._of_all)
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
        while state.accepted and self._last_explains_nothing(p_after <= SIGNIFICANT):
            nearest = state.accepted[-1]
            self._stand(self.walk[-2])
            state = self.walk[-1]
            p_after = chance(self.lab, self.signs, state).p_value
        missing = bool(p_after <= SIGNIFICANT)
        significant = p_given <= SIGNIFICANT or p_before <= SIGNIFICANT
        told = self.steps[-1].error
        excess = bool(state.accepted) or (significant and is_clear(told))
        return Diagnosis(
            camera=state.fitted.camera,
            accepted=state.accepted,
            error_after=told if excess else None,
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
            unexplained=residue(told, self.errors, self.lab.measured[2], state, missing, nearest),
            form=form(self._of_all, state),
            cannot_show=cannot_show(self.signs, first),
            used=self.lab.selection,
            warnings=self.lab.warnings,
        )

    def _last_explains_nothing(self, missing: bool) -> bool:
        told, (before, state) = self.steps[-1].error, self.walk[-2:]
        return is_no_explanation(told, self.errors, self.lab.statistics, before, state, missing)

    @property
    def _of_all(self) -> tuple[Statistic, ...]:
        """Statistics of all frames together."""
        return self.lab.measured[2].statistics

    def _reference(self) -> Reference:
        coordinates = base_coordinates(self.given, self.lab.frames, self.lab.calibrated)
        return cache.reference(self.lab, self.given, coordinates, self.sets, self.report)

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
        earlier, standings = self.refined, self.ranking.standings()
        accepted: list[Accepted] = []
        for fitted in self._starts(state):
            if accepted and fitted is self._unfitted:
                break  # it comes last where it is there for want of anything else
            tried = self.signs + self._seen
            found = candidates(self.lab, tried, fitted, state, self.without, self.report, earlier)
            if not found:
                continue
            if fitted is state.fitted:
                self.refined = {**earlier, **{r.effect: r for r in found}}
                self.ranking.rank(state, found)
                nearest = found[0].effect if found[0].gain > 3 else None
            if accepted and found[0].effect == accepted[0].refined.effect:
                break  # no other start is needed to find it again
            one = self.choice.accepted(state, found, by_chance)
            if one is not None:
                accepted.append(one)
                if one.state.p_value > SIGNIFICANT:
                    break
        if not accepted:
            return None, nearest
        best = decided(self.lab.statistics, state, [(one.refined, one.state) for one in accepted])[0][1]
        chosen = next(one for one in accepted if one.state is best)
        standing = [r for r, _ in chosen.standing]
        self.ranking.restore(standings)
        self.ranking.rank(state, standing + chosen.others)
        self.ranking.accept(
            best, chosen.refined.effect, self.steps[-1].error and self.errors.told(best.fitted)
        )
        self.ranking.note_ambiguous(standing, chosen.others, self.report)
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
            if rival.effect == state.accepted[-1] and not far_behind and self.choice.holds(alone):
                self._stand(alone)
                self.ranking.rename(own.effect, rival.effect)
                self.ranking.accept(alone, rival.effect, self.steps[-1].error)
                self.stood[-2:] = [[(rival, alone), (own, with_own)]]
                return alone
            is_base = any(catalogue()[r.effect].base for r in (own, rival))
            if rival.effect in state.accepted or far_behind or is_base:
                continue
            swapped = self.adding.swapped(state, own, rival)
            (best, _), _ = decided(self.lab.statistics, plain, [(own, state), (rival, swapped)])
            if best.effect == rival.effect:
                self._stand(alone)
                self._stand(swapped)
                self.ranking.rename(own.effect, rival.effect)
                for effect in swapped.accepted[-2:]:
                    self.ranking.accept(swapped, effect, self.steps[-1].error)
                return swapped
        return state

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

    def _sequence_numbers(self) -> dict[str, list[int]]:
        records, folds = self.lab.frames.records, self.lab.folds
        return {
            name: [records[i].sequence for i in getattr(folds, name)] for name in ("fit", "select", "confirm")
        }
