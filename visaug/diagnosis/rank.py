"""Which effect's signature best matches what the refitted camera leaves over."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy.linalg import solve_triangular

from visaug.camera import Camera
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.candidates import Trial, trials
from visaug.diagnosis.fit import Fitted, Reference, Report, adjust
from visaug.diagnosis.parameters import Coordinate, base_coordinates, effect_coordinates, moved
from visaug.effects import catalogue

ROUGH, FINE = (
    0.3,
    0.1,
)  # how far a form may differ from the catalogue's, relative, in first signatures and after refining


@dataclass(frozen=True)
class Metric:
    """A Gaussian law of the residual of a camera that lacks nothing, with the camera's own numbers left open.

    Its covariance is the bootstrap's, plus what the free numbers can do, plus for what stands far out a share of its own
    size: a real glow or lag never has the catalogue's exact form, and with a strong effect every wrong form would be
    significant, so a statistic counts as explained when its residual falls to a small share of what it was.
    """

    used: np.ndarray
    scale: np.ndarray
    covariance: np.ndarray  # of standardised residuals

    @cached_property
    def factor(self) -> np.ndarray:
        return np.linalg.cholesky(self.covariance)

    def z(self, vector: np.ndarray) -> np.ndarray:
        """Standardised: (..., statistics)."""
        return vector[..., self.used] / self.scale

    def white(self, vector: np.ndarray) -> np.ndarray:
        return solve_triangular(self.factor, self.z(vector).T, lower=True, check_finite=False).T

    def widened(self, variance: np.ndarray) -> "Metric":
        """With the variance that an effect brings of its own, per statistic: drift, tracks, sparse defects."""
        return Metric(self.used, self.scale, self.covariance + np.diag(variance[self.used] / self.scale**2))

    def log_likelihood(self, residual: np.ndarray) -> float:
        """Of a residual, but for a constant."""
        return float(-0.5 * np.sum(self.white(residual) ** 2) - np.log(np.diag(self.factor)).sum())


def metric(fitted: Fitted, form: float, allowance: np.ndarray | float = 0.0) -> Metric:
    """Of the residual of a fitted camera.

    Args:
        form: how far the form of what stands out may differ from the catalogue's, relative.
        allowance: what the forms of accepted effects may leave over, per statistic.
    """
    return law(fitted.reference, np.hypot(form * fitted.residual, allowance))


def law(
    reference: Reference, left: np.ndarray, used: np.ndarray | None = None, null: np.ndarray | None = None
) -> Metric:
    """Of the residual of a refitted camera: its simulated sets' covariance, what its free numbers can do, and `left`.

    Args:
        left: what forms may leave over, per statistic.
        used: which statistics; all that vary where left out.
        null: residuals of some of the simulated sets; of all where left out.
    """
    used = reference.null_scale > 0 if used is None else used
    scale = reference.null_scale[used]
    slopes = reference.slopes[used] / scale[:, None] * reference.priors
    sets = reference.null if null is None else null
    covariance = shrunk(sets[:, used] / scale) + slopes @ slopes.T + np.diag((left[used] / scale) ** 2)
    return Metric(used, scale, covariance)


def log_density(fitted: Fitted, allowance: np.ndarray, used: np.ndarray) -> float:
    """Of what a camera leaves over, under that camera's own simulated sets and with its numbers left open.

    Unlike the first matches it is exact about the spread that an effect brings, so it can decide between effects.

    Args:
        allowance: what forms may leave over, per statistic.
        used: statistics that vary under every camera that is compared.
    """
    m = law(fitted.reference, allowance, used)
    return m.log_likelihood(fitted.residual) - float(np.log(m.scale).sum())


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
class Signatures:
    """How each trial moves every statistic of the reference camera, and what spread it adds: (trials, statistics) each."""

    trials: tuple[Trial, ...]
    values: np.ndarray
    variances: np.ndarray


FEW, MORE = 2, 6  # simulations of a trial whose effect brings no spread of its own, and of one that does


def signatures(lab: Laboratory, reference: Reference, without: frozenset[str], report: Report) -> Signatures:
    """Simulates every trial with the random numbers of the reference's first sets.

    An effect that only moves the means shows it in two simulations; one that draws numbers of its own gets more.
    """
    tried = trials(reference.camera, without)
    moves = _moves(lab, reference, tried, range(FEW), report, "trying")
    scale = reference.null_scale
    z = np.divide(moves, scale, out=np.zeros_like(moves), where=scale > 0)
    own = z.var(1, ddof=1).mean(1)
    random = [i for i in range(len(tried)) if own[i] > max(0.15, 0.02 * (z[i].mean(0) ** 2).mean())]
    means, variances = moves.mean(1), np.zeros_like(moves[:, 0])
    if random:
        again = _moves(lab, reference, [tried[i] for i in random], range(FEW, MORE), report, "trying again")
        whole = np.concatenate([moves[random], again], 1)
        means[random], variances[random] = whole.mean(1), whole.var(1, ddof=1)
    return Signatures(tuple(tried), means, variances)


def _moves(
    lab: Laboratory, reference: Reference, tried: list[Trial], numbers: range, report: Report, word: str
) -> np.ndarray:
    """(trials, simulations, statistics): how far each trial moves each of the reference's sets."""
    jobs = [(trial.on(reference.camera), k) for trial in tried for k in numbers]

    def tick(done: int) -> None:
        report(f"{word} {tried[min((done - 1) // len(numbers), len(tried) - 1)].effect}", done, len(jobs))

    values = lab.finding(jobs, tick).reshape(len(tried), len(numbers), -1)
    return values - reference.sets[numbers.start : numbers.stop]


SCALES = (0.03, 0.1, 0.3, 0.6, 1.0, 1.6)


@dataclass(frozen=True)
class Match:
    """An effect's best trial.

    Attributes:
        gain: by how much it raises the logarithm of the residual's likelihood.
        scale: by how much the trial's signature wants to be multiplied.
        variance: what spread it brings at that scale, per statistic.
    """

    trial: Trial
    gain: float
    scale: float
    variance: np.ndarray


def matches(
    signed: Signatures,
    fitted: Fitted,
    without: frozenset[str] = frozenset(),
    allowance: np.ndarray | float = 0.0,
    form: float = ROUGH,
) -> list[Match]:
    """Of every trial, best first.

    Args:
        form: see `metric`.
    """
    m = metric(fitted, form, allowance)
    nothing = m.log_likelihood(fitted.residual)
    residual = m.white(fitted.residual)
    found = [
        _match(m, trial, signature, variance, fitted.residual, residual, nothing)
        for trial, signature, variance in zip(signed.trials, signed.values, signed.variances, strict=True)
        if trial.effect not in without
    ]
    return sorted(found, key=lambda match: -match.gain)


def best_of_each(found: Sequence[Match]) -> list[Match]:
    """The best trial of every effect, best first."""
    best: dict[str, Match] = {}
    for match in found:
        best.setdefault(match.trial.effect, match)
    return list(best.values())


def _match(m: Metric, trial: Trial, signature, variance, residual, white_residual, nothing: float) -> Match:
    fixed = trial.is_fixed
    spread = variance[m.used] / m.scale**2
    if spread.max() < 2 and spread.mean() < 0.1:
        d = m.white(signature)
        scale = 1.0 if fixed else max(float(d @ white_residual) / max(float(d @ d), 1e-12), 0.0)
        gain = scale * float(d @ white_residual) - 0.5 * scale**2 * float(d @ d)
        return Match(trial, gain, scale, np.zeros_like(variance))
    tried = [
        (m.widened(c**2 * variance).log_likelihood(residual - c * signature) - nothing, c)
        for c in ((1.0,) if fixed else SCALES)
    ]
    gain, scale = max(tried)
    return Match(trial, gain, scale, scale**2 * variance)


STALLED = 0.5  # gain in log likelihood below which an iteration is said to bring nothing
HOPE = 2.0  # times what the last two iterations gained is what the next ones may still gain


@dataclass(frozen=True)
class Refined:
    """A candidate after its own numbers were fitted with the camera's.

    Attributes:
        camera: the fitted camera with the effect.
        coordinates, at: the effect's free numbers and where they are.
        gain: by how much it raises the logarithm of the residual's likelihood.
        residual: what is left of the residual per statistic, the camera's own numbers following.
        variance: what spread the effect brings, per statistic.
    """

    effect: str
    camera: Camera
    coordinates: tuple[Coordinate, ...]
    at: np.ndarray
    gain: float
    residual: np.ndarray
    variance: np.ndarray


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
    iterations: int = 8,
) -> Refined:
    """Fits the effect's numbers by damped Gauss-Newton with common random numbers; the camera's own stay open.

    It ends where two iterations in a row gain less than `STALLED`, or do not bring it near what another has.

    Args:
        beaten: what the best of the effects tried before gains.
    """
    m = metric(fitted, FINE, allowance)
    nothing = m.log_likelihood(fitted.residual)
    m = m.widened(match.variance)
    twins = MORE if match.variance.any() else FEW
    base = lab.finding([(fitted.camera, k) for k in range(twins)])
    camera = _scaled(fitted.camera, match)
    coordinates = coordinates_of(match.trial.effect, camera, lab)
    at = np.array([c.read(camera) for c in coordinates])
    priors, steps = np.array([c.prior for c in coordinates]), np.array([c.step for c in coordinates])
    best: tuple[float, np.ndarray, np.ndarray, np.ndarray] | None = None
    step, damping, gains = np.zeros(len(at)), 1.0, []
    for i in range(iterations if coordinates else 1):
        points = [at, *(at + steps * (np.arange(len(at)) == j) for j in range(len(at)))]
        jobs = [(moved(camera, coordinates, list(x)), k) for x in points for k in range(twins)]
        total = iterations * len(jobs)
        values = lab.finding(jobs, partial(_tick, report, match.trial.effect, i * len(jobs), total))
        moves = values.reshape(len(points), twins, -1) - base
        means = moves.mean(1)
        gain = m.log_likelihood(fitted.residual - means[0]) - nothing
        gains.append(gain if best is None else max(gain, best[0]))
        if best is None or gain > best[0]:
            best = (gain, at.copy(), means[0], moves[0].var(0, ddof=1))
            damping = 1.0
            if len(at):
                design = m.white((means[1:] - means[0]) / steps[:, None]).T
                left = m.white(fitted.residual - means[0])
                step = np.linalg.solve(design.T @ design + np.diag(1 / priors**2), design.T @ left)
                step = np.clip(step, -0.6 * priors, 0.6 * priors)
        else:  # too far: from the best point a shorter step
            damping *= 0.35
        if len(gains) > 2:
            lately = gains[-1] - gains[-3]
            if lately < 2 * STALLED or gains[-1] + HOPE * lately < beaten - 0.2 * abs(beaten):
                break
        at = np.array(
            [c.read(moved(camera, coordinates, list(best[1] + damping * step))) for c in coordinates]
        )
    assert best is not None
    gain, at, signature, variance = best
    residual = fitted.residual - signature
    following = adjust(residual[None], fitted.slopes, fitted.reference.scale, fitted.reference.priors)[0]
    return Refined(
        match.trial.effect,
        moved(camera, coordinates, list(at)),
        tuple(coordinates),
        at,
        gain,
        residual - fitted.slopes @ following,
        variance,
    )


def _tick(report: Report, effect: str, before: int, total: int, done: int) -> None:
    report(f"refining {effect}", before + done, total)


def _scaled(camera: Camera, match: Match) -> Camera:
    """The trial with its strengths scaled as its signature wants; a variance grows as the square, so part of the way."""
    with_effect = match.trial.on(camera)
    effect = catalogue()[match.trial.effect]
    factor = float(np.clip(match.scale, 0.02, 50)) ** 0.7
    values = {}
    for path, value in match.trial.values:
        parameter = effect.parameters.get(path.split(".", 1)[-1])
        if parameter is not None and parameter.strength and not parameter.integer and value:
            values[path] = min(max(value * factor, parameter.low), parameter.high)
    return with_effect.replace(values) if values else with_effect
