"""The verdict on every effect of the catalogue, from the signatures and the simulated sets of a search.

An effect of strength x shifts the statistics of all frames by s(x), which is another shift for each specimen of an effect with
random numbers of its own. It is simulated at some strengths and follows a power law beyond them. The test of adequacy shows a
specimen where the match with a signature, or the largest residual, exceeds the 99 % quantile of simulated sets without the effect;
P(x) is the mean of this probability over specimens. The limit of an absent effect is the strength at which P is 95 % (a
power-constrained limit: G. Cowan, K. Cranmer, E. Gross and O. Vitells, arXiv 1105.3166), or the upper limit of 95 % on its strength
where that is larger.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from visaug.camera import Camera
from visaug.camera.paths import path_of, place_of
from visaug.diagnosis.candidates.signatures import (
    FEW,
    MORE,
    REDRAWN,
    Signatures,
    moved_along,
    moves_of,
    signed,
)
from visaug.diagnosis.candidates.trials import Trial, leads, strength_of
from visaug.diagnosis.chance import chance
from visaug.diagnosis.criterion import ODDS
from visaug.diagnosis.fitting.law import law, scatter_along
from visaug.diagnosis.fitting.reference import Null, Reference
from visaug.diagnosis.planned import POWER, Planned, frames_that_show, least_of_events
from visaug.diagnosis.stage import SearchStage, Setting
from visaug.diagnosis.verdict import Verdict
from visaug.effects import catalogue

ONE_SIDED = 1.645  # standard deviations of an upper limit of 95 %
RARE = 0.99  # quantile of the null beyond which a residual is shown: two tests share the 2 % of false alarms
FACTORS = np.geomspace(1e-3, 1e3, 241)  # of a simulated strength, among which a limit is sought
NEAR = 1.6  # ratio of a limit and a simulated strength up to which the power law is trusted
ROUNDS = 3  # of simulations near a limit
BEYOND = 2.0  # times the strongest simulated strength is the next one where none is shown
STEEPEST = 6.0  # exponent of a shift in the strength


@dataclass(frozen=True)
class Sight:
    """What the test of adequacy shows in all frames.

    Attributes:
        null: residuals of simulated sets of the camera.
        views: (statistics,) the view of each.
        residual, allowance: of the measurement, see `visaug.diagnosis.fitting.uses.Use`.
        match, largest: quantiles of the null's largest match and largest residual.
    """

    null: Null
    views: np.ndarray
    residual: np.ndarray
    allowance: np.ndarray
    match: float
    largest: float

    def knowing(self, columns: Iterable[int]) -> "Sight":
        """The same if some of the camera's parameters were known."""
        kept = [k for k in range(len(self.null.priors)) if k not in set(columns)]
        null = replace(self.null, slopes=self.null.slopes[:, kept], priors=self.null.priors[kept])
        return replace(self, null=null)

    @cached_property
    def metric(self):
        return law(self.null, self.allowance)

    def directions(self, shifts: np.ndarray) -> np.ndarray:
        """(n, statistics used) unit vectors of the match with shifts (n, statistics), in standard deviations of simulated sets."""
        white = self.metric.white(shifts)
        sizes = np.maximum(np.linalg.norm(white, axis=-1, keepdims=True), 1e-9)
        return white / sizes / np.sqrt(scatter_along(self.null, self.allowance, shifts))[:, None]

    def gain(self, variance: np.ndarray) -> float:
        """Log likelihood that the residual gains if an effect at this strength, or half or twice it, adds variance alone."""
        nothing = self.metric.log_likelihood(self.residual)
        with_it = (
            self.metric.widened_log_likelihood(self.residual, c**2 * variance) for c in (0.5, 1.0, 2.0)
        )
        return max(with_it) - nothing

    def smallest(self, matches: np.ndarray, shifts: np.ndarray, power: float) -> float:
        """The factor on a strength at which it is shown with the probability `POWER`; infinite where none is.

        Args:
            matches: (specimens,) of the shifts with the signatures, in standard deviations.
            shifts: (specimens, statistics).
        """
        by = FACTORS[:, None] ** power
        largest = np.abs([self.null.beyond(shift) for shift in shifts]).max(1)
        if len(shifts) > 1:  # which differ by noise that was drawn again too
            noise = np.sqrt(REDRAWN)
            matches = np.where(matches > noise * self.match, matches, 0.0)
            largest = np.where(largest > noise * self.largest, largest, 0.0)
        hidden = ndtr(self.largest - by * largest) - ndtr(-self.largest - by * largest)
        shown = np.maximum(ndtr(by * matches - self.match), 1 - hidden).mean(1) >= POWER
        return float(FACTORS[shown.argmax()]) if shown.any() else np.inf


@dataclass(frozen=True)
class StrengthCurve:
    """An effect over the strength of its first parameter.

    Attributes:
        path: of the strength.
        strengths: (n,) ascending; distances from the value without the effect.
        shifts, variances: (n, statistics) of all frames, the mean of specimens and what they add.
        specimens: (n, specimens, statistics) shifts, of one specimen where none of its random numbers are its own.
        signs: (m, statistics) signatures of the search with which the measurement is matched.
        is_stepwise: whether only these strengths exist.
        ways, ways_of_signs: (n, parameters) and (m, parameters) steps of the camera's parameters with which both were simulated.
        least: strength below which there is no event in most sets, and nothing to be shown; 0 if the effect has no events.
    """

    path: str
    strengths: np.ndarray
    shifts: np.ndarray
    variances: np.ndarray
    specimens: np.ndarray
    signs: np.ndarray
    is_stepwise: bool
    ways: np.ndarray
    ways_of_signs: np.ndarray
    least: float = 0.0

    def knowing(self, columns: Sequence[int], slopes: np.ndarray) -> "StrengthCurve":
        """The same if some of the camera's parameters were known and could not follow.

        Args:
            slopes: (statistics, parameters), derivatives of the means.
        """
        own = slopes[:, columns].T
        moved = self.ways[:, columns] @ own
        return replace(
            self,
            shifts=self.shifts - moved,
            specimens=self.specimens - moved[:, None],
            signs=self.signs - self.ways_of_signs[:, columns] @ own,
        )

    def matches(self, sight: Sight) -> np.ndarray:
        """(n, specimens) the match of each with the signatures of the search: those of other random numbers."""
        of_signs = sight.directions(self.signs)
        each = sight.metric.white(self.specimens.reshape(-1, self.specimens.shape[-1]))
        return (each @ of_signs.T).max(1, initial=0.0).reshape(self.specimens.shape[:2])

    def joined(self, other: "StrengthCurve") -> "StrengthCurve":
        """Of the strengths of both curves, those of one effect."""
        strengths = np.append(self.strengths, other.strengths)
        order = np.argsort(strengths)
        both = {
            of: np.concatenate([getattr(self, of), getattr(other, of)])[order]
            for of in ("shifts", "variances", "specimens", "ways")
        }
        return replace(self, strengths=strengths[order], **both)

    def limit(self, sight: Sight, is_final: bool = False) -> tuple[float, int]:
        """The smallest strength that is shown, and the place of the simulated strength from which it follows.

        Args:
            is_final: far from every simulated strength the power law is not trusted; the smallest of these that is shown
                is taken.
        """
        matches = self.matches(sight)
        power = 1.0
        ways = np.diff(np.log(self.strengths))
        if (ways > 0).any():
            ratios = np.diff(np.log(np.maximum(matches.mean(1), 1e-3)))[ways > 0] / ways[ways > 0]
            power = float(np.clip(np.median(ratios), 0.5, STEEPEST))
        factors = np.array([sight.smallest(*one, power) for one in zip(matches, self.specimens, strict=True)])
        if self.is_stepwise:
            k = int(np.argmax(factors <= 1)) if (factors <= 1).any() else len(factors) - 1
            return (float(self.strengths[k]) if factors[k] <= 1 else np.inf), k
        k = len(factors) - 1 - int(np.abs(np.log(factors))[::-1].argmin())
        # a strength that was simulated and is not shown is below the limit, whatever the power law says
        low = self.strengths[factors > 1].max(initial=0.0)
        high = self.strengths[(factors <= 1) & (self.strengths > low)].min(initial=np.inf)
        limit = float(np.clip(factors[k] * self.strengths[k], low, high))
        if is_final and not abs(np.log(limit / self.strengths[k])) <= np.log(NEAR):
            limit = float(high)
        return limit, k


def verdicts(setting: Setting, end: SearchStage) -> tuple[Verdict, ...]:
    """The verdict on every effect that was considered, in the order of the catalogue."""
    sight = sight_of(setting, end)
    considered = {t.effect for t in setting.signs.trials if not t.looked} | set(end.state.accepted)
    found = {name: _named(name, end) for name in end.state.accepted}
    paths = [c.path for c in end.state.fitted.reference.coordinates]
    courses = {
        name: course
        for name in sorted(considered - set(found))
        if (course := _course(setting, setting.signs, name, paths)) is not None
    }
    known = _found(setting, end)
    courses = _completed(setting, known, sight, courses, paths)
    for name, course in courses.items():
        found[name] = _rival(name, course, end) or _judged(setting, end, known.camera, sight, name, course)
    hidden = {name: courses[name] for name, verdict in found.items() if verdict.verdict == "not testable"}
    for name, others in _absorbing(end, sight, hidden).items():
        found[name] = replace(found[name], verdict="not separable", limit=None, others=others)
    given = setting.first.camera
    open_ = [
        v.effect for v in found.values() if v.verdict in ("not separable", "not testable") and not v.frames
    ]
    strong = {name: _strong(given, name, setting) for name in open_}
    shown = frames_that_show(strong, Planned(given, setting.report))
    return tuple(replace(found[n], frames=shown.get(n, found[n].frames)) for n in catalogue() if n in found)


def sight_of(setting: Setting, end: SearchStage) -> Sight:
    state, lab = end.state, setting.lab
    test = chance(lab, setting.signs, state)
    views = np.array([s.view for s in lab.measured[2].statistics])
    match, largest = (float(np.quantile(of, RARE)) for of in (test.matches, test.largests))
    null = state.fitted.reference.whole_null
    return Sight(null, views, state.fitted.whole_residual, state.whole.allowance, match, largest)


def _course(setting: Setting, signs: Signatures, name: str, paths: Sequence[str]) -> StrengthCurve | None:
    """Of the first strength alone, in the default form."""
    chosen: dict[float, int] = {}
    path = ""
    for i, trial in enumerate(signs.trials):
        if trial.effect != name or trial.looked or trial.is_other_form or not leads(trial):
            continue
        here, strength = strength_of(setting.first.camera, trial)
        if (not path or here == path) and strength > 0 and trial.values[0][1] != 0:
            path = here
            chosen[strength] = i
    if not chosen:
        return None
    places = [chosen[x] for x in sorted(chosen)]
    stepwise = signs.trials[places[0]].is_fixed or path == path_of("saturation", "full_well_e")
    shifts, ways = setting.lab.whole_of(signs.values[places]), _ways([signs.trials[i] for i in places], paths)
    variances = setting.lab.whole_of(signs.variances[places])
    sds = np.sqrt(variances)
    specimens = np.stack([shifts - sds, shifts + sds] if variances.any() else [shifts], 1)
    least = least_of_events(setting.lab.parts[-1].frames, path, place_of(path).parameter.unit)
    return StrengthCurve(
        path, np.array(sorted(chosen)), shifts, variances, specimens, shifts, stepwise, ways, ways, least
    )


def _ways(tried: Sequence[Trial], paths: Sequence[str]) -> np.ndarray:
    """(trials, parameters) steps of the camera's parameters with which trials were simulated."""
    return np.array([[dict(trial.following).get(path, 0.0) for path in paths] for trial in tried])


def _found(setting: Setting, end: SearchStage) -> Reference:
    """Simulated sets of the camera beside which effects are absent: with what was found, which can hide them as lost bits do."""
    return end.state.fitted.reference if end.state.accepted else setting.first


def _completed(
    setting: Setting,
    known: Reference,
    sight: Sight,
    courses: dict[str, StrengthCurve],
    paths: Sequence[str],
) -> dict[str, StrengthCurve]:
    """Each effect simulated near its limit, with random numbers that its signatures do not have, until it is near.

    A signature of few simulations contains their noise, with which only they match.

    Args:
        known: simulated sets of the camera to which effects are added.
    """
    open_ = {name for name, course in courses.items() if not course.is_stepwise}
    plain: dict[str, Trial] = {}
    for trial in setting.signs.trials:
        if trial.effect in open_ and not trial.looked and not trial.is_other_form:
            plain.setdefault(trial.effect, trial)
    for round_ in range(ROUNDS):
        at: dict[int, list[Trial]] = {FEW: [], MORE: []}
        for name in sorted(open_):
            course = courses[name]
            limit = course.limit(sight)[0]
            limit = limit if np.isfinite(limit) else BEYOND * course.strengths[-1]
            limit = min(limit, 3 * _plausible(name, course)) if limit > 0 else limit
            limit = max(limit, course.least)
            trial = _times(known, plain[name], limit / strength_of(known.camera, plain[name])[1])
            if trial is not None:
                at[MORE if course.specimens.shape[1] > 1 else FEW].append(trial)
        open_ = set()
        for count, tried in at.items():
            numbers = range(MORE + count * round_, MORE + count * (round_ + 1))
            every = moves_of(setting.lab, known, tried, numbers, setting.report, "limit of") if tried else ()
            for trial, moves in zip(tried, every, strict=True):
                if not np.isfinite(moves).all():
                    continue
                new = _simulated(setting, known, trial, moves, paths)
                old, (x,) = courses[trial.effect], new.strengths
                new = replace(new, signs=old.signs, ways_of_signs=old.ways_of_signs, least=old.least)
                courses = {**courses, trial.effect: old.joined(new) if round_ else new}
                if abs(np.log(courses[trial.effect].limit(sight)[0] / x)) > np.log(NEAR):
                    open_.add(trial.effect)
        if not open_:
            break
    return courses


def _times(known: Reference, trial: Trial, factor: float) -> Trial | None:
    """The trial with its strength and the steps of the camera's parameters multiplied; None if no camera has that strength."""
    scaled, steps = trial.unmoved.times(factor), dict(trial.following)
    if not scaled.fits(known.camera):
        return None
    if not steps:
        return scaled
    way = np.array([factor * steps.get(c.path, 0.0) for c in known.coordinates])
    return moved_along(known, scaled, np.clip(way, -known.priors, known.priors))


def _simulated(
    setting: Setting, known: Reference, trial: Trial, moves: np.ndarray, paths: Sequence[str]
) -> StrengthCurve:
    """Of the one strength of a trial with these shifts (simulations, statistics)."""
    whole_of = setting.lab.whole_of
    one = signed(known, [trial], moves[None])
    shifts, variances, ways = whole_of(one.values), whole_of(one.variances), _ways([trial], paths)
    path, strength = strength_of(known.camera, trial)
    specimens = whole_of(moves)[None] if len(moves) == MORE else shifts[None]
    return StrengthCurve(path, np.array([strength]), shifts, variances, specimens, shifts, False, ways, ways)


def _judged(
    setting: Setting, end: SearchStage, camera: Camera, sight: Sight, name: str, course: StrengthCurve
) -> Verdict:
    limit, k = course.limit(sight, is_final=True)
    unit = place_of(course.path).parameter.unit
    plausible = _plausible(name, course)
    without = camera.values().get(course.path, 0.0)

    def stated(strength: float) -> float | None:
        """The parameter at a distance from the camera without the effect."""
        if not np.isfinite(strength):
            return None
        stated = 1 / strength if not np.isfinite(without) else without - strength if without else strength
        return float(stated)

    words = (name, course.path, unit)
    directions = sight.directions(course.signs)
    way = directions[(directions @ sight.metric.white(course.shifts[k])).argmax()]
    width = 1 / max(float(way @ sight.metric.white(course.shifts[k])), 1e-9)
    factor = width * float(way @ sight.metric.white(sight.residual))
    scatter = course.variances[k]
    if end.is_missing and (factor > sight.match * width or (scatter.any() and sight.gain(scatter) > ODDS)):
        return Verdict(words[0], "not separable", *words[1:], others=("unexplained",))
    limit = max(limit, course.least)
    upper = (max(factor, 0.0) + ONE_SIDED * width) * course.strengths[k]
    if limit <= plausible:
        is_matched = (sight.match + ONE_SIDED) * width * course.strengths[k] < NEAR * limit
        most = max(limit, min(upper, plausible)) if is_matched and not course.is_stepwise else limit
        return Verdict(words[0], "absent", *words[1:], limit=stated(most))
    return Verdict(words[0], "not testable", *words[1:], limit=stated(limit))


def _plausible(name: str, course: StrengthCurve) -> float:
    """The largest strength at which an effect is tried."""
    parameter = place_of(course.path).parameter
    values = [abs(v) for v in parameter.trials if not isinstance(v, str)] if parameter.strength else []
    return max(values, default=float(course.strengths[-1])) * (1 + 1e-9)


def _absorbing(
    end: SearchStage, sight: Sight, courses: Mapping[str, StrengthCurve]
) -> dict[str, tuple[str, ...]]:
    """Parameters of the camera that explain what an effect would change, for those that these frames would show with them known.

    The parameters are taken one after the other for all effects: the covariance with one known is large.
    """
    paths = [c.path for c in end.state.fitted.reference.coordinates]
    every = range(len(paths))
    known, slopes = sight.knowing(every), sight.null.slopes
    absorbed = {
        n: c
        for n, c in courses.items()
        if paths and c.knowing(every, slopes).limit(known)[0] <= _plausible(n, c)
    }
    if not absorbed:
        return {}
    names = [path.split(".")[0] if path.split(".")[0] in end.state.accepted else path for path in paths]
    limits: dict[str, dict[str, float]] = {effect: {} for effect in absorbed}
    for name in dict.fromkeys(names):
        columns = [k for k, own in enumerate(names) if own == name]
        known = sight.knowing(columns)
        for effect, course in absorbed.items():
            limits[effect][name] = course.knowing(columns, slopes).limit(known)[0]
    found = {}
    for effect, course in absorbed.items():
        own = limits[effect]
        alone = [name for name, limit in own.items() if limit <= _plausible(effect, course)]
        found[effect] = tuple(alone or [min(own, key=own.__getitem__)])
    return found


def _named(name: str, end: SearchStage) -> Verdict:
    entry = end.ranked[name]
    strengths = [key for key in catalogue()[name].strengths() if key in entry.parameters]
    key = next(iter(strengths or entry.parameters), None)
    if key is None:
        return Verdict(name, "named")
    of = entry.parameters[key]
    return Verdict(name, "named", path_of(name, key), of.unit, of.value, of.low, of.high)


def _rival(name: str, course: StrengthCurve, end: SearchStage) -> Verdict | None:
    """The verdict on an effect that these frames do not distinguish from an accepted one."""
    for pair in end.ambiguous:
        own = [other for other in pair["effects"] if other in end.state.accepted]
        if name in pair["effects"] and own:
            unit = place_of(course.path).parameter.unit
            return Verdict(
                name, "not separable", course.path, unit, others=tuple(own), frames=(pair["measure"],)
            )
    return None


def _strong(camera: Camera, name: str, setting: Setting) -> Camera:
    """The camera with an effect at the strongest of its trials."""
    trials: Sequence[Trial] = [
        t for t in setting.signs.trials if t.effect == name and not t.looked and not t.is_other_form
    ]
    return max(trials, key=lambda t: strength_of(camera, t)[1]).on(camera)
