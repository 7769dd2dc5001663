"""Do the 95 % intervals of fitted parameters hold the truth? Sets that visaug simulates itself, refitted.

    python -m scripts.fit_coverage                       # every effect that a diagnosis tries, 20 s to 4 min each
    python -m scripts.fit_coverage periodic_banding amplifier_glow --sets 48

The truth is a small camera with one effect, at the first trial strength, doubled until some statistic deviates by ten standard
deviations. A fit starts from a camera up to a step of every parameter beside the truth. This tests the fit and its intervals and
nothing else: whether the law of an effect is right, and whether it is found, is counted by `python -m benchmark`. Strengths are
fitted from mean shifts here, also those that a diagnosis estimates from variance. Errors are those of the coordinates of the fit,
in DN where a parameter is in electrons.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from tests.diagnosis.small import PLAN, frame_set, stated_camera
from visaug.camera import Camera
from visaug.diagnosis.candidates.trials import effect_trials, trials
from visaug.diagnosis.fitting.fit import Fitted, refit, settled
from visaug.diagnosis.fitting.parameters import Coordinate, base_coordinates, effect_coordinates, moved
from visaug.diagnosis.fitting.reference import FIRST, Reference, make_reference
from visaug.diagnosis.fitting.robust import standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.diagnosis.response import with_responses
from visaug.diagnosis.state import State
from visaug.effects import catalogue

SHOWN = 10.0  # standard deviations by which the effect changes some statistic
SETS = 24
FIRST_SET = 5000  # number of the first simulated measurement; those of references begin at 0


@dataclass(frozen=True)
class Coverage:
    """Of one parameter: errors (sets,) of its estimates in standard deviations of their interval."""

    path: str
    errors: np.ndarray

    @property
    def inside(self) -> int:
        """Sets whose 95 % interval holds the truth."""
        return int((np.abs(self.errors) < 1.96).sum())

    def __str__(self) -> str:
        size = np.sqrt((self.errors**2).mean())
        return f"{self.path:45s} {self.inside:3d} of {len(self.errors)}   rms error {size:.2f} sd"


class Truths:
    """Simulated sets of cameras with one effect, refitted."""

    def __init__(self, camera: Camera):
        self.camera = camera
        self.lab = Laboratory(frame_set(3, plan=tuple(PLAN)), camera)
        self.plain = base_coordinates(camera, self.lab.frames, self.lab.calibrated)

    @cached_property
    def without(self) -> Reference:
        return make_reference(self.lab, self.camera, self.plain, FIRST, _silent)

    def shown(self, effect: str) -> Camera:
        """The camera with an effect that these frames show."""
        first = effect_trials(catalogue()[effect])[0]
        truth = first.on(self.camera)
        for factor in (2, 4, 8, 16):
            moves = self.lab.finding([(truth, k) for k in range(2)]) - self.without.sets[:2]
            stronger = first.times(factor)
            if np.abs(
                standardised(moves.mean(0), self.without.null_scale)
            ).max() >= SHOWN or not stronger.fits(self.camera):
                break
            truth = stronger.on(self.camera)
        return truth

    def coverage(
        self, truth: Camera, effect: str, sets: int = SETS, first: int = FIRST_SET
    ) -> list[Coverage]:
        """Of every free parameter, from `sets` simulated measurements."""
        free = [*self.plain, *effect_coordinates(truth, effect)]
        reference = make_reference(self.lab, self._beside(truth, free), free, FIRST, _silent)
        measured, errors = self.lab.measured, {c.path: np.zeros(sets) for c in free}
        simulated = self.lab.simulated([(truth, first + k) for k in range(sets)])
        for k, values in enumerate(zip(*simulated, strict=True)):
            self.lab.measured = tuple(  # pyrefly: ignore[bad-assignment]
                replace(f, values=own) for f, own in zip(measured, values, strict=True)
            )
            fitted = settled(self.lab, refit(self.lab, reference, _silent), FIRST, _silent)
            for path, error in self._errors(fitted, truth, effect).items():
                errors[path][k] = error
        self.lab.measured = measured
        return [Coverage(path, own) for path, own in errors.items()]

    def _errors(self, fitted: Fitted, truth: Camera, effect: str) -> dict[str, float]:
        find, confirm, whole = (np.zeros(len(left)) for left in fitted.residuals)
        state = State(fitted, (effect,), (find, confirm, whole), self.lab.views)
        coordinates, steps, undetermined = with_responses(self.lab, state, _silent).numbers
        spread = np.hypot(np.nanstd(steps, axis=0, ddof=1), undetermined)
        off = [c.read(fitted.camera) - c.read(truth) for c in coordinates]
        return {c.path: x / sd for c, x, sd in zip(coordinates, off, spread, strict=True)}

    @staticmethod
    def _beside(truth: Camera, free: Sequence[Coordinate]) -> Camera:
        """A camera up to a step beside the truth; the full well stays, which only one statistic determines."""
        aside = np.random.default_rng(1).uniform(-1, 1, len(free)) * [
            0.0 if c.path == "full_well_e" else c.step for c in free
        ]
        return moved(truth, free, [c.read(truth) + step for c, step in zip(free, aside, strict=True)])


def _silent(*_: object) -> None:
    """Takes the progress of a phase."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("effects", nargs="*", help="names; all that a diagnosis tries by default")
    parser.add_argument("--sets", type=int, default=SETS)
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    threadpool_limits(1, user_api="blas")
    truths = Truths(stated_camera())
    every = list(dict.fromkeys(trial.effect for trial in trials(truths.camera)))
    known = [name for name in every if not catalogue()[name].base]
    if unknown := set(chosen.effects) - set(known):
        parser.error(f"{', '.join(sorted(unknown))}: not among the effects {', '.join(known)}")
    effects = chosen.effects or known
    own, others = [], []
    for effect in effects:  # sets with numbers of their own: the effects are independent
        number = FIRST_SET + 1000 * list(catalogue()).index(effect)
        found = truths.coverage(truths.shown(effect), effect, chosen.sets, number)
        of_effect = [c for c in found if c.path.startswith(f"{effect}.")]
        own += of_effect
        others += [c for c in found if c not in of_effect]
        print(*of_effect, sep="\n", flush=True)
    for label, some in (("parameters of effects", own), ("other parameters", others)):
        print(
            f"{label}: {sum(c.inside for c in some)} of {sum(len(c.errors) for c in some)} intervals hold the truth"
        )


if __name__ == "__main__":
    main()
