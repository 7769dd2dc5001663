"""How each trial of an effect moves every statistic: simulated, never written down."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.camera import Camera
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.candidates import Trial
from visaug.diagnosis.fit import bias_level
from visaug.diagnosis.law import ROUGH, law
from visaug.diagnosis.parameters import BLACK, moved
from visaug.diagnosis.reference import Reference, Report
from visaug.diagnosis.robust import drawn_to_zero, standardised

FAR_DN = 0.3  # that the black level has to follow to be moved along
REDRAWN = 2.0  # variances of the null that a difference of two independent sets has
FEW, MORE = 2, 6  # simulations of a trial whose effect brings no spread of its own, and of one that does


@dataclass(frozen=True)
class Signatures:
    """How each trial moves every statistic of the reference camera, and what spread it adds: (trials, statistics) each."""

    trials: tuple[Trial, ...]
    values: np.ndarray
    variances: np.ndarray

    def __add__(self, other: "Signatures") -> "Signatures":
        return Signatures(
            self.trials + other.trials,
            np.concatenate([self.values, other.values]),
            np.concatenate([self.variances, other.variances]),
        )


def signatures(lab: Laboratory, reference: Reference, tried: Sequence[Trial], report: Report) -> Signatures:
    """Simulates every trial with the random numbers of the reference's first sets.

    An effect that only moves the means shows it in two simulations; one that draws numbers of its own gets more. Where the camera's
    own numbers would follow far they are moved along: over a long way no derivative is right, and bits and codes have none.
    """
    if not tried:
        nothing = np.zeros((0, len(reference.scale)))
        return Signatures((), nothing, nothing)
    moves = _moves(lab, reference, tried, range(FEW), report, "trying")
    tried = _followed(lab, reference, tried, moves.mean(1))
    again = [i for i, trial in enumerate(tried) if trial.following]
    if again:
        moves[again] = _moves(lab, reference, [tried[i] for i in again], range(FEW), report, "following")
    scale = reference.null_scale
    random = [i for i in range(len(tried)) if is_random(moves[i], scale)]
    means, variances = cleared(moves, scale), np.zeros_like(moves[:, 0])
    if random:
        again = _moves(lab, reference, [tried[i] for i in random], range(FEW, MORE), report, "trying again")
        whole = np.concatenate([moves[random], again], 1)
        means[random] = cleared(whole, scale)
        variances[random] = own_variance(whole, scale)
    return Signatures(tuple(tried), means, variances)


def is_random(moves: np.ndarray, scale: np.ndarray) -> bool:
    """Whether moves (simulations, statistics) differ by more than what noise drawn once does: the effect has numbers of its own."""
    z = standardised(moves, scale)
    return bool(z.var(0, ddof=1).mean() > max(0.15, 0.02 * (z.mean(0) ** 2).mean()))


def own_variance(moves: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Of moves (..., simulations, statistics): the spread that an effect brings of its own.

    Noise that is drawn anew is in the null already; what the effect brings exceeds it.
    """
    variance = moves.var(-2, ddof=1)
    return np.where(variance > REDRAWN * scale**2, variance, 0.0)


def cleared(moves: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Mean over simulations (..., simulations, statistics), drawn to 0 where it is no more than their noise.

    An effect with random numbers of its own draws all noise anew. A thousand statistics of which each wavers a little would
    outweigh the few that a faint effect moves. Of few simulations the noise is that of all statistics together.
    """
    count = moves.shape[-2]
    mean, variance = moves.mean(-2), moves.var(-2, ddof=1)
    if count < MORE:
        spread = np.divide(variance, scale**2, out=np.zeros_like(variance), where=scale > 0)
        variance = spread.mean(-1, keepdims=True) * scale**2
    return drawn_to_zero(mean, variance / count)


def _followed(
    lab: Laboratory, reference: Reference, tried: Sequence[Trial], moves: np.ndarray
) -> list[Trial]:
    """The trials with the camera's own numbers where these moves (trials, statistics) lead them, if that is far.

    The black level goes as far as the mean of the bias frames came, so that bits and codes stay where they are; then the others.
    """
    level = bias_level(lab.statistics)
    black = [k for k, c in enumerate(reference.coordinates) if c.path == BLACK]
    steps = np.array([FAR_DN if c.path == BLACK else c.step for c in reference.coordinates])
    priors = reference.priors.copy()
    if level is not None:
        priors[black] = 0.0  # it is set, so the others have to do without it
    null = replace(reference.null, priors=priors)
    found = []
    for trial, move in zip(tried, moves, strict=True):
        way = np.zeros(len(priors))
        if level is not None:
            way[black] = -move[level]
        m = law(null, ROUGH * move)
        left = m.white(move + reference.slopes @ way)
        way += np.clip(-(priors**2) * (m.white(reference.slopes.T) @ left), -priors, priors)
        if np.any(np.abs(way) > steps):
            paths = [c.path for c in reference.coordinates]
            trial = replace(trial, following=tuple(zip(paths, map(float, way), strict=True)))
        found.append(trial)
    return found


def _moves(
    lab: Laboratory, reference: Reference, tried: Sequence[Trial], numbers: range, report: Report, word: str
) -> np.ndarray:
    """(trials, simulations, statistics): how far each trial moves each of the reference's sets."""
    cameras = [following(reference, trial.on(reference.camera), trial, 1.0) for trial in tried]
    jobs = [(camera, k) for camera in cameras for k in numbers]

    def tick(done: int) -> None:
        report(f"{word} {tried[min((done - 1) // len(numbers), len(tried) - 1)].effect}", done, len(jobs))

    values = lab.finding(jobs, tick).reshape(len(tried), len(numbers), -1)
    return values - reference.sets[numbers.start : numbers.stop]


def following(reference: Reference, camera: Camera, trial: Trial, share: float) -> Camera:
    """The camera with its own numbers where the trial leads them, or a share of the way."""
    if not trial.following:
        return camera
    ways = dict(trial.following)
    own = [c for c in reference.coordinates if c.path in ways]
    return moved(camera, own, [c.read(camera) + share * ways[c.path] for c in own])
