"""Signatures: the shift of every statistic by each trial of an effect, computed by simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.fitting.fit import bias_level
from visaug.diagnosis.fitting.parameters import BLACK, moved
from visaug.diagnosis.fitting.reference import CERTAIN, Reference, Report
from visaug.diagnosis.fitting.robust import adjust, drawn_to_zero, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue

SHOWN = (
    3.0  # standard deviations by which an effect must change some statistic to be detectable in the frames
)
REDRAWN = 2.0  # variances of the null that a difference of two independent sets has
FEW, MORE = 2, 6  # simulations of a trial whose effect has no random numbers of its own, and of one that has


@dataclass(frozen=True)
class Signatures:
    """Mean shift of every statistic by each trial, and the variance that it adds: (trials, statistics) each."""

    trials: tuple[Trial, ...]
    values: np.ndarray
    variances: np.ndarray

    def __add__(self, other: "Signatures") -> "Signatures":
        return Signatures(
            self.trials + other.trials,
            np.concatenate([self.values, other.values]),
            np.concatenate([self.variances, other.variances]),
        )

    def taken(self, places: Sequence[int]) -> "Signatures":
        """Those of some trials."""
        return Signatures(tuple(self.trials[i] for i in places), self.values[places], self.variances[places])


def scanned(lab: Laboratory, reference: Reference, tried: Sequence[Trial], report: Report) -> Signatures:
    """Simulates every trial with the random numbers of the reference's first one or two sets, which finds what may match.

    Other forms of an effect that has no random numbers of its own are simulated once. A trial that changes no statistic much is
    tried at its effect's strongest trial value too. Trial values are for frames of a camera; of pictures they follow the noise.
    """
    tried = [trial.in_units(lab.units) for trial in tried]
    plain = [trial for trial in tried if not trial.is_other_form]
    followed, moves = _following_moves(lab, reference, plain, range(FEW), report)
    sizes = np.abs(standardised(moves.mean(1), reference.null_scale)).max(1, initial=0.0)
    found = signed(reference, followed, moves)
    random = {t.effect for t, move in zip(plain, moves, strict=True) if is_random(move, reference.null_scale)}
    faint = {t.kind for t, size in zip(plain, sizes, strict=True) if size < SHOWN}
    others = [most for t in plain if t.kind in faint and (most := strongest(t, lab.units)) != t]
    weak = {kind[0] for kind in faint}
    others += [strongest(t, lab.units) if t.effect in weak else t for t in tried if t.is_other_form]
    others = [trial for trial in others if trial.fits(reference.camera)]
    for count, chosen in (
        (FEW, [t for t in others if t.effect in random]),
        (1, [t for t in others if t.effect not in random]),
    ):
        found += signed(reference, *_following_moves(lab, reference, chosen, range(count), report))
    order = {effect: k for k, effect in enumerate(dict.fromkeys(trial.effect for trial in tried))}
    return found.taken(sorted(range(len(found.trials)), key=lambda i: order[found.trials[i].effect]))


def resolved(lab: Laboratory, reference: Reference, signs: Signatures, report: Report) -> Signatures:
    """The signatures of a scan, those of effects with random numbers of their own by more simulations.

    What such an effect moves either way, as a drift the level, has a mean far from 0 in two simulations, with which no
    measurement matches.
    """
    random = np.flatnonzero(signs.variances.any(1)).tolist()
    if not random:
        return signs
    tried = [signs.trials[i] for i in random]
    again = signed(reference, *_following_moves(lab, reference, tried, range(MORE), report, "trying again"))
    kept = [i for i in range(len(signs.trials)) if i not in random]
    every = signs.taken(kept) + again
    order = {trial.unmoved: k for k, trial in enumerate(signs.trials)}
    return every.taken(sorted(range(len(every.trials)), key=lambda i: order[every.trials[i].unmoved]))


def signatures(lab: Laboratory, reference: Reference, tried: Sequence[Trial], report: Report) -> Signatures:
    """Simulates every trial with the random numbers of the reference's first sets.

    Two simulations suffice for an effect that only shifts means; one that adds variance gets more. Parameters of the camera that
    take up most of a signature are moved along: their derivatives do not hold as well as what is left has to be known.
    """
    return resolved(lab, reference, simulated(lab, reference, tried, range(FEW), report), report)


def simulated(
    lab: Laboratory, reference: Reference, tried: Sequence[Trial], numbers: range, report: Report
) -> Signatures:
    """Signatures from simulations with these numbers; parameters of the camera that take up most of one are moved along."""
    return signed(reference, *_following_moves(lab, reference, tried, numbers, report))


def _following_moves(
    lab: Laboratory,
    reference: Reference,
    tried: Sequence[Trial],
    numbers: range,
    report: Report,
    word: str = "trying",
) -> tuple[list[Trial], np.ndarray]:
    """The trials, those with parameters that have to follow with these moved, and their shifts (trials, numbers, statistics)."""
    tried = [trial.unmoved for trial in tried]
    if not tried:
        return [], np.zeros((0, len(numbers), len(reference.scale)))
    moves = moves_of(lab, reference, tried, numbers, report, word)
    followed = _followed(lab, reference, tried, moves)
    again = [i for i, trial in enumerate(followed) if trial.following]
    if again:
        moves[again] = moves_of(lab, reference, [followed[i] for i in again], numbers, report, "following")
    return followed, moves


def strongest(trial: Trial, scale: Mapping[str, float] | None = None) -> Trial:
    """The trial with the strengths that it has at their last trial value, multiplied by the scale of its unit."""
    effect = catalogue()[trial.effect]
    if effect.base or trial.is_fixed:
        return trial
    strong = {key: effect.parameters[key].trials for key in effect.strengths() if trial.by_name.get(key)}
    most = Trial(trial.effect, tuple((f"{trial.effect}.{key}", of[-1]) for key, of in strong.items() if of))
    return trial.with_values(most.in_units(scale or {}).by_name)


def signed(reference: Reference, tried: Sequence[Trial], moves: np.ndarray) -> Signatures:
    """Signatures from shifts (trials, simulations, statistics); trials without a finite one are left out."""
    finite = np.flatnonzero(np.isfinite(moves).all((1, 2))).tolist()
    moves, scale = moves[finite], reference.null_scale
    if moves.shape[1] == 1:
        return Signatures(tuple(tried[i] for i in finite), moves[:, 0], np.zeros_like(moves[:, 0]))
    random = np.array([is_random(move, scale) for move in moves], bool).reshape(-1, 1)
    variances = np.where(random, own_variance(moves, scale), 0.0)
    return Signatures(tuple(tried[i] for i in finite), cleared(moves, scale), variances)


def is_random(moves: np.ndarray, scale: np.ndarray) -> bool:
    """Whether shifts (simulations, statistics) differ by more than noise drawn once: the effect has random numbers of its own."""
    z = standardised(moves, scale)
    return bool(z.var(0, ddof=1).mean() > max(0.15, 0.02 * (z.mean(0) ** 2).mean()))


def own_variance(moves: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Variance that an effect adds to shifts (..., simulations, statistics), beyond the noise of the null."""
    variance = moves.var(-2, ddof=1)
    return np.where(variance > REDRAWN * scale**2, variance, 0.0)


def cleared(moves: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Mean over simulations (..., simulations, statistics), shrunk to 0 where it is within their noise.

    An effect with random numbers changes all noise. The fluctuations of a thousand statistics would outweigh the few that a
    faint effect shifts. With few simulations the noise is estimated from all statistics together.
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
    """The trials with the camera's parameters moved to where a refit would take them, see `is_mostly_taken`.

    The black level is moved by the shift of the mean of the bias frames, so that bits and codes keep their place; then the
    others. Steps within three standard errors of 0, from simulations (trials, simulations, statistics), are not made.
    """
    level = bias_level(lab.statistics)
    is_black = np.array([c.path == BLACK for c in reference.coordinates], bool)
    priors, slopes, scale = reference.priors, reference.slopes, reference.null_scale
    each = moves.reshape(-1, moves.shape[-1])
    found = np.zeros((len(each), len(priors)))
    free = np.full(len(priors), True)
    if level is not None:
        found[:, is_black] = -each[:, [level]]
        free = ~is_black  # the others have to do without it
    own = adjust(each + found @ slopes.T, slopes[:, free], scale, priors[free])
    found[:, free] = -np.clip(own, -priors[free], priors[free])
    found = found.reshape(*moves.shape[:2], -1)
    ways, count = found.mean(1), moves.shape[1]
    errors = found.std(1, ddof=1) / np.sqrt(count) if count > 1 else np.zeros_like(ways)
    ways = np.where(np.abs(ways) > CERTAIN * errors, ways, 0.0)
    mean = cleared(moves, scale) if count > 1 else moves[:, 0]
    return [
        moved_along(reference, trial, way) if is_mostly_taken(move, move + slopes @ way, scale) else trial
        for trial, way, move in zip(tried, ways, mean, strict=True)
    ]


def moved_along(reference: Reference, trial: Trial, way: np.ndarray) -> Trial:
    """The trial with the steps that the camera's parameters can make within their bounds."""
    camera = trial.on(reference.camera)
    at = [c.read(camera) for c in reference.coordinates]
    there = moved(camera, reference.coordinates, [x + step for x, step in zip(at, way, strict=True)])
    steps = [(c.path, c.read(there) - x) for c, x in zip(reference.coordinates, at, strict=True)]
    return replace(trial, following=tuple(steps))


def is_mostly_taken(shift: np.ndarray, left: np.ndarray, scale: np.ndarray) -> bool:
    """Whether the camera's parameters take up more of a shift than they leave; the curvature of what they take up then matters.

    Args:
        shift, left: (statistics,) without and with a refit by derivatives, which has to reduce the shift.
    """
    taken, before, after = (
        float(np.linalg.norm(standardised(v, scale))) for v in (shift - left, shift, left)
    )
    return taken > max(SHOWN, after) and after < before


def moves_of(
    lab: Laboratory,
    reference: Reference,
    tried: Sequence[Trial],
    numbers: range,
    report: Report,
    word: str,
) -> np.ndarray:
    """(trials, simulations, statistics) shift of each of the reference's sets by each trial."""
    cameras = [following(reference, trial.on(reference.camera), trial, 1.0) for trial in tried]
    jobs = [(camera, k) for camera in cameras for k in numbers]

    def tick(done: int) -> None:
        report(f"{word} {tried[min((done - 1) // len(numbers), len(tried) - 1)].effect}", done, len(jobs))

    values = lab.finding(jobs, tick).reshape(len(tried), len(numbers), -1)
    return values - reference.sets[numbers.start : numbers.stop]


def following(reference: Reference, camera: Camera, trial: Trial, share: float) -> Camera:
    """The camera with its parameters moved to where a refit of the trial takes them, or a multiple of that within the priors."""
    if not trial.following:
        return camera
    ways = dict(trial.following)
    own = [c for c in reference.coordinates if c.path in ways]
    steps = [float(np.clip(share * ways[c.path], -c.prior, c.prior)) for c in own]
    return moved(camera, own, [c.read(camera) + step for c, step in zip(own, steps, strict=True)])
