"""Which effect's signature best matches what the refitted camera leaves over."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from visaug.camera import Camera
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.candidates import Trial, trials
from visaug.diagnosis.fit import Fitted, Reference, Report
from visaug.diagnosis.parameters import Coordinate, base_coordinates, effect_coordinates, moved
from visaug.effects import catalogue

TWINS = 2  # simulations with and without the effect, with common random numbers, for a first signature
ROUGH, FINE = 0.3, 0.1  # how far a form may differ from the catalogue's, relative, in first signatures and after refining


@dataclass(frozen=True)
class Metric:
    """Distances between fingerprints: the bootstrap's covariance and, for what stands far out, a share of its own size.

    A real glow or lag never has the catalogue's exact form. With a strong effect every wrong form would be significant, so a
    statistic counts as explained when its residual falls to a small share of what it was.
    """

    used: np.ndarray
    scale: np.ndarray
    factor: np.ndarray  # lower Cholesky factor of the covariance of standardised residuals

    def white(self, vectors: np.ndarray) -> np.ndarray:
        """(..., statistics) or (statistics, n) whitened along the statistics; columns for matrices."""
        z = vectors[self.used] / (self.scale if vectors.ndim == 1 else self.scale[:, None])
        return solve_triangular(self.factor, z, lower=True, check_finite=False)


def metric(fitted: Fitted, form: float) -> Metric:
    reference = fitted.reference
    used = reference.null_scale > 0
    scale = reference.null_scale[used]
    null = reference.null[:, used] / scale
    correlation = shrunk(null) + np.diag((form * fitted.residual[used] / scale) ** 2)
    return Metric(used, scale, np.linalg.cholesky(correlation))


def shrunk(samples: np.ndarray) -> np.ndarray:
    """Correlation of (R, n) samples of mean 0, drawn towards the identity.

    The amount is the one that minimises the expected error: J. Schaefer and K. Strimmer, Stat. Appl. Genet. Mol. Biol. 4 (2005) 32.
    """
    count = len(samples)
    spread = np.sqrt((samples**2).mean(0))
    unit = np.divide(samples, spread, out=np.zeros_like(samples), where=spread > 0)
    correlation = unit.T @ unit / count
    variance = ((unit**2).T @ unit**2 / count - correlation**2) / count
    np.fill_diagonal(variance, 0)
    np.fill_diagonal(correlation, 0)
    amount = float(np.clip(variance.sum() / max((correlation**2).sum(), 1e-12), 0.05, 1))
    return (1 - amount) * correlation + np.eye(samples.shape[1])


@dataclass(frozen=True)
class Match:
    """An effect's best trial.

    Attributes:
        gain: how much of the residual's squared length in the metric it takes away beyond a refit of the camera.
        scale: by how much the trial's signature wants to be multiplied.
    """

    trial: Trial
    gain: float
    scale: float
    signature: np.ndarray


@dataclass(frozen=True)
class Signatures:
    """How each trial moves every statistic of the reference camera: (trials, statistics)."""

    trials: tuple[Trial, ...]
    values: np.ndarray


def signatures(lab: Laboratory, reference: Reference, without: frozenset[str], report: Report) -> Signatures:
    """Simulates every trial with the random numbers of the reference's first sets."""
    tried = trials(reference.camera, without)
    done = [0]

    def tick(_: int) -> None:
        done[0] += 1
        name = tried[min((done[0] - 1) // TWINS, len(tried) - 1)].effect
        report(f"trying {name}", done[0], TWINS * len(tried))

    values = lab.finding([(trial.on(reference.camera), k) for trial in tried for k in range(TWINS)], tick)
    return Signatures(tuple(tried), values.reshape(len(tried), TWINS, -1).mean(1) - reference.sets[:TWINS].mean(0))


def best_of_each(signed: Signatures, fitted: Fitted, without: frozenset[str] = frozenset()) -> list[Match]:
    """The best trial of every effect, best first."""
    m = metric(fitted, ROUGH)
    matches: dict[str, Match] = {}
    priors = np.array([c.prior for c in fitted.reference.coordinates])
    slopes, residual = m.white(fitted.slopes), m.white(fitted.residual)
    normal = cho_factor(slopes.T @ slopes + np.diag(1 / priors**2)) if slopes.shape[1] else None

    def projected(v: np.ndarray) -> np.ndarray:
        return v if normal is None else v - slopes @ cho_solve(normal, slopes.T @ v)

    for trial, signature in zip(signed.trials, signed.values, strict=True):
        if trial.effect in without:
            continue
        d = m.white(signature)
        own = projected(d)
        length = float(d @ own)
        if length < 1e-9:
            continue
        scale = max(float(own @ residual) / length, 0.0)
        match = Match(trial, scale * float(own @ residual), scale, signature)
        if trial.effect not in matches or match.gain > matches[trial.effect].gain:
            matches[trial.effect] = match
    return sorted(matches.values(), key=lambda match: -match.gain)


@dataclass(frozen=True)
class Refined:
    """A candidate after its own numbers were fitted with the camera's.

    Attributes:
        camera: the fitted camera with the effect.
        cost: squared length of what is left, in the metric; `cost_before` of the camera without it.
        residual: what is left, per statistic.
    """

    effect: str
    camera: Camera
    coordinates: tuple[Coordinate, ...]
    at: np.ndarray
    cost: float
    cost_before: float
    residual: np.ndarray

    @property
    def gain(self) -> float:
        return self.cost_before - self.cost


def coordinates_of(effect: str, camera: Camera, lab: Laboratory) -> list[Coordinate]:
    """The free numbers of a candidate: those of a further effect, or of a base term that was at zero."""
    if not catalogue()[effect].base:
        return effect_coordinates(camera, effect)
    prefix = "full_well_e" if effect == "saturation" else f"{effect}."
    return [c for c in base_coordinates(camera, lab.frames, True) if c.path.startswith(prefix)]


def refine(
    lab: Laboratory, fitted: Fitted, match: Match, report: Report, iterations: int = 3, twins: int = 3
) -> Refined:
    """Fits the effect's numbers, the camera's following linearly, by damped Gauss-Newton with common random numbers."""
    m = metric(fitted, FINE)
    priors = np.array([c.prior for c in fitted.reference.coordinates])
    slopes = m.white(fitted.slopes)
    base = lab.finding([(fitted.camera, k) for k in range(twins)]).mean(0)
    camera = _scaled(fitted.camera, match)
    coordinates = coordinates_of(match.trial.effect, camera, lab)
    at = np.array([c.read(camera) for c in coordinates])
    own_priors = np.array([c.prior for c in coordinates])
    steps = np.array([c.step for c in coordinates])

    def solve(signature: np.ndarray, derivative: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Step of all coordinates, what is left before it, and its squared length with the camera's own refitted."""
        left = m.white(fitted.residual - signature)
        ridge = np.diag(1 / priors**2)
        alone = np.linalg.solve(slopes.T @ slopes + ridge, slopes.T @ left) if len(priors) else np.zeros(0)
        cost = float(np.sum((left - slopes @ alone) ** 2) + np.sum((alone / priors) ** 2)) if len(priors) else float(left @ left)
        design = np.hstack([slopes, derivative])
        damping = np.diag(np.concatenate([1 / priors**2, 1 / own_priors**2]))
        step = np.linalg.solve(design.T @ design + damping, design.T @ left)
        return step[len(priors):], fitted.slopes @ alone, cost

    _, _, cost_before = solve(np.zeros_like(fitted.residual), np.zeros((int(m.used.sum()), 0 * len(at) or len(at))))
    best: tuple[float, np.ndarray, Camera, np.ndarray] | None = None
    total = iterations * (len(coordinates) + 1) * twins
    shrink = 1.0
    for i in range(iterations):
        points = [at, *(at + steps * (np.arange(len(at)) == j) for j in range(len(at)))]
        jobs = [(moved(camera, coordinates, list(x)), k) for x in points for k in range(twins)]
        values = lab.finding(jobs, lambda n: report(f"refining {match.trial.effect}", i * len(jobs) + n, total))
        means = values.reshape(len(points), twins, -1).mean(1)
        signature = means[0] - base
        derivative = m.white(((means[1:] - means[0]) / steps[:, None]).T) if len(at) else np.zeros((int(m.used.sum()), 0))
        step, moved_base, cost = solve(signature, derivative)
        if best is None or cost < best[0]:
            best = (cost, at.copy(), moved(camera, coordinates, list(at)), fitted.residual - signature - moved_base)
            shrink = 1.0
        else:  # too far: go back half way
            shrink *= 0.4
            at = best[1]
            continue
        at = at + shrink * np.clip(step, -0.8 * own_priors, 0.8 * own_priors)
        at = np.array([c.read(moved(camera, coordinates, list(at))) for c in coordinates])
    assert best is not None
    cost, at, camera, left = best
    return Refined(match.trial.effect, camera, tuple(coordinates), at, cost, cost_before, left)


def _scaled(camera: Camera, match: Match) -> Camera:
    """The trial with its strengths scaled as its signature wants; a variance grows as the square, so half way in the log."""
    with_effect = match.trial.on(camera)
    effect = catalogue()[match.trial.effect]
    factor = float(np.clip(match.scale, 0.02, 50)) ** (0.7 if match.scale > 1 else 0.7)
    values = {}
    for path, value in match.trial.values:
        key = path.split(".", 1)[-1]
        parameter = effect.parameters.get(key)
        if parameter is not None and parameter.strength and not parameter.integer and value:
            values[path] = min(max(value * factor, parameter.low), parameter.high)
    return with_effect.replace(values) if values else with_effect
