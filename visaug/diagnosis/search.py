"""Finds missing effects: fit, select, add, refit, until the camera is adequate or no known effect explains the difference."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from visaug.camera import Camera
from visaug.core.cluster import connected
from visaug.core.errors import InputError
from visaug.diagnosis.adding import SETS_AFTER, Adding
from visaug.diagnosis.candidates import cache
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.candidates.selection import candidates
from visaug.diagnosis.candidates.signatures import Signatures, signatures
from visaug.diagnosis.candidates.trials import looked, trials
from visaug.diagnosis.chance import chance
from visaug.diagnosis.choice import Accepted, Judged, accepted, odds_between
from visaug.diagnosis.criterion import ODDS, between
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.fit import Fitted, refit
from visaug.diagnosis.fitting.parameters import base_coordinates
from visaug.diagnosis.fitting.reference import FAR, Reference, Report, is_far
from visaug.diagnosis.fitting.robust import p_value, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.ranking import Ranking
from visaug.diagnosis.ray_executor import by_ray
from visaug.diagnosis.result import Diagnosis, Step
from visaug.diagnosis.state import State
from visaug.diagnosis.telling import cannot_show, form, residue
from visaug.effects import catalogue, load_file
from visaug.frames import FrameSet
from visaug.pictures.part import with_a_well
from visaug.statistics import Statistic
from visaug.statistics.distance import is_clear
from visaug.statistics.places import places
from visaug.statistics.tail import SIGNIFICANT

SETS = 200  # simulated sets of the camera file
FEWEST = 50  # of fewer no p-value is below the rate of false alarms
MOST = 4  # largest number of steps that add an effect
STANDS_OUT = 30.0  # deviation, in standard deviations, above which a second starting point is tried


def diagnose(
    camera: Camera | str | Path,
    frames: FrameSet | str | Path,
    effects: Sequence[str | Path] = (),
    without: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
    sets: int = SETS,
    cluster: str | None = None,
    transfer: Literal["linear", "srgb"] = "linear",
    scenes: FrameSet | str | Path | None = None,
) -> Diagnosis:
    """Finds the physical effects that a camera model lacks.

    Args:
        camera: the camera model to test, or its file or name.
        frames: measured bias, dark, flat or scene frames, or the path of a frame set; or ordinary pictures, see
            `visaug.pictures.part`.
        effects: files with your own effects, tried together with those of the catalogue.
        without: effects of the catalogue that are not tried.
        seed: of all simulations. The same seed gives the same result on the same type of processor; others round sums
            differently, which can change a borderline decision.
        progress: called with (description, done, total).
        sets: simulated sets of the camera, 50 or more; fewer are faster and less certain.
        cluster: address of a Ray cluster that runs the simulations, or `local`; None uses the threads of this machine.
        transfer: of ordinary pictures, how their values follow from light.
        scenes: for ordinary pictures, others with such scenes, e.g. the training images; without them scenes are taken to
            have no preferred axis and no centre.

    Returns:
        The accepted effects with their parameters, the error before and after, and what remains unexplained.

    Raises:
        InputError: too few frames or pictures, unknown effects, or fewer than 50 sets.

    Examples:
        >>> import visaug
        >>> result = visaug.diagnose(camera, frames)  # doctest: +SKIP
        >>> result.accepted  # doctest: +SKIP
        ('row_noise',)
    """
    for file in effects:
        load_file(file)
    if sets < FEWEST:
        raise InputError(
            f"{sets} simulated sets",
            field="sets",
            expected=f"at least {FEWEST}: p-values are counted among them",
        )
    for name in without:
        if name not in catalogue():
            raise InputError(
                f"{name!r} is not an effect", field="without", expected="a name of `visaug effects`"
            )
    camera = Camera.load(camera)
    frames = FrameSet.of(frames, camera.resolution)
    if frames.is_pictures:
        camera = with_a_well(camera)
    left_out, report = frozenset(without), progress or (lambda *_: None)
    of_pictures = {"transfer": transfer, "scenes": None if scenes is None else FrameSet.of(scenes)}
    with nullcontext() if cluster is None else connected(cluster) as ray:
        spread = None if cluster is None else by_ray(ray)
        lab = Laboratory(frames, camera, seed, spread=spread, report=report, **of_pictures)
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
        self.walk: list[State] = []  # the refitted camera, then one state per added effect
        self.steps: list[Step] = []  # the same, as reported
        self.stood: list[list[Judged]] = []  # of every added effect, the accepted first
        self.refined: dict[str, Refined] = {}  # from the last step that tried the effect

    def run(self) -> Diagnosis:
        first = self.first = self._reference()
        fitted = cache.settled(self.lab, refit(self.lab, first, self.report), SETS_AFTER, self.report)
        tried = [t.in_units(self.lab.units) for t in trials(first.camera, self.without)]
        self.signs = cache.signatures(self.lab, first, tried, self.sets, self.report)
        self.adding = Adding(self.lab, first, self.signs.trials, self.report)
        self.errors = Errors(self.lab, first, fitted)
        self.ranking = Ranking(self.errors.distance, self._of_all)
        p_given = p_value(self._largest_as_given(first), first.largest_as_given)
        state = refitted = State.plain(fitted)
        p_before = self._p_value(state)
        self._stand(state)
        nearest: str | None = None
        p_after = p_before
        for _ in range(MOST):  # steps and not effects, since a step can replace two effects by one
            if p_after > SIGNIFICANT:
                break
            found, nearest = self._add(state)
            if found is None:
                break
            self._stand(found)
            state = self._reconsidered(refitted, found)
            p_after = self._p_value(state)
        state, p_after, dropped = self._without_idle_effects(state, p_after)
        nearest = dropped or nearest
        kept = self._no_worse(state)
        if kept is not state:  # the file as given is not refitted, and is judged as it is
            state, p_after = kept, p_given
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
            unexplained=residue(self.lab.measured[2], state, missing, nearest),
            form=form(self._of_all, state),
            cannot_show=cannot_show(self.signs, first),
            used=self.lab.selection,
            warnings=self.lab.warnings,
        )

    def _no_worse(self, state: State) -> State:
        """The camera file as given, where no effect was found and the frames are farther from the refitted file."""
        told = self.steps[-1].error
        if state.accepted or told is None or told.value <= 1:
            return state
        given = State.plain(self._unfitted)
        self.walk[:], self.steps[:] = [given], [Step("keep the camera file", self.errors.told(given.fitted))]
        return given

    def _without_idle_effects(self, state: State, p_value: float) -> tuple[State, float, str | None]:
        """The state without last effects with which the camera is clearly farther from the frames than the file as given."""
        dropped: str | None = None
        while state.accepted and (told := self.steps[-1].error) is not None and told.low > 1:
            dropped = state.accepted[-1]
            self._stand(self.walk[-2])
            state = self.walk[-1]
            p_value = self._p_value(state)
        return state, p_value, dropped

    def _p_value(self, state: State) -> float:
        """Of the camera of a state, see `chance`."""
        return chance(self.lab, self.signs, state).p_value

    @property
    def _of_all(self) -> tuple[Statistic, ...]:
        """Statistics of all frames."""
        return self.lab.measured[2].statistics

    def _reference(self) -> Reference:
        coordinates = base_coordinates(self.given, self.lab.frames, self.lab.calibrated)
        return cache.reference(self.lab, self.given, coordinates, self.sets, self.report)

    @cached_property
    def _seen(self) -> Signatures:
        """Signatures of trials whose starting points come from the frames themselves, and so are not part of the null."""
        tried = looked(self.lab, self.first.camera, self.without)
        return signatures(self.lab, self.first, tried, self.report)

    def _largest_as_given(self, first: Reference) -> float:
        return float(np.abs(self._z_as_given(first)).max())

    def _z_as_given(self, first: Reference) -> np.ndarray:
        return standardised(self.lab.measured[0].values - first.mean, first.scale)

    def _stand(self, state: State) -> None:
        """Replaces the states with as many effects or more by this one."""
        place = len(state.accepted)
        action = f"add {state.accepted[-1]}" if place else "refit"
        self.walk[place:] = [state]
        self.steps[place:] = [Step(action, self.errors.told(state.fitted))]

    def _add(self, state: State) -> tuple[State | None, str | None]:
        """The state with one more effect; None, with the name of the nearest effect, if none is accepted.

        If the camera with an effect found from one starting point is not adequate, the other starting point is tried too.
        """
        nearest: str | None = None
        earlier = self.refined
        chosen: list[Accepted] = []
        for fitted in self._starts(state):
            if chosen and fitted is self._unfitted:
                break  # it is last if it is only a fallback
            tried = self.signs + self._seen
            taken, allowance = self.without | set(state.accepted), state.find.allowance
            found = candidates(self.lab, tried, fitted, taken, allowance, self.report, earlier)
            if not found:
                continue
            if fitted is state.fitted:
                self.refined = {**earlier, **{r.effect: r for r in found}}
                self.ranking.rank(state, found, [r.gain for r in found])
                nearest = found[0].effect if found[0].gain > ODDS else None
            if chosen and found[0].effect == chosen[0].best.refined.effect:
                break  # the same effect again: no further starting point is needed
            one = accepted(state, found, self.adding)
            if one is not None:
                chosen.append(one)
                if one.best.state.is_adequate:
                    break
        if not chosen:
            return None, nearest
        first, *later = chosen
        for one in later:
            if odds_between(state, one.best, first.best) > 0:
                first = one
        after = first.best.state
        self.ranking.choose(
            state, first, self.steps[-1].error and self.errors.told(after.fitted), self.report
        )
        self.stood.append(first.standing)
        return after, None

    def _reconsidered(self, plain: State, state: State) -> State:
        """The state with the effect before the last replaced by a rival that is more probable with the last, or explains all alone.

        As long as a further effect is missing, a wrong effect can fit better. And if the last effect is that rival, it may
        explain everything by itself.
        """
        if len(state.accepted) < 2:
            return state
        own, *others = self.stood[-2]
        for rival in others:
            effect = rival.refined.effect
            if effect == state.accepted[-1] and self._p_value(rival.state) > SIGNIFICANT:
                self._stand(rival.state)
                self.ranking.swap(own, rival)
                self.ranking.accept(rival.state, effect, self.steps[-1].error)
                self.stood[-2:] = [[rival, own]]
                return rival.state
            is_base = any(catalogue()[j.refined.effect].base for j in (own, rival))
            if effect in state.accepted or is_base:
                continue
            swapped = self.adding.swapped(state, own.refined.effect, rival.state)
            if between(plain, swapped, state) + own.evidence.cost > rival.evidence.cost:
                self._stand(rival.state)
                self._stand(swapped)
                self.ranking.swap(own, rival)
                for name in swapped.accepted[-2:]:
                    self.ranking.accept(swapped, name, self.steps[-1].error)
                self.stood[-1] = self.stood[-1][:1]  # its rivals stood beside the effect that is gone
                return swapped
        return state

    def _starts(self, state: State) -> list[Fitted]:
        """Starting points of the search: the refitted camera, preceded by the given camera if the refit is far from it.

        A strong effect biases the fit of the nuisance parameters until its signature is no longer recognised there. If deviations
        are large without that, the full well may be in a region from which refinement does not converge: the given camera is
        then tried if nothing else is accepted.
        """
        if state.accepted:
            return [state.fitted]
        if is_far(self.first, state.fitted.camera, 0.5 * FAR):
            return [self._unfitted, state.fitted]
        stands_out = float(np.abs(state.find.z).max()) > STANDS_OUT
        return [state.fitted, self._unfitted] if stands_out else [state.fitted]

    @cached_property
    def _unfitted(self) -> Fitted:
        return Fitted.unfitted(self.lab, self.first)

    def _sequence_numbers(self) -> dict[str, list[int]]:
        sequences, folds = self.lab.sequences, self.lab.folds
        return {
            name: list(dict.fromkeys(sequences[i] for i in getattr(folds, name)))
            for name in ("fit", "select", "confirm")
        }
