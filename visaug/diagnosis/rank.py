"""Which effect's signature best matches what the refitted camera leaves over."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_solve, eigh, solve_triangular

from visaug.camera import Camera
from visaug.comparison.laboratory import Laboratory
from visaug.diagnosis.candidates import Trial
from visaug.diagnosis.fit import (
    Fitted,
    Null,
    Reference,
    Report,
    adjust,
    bias_level,
    drawn_to_zero,
    standardised,
)
from visaug.diagnosis.parameters import BLACK, Coordinate, base_coordinates, effect_coordinates, moved
from visaug.effects import catalogue

CHANCE = (
    5.0  # log likelihood that the best of a hundred ways gains by chance, where a law is right about them
)
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

    @cached_property
    def precision(self) -> np.ndarray:
        return cho_solve((self.factor, True), np.eye(len(self.factor)), check_finite=False)

    def z(self, vector: np.ndarray) -> np.ndarray:
        """Standardised: (..., statistics)."""
        return vector[..., self.used] / self.scale

    def white(self, vector: np.ndarray) -> np.ndarray:
        z = self.z(vector)
        flat = z.reshape(-1, z.shape[-1]).T
        return solve_triangular(self.factor, flat, lower=True, check_finite=False).T.reshape(z.shape)

    def widened(self, variance: np.ndarray) -> "Metric":
        """With the variance that an effect brings of its own, per statistic: drift, tracks, sparse defects."""
        return Metric(self.used, self.scale, self.covariance + np.diag(variance[self.used] / self.scale**2))

    def widened_log_likelihood(self, residual: np.ndarray, variance: np.ndarray) -> float:
        """What `widened(variance).log_likelihood(residual)` gives, in a fraction of the time where few variances are above 0.

        Woodbury's identity: a change of k diagonal entries takes a factor of k rows.
        """
        extra = variance[self.used] / self.scale**2
        wide = np.flatnonzero(extra)
        z = self.z(residual)
        flat = self.precision @ z
        root = np.sqrt(extra[wide])
        inner = np.eye(len(wide)) + root[:, None] * self.precision[np.ix_(wide, wide)] * root
        factor = np.linalg.cholesky(inner)
        freed = solve_triangular(factor, root * flat[wide], lower=True, check_finite=False)
        square = float(z @ flat - freed @ freed)
        return -0.5 * square - float(np.log(np.diag(self.factor)).sum() + np.log(np.diag(factor)).sum())

    def log_likelihood(self, residual: np.ndarray) -> float:
        """Of a residual, but for a constant."""
        return float(-0.5 * np.sum(self.white(residual) ** 2) - np.log(np.diag(self.factor)).sum())


def metric(fitted: Fitted, form: float, allowance: np.ndarray | float = 0.0) -> Metric:
    """Of the residual of a fitted camera.

    Args:
        form: how far the form of what stands out may differ from the catalogue's, relative.
        allowance: what the forms of accepted effects may leave over, per statistic.
    """
    return law(fitted.reference.null, np.hypot(form * fitted.residual, allowance))


def law(
    null: Null, left: np.ndarray, used: np.ndarray | None = None, sets: np.ndarray | None = None
) -> Metric:
    """Of the residual of a refitted camera: its simulated sets' covariance, what its free numbers can do, and `left`.

    Args:
        left: what forms may leave over, per statistic.
        used: which statistics; all that vary where left out.
        sets: residuals of some of the simulated sets; of all where left out.
    """
    used = null.scale > 0 if used is None else used
    scale = null.scale[used]
    slopes = null.slopes[used] / scale[:, None] * null.priors
    sets = null.residuals if sets is None else sets
    covariance = shrunk(sets[:, used] / scale) + slopes @ slopes.T + np.diag((left[used] / scale) ** 2)
    return Metric(used, scale, covariance)


def each_half(null: Null, left: np.ndarray) -> list[tuple[Metric, np.ndarray]]:
    """The law of each half of the simulated sets, with the residuals of the other half, which it may judge: not its own."""
    first, second = null.residuals[::2], null.residuals[1::2]
    return [(law(null, left, sets=first), second), (law(null, left, sets=second), first)]


def scatter(null: Null, left: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(n,) variance along ways (n, statistics) of simulated sets, in units of what `law` says; at least 1.

    A covariance of many statistics from few sets is too small along some ways, and what matches along them by chance gains as much
    more: that is taken off.
    """
    found = np.zeros(len(ways))
    for m, others in each_half(null, left):
        white = m.white(ways)
        squares = (white**2).sum(1)
        along = ((m.white(others) @ white.T) ** 2).mean(0)
        found += 0.5 * np.divide(along, squares, out=np.ones_like(squares), where=squares > 0)
    return np.maximum(found, 1.0)


def log_density(fitted: Fitted, allowance: np.ndarray, used: np.ndarray) -> float:
    """Of what a camera leaves over, under that camera's own simulated sets and with its numbers left open.

    Unlike the first matches it is exact about the spread that an effect brings, so it can decide between effects.

    Args:
        allowance: what forms may leave over, per statistic.
        used: statistics that vary under every camera that is compared.
    """
    m = law(fitted.reference.null, allowance, used)
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

    def __add__(self, other: "Signatures") -> "Signatures":
        return Signatures(
            self.trials + other.trials,
            np.concatenate([self.values, other.values]),
            np.concatenate([self.variances, other.variances]),
        )


FAR_DN = 0.3  # that the black level has to follow to be moved along
REDRAWN = 2.0  # variances of the null that a difference of two independent sets has
FEW, MORE = 2, 6  # simulations of a trial whose effect brings no spread of its own, and of one that does


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
    z = np.divide(moves, scale, out=np.zeros_like(moves), where=scale > 0)
    own = z.var(1, ddof=1).mean(1)
    random = [i for i in range(len(tried)) if own[i] > max(0.15, 0.02 * (z[i].mean(0) ** 2).mean())]
    means, variances = cleared(moves, scale), np.zeros_like(moves[:, 0])
    if random:
        again = _moves(lab, reference, [tried[i] for i in random], range(FEW, MORE), report, "trying again")
        whole = np.concatenate([moves[random], again], 1)
        own_variance = whole.var(1, ddof=1)
        means[random] = cleared(whole, scale)
        # noise that is drawn anew is in the null already; what the effect brings of its own exceeds it
        variances[random] = np.where(own_variance > REDRAWN * scale**2, own_variance, 0)
    return Signatures(tuple(tried), means, variances)


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
    cameras = [_following(reference, trial.on(reference.camera), trial, 1.0) for trial in tried]
    jobs = [(camera, k) for camera in cameras for k in numbers]

    def tick(done: int) -> None:
        report(f"{word} {tried[min((done - 1) // len(numbers), len(tried) - 1)].effect}", done, len(jobs))

    values = lab.finding(jobs, tick).reshape(len(tried), len(numbers), -1)
    return values - reference.sets[numbers.start : numbers.stop]


def _following(reference: Reference, camera: Camera, trial: Trial, share: float) -> Camera:
    """The camera with its own numbers where the trial leads them, or a share of the way."""
    if not trial.following:
        return camera
    ways = dict(trial.following)
    own = [c for c in reference.coordinates if c.path in ways]
    return moved(camera, own, [c.read(camera) + share * ways[c.path] for c in own])


SCALES = (0.03, 0.1, 0.3, 0.6, 1.0, 1.6)


@dataclass(frozen=True)
class Match:
    """An effect's best trial.

    Attributes:
        gain: by how much it raises the logarithm of the residual's likelihood, see `scatter`.
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
    wide = scatter(fitted.reference.null, np.hypot(form * fitted.residual, allowance), signed.values)
    found = [
        _match(m, trial, signature, variance, fitted.residual, residual, share, nothing)
        for trial, signature, variance, share in zip(
            signed.trials, signed.values, signed.variances, wide, strict=True
        )
        if trial.effect not in without
    ]
    return sorted(found, key=lambda match: -match.gain)


def best_of_each(found: Sequence[Match]) -> list[Match]:
    """The best trial of every effect, and the best that comes from a look, best first.

    Of trials that gain almost as much it is the one that wants to be scaled least: strengths do not act in proportion, and
    the small one of a wide blur is not a narrow blur.
    """
    best: dict[tuple[str, bool], Match] = {}
    for match in found:
        kind = (match.trial.effect, match.trial.looked)
        top = best.setdefault(kind, match)
        alike = match.gain > ALMOST * top.gain and match.trial.form == top.trial.form
        if alike and _extrapolation(match) < _extrapolation(top):
            best[kind] = match
    return sorted(best.values(), key=lambda match: -match.gain)


def _extrapolation(match: Match) -> float:
    return abs(np.log(max(match.scale, 1e-9)))


def _match(
    m: Metric, trial: Trial, signature, variance, residual, white_residual, wide: float, nothing: float
) -> Match:
    fixed = trial.is_fixed
    spread = variance[m.used] / m.scale**2
    if spread.max() < 2 and spread.mean() < 0.1:
        d = m.white(signature)
        scale = 1.0 if fixed else max(float(d @ white_residual) / max(float(d @ d), 1e-12), 0.0)
        gain = scale * float(d @ white_residual) - 0.5 * scale**2 * float(d @ d)
        return Match(trial, gain - CHANCE * (wide - 1), scale, np.zeros_like(variance))
    tried = [
        (m.widened_log_likelihood(residual - c * signature, c**2 * variance) - nothing, c)
        for c in ((1.0,) if fixed else SCALES)
    ]
    gain, scale = max(tried)
    return Match(trial, gain, scale, scale**2 * variance)


ALMOST = 0.8  # of the gain of an effect's best trial
SCALED_FAR = 3.0  # times that a signature wants to be multiplied: neither a level nor a variance, perhaps
MOST = 1e3  # times that moves want to be multiplied, or divided; more says nothing
NOTHING = 1e-6  # standard deviations: a blur of 0.04 px moves nothing that can be multiplied
BALANCED = 6  # simulated strengths until the one is found whose moves are as large as what is left
STALLED = 0.5  # gain in log likelihood below which an iteration is said to bring nothing
NEAR = 3.0  # steps within which the derivatives of a camera's own numbers hold
FOLLOWED = 3  # times that these are moved along
HOPELESS = 1000.0  # log likelihood behind the best that no following of the camera's numbers makes up for
STRONGER, FARTHEST = 3.0, 5  # times a strength that is tried next at the start; how often
NUMBER = 1.0  # log likelihood that a free number gains by fitting noise (Akaike),
LOOKED = 5.0  # and that places gain which were chosen by a look at the frames: the best of a hundred
NOISY = 1.0  # log likelihood that the noise of a few simulations may cost
LEAST_SHARE = 0.02  # that a derivative's true size is taken to have of its noisy one
HOPE = 2.0  # times what the last two iterations gained is what the next ones may still gain


@dataclass(frozen=True)
class Refined:
    """A candidate after its own numbers were fitted with the camera's.

    Attributes:
        camera: the fitted camera with the effect.
        coordinates, at: the effect's free numbers and where they are.
        gain: by how much it raises the logarithm of the residual's likelihood, see `scatter`, less the cost.
        residual: what is left of the residual per statistic, the camera's own numbers following.
        variance: what spread the effect brings, per statistic.
        cost: what its free numbers gain by fitting noise.
    """

    effect: str
    camera: Camera
    coordinates: tuple[Coordinate, ...]
    at: np.ndarray
    gain: float
    residual: np.ndarray
    variance: np.ndarray
    cost: float = 0.0


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
    """
    cameras = [_scaled(fitted, match, power) for power in POWERS]
    camera = cameras[0]
    # a camera that was not refitted has not followed: there the effect may stand alone
    if match.trial.following:
        cameras.append(match.trial.on(fitted.camera))
    if beside and _extrapolation(match) > np.log(SCALED_FAR):
        cameras += _among(lab, fitted, beside)
    own = coordinates_of(match.trial.effect, camera, lab)
    climb = _Climb(lab, fitted, metric(fitted, FINE, allowance), match, camera, own)
    report(f"refining {match.trial.effect}", 0, iterations)
    best = climb.upwards(climb.start(cameras))
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
    (wide,) = scatter(fitted.reference.null, left, best.move[None])
    cost = NUMBER * len(own) + (LOOKED if match.trial.looked else 0.0)
    residual = fitted.residual - best.move
    following = adjust(residual[None], fitted.slopes, fitted.reference.scale, fitted.reference.priors)[0]
    return Refined(
        match.trial.effect,
        moved(camera, climb.coordinates, list(best.at)),
        tuple(own),
        best.at[climb.theirs :],
        best.gain - CHANCE * (float(wide) - 1) - cost,
        residual - fitted.slopes @ following,
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
    cameras = [_following(fitted.reference, t.on(fitted.camera), t, 1.0) for t in rising]
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


@dataclass(frozen=True)
class _Point:
    """Coordinates, what they gain, and how they move every statistic: on the average, and (twins, statistics)."""

    at: np.ndarray
    gain: float
    move: np.ndarray
    moves: np.ndarray

    @property
    def variance(self) -> np.ndarray:
        """The spread that they bring."""
        return self.moves.var(0, ddof=1)


class _Climb:
    """The likelihood of what was measured as a function of an effect's numbers, the camera's own following."""

    def __init__(
        self,
        lab: Laboratory,
        fitted: Fitted,
        law: Metric,
        match: Match,
        camera: Camera,
        own: Sequence[Coordinate],
    ):
        self.lab, self.fitted, self.camera = lab, fitted, camera
        self.twins = MORE if match.variance.any() else FEW
        self.base = np.zeros((0, len(fitted.residual)))
        self.nothing = law.log_likelihood(fitted.residual)
        self.law = law.widened(match.variance)
        self.answers = self.law.white(fitted.slopes.T)
        self.coordinates = (*fitted.reference.coordinates, *own)
        self.theirs = len(self.coordinates) - len(own)  # of these are the camera's
        self.steps = np.array([c.step for c in self.coordinates])
        self.priors = np.array([c.prior for c in self.coordinates])
        strengths = {f"{match.trial.effect}.{key}" for key in catalogue()[match.trial.effect].strengths()}
        self.strengths = np.array([c.path in strengths for c in self.coordinates])

    def start(self, cameras: Sequence[Camera]) -> _Point:
        """The best of some cameras."""
        found: list[np.ndarray] = []
        for camera in cameras:
            at = np.array([c.read(camera) for c in self.coordinates])
            if all(np.any(np.abs(at - other) > self.steps) for other in found):
                found.append(at)
        best = self.settled(found[0])
        for at in found[1:]:
            best = max(best, self.settled(at, best), key=lambda point: point.gain)
        return best

    def upwards(self, best: _Point) -> _Point:
        """The start, or where a strength some times as large gains more: near zero a derivative shows no way, or is noise."""
        logarithmic = np.array([c.logarithmic for c in self.coordinates])
        for _ in range(FARTHEST if self.strengths.any() else 0):
            more = np.where(logarithmic, best.at + np.log(STRONGER), STRONGER * best.at)
            point = self.settled(np.where(self.strengths, more, best.at), best)
            if point.gain <= best.gain:
                break
            best = point
        return best

    def settled(self, at: np.ndarray, beside: _Point | None = None) -> _Point:
        """The effect's numbers there, the camera's own brought to where they belong with them.

        Args:
            beside: the best point so far.
        """
        best = self._simulated(at, self.twins if beside is None else len(beside.moves))
        for _ in range(FOLLOWED):
            step = self._following(self.law.white(self.fitted.residual - best.move))
            hopeless = beside is not None and best.gain < beside.gain - HOPELESS
            if hopeless or np.all(np.abs(step) <= NEAR * self.steps):
                break
            if len(best.moves) < MORE:  # the same random numbers are no longer the same noise
                best = self._simulated(best.at, MORE)
            point = self._simulated(best.at + step, MORE)
            if point.gain < best.gain:
                break
            best = point
        return best

    def step(self, point: _Point) -> np.ndarray:
        """Of all coordinates, from a point."""
        effect = np.arange(self.theirs, len(point.at))
        step = np.zeros(len(point.at))
        aside = [point.at + self.steps * (np.arange(len(step)) == j) for j in effect]
        moves = self._moves(aside, len(point.moves))
        design = self.law.white((moves - point.moves) / self.steps[effect, None, None])
        left = self.law.white(self.fitted.residual - point.moves)
        step[effect] = newton(design, left, self.priors[effect])
        step = self._short(step)
        theirs = self._following(left.mean(0) - step[effect] @ design.mean(1))
        return step + theirs if np.any(np.abs(theirs) > NEAR * self.steps) else step

    def _following(self, left: np.ndarray) -> np.ndarray:
        """How far the camera's own numbers go for what is left, white.

        The law has them open, with their priors, so their expectation is that of a Gaussian.
        """
        step = np.zeros(len(self.coordinates))
        step[: self.theirs] = self.priors[: self.theirs] ** 2 * (self.answers @ left)
        return self._short(step)

    def _short(self, step: np.ndarray) -> np.ndarray:
        return np.clip(step, -0.6 * self.priors, 0.6 * self.priors)

    def _simulated(self, at: np.ndarray, twins: int) -> _Point:
        at = self._within(at)
        (moves,) = self._moves([at], twins)
        point = self._point(at, moves)
        if twins < MORE and self._noise(moves) > max(NOISY, 0.1 * abs(point.gain)):
            (moves,) = self._moves([at], MORE)
            point = self._point(at, moves)
        return point

    def _point(self, at: np.ndarray, moves: np.ndarray) -> _Point:
        move = cleared(moves, self.fitted.reference.null_scale)
        gain = self.law.log_likelihood(self.fitted.residual - move) - self.nothing
        return _Point(at, gain, move, moves)

    def _noise(self, moves: np.ndarray) -> float:
        """What the noise of the mean of some moves (twins, statistics) takes from the log likelihood."""
        return 0.5 * float((self.law.white(moves - moves.mean(0)) ** 2).sum()) / (len(moves) - 1) / len(moves)

    def _moves(self, points: Sequence[np.ndarray], twins: int) -> np.ndarray:
        """(points, twins, statistics)."""
        cameras = [moved(self.camera, self.coordinates, list(at)) for at in points]
        values = self.lab.finding([(camera, k) for camera in cameras for k in range(twins)])
        if len(self.base) < twins:
            self.base = self.lab.finding([(self.fitted.camera, k) for k in range(twins)])
        return values.reshape(len(points), twins, -1) - self.base[:twins]

    def _within(self, at: np.ndarray) -> np.ndarray:
        """The point itself, or the nearest within the bounds of the camera's numbers."""
        camera = moved(self.camera, self.coordinates, list(at))
        return np.array([c.read(camera) for c in self.coordinates])


def newton(design: np.ndarray, left: np.ndarray, priors: np.ndarray) -> np.ndarray:
    """Gauss and Newton's step (coordinates,): it takes away most of what is left.

    Derivatives of what is drawn at random are noisy, and their noise would make every step short. So only products of
    different twins enter, whose noise is independent.

    Args:
        design: (coordinates, twins, statistics), derivatives, white.
        left: (twins, statistics), white.
    """
    twins, wide = len(left), np.diag(1 / priors**2)
    whole, total = design.sum(1), left.sum(0)
    if twins < MORE:  # too few to tell the noise
        return np.linalg.solve(whole @ whole.T / twins**2 + wide, whole @ total / twins**2)
    own = np.einsum("itn,jtn->ij", design, design)
    pairs = twins * (twins - 1)
    curvature = (whole @ whole.T - own) / pairs
    pull = (whole @ total - np.einsum("itn,tn->i", design, left)) / pairs
    share, ways = eigh(curvature + wide, own / twins + wide)
    return ways @ ((ways.T @ pull) / np.clip(share, LEAST_SHARE, 1.0))


POWERS = (
    0.7,
    1.0,
    0.5,
)  # of the scale that a signature wants: a level grows with a strength, a variance with its square


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
    return _following(fitted.reference, scaled, match.trial, factor)
