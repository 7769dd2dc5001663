"""Fits the parameters of a candidate effect together with the camera's nuisance parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.climb import Climb
from visaug.diagnosis.candidates.matches import CHANCE, Match, extrapolation
from visaug.diagnosis.candidates.signatures import FEW, cleared, following, is_random, own_variance
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import FORM, metric, scatter_along
from visaug.diagnosis.fitting.parameters import Coordinate, base_coordinates, effect_coordinates, moved
from visaug.diagnosis.fitting.reference import Report
from visaug.diagnosis.fitting.robust import adjust, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue

SCALED_FAR = 3.0  # factor on a signature beyond which it may be neither a level nor a variance
MOST = 1e3  # bound on the factor, and on its inverse
NOTHING = 1e-6  # standard deviations of a shift below which no factor is defined
BALANCED = 6  # largest number of strengths that are simulated until the shifts are as large as the residuals
STALLED = 0.5  # log-likelihood gain below which an iteration has stalled
HOPE = 2.0  # times the gain of the last two iterations: a bound on what the next ones may gain
NUMBER = 1.0  # log likelihood that a free parameter gains by fitting noise (Akaike),
LOOKED = 5.0  # and that a place gains that was chosen as the best of about a hundred in the measured frames
POWERS = (
    0.7,
    1.0,
    0.5,
)  # exponents of the scale of a signature: a level is proportional to a strength, a variance to its square


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
        otherwise: the same effect with other options, if it gains almost as much.
    """

    effect: str
    camera: Camera
    coordinates: tuple[Coordinate, ...]
    at: np.ndarray
    gain: float
    residual: np.ndarray
    variance: np.ndarray
    cost: float = 0.0
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


def coordinates_of(
    effect: str, camera: Camera, lab: Laboratory, free: Sequence[Coordinate]
) -> list[Coordinate]:
    """The free parameters of a candidate: of a further effect, or of what was zero in a base term.

    Args:
        free: the camera's own free parameters, to which those of the candidate are added.
    """
    if not catalogue()[effect].base:
        return effect_coordinates(camera, effect)
    prefix, known = "full_well_e" if effect == "saturation" else f"{effect}.", {c.path for c in free}
    own = base_coordinates(camera, lab.frames, True)
    return [c for c in own if c.path.startswith(prefix) and c.path not in known]


def refine(
    lab: Laboratory,
    fitted: Fitted,
    match: Match,
    report: Report,
    allowance: np.ndarray | float = 0.0,
    beaten: float = 0.0,
    least: float = -np.inf,
    beside: Sequence[Trial] = (),
    also: Sequence[Camera] = (),
    iterations: int = 8,
) -> Refined:
    """Fits the effect's parameters by damped Gauss-Newton with common random numbers, the camera's parameters left open.

    Camera parameters that follow far are moved along, so that no derivative is used over a long distance. The iteration ends
    after two iterations that gain less than `STALLED`, or when it cannot reach the gain of another effect.

    Args:
        beaten: gain of the best effect refined so far.
        least: gain that the start needs to be iterated.
        beside: trials of the same kind, used as further starts where the match has a scale far from 1: the shift by a blur
            grows a thousandfold from 0.1 to 0.6 px, by no power of its width.
        also: cameras with the effect in the same options, whose values are further starts.
    """
    cameras = [_scaled(fitted, match, power) for power in POWERS]
    camera = cameras[0]
    # a camera that was not refitted has not followed: there the effect may stand alone
    if match.trial.following:
        cameras.append(match.trial.on(fitted.camera))
    if beside and extrapolation(match) > np.log(SCALED_FAR):
        cameras += _among(lab, fitted, beside)
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
    )


def _among(lab: Laboratory, fitted: Fitted, beside: Sequence[Trial]) -> list[Camera]:
    """Some trials of different strength, and a strength between two of them at which the factor on the shifts is 1.

    Other fits can be separated from the optimum by a ridge of the likelihood.
    """
    scale = fitted.reference.null_scale
    base = lab.finding([(fitted.camera, k) for k in range(FEW)])

    def wanted(camera: Camera) -> float:
        """Logarithm of the factor on the shifts that fits the residuals; the largest allowed where there are no shifts."""
        moves = cleared(lab.finding([(camera, k) for k in range(FEW)]) - base, scale)
        z = standardised(moves, scale)
        factor = z @ fitted.z / (z @ z) if np.any(np.abs(z) > NOTHING) else MOST
        return float(np.log(np.clip(factor, 1 / MOST, MOST)))

    effect = catalogue()[beside[0].effect]
    keys = [f"{effect.name}.{key}" for key in effect.strengths()]
    rising = sorted(beside, key=lambda trial: sum(abs(v) for path, v in trial.values if path in keys))
    cameras = [following(fitted.reference, t.on(fitted.camera), t, 1.0) for t in rising]
    factors = [wanted(camera) for camera in cameras]
    for (a, weak), (b, strong) in pairwise(zip(cameras, factors, strict=True)):
        if weak > 0 > strong:
            cameras.append(_balanced(a, b, weak, strong, keys, wanted))
            break
    return cameras


def _balanced(a: Camera, b: Camera, weak: float, strong: float, keys: Sequence[str], wanted) -> Camera:
    """The camera between two others, by regula falsi in the logarithm of their strengths, where that factor is 1."""
    low, high, camera = 0.0, 1.0, a
    at = {key: (a.values()[key], b.values()[key]) for key in keys if a.values()[key] * b.values()[key] > 0}
    for _ in range(BALANCED):
        share = low + (high - low) * weak / (weak - strong)
        camera = b.replace({key: x * (y / x) ** share for key, (x, y) in at.items()})
        now = wanted(camera)
        if abs(now) < 0.02:
            break
        low, weak, high, strong = (share, now, high, strong) if now > 0 else (low, weak, share, now)
    return camera


def _scaled(fitted: Fitted, match: Match, power: float) -> Camera:
    """The trial with its strengths multiplied by the scale of its signature."""
    with_effect = match.trial.on(fitted.camera)
    effect = catalogue()[match.trial.effect]
    factor = float(np.clip(match.scale, 2e-3, 50)) ** power
    values = {}
    for path, value in match.trial.values:
        parameter = effect.parameters.get(path.split(".", 1)[-1])
        if parameter is not None and parameter.strength and not parameter.integer and value:
            values[path] = min(max(value * factor, parameter.low), parameter.high)
    scaled = with_effect.replace(values) if values else with_effect
    return following(fitted.reference, scaled, match.trial, factor)
