"""A candidate effect with its own numbers fitted, the camera's following."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from visaug.camera import Camera
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.candidates import Trial
from visaug.diagnosis.climb import Climb
from visaug.diagnosis.fit import Fitted
from visaug.diagnosis.law import FINE, metric, scatter_along
from visaug.diagnosis.matches import CHANCE, Match, extrapolation
from visaug.diagnosis.parameters import Coordinate, base_coordinates, effect_coordinates, moved
from visaug.diagnosis.reference import Report
from visaug.diagnosis.robust import adjust, standardised
from visaug.diagnosis.signatures import FEW, cleared, following, is_random, own_variance
from visaug.effects import catalogue

SCALED_FAR = 3.0  # times that a signature wants to be multiplied: neither a level nor a variance, perhaps
MOST = 1e3  # times that moves want to be multiplied, or divided; more says nothing
NOTHING = 1e-6  # standard deviations: a blur of 0.04 px moves nothing that can be multiplied
BALANCED = 6  # simulated strengths until the one is found whose moves are as large as what is left
STALLED = 0.5  # gain in log likelihood below which an iteration is said to bring nothing
HOPE = 2.0  # times what the last two iterations gained is what the next ones may still gain
NUMBER = 1.0  # log likelihood that a free number gains by fitting noise (Akaike),
LOOKED = 5.0  # and that places gain which were chosen by a look at the frames: the best of a hundred
POWERS = (
    0.7,
    1.0,
    0.5,
)  # of the scale that a signature wants: a level grows with a strength, a variance with its square


@dataclass(frozen=True)
class Refined:
    """A candidate after its own numbers were fitted with the camera's.

    Attributes:
        camera: the fitted camera with the effect.
        coordinates, at: the effect's free numbers and where they are.
        gain: by how much it raises the logarithm of the residual's likelihood, see `scatter_along`, less the cost.
        residual: what is left of the residual per statistic, the camera's own numbers following.
        variance: what spread the effect brings, per statistic.
        cost: what its free numbers gain by fitting noise.
        otherwise: the same effect in other words, if it gains nearly as much.
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
        """Those under the effect's own name, free or not."""
        return {
            path: value for path, value in self.camera.values().items() if path.startswith(f"{self.effect}.")
        }


def coordinates_of(effect: str, camera: Camera, lab: Laboratory) -> list[Coordinate]:
    """The free numbers of a candidate: those of a further effect, or of a base term that was at zero."""
    if not catalogue()[effect].base:
        return effect_coordinates(camera, effect)
    prefix = "full_well_e" if effect == "saturation" else f"{effect}."
    return [c for c in base_coordinates(camera, lab.frames, True) if c.path.startswith(prefix)]


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
    """Fits the effect's numbers by damped Gauss-Newton with common random numbers; the camera's own stay open.

    Where those would follow far they are moved along, so that no derivative has to hold over a long way.

    It ends where two iterations in a row gain less than `STALLED`, or do not bring it near what another has.

    Args:
        beaten: what the best of the effects tried before gains.
        least: what the start must gain to be worth iterating.
        beside: trials of the same kind, among which it is started too where the match wants to be scaled far: what a blur moves
            grows a thousandfold from 0.1 to 0.6 px, by no power of its width.
        also: cameras with the effect in the match's words, from whose numbers it is started too.
    """
    cameras = [_scaled(fitted, match, power) for power in POWERS]
    camera = cameras[0]
    # a camera that was not refitted has not followed: there the effect may stand alone
    if match.trial.following:
        cameras.append(match.trial.on(fitted.camera))
    if beside and extrapolation(match) > np.log(SCALED_FAR):
        cameras += _among(lab, fitted, beside)
    cameras += also
    own = coordinates_of(match.trial.effect, camera, lab)
    judged = metric(fitted, FINE, allowance)
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
    left = np.sqrt((FINE * fitted.residual) ** 2 + np.square(allowance) + match.variance)
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
    """Some trials that differ in strength, and between two of them the one whose moves want to be multiplied by 1.

    Every other fit can have a ridge in between: of a blur, some statistics are right, or none is moved, where most are not.
    """
    scale = fitted.reference.null_scale
    base = lab.finding([(fitted.camera, k) for k in range(FEW)])

    def wanted(camera: Camera) -> float:
        """The logarithm of the factor by which its moves want to be multiplied; the largest where it moves nothing."""
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
    """Between two cameras, by false position in the logarithm of their strengths, where nothing more is wanted."""
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
    """The trial with its strengths scaled as its signature wants."""
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
