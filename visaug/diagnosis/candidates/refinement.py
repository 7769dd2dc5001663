"""Fits the parameters of a candidate effect together with the camera's nuisance parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.climb import Climb
from visaug.diagnosis.candidates.matches import CHANCE, Match
from visaug.diagnosis.candidates.signatures import following, is_random, own_variance
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import FORM, metric, scatter_along
from visaug.diagnosis.fitting.parameters import Coordinate, base_coordinates, effect_coordinates, is_of, moved
from visaug.diagnosis.fitting.reference import Report
from visaug.diagnosis.fitting.robust import adjust
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue

MOST = 50.0  # bound on the factor of a signature, and on its inverse
STALLED = 0.5  # log-likelihood gain below which an iteration has stalled
HOPE = 2.0  # times the gain of the last two iterations: a bound on what the next ones may gain
NUMBER = 1.0  # log likelihood that a free parameter gains by fitting noise (Akaike),
LOOKED = 5.0  # and that a place gains that was chosen as the best of about a hundred in the measured frames

APART = 0.2  # share by which a value that was read from the frames differs from a fitted one that is another explanation


@dataclass(frozen=True)
class Refined:
    """A candidate whose parameters were fitted together with the camera's.

    Attributes:
        camera: the fitted camera with the effect.
        coordinates, at: the effect's free parameters and their values.
        gain: log-likelihood gain, see `scatter_along`, less `cost`.
        residual: of every statistic, with the camera's parameters refitted.
        variance: variance that the effect adds, per statistic.
        cost: log likelihood that its free parameters gain by fitting noise.
        looked: whether the fit began at values that were estimated from the frames.
        otherwise: the same effect with other options, or from such values, if it gains almost as much.
    """

    effect: str
    camera: Camera
    coordinates: tuple[Coordinate, ...]
    at: np.ndarray
    gain: float
    residual: np.ndarray
    variance: np.ndarray
    cost: float = 0.0
    looked: bool = False
    otherwise: "Refined | None" = None

    @property
    def words(self) -> dict[str, str]:
        return {
            path: word for path, word in self.camera.choices().items() if path.startswith(f"{self.effect}.")
        }

    @property
    def numbers(self) -> dict[str, float]:
        """All parameters of the effect, free or not."""
        return {
            path: value for path, value in self.camera.values().items() if path.startswith(f"{self.effect}.")
        }

    def is_like(self, other: "Refined") -> bool:
        """Whether another fit of the effect has the same options and, where one of both was read from the frames, its values."""
        if self.words != other.words or self.looked == other.looked:
            return self.words == other.words
        pairs = [(value, other.numbers[path]) for path, value in self.numbers.items()]
        return all(abs(a - b) <= APART * max(abs(a), abs(b)) for a, b in pairs)


def coordinates_of(
    effect: str, camera: Camera, lab: Laboratory, free: Sequence[Coordinate]
) -> list[Coordinate]:
    """The free parameters of a candidate: of a further effect, or of what was zero in a base term.

    Args:
        free: the camera's own free parameters, to which those of the candidate are added.
    """
    if not catalogue()[effect].base:
        return effect_coordinates(camera, effect)
    known = {c.path for c in free}
    own = base_coordinates(camera, lab.frames, True)
    return [c for c in own if is_of(c.path, effect) and c.path not in known]


def refine(
    lab: Laboratory,
    fitted: Fitted,
    match: Match,
    report: Report,
    allowance: np.ndarray | float = 0.0,
    beaten: float = 0.0,
    least: float = -np.inf,
    also: Sequence[Camera] = (),
    iterations: int = 8,
) -> Refined:
    """Fits the effect's parameters by damped Gauss-Newton with common random numbers, the camera's parameters left open.

    Camera parameters that follow far, or take up most of a shift, are moved along. The iteration ends after two iterations that
    gain less than `STALLED`, or when it cannot reach the gain of another effect.

    Args:
        beaten: gain of the best effect refined so far.
        least: gain that the start needs to be iterated.
        also: cameras with the effect in the same options, whose values are further starts.
    """
    cameras = [_scaled(fitted, match)]
    camera = cameras[0]
    # a camera that was not refitted has not followed: there the effect may stand alone
    if match.trial.following:
        cameras.append(_scaled(fitted, replace(match, trial=match.trial.unmoved)))
    # shifts are not proportional to strengths: those of a faint blur grow with a power above ten
    cameras.append(_scaled(fitted, replace(match, scale=np.sign(match.scale))))
    cameras += also
    own = coordinates_of(match.trial.effect, camera, lab, fitted.reference.coordinates)
    judged = metric(fitted, FORM, allowance)
    climb = Climb(lab, fitted, judged, match, camera, own)
    report(f"refining {match.trial.effect}", 0, iterations)
    begun = climb.start(cameras)
    if not match.variance.any() and is_random(begun.moves, fitted.reference.null_scale):
        # what is rare, the signature's first simulations did not show: a code that never comes among the few of a dark frame
        match = replace(match, variance=own_variance(begun.moves, fitted.reference.null_scale))
        climb = Climb(lab, fitted, judged, match, camera, own)
        begun = climb.start(cameras)
    best = climb.upwards(begun)
    step, damping, gains = None, 1.0, [best.gain]
    for i in range(1, iterations if own and best.gain > least else 1):
        report(f"refining {match.trial.effect}", i, iterations)
        step = climb.step(best) if step is None else step
        point = climb.settled(best.at + damping * step, best)
        if point.gain > best.gain:
            best, step, damping = point, None, 1.0
        else:  # too far: from the best point a shorter step
            damping *= 0.35
        gains.append(best.gain)
        if len(gains) > 2:
            lately = gains[-1] - gains[-3]
            if lately < 2 * STALLED or gains[-1] + HOPE * lately < beaten - 0.2 * abs(beaten):
                break
    left = np.sqrt((FORM * fitted.residual) ** 2 + np.square(allowance) + match.variance)
    (wide,) = scatter_along(fitted.reference.null, left, best.move[None])
    cost = NUMBER * len(own) + (LOOKED if match.trial.looked else 0.0)
    residual = fitted.residual - best.move
    theirs = adjust(residual[None], fitted.slopes, fitted.reference.scale, fitted.reference.priors)[0]
    return Refined(
        match.trial.effect,
        moved(camera, climb.coordinates, list(best.at)),
        tuple(own),
        best.at[climb.theirs :],
        best.gain - CHANCE * (float(wide) - 1) - cost,
        residual - fitted.slopes @ theirs,
        np.maximum(best.variance, match.variance),  # rare events may be missing from a few simulations
        cost,
        match.trial.looked,
    )


def _scaled(fitted: Fitted, match: Match) -> Camera:
    """The trial with its strengths multiplied by the scale of its signature."""
    factor = float(np.clip(abs(match.scale), 1 / MOST, MOST)) * (-1.0 if match.scale < 0 else 1.0)
    return following(fitted.reference, match.trial.times(factor).on(fitted.camera), match.trial, factor)
