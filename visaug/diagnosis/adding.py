"""A camera with one more effect: simulated, refitted, its strength estimated from mean shifts or from variance."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.refinement import Refined
from visaug.diagnosis.candidates.trials import Trial, exchanged
from visaug.diagnosis.criterion import SHARE, Evidence, evidence
from visaug.diagnosis.fitting.fit import Fitted, followed, is_apart, refit, settled
from visaug.diagnosis.fitting.parameters import (
    Coordinate,
    effect_coordinates,
    is_stopped,
    moved,
    strengths_of,
)
from visaug.diagnosis.fitting.reference import Reference, Report, make_reference
from visaug.diagnosis.fitting.robust import adjust
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.scatter import VarianceStrength, scatter
from visaug.diagnosis.state import State

SETS_AFTER = 120  # largest number of simulated sets of a camera with an effect added
STAGES_AFTER = (
    30,
    60,
    SETS_AFTER,
)  # their number after each of which the evidence is asked whether it is decided
FIRST = 0.5  # share of the least evidence from which few simulated sets do not exclude a candidate
SCALED = 2  # iterations of a strength that is estimated from variance
STRONGER = 1.5  # ratio of strengths from which the answer of such an estimate is simulated
AS_DEEP = 1.1  # ratio of two misfits up to which two minima count as equally good


@dataclass(frozen=True)
class Adding:
    """Adds candidates to a camera, by the same steps for each.

    Args:
        lab: of the measured frames.
        first: the camera file as given.
        trials: of the catalogue.
        report: progress.
        sets: simulated sets of a camera with an effect added.
    """

    lab: Laboratory
    first: Reference
    trials: Sequence[Trial]
    report: Report
    sets: int = SETS_AFTER

    def with_candidate(self, state: State, candidate: Refined) -> State:
        """The state with a candidate, simulated and refitted, by as many simulated sets as its evidence needs."""
        sketch = self.sketched(state, candidate)
        if self.is_hopeless(state, candidate, sketch):
            return sketch
        return self.completed(state, candidate, sketch)

    def completed(self, state: State, candidate: Refined, after: State) -> State:
        """The state of a sketch by more simulated sets, until its evidence is decided.

        The strength is estimated from the variance that the effect adds where its mean shift is not enough.
        """
        told = self._told(state, after, candidate)
        if told is not None and not told.is_in_means:
            so = self._as_it_scatters(state, candidate, after, told)
            if so is not None:
                return so
        for sets in self._stages[1:]:
            after = self.grown(after, sets)
            if evidence(state, after, len(candidate.coordinates), self.effects).is_decided:
                break
        return after

    def sketched(self, state: State, candidate: Refined) -> State:
        """The state by the first of the simulated sets. Where the fit ended far from them, they are simulated anew."""
        return self._added(state, candidate.effect, candidate.camera, candidate.coordinates, self._few)

    def grown(self, state: State, sets: int) -> State:
        """A state by more simulated sets, refitted; one whose strength is estimated from variance has all its sets."""
        known = state.fitted.reference
        if len(known.sets) >= sets or state.scatters:
            return state
        reference = make_reference(self.lab, known.camera, known.coordinates, sets, self.report, begun=known)
        fitted = refit(self.lab, reference, self.report, begin=state.fitted.camera)
        return replace(state, fitted=followed(self.lab, fitted, self.report))

    def is_hopeless(self, state: State, candidate: Refined, sketch: State) -> bool:
        """Whether few simulated sets exclude a candidate: its strength is fitted, and it explains little."""
        told = self._told(state, sketch, candidate)
        is_fitted = told is None or told.is_in_means
        first = evidence(state, sketch, len(candidate.coordinates), self.effects)
        return is_fitted and first.share < FIRST * SHARE and not first.is_reached

    @property
    def effects(self) -> int:
        """Number of effects that may be missing."""
        return max(len({trial.effect for trial in self.trials}), 1)

    @property
    def _stages(self) -> list[int]:
        return sorted({min(stage, self.sets) for stage in STAGES_AFTER})

    @property
    def _few(self) -> int:
        return self._stages[0]

    def _as_it_scatters(
        self, state: State, candidate: Refined, sketch: State, told: VarianceStrength
    ) -> State | None:
        """The state with a strength estimated from variance; None if that does not reproduce itself.

        The effect's other parameters are tried at the catalogue's values too, with few simulated sets each, since their
        estimates come from mean shifts.
        """
        strengths = told.strengths
        sketches: list[tuple[Evidence, State]] = []
        for camera in self._otherwise(
            candidate, told.scaled(sketch.fitted.camera), {c.path for c in strengths}
        ):
            again = self._scattering(state, candidate, camera, strengths, self._few)
            if again is None:
                break
            sketches.append((evidence(state, again, len(candidate.coordinates), self.effects), again))
            if sketches[-1][0].is_reached:
                break
        if not sketches:
            return None
        best = max(sketches, key=lambda pair: pair[0].score)[1].fitted.reference
        return self._scattering(state, candidate, best.camera, strengths, self.sets, best)

    def _scattering(
        self,
        state: State,
        candidate: Refined,
        camera: Camera,
        strengths: tuple[Coordinate, ...],
        sets: int,
        begun: Reference | None = None,
    ) -> State | None:
        """The state with the strength of the camera given, or the one that its variance then yields; None if they differ."""
        held, free = {c.path for c in strengths}, {c.path for c in candidate.coordinates}
        for _ in range(SCALED):
            # on the scale that the camera's values allow: 0 has no logarithm
            every = effect_coordinates(camera, candidate.effect)
            others = [c for c in every if c.path in free and c.path not in held]
            after = self._added(
                state, candidate.effect, camera, others, sets, begun, settle=sets == self.sets
            )
            told = self._told(state, after, candidate)
            assert told is not None
            if told.is_met:
                told = self._answering(state, after, told) if sets == self.sets else told
                return replace(after, scatters=(*after.scatters, told))
            camera, begun = told.scaled(after.fitted.camera), None
        return None

    def _answering(self, state: State, after: State, told: VarianceStrength) -> VarianceStrength:
        """An estimate with its answer to the strength, from a few sets of another one, refitted as those of the state."""
        reference = after.fitted.reference
        for ratio in (STRONGER, 1 / STRONGER):  # weaker at a bound
            at = [c.read(reference.camera) + math.log(ratio) for c in told.strengths]
            other = moved(reference.camera, told.strengths, at)
            if not any(is_stopped(c, other, x) for c, x in zip(told.strengths, at, strict=True)):
                break
        label, jobs = "simulating sets of another strength", [(other, k) for k in range(self._few)]
        there = self.lab.finding(jobs, lambda n: self.report(label, n, len(jobs))) - reference.mean
        steps = adjust(there, reference.slopes, reference.scale, reference.priors)
        return told.answering(state.find, after.find, there - steps @ reference.slopes.T, ratio)

    def swapped(self, state: State, own: str, with_rival: State) -> State:
        """The state with an effect replaced by a rival, everything refitted.

        Args:
            own: the effect that is replaced.
            with_rival: the state whose last effect is the rival.
        """
        rival, known = with_rival.accepted[-1], with_rival.fitted
        camera = exchanged(state.fitted.camera, own, known.camera, rival)
        kept = [c for c in state.fitted.reference.coordinates if not c.path.startswith(f"{own}.")]
        gained = [c for c in known.reference.coordinates if c.path.startswith(f"{rival}.")]
        accepted = tuple(rival if name == own else name for name in state.accepted)
        fitted = self._fitted(state, camera, [*kept, *gained], self.sets)
        scatters = [s for s in state.scatters if s.effect != own]
        scatters += [s for s in with_rival.scatters if s.effect == rival]
        return replace(state, fitted=fitted, accepted=accepted, scatters=tuple(scatters))

    def without(self, earlier: State, state: State, own: str) -> State:
        """The state without the effect before its last one, everything refitted, by the first of the simulated sets.

        Args:
            earlier: the state to which that effect was added.
        """
        kept = [c for c in state.fitted.reference.coordinates if not c.path.startswith(f"{own}.")]
        fitted = self._fitted(state, state.fitted.camera.without_effect(own), kept, self._few)
        scatters = tuple(s for s in state.scatters if s.effect != own)
        return replace(earlier.with_effect(state.accepted[-1], fitted), scatters=scatters)

    def _otherwise(self, candidate: Refined, camera: Camera, held: set[str]) -> Iterator[Camera]:
        """A camera, then the same with the free parameters of its effect at each of the catalogue's trial values."""
        yield camera
        free = [c.path for c in candidate.coordinates if c.path not in held]
        tried = [{path: camera.values()[path] for path in free}]
        for trial in self.trials:
            if trial.effect == candidate.effect:
                values = trial.on(self.first.camera).values()
                numbers = {path: values[path] for path in free}
                if numbers not in tried:
                    tried.append(numbers)
                    yield camera.replace(numbers)

    @staticmethod
    def _told(before: State, after: State, candidate: Refined) -> VarianceStrength | None:
        return scatter(before.find, after.find, strengths_of(candidate.effect, candidate.coordinates))

    def _added(
        self,
        state: State,
        effect: str,
        camera: Camera,
        own: Sequence[Coordinate],
        sets: int,
        begun: Reference | None = None,
        settle: bool = True,
    ) -> State:
        """The state with an effect whose free coordinates are `own`."""
        coordinates = [*state.fitted.reference.coordinates, *own]
        fitted = self._fitted(state, camera, coordinates, sets, begun, settle)
        return state.with_effect(effect, fitted)

    def _fitted(
        self,
        near: State,
        camera: Camera,
        coordinates: Sequence[Coordinate],
        sets: int,
        begun: Reference | None = None,
        settle: bool = True,
    ) -> Fitted:
        """A camera, simulated and refitted. Derivatives of a neighbouring state and sets that exist are reused.

        Args:
            settle: whether the fit is followed to its end, and the reference simulated anew if that is far from it.
        """
        known = near.fitted.reference
        reference = make_reference(self.lab, camera, coordinates, sets, self.report, known, begun)
        fitted = self._refitted(reference, near.fitted)
        if not settle:
            return fitted
        return followed(self.lab, settled(self.lab, fitted, sets, self.report, known), self.report)

    def _refitted(self, reference: Reference, near: Fitted) -> Fitted:
        """The best of three fits, started from the candidate's camera, the camera as given, and the earlier effects' parameters.

        A robust fit can stop in a local minimum. If two minima are about equally good, the one with the earlier parameters is
        kept.
        """
        fitted = refit(self.lab, reference, self.report)
        given = {c.path for c in self.first.coordinates}
        gained = [c for c in near.reference.coordinates if c.path not in given]
        starts = ((self.first.camera, self.first.coordinates, 1.0), (near.camera, gained, AS_DEEP))
        for camera, numbers, share in starts:
            start = self._where_elsewhere(fitted.camera, camera, numbers, reference)
            if start is not None:
                again = refit(self.lab, reference, self.report, begin=start, known=fitted)
                fitted = again if again.misfit < share * fitted.misfit else fitted
        return fitted

    @staticmethod
    def _where_elsewhere(
        fitted: Camera, camera: Camera, numbers: Sequence[Coordinate], reference: Reference
    ) -> Camera | None:
        """The fitted camera with some coordinates of another one; None if these differ by less than `BENT` standard deviations."""
        at = {(c.path, c.logarithmic): c.read(camera) for c in numbers}  # on the same scale alone
        own = [c for c in reference.coordinates if (c.path, c.logarithmic) in at]
        there = [at.get((c.path, c.logarithmic), c.read(fitted)) for c in reference.coordinates]
        if not is_apart(reference, fitted, np.array(there)):
            return None
        return moved(fitted, own, [at[c.path, c.logarithmic] for c in own])
