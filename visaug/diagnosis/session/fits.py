"""A camera with chosen effects added or removed, refitted to the discovery frames."""

import math
from dataclasses import dataclass

from visaug.camera import Camera
from visaug.diagnosis import FittedValue
from visaug.diagnosis.adding import SETS_AFTER, Adding
from visaug.diagnosis.candidates.selection import candidates
from visaug.diagnosis.candidates.signatures import resolved, scanned, signatures
from visaug.diagnosis.candidates.trials import looked, trials
from visaug.diagnosis.considered import considering
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.fit import Fitted, refit, settled
from visaug.diagnosis.fitting.reference import Reference, Report, make_reference
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.response import with_responses
from visaug.diagnosis.result import estimates
from visaug.diagnosis.search import SETS, check_usable, given_reference
from visaug.diagnosis.state import State
from visaug.effects import catalogue
from visaug.frames import FrameSet
from visaug.statistics.distance import Distance, Error
from visaug.statistics.places import Places, places
from visaug.statistics.tail import SIGNIFICANT

Names = tuple[str, ...]
FEW, FEWEST = (
    24,
    8,
)  # simulated sets of the camera file and of a camera set by hand, for a quick estimate of its error


@dataclass(frozen=True)
class CameraFit:
    """A refitted camera and how far it is from the frames.

    Attributes:
        error: as `visaug.diagnose` reports it; None where the camera file shows no excess over chance.
        p_value: of the largest residual, against simulated sets of the camera.
        where: views that still differ, by their share of the excess.
        parameters: of the effects that were added, by effect and name.
    """

    camera: Camera
    error: Error | None
    p_value: float
    where: Places
    parameters: dict[str, dict[str, FittedValue]]

    @property
    def adequate(self) -> bool:
        return self.p_value > SIGNIFICANT


class Fits:
    """Fits of one camera file to one frame set. Each fit is computed once and kept.

    Args:
        given: the camera as its file has it; errors are relative to it.
        sets: simulated sets of the camera file; with an effect added at most `SETS_AFTER`.

    Raises:
        InputError: frames of which nothing is known, too few frames.
    """

    def __init__(self, given: Camera, frames: FrameSet, seed: int = 0, sets: int = SETS):
        self.given, self.sets = given, sets
        self.lab = Laboratory(frames, given, seed)
        check_usable(self.lab)
        self._references: dict[Names, Reference] = {}
        self._states: dict[tuple[Names, Names], State] = {}
        self._given: Reference | None = None  # its sets alone, where nothing was fitted yet

    def fit(self, without: Names, added: Names, report: Report) -> CameraFit:
        """The camera file without some of its own effects and with others added, in this order."""
        state = with_responses(self.lab, self._state(without, added, report), report)
        state = considering(self.lab, state)
        plain = self._state((), (), report)
        fitted, reference = state.fitted, state.fitted.reference
        left = Distance(
            self.lab.statistics, reference.mean + fitted.residual, reference.sets, reference.find.least
        )
        return CameraFit(
            state.camera,
            Errors(self.lab, self._reference((), report), plain.fitted).told(fitted),
            state.p_value,
            places(left, self.lab.statistics, state.find.z),
            {name: estimates(name, state.camera, *state.numbers) for name in added},
        )

    def as_it_is(self, camera: Camera, quick: bool, report: Report) -> CameraFit:
        """How far a camera is from the frames with its numbers as they are: nothing is refitted.

        Args:
            quick: from a few simulated sets. Its p-value is NaN and it tells no places: few sets resolve neither.
        """
        first = self._sets_of_given(FEW if quick else self._after, report)
        reference = make_reference(self.lab, camera, (), FEWEST if quick else self._after, report)
        fitted = Fitted.unfitted(self.lab, reference)
        error = Errors(self.lab, first, Fitted.unfitted(self.lab, first)).told(fitted)
        if quick:
            return CameraFit(camera, error, math.nan, Places(), {})
        state = State.plain(fitted, self.lab.views)
        left = Distance(
            self.lab.statistics, reference.mean + fitted.residual, reference.sets, reference.find.least
        )
        return CameraFit(camera, error, state.p_value, places(left, self.lab.statistics, state.find.z), {})

    def _sets_of_given(self, count: int, report: Report) -> Reference:
        """Simulated sets of the camera file, without derivatives: those that exist already, or as many as requested."""
        known = self._references.get(()) or self._given
        if known is None or len(known.sets) < count:
            known = self._given = make_reference(self.lab, self.given, (), count, report, begun=self._given)
        return known

    def can_add(self, camera: Camera) -> list[str]:
        """Effects that a camera lacks and that have a strength to fit, in the order of the chain."""
        fittable = {name for name, effect in catalogue().items() if effect.base or effect.strengths()}
        without = frozenset(catalogue()) - fittable
        names = {trial.effect for trial in trials(camera, without, only=frozenset(fittable))}
        return [name for name in catalogue() if name in names]

    def forget(self, name: str) -> None:
        """Drops fits with an effect whose file was loaded anew."""
        self._states = {key: state for key, state in self._states.items() if name not in key[1]}

    def _state(self, without: Names, added: Names, report: Report) -> State:
        key = (without, added)
        if key not in self._states:
            if added:
                self._states[key] = self._with(self._state(without, added[:-1], report), added[-1], report)
            else:
                self._states[key] = self._plain(without, report)
        return self._states[key]

    def _plain(self, without: Names, report: Report) -> State:
        """The camera refitted, nothing added."""
        fitted = refit(self.lab, self._reference(without, report), report)
        return State.plain(settled(self.lab, fitted, self._after, report), self.lab.views)

    def _with(self, before: State, name: str, report: Report) -> State:
        """One more effect: its best trial, its numbers refined, then everything refitted together."""
        camera, only = before.fitted.reference.camera, frozenset({name})
        others = frozenset(catalogue()) - only
        reference = before.fitted.reference
        signs = scanned(self.lab, reference, trials(camera, others, only), report)
        signs = resolved(self.lab, reference, signs, report)
        signs += signatures(self.lab, reference, looked(self.lab, camera, others), report)
        allowance, least = before.find.allowance, -math.inf
        (best, *_), _ = candidates(self.lab, signs, before.fitted, others, allowance, report, {}, least)
        adding = Adding(self.lab, self._reference((), report), signs.trials, report, self._after)
        return adding.with_candidate(before, best)

    @property
    def _after(self) -> int:
        return min(self.sets, SETS_AFTER)

    def _reference(self, without: Names, report: Report) -> Reference:
        """Simulated sets of the camera file; those of the whole file are shared with `visaug.diagnose`."""
        if without not in self._references:
            camera = self.given
            for name in without:
                camera = camera.without_effect(name)
            sets = self._after if without else self.sets
            self._references[without] = given_reference(self.lab, camera, sets, report)
        return self._references[without]
