"""Selects the effects whose signatures match the residuals and refines their parameters, the most likely first."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from visaug.camera import Camera
from visaug.diagnosis.candidates.matches import NEAR_ENOUGH, Match, best_of_each, extrapolation, matches
from visaug.diagnosis.candidates.refinement import Refined, refine
from visaug.diagnosis.candidates.signatures import Signatures, signatures
from visaug.diagnosis.candidates.trials import Trial, beside_words
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.fitting.reference import Report
from visaug.diagnosis.fitting.robust import OUTLIER, standardised
from visaug.diagnosis.laboratory import Laboratory
from visaug.effects import catalogue

SHARPENED = 6  # largest number of strengths at which the signature of a candidate is simulated,
FAR_STEP = 3.0  # and largest step of the logarithm of a strength
TRIED = 4  # largest number of candidates that are refined in a step, if they gain
SHARE = 0.2  # this share of the best gain
ALIKE = 0.3  # share of the best gain within which two candidates, or two options of one, are equivalent
OTHER_STARTS = 4  # further starts of the best candidate,
OTHER = 0.05  # with forms whose signatures gain at least this share of the best form's,
NOT_FAR = 0.3  # iterated if their start gains at least this share
MUCH = 6.0  # standard deviations in some statistic from which other values are further starts
FAR_OUT = 30.0  # standard deviations beyond which even a slightly different form is rejected
LEAST_GAIN = (
    2.0  # log likelihood, less what noise gains, of effects that are tried only where something is missing
)


def candidates(
    lab: Laboratory,
    signs: Signatures,
    fitted: Fitted,
    taken: frozenset[str],
    allowance: np.ndarray,
    report: Report,
    earlier: Mapping[str, Refined],
    least: float = LEAST_GAIN,
) -> tuple[list[Refined], Signatures]:
    """The effects whose signatures best match the residuals, refined, the best first, and the signatures simulated by the way.

    Args:
        fitted: the camera from which they are tried: as refitted last, or as given.
        taken: effects that are not tried: left out, or added already.
        allowance: residual that may stay, see `visaug.diagnosis.fitting.uses.Use`.
        earlier: effects as refined before the last one was added; their values are further starts.
        least: gain below which an effect is not refined.
    """
    signs = sharpened(lab, signs, fitted, taken, allowance, report, least)
    tried, chosen = first_matches(signs, fitted, taken, allowance, least)
    best: dict[str, Refined] = {}
    for m in chosen:
        beaten = max((r.gain for r in best.values()), default=0.0)
        also = _as_earlier(fitted, m, earlier.get(m.trial.effect))
        refined = refine(lab, fitted, m, report, allowance, beaten, also=also)
        best[refined.effect] = better(refined, best.get(refined.effect, refined))
    found = sorted(best.values(), key=lambda r: -r.gain)
    for k, r in enumerate(found):
        if r.gain < (1 - ALIKE) * found[0].gain:
            break
        begun = [m for m in chosen if m.trial.effect == r.effect]
        least, forms = OTHER * max(m.gain for m in begun), [m.trial.form for m in begun]
        others = [
            m for m in tried if m.trial.effect == r.effect and m.trial.form not in forms and m.gain > least
        ]
        if k > 0:
            # An equivalent effect is tried with other options too, so that it is not ranked lower because of its options.
            others = [m for m in others if _reworded(fitted, r, m) is not None]
        found[k] = from_other_starts(lab, fitted, r, others, report, allowance)
    return sorted(found, key=lambda r: -r.gain), signs


def sharpened(
    lab: Laboratory,
    signs: Signatures,
    fitted: Fitted,
    taken: frozenset[str],
    allowance: np.ndarray,
    report: Report,
    least: float = LEAST_GAIN,
) -> Signatures:
    """Adds signatures of the best candidates: beside their words, and at strengths at which these need no scale.

    First each effect is tried at the strength that deviating statistics ask for, see `asked`.

    Shifts are not proportional to strengths: a variance grows with the square, a blur with no power at all. The strength is
    sought by the secant rule in the logarithms of strength and scale.
    """
    further: list[Trial] = []
    for round_ in range(SHARPENED):
        tried, chosen = first_matches(signs, fitted, taken, allowance, least)
        if round_ == 0:
            further = [t for m in chosen if not m.trial.looked for t in beside_words(m.trial)]
            further += asked(signs, fitted, taken)
        for m in chosen:
            if m.trial.looked or extrapolation(m) < NEAR_ENOUGH or not m.scale:
                continue
            start = m.trial.times(np.sign(m.scale))
            points = [point for other in tried if (point := _point(other, start)) is not None]
            if points:
                idle = [_ratio(other.trial, start) for other in tried if not other.scale]
                vain = [float(np.log(abs(ratio))) for ratio in idle if ratio is not None]
                further.append(start.times(float(np.exp(_above(vain, _next(points), points)))))
        known = {t.values for t in signs.trials}
        further = [t for t in dict.fromkeys(further) if t.values not in known and t.fits(fitted.camera)]
        if not further:
            break
        signs += signatures(lab, fitted.reference, further, report)
        further = []
    return signs


def asked(signs: Signatures, fitted: Fitted, taken: frozenset[str]) -> list[Trial]:
    """Of each effect, the trial that fits the deviating statistics best, at the weaker strength that these ask for.

    At its own strength a trial may change others most, and match nothing: a vignetting of 8 % brings a flat out of saturation, one
    of 0.5 % does not. Effects that would explain less than `SHARE` of the deviations are left out.
    """
    off = np.abs(fitted.z) > OUTLIER
    if not off.any():
        return []
    shapes, deviations = standardised(signs.values, fitted.reference.null_scale)[:, off], fitted.z[off]
    along, squares = shapes @ deviations, np.maximum((shapes**2).sum(1), 1e-12)
    least = SHARE * float((deviations**2).sum())
    best: dict[str, tuple[float, float, Trial]] = {}
    for trial, scale, gain in zip(signs.trials, along / squares, along**2 / squares, strict=True):
        if trial.effect in taken or trial.looked or trial.is_fixed or not (scale > 0 or trial.is_signed):
            continue
        if gain > best.get(trial.effect, (least,))[0]:
            best[trial.effect] = float(gain), float(scale), trial
    return [trial.times(scale) for _, scale, trial in best.values() if np.log(abs(scale)) < -NEAR_ENOUGH]


def _point(match: Match, start: Trial) -> tuple[float, float] | None:
    """Logarithms of the ratio of a match's strengths to those of a start, and of its scale; None if it differs in more."""
    ratio = _ratio(match.trial, start)
    if ratio is None or match.scale * ratio <= 0:
        return None
    return float(np.log(abs(ratio))), float(np.log(abs(match.scale)))


def _ratio(trial: Trial, start: Trial) -> float | None:
    """Ratio of a trial's strengths to those of a start; None if it differs in more."""
    if trial.looked or trial.kind != start.kind:
        return None
    strengths = catalogue()[trial.effect].strengths()
    ratios = [
        value / start.by_name[key]
        for key, value in trial.by_name.items()
        if key in strengths and value and start.by_name.get(key)
    ]
    return ratios[0] if ratios and np.allclose(ratios, ratios[0]) else None


def _above(vain: Sequence[float], wanted: float, points: Sequence[tuple[float, float]]) -> float:
    """The log factor that is wanted; halfway back to the weakest point if a stronger trial than that had no effect.

    Args:
        vain: log factors of trials without a shift, or with one against the residual.
    """
    weakest = min(x for x, _ in points)
    highest = max((x for x in vain if x < weakest), default=-np.inf)
    return wanted if wanted > highest else (highest + weakest) / 2


def _next(points: Sequence[tuple[float, float]]) -> float:
    """The log factor at which the log scale is expected to vanish.

    From the point nearest to that, by the secant to the nearest point beyond it, or to the next best one.
    """
    (x, y), *others = sorted(points, key=lambda point: abs(point[1]))
    beyond = [point for point in others if point[1] * y < 0 < (point[0] - x) * y]
    other = min(beyond, key=lambda point: abs(point[0] - x)) if beyond else next(iter(others), None)
    if other and abs(x - other[0]) > 1e-3 and (slope := (y - other[1]) / (x - other[0])) < 0:
        return x - float(np.clip(y / slope, -FAR_STEP, FAR_STEP))
    return x + float(np.clip(0.7 * y, -FAR_STEP, FAR_STEP))  # between a level and a variance


def _as_earlier(fitted: Fitted, match: Match, earlier: Refined | None) -> list[Camera]:
    """The fitted camera with the values that an effect had in an earlier step, if it is tried with the same options.

    For example, column bands that were fitted beside a flare remain a good start after the flare was added, when the estimate
    read from the frames finds other edges. A number that was 0 and is not in the trial has the trial's value: where it is
    refined on a logarithmic scale, 0 is no start.
    """
    if earlier is None or catalogue()[earlier.effect].base:
        return []
    camera = match.trial.on(fitted.camera)
    if any(camera.choices()[path] != word for path, word in earlier.words.items()):
        return []
    return [camera.replace({path: value for path, value in earlier.numbers.items() if value != 0})]


def first_matches(
    signs: Signatures,
    fitted: Fitted,
    without: frozenset[str],
    allowance: np.ndarray | float,
    least: float = LEAST_GAIN,
) -> tuple[list[Match], list[Match]]:
    """All matches, the best first, and for every effect that is worth refining its best one.

    With a model-discrepancy term an effect that shifts a single statistic gains little, however large the residual. Therefore
    the trial with the largest gain for its exact form is included too, unless it adds variance, which covers any residual.
    Where a residual is so large that every exact form would be rejected, it is the trial with the largest gain for the
    discrepancy that remains after refinement. Trials read from the frames are the best of about a hundred and get no such
    preference, except those that cannot be scaled: their signatures come from the camera as given and may not be valid for
    the refitted one. One more effect is included, the best of forgiving matches; all its matches are these then.
    """
    tried = matches(signs, fitted, without, allowance)
    if not tried:  # every effect is left out or there already
        return [], []
    best = best_of_each(tried)
    most = {(m.trial.effect, m.trial.looked): m.gain for m in reversed(tried)}
    enough = max(least, min(SHARE * best[0].gain, best[0].gain - 1e-9))
    chosen = [m for m in best if most[m.trial.effect, m.trial.looked] > enough][:TRIED]
    far_out = np.abs(fitted.z).max() > FAR_OUT
    exact = matches(signs, fitted, without, allowance, form=FORM if far_out else 0.0)
    claim = [m for m in exact if far_out or not (m.variance.any() or m.trial.looked)][:1]
    names = {m.trial.effect for m in chosen}
    chosen += [m for m in claim if m.gain > least and m.trial.effect not in names]
    first, *others = matches(signs, fitted, without, allowance, forgiving=True)
    own = first.trial.effect
    if first.gain > least and own not in {m.trial.effect for m in chosen}:
        chosen.append(first)
        tried = [m for m in tried if m.trial.effect != own]
        tried += [m for m in (first, *others) if m.trial.effect == own]
        tried.sort(key=lambda m: -m.gain)
    chosen += [m for m in tried if m.trial.looked and m.trial.is_fixed and m not in chosen]
    return tried, chosen


def from_other_starts(
    lab: Laboratory,
    fitted: Fitted,
    refined: Refined,
    others: Sequence[Match],
    report: Report,
    allowance: np.ndarray | float,
) -> Refined:
    """The best fit of an effect from starts of another form.

    Other options are tried first, with the values found so far, since no continuous step leads from one option to another. Where
    residuals stay, so are other values: a wrong period or place is a local optimum. Where none stay, an option that does not
    start about as well is not iterated: it is sought as one that these frames do not tell from the first.

    Args:
        refined: the effect from its best match.
        others: the effect's matches of other forms, the best first.
    """
    words: dict[tuple, Match] = {}
    numbers: list[Match] = []
    for m in others:
        worded = _reworded(fitted, refined, m)
        if worded is None:
            numbers.append(m)
        else:
            words.setdefault(worded.trial.values, worded)
    for k, m in enumerate([*words.values(), *numbers][:OTHER_STARTS]):
        scale = fitted.reference.null_scale
        own = np.where(scale > 0, np.sqrt(scale**2 + refined.variance), 0.0)
        is_left = np.abs(standardised(refined.residual, own)).max() >= MUCH
        if not is_left and k >= len(words):
            break
        least = (NOT_FAR if is_left else 1 - ALIKE) * refined.gain
        again = refine(lab, fitted, m, report, allowance, refined.gain, least=least)
        refined = better(refined, again)
    return refined


def better(one: Refined, other: Refined) -> Refined:
    """The fit with the larger gain; it refers to the best of the different ones that gain almost as much.

    A few defects shift many statistics by chance, so that a fit to these can gain more than the values that the frames show.
    """
    best, behind = (one, other) if one.gain >= other.gain else (other, one)
    others = [r for r in (behind, behind.otherwise, best.otherwise) if r is not None and not r.is_like(best)]
    otherwise = max(others, key=lambda r: r.gain, default=None)
    if otherwise is not None and otherwise.gain < (1 - ALIKE) * best.gain:
        otherwise = None
    return best if best.otherwise is otherwise else replace(best, otherwise=otherwise)


def _reworded(fitted: Fitted, refined: Refined, other: Match) -> Match | None:
    """The refined candidate with the options of another trial; None if they are the same."""
    camera, words = refined.camera, refined.words
    others = {path: word for path, word in other.trial.values if isinstance(word, str)}
    if all(words.get(path, word) == word for path, word in others.items()):
        return None
    own = [c for c in fitted.reference.coordinates if not c.path.startswith(f"{refined.effect}.")]
    following = tuple((c.path, c.read(camera) - c.read(fitted.camera)) for c in own)
    trial = replace(
        other.trial, values=tuple({**refined.numbers, **words, **others}.items()), following=following
    )
    return Match(trial, other.gain, 1.0, refined.variance)
