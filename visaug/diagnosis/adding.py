"""A camera with one more effect: simulated, refitted, its strength estimated from mean shifts or from variance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.camera import Camera
from visaug.comparison import Laboratory
from visaug.diagnosis import cache
from visaug.diagnosis.acceptance import OFF, State, explains, may_explain, moves_of
from visaug.diagnosis.candidates import Trial, exchanged
from visaug.diagnosis.fit import TWINS, Fitted, refit
from visaug.diagnosis.naming import SIGNIFICANT, decided
from visaug.diagnosis.parameters import Coordinate, effect_coordinates, moved, strengths_of
from visaug.diagnosis.reference import Reference, Report
from visaug.diagnosis.refinement import Refined
from visaug.diagnosis.robust import standardised
from visaug.diagnosis.signatures import cleared
from visaug.diagnosis.spread import Scatter, scatter, widened
from visaug.effects import catalogue

SETS_AFTER = 120  # simulated sets of a camera with an effect added,
SETS_BEFORE = 30  # and the first of them, from which `may_explain` is decided
SCALED = 2  # iterations of a strength that is estimated from variance
BENT = 5.0  # standard deviations between fit and camera file above which a second fit starts from the file
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

    def where_promising(self, state: State, candidate: Refined) -> State | None:
        """As `with_candidate`, or None if a few simulated sets show that the effect does not explain the residuals."""
        sketch = self._sketched(state, candidate)
        if not self._may_explain(state, candidate, sketch):
            return None
        so = self._as_it_scatters(state, candidate, sketch)
        if so is not None and explains(self.lab.statistics, state, so):
            return so
        settled = self._settled(state, candidate, sketch)
        if so is None:
            return (
                self._completed(state, candidate, settled)
                if self._may_explain(state, candidate, settled)
                else None
            )
        # One rare missing code in dark frames has the variance of four times as many; flat frames exclude that.
        if may_explain(self.lab.statistics, state, settled):
            by_moves = self._completed(state, candidate, settled)
            if explains(self.lab.statistics, state, by_moves):
                return by_moves
        return so

    def with_candidate(self, state: State, candidate: Refined) -> State:
        """The state with a candidate, simulated and refitted; its strength is estimated from variance if it has no mean shift."""
        sketch = self._sketched(state, candidate)
        so = self._as_it_scatters(state, candidate, sketch)
        return so or self._completed(state, candidate, self._settled(state, candidate, sketch))

    def _sketched(self, state: State, candidate: Refined) -> State:
        """The state by the first of the simulated sets, without a new reference where the fit ends."""
        effect, own = candidate.effect, candidate.coordinates
        return self._added(state, effect, candidate.camera, own, self._few, settle=False)

    def _may_explain(self, state: State, candidate: Refined, sketch: State) -> bool:
        scatters = self._scatter(state, sketch, strengths_of(candidate.effect, candidate.coordinates))
        return scatters is not None or may_explain(self.lab.statistics, state, sketch)

    def _settled(self, state: State, candidate: Refined, sketch: State) -> State:
        """The state with a reference simulated where the fit ended, if that is far from the first."""
        fitted = cache.settled(self.lab, sketch.fitted, self._few, self.report)
        if fitted is sketch.fitted:
            return sketch
        return state.with_effect(candidate.effect, fitted, *self._moves_of(candidate.effect, state, fitted))

    def _completed(self, state: State, candidate: Refined, sketch: State) -> State:
        effect, own, begun = candidate.effect, candidate.coordinates, sketch.fitted.reference
        return self._added(state, effect, begun.camera, own, self.sets, begun, settle=False)

    @property
    def _few(self) -> int:
        return min(SETS_BEFORE, self.sets)

    def _as_it_scatters(self, state: State, candidate: Refined, sketch: State) -> State | None:
        """The state with a strength estimated from variance; None if the variance does not determine it.

        If residuals stay where the effect acts, its other parameters are tried at the catalogue's values, with few simulated
        sets each.
        """
        effect, strengths = candidate.effect, strengths_of(candidate.effect, candidate.coordinates)
        told = self._scatter(state, sketch, strengths)
        if told is None or not told.tells:
            return None
        sketches = []
        for camera in self._otherwise(effect, told.scaled(sketch.fitted.camera), {c.path for c in strengths}):
            again = self._scattering(state, effect, camera, strengths, self._few)
            if again is None:
                break
            sketches.append(again)
            if self._holds_where_it_acts(state, again):
                break
        if not sketches:
            return None
        best = decided(self.lab.statistics, state, [(candidate, each) for each in sketches])[0][
            1
        ].fitted.reference
        return self._scattering(state, effect, best.camera, strengths, self.sets, best)

    def _scattering(
        self,
        state: State,
        effect: str,
        camera: Camera,
        strengths: tuple[Coordinate, ...],
        sets: int,
        begun: Reference | None = None,
    ) -> State | None:
        """The state with the strength of the camera given, or the one that its variance then yields; None if they differ."""
        held = {c.path for c in strengths}
        for _ in range(SCALED):
            others = [c for c in effect_coordinates(camera, effect) if c.path not in held]
            after = self._added(state, effect, camera, others, sets, begun, settle=sets == self.sets)
            told = self._scatter(state, after, strengths)
            if told is None:
                return None
            if told.is_met:
                return replace(after, scatters=(*after.scatters, told))
            camera, begun = told.scaled(after.fitted.camera), None
        return None

    @staticmethod
    def _holds_where_it_acts(before: State, after: State) -> bool:
        """Whether no residual is left that another value of the last effect could remove: it neither shifts nor varies there."""
        moved_far = np.abs(standardised(moves_of(before, after), before.fitted.reference.null_scale)) > OFF
        off = np.abs(after.z) > np.quantile(after.fitted.reference.null.largest, 1 - SIGNIFICANT)
        return not np.any(off & (moved_far | widened(before.fitted, after.fitted)))

    def swapped(self, state: State, own: Refined, rival: Refined) -> State:
        """The state with an effect replaced by a rival, everything refitted."""
        camera = exchanged(state.fitted.camera, own.effect, rival.camera, rival.effect)
        kept = [c for c in state.fitted.reference.coordinates if not c.path.startswith(f"{own.effect}.")]
        accepted = tuple(rival.effect if name == own.effect else name for name in state.accepted)
        fitted = self._fitted(state, camera, [*kept, *rival.coordinates], self.sets)
        scatters = tuple(s for s in state.scatters if s.effect != own.effect)
        return replace(
            state, fitted=fitted, accepted=accepted, moves=None, confirm_moves=None, scatters=scatters
        )

    def _otherwise(self, effect: str, camera: Camera, held: set[str]) -> Iterator[Camera]:
        """A camera, then the same with the free parameters of its effect at each of the catalogue's trial values."""
        yield camera
        free = [c.path for c in effect_coordinates(camera, effect) if c.path not in held]
        tried = [{path: camera.values()[path] for path in free}]
        for trial in self.trials:
            if trial.effect == effect:
                values = trial.on(self.first.camera).values()
                numbers = {path: values[path] for path in free}
                if numbers not in tried:
                    tried.append(numbers)
                    yield camera.replace(numbers)

    @staticmethod
    def _scatter(before: State, after: State, strengths: tuple[Coordinate, ...]) -> Scatter | None:
        return None if after.moves is None else scatter(before.fitted, after.fitted, after.moves, strengths)

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
        return state.with_effect(effect, fitted, *self._moves_of(effect, state, fitted))

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
            settle: whether the reference is simulated anew if the fit ends far from it.
        """
        known = near.fitted.reference
        reference = cache.reference(self.lab, camera, coordinates, sets, self.report, known, begun)
        fitted = self._refitted(reference, near.fitted)
        return cache.settled(self.lab, fitted, sets, self.report) if settle else fitted

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
                again = refit(self.lab, reference, self.report, begin=start)
                fitted = again if again.misfit < share * fitted.misfit else fitted
        return fitted

    @staticmethod
    def _where_elsewhere(
        fitted: Camera, camera: Camera, numbers: Sequence[Coordinate], reference: Reference
    ) -> Camera | None:
        """The fitted camera with some coordinates of another one; None if these differ by less than `BENT` standard deviations."""
        at = {(c.path, c.logarithmic): c.read(camera) for c in numbers}  # on the same scale alone
        spread = reference.null_steps.std(0)
        own = [
            (c, at[c.path, c.logarithmic], known)
            for c, known in zip(reference.coordinates, spread)
            if (c.path, c.logarithmic) in at
        ]
        if all(abs(c.read(fitted) - there) <= BENT * known for c, there, known in own):
            return None
        return moved(fitted, [c for c, _, _ in own], [there for _, there, _ in own])

    def _moves_of(
        self, effect: str, before: State, fitted: Fitted
    ) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """Shift of the statistics of the discovery and hold-out frames by an effect of a fitted camera.

        (None, None) for a term of the base chain, which cannot be removed.
        """
        if catalogue()[effect].base:
            return None, None
        pair, reference = (fitted.camera, fitted.camera.without_effect(effect)), before.fitted.reference
        find, confirm, _ = self.lab.simulated([(c, k) for c in pair for k in range(TWINS)])
        moves = [values.reshape(2, TWINS, -1) for values in (find, confirm)]
        scales = (reference.null_scale, reference.confirm_null.scale)
        found, confirmed = (cleared(m[0] - m[1], scale) for m, scale in zip(moves, scales, strict=True))
        return found, confirmed
