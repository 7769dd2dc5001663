"""Decides what is reported at the end of a search: unexplained residuals, and residuals in the form of accepted effects."""

from collections.abc import Sequence

import numpy as np

from visaug.comparison import Error
from visaug.diagnosis.acceptance import OFF, State, owes
from visaug.diagnosis.errors import Errors
from visaug.diagnosis.naming import SIGNIFICANT
from visaug.diagnosis.reference import Reference
from visaug.diagnosis.residue import Residue, describe
from visaug.diagnosis.robust import standardised
from visaug.diagnosis.signatures import Signatures
from visaug.diagnosis.spread import COVERS, only_covers
from visaug.fingerprint import Fingerprint, Statistic

TRACE = 0.03  # with accepted effects: an error whose lower limit exceeds this is reported
MUCH = 0.1  # with accepted effects: reported if the upper limit exceeds this, and for adequate cameras if the lower limit does
STAYS = 0.2  # lower limit of the error above which the last effect may be judged to explain nothing
APART = 10.0  # deviation, in standard deviations, of statistics that no accepted effect acts on; reported for any error
SHOWN = (
    3.0  # standard deviations by which an effect must change some statistic to be detectable in the frames
)


def is_worth_telling(errors: Errors, state: State) -> bool:
    """Whether the remaining difference is reported: with accepted effects, a small fraction of the original error is not.

    An exception are large deviations of statistics on which no accepted effect acts: their forms cannot cause these.
    """
    error = errors.found(state.fitted)
    if not state.accepted or error is None or error.low > TRACE or error.high > MUCH:
        return True
    scale = state.fitted.reference.whole_null.scale
    elsewhere = state.whole_allowance < scale
    return bool(np.abs(state.whole_z[elsewhere]).max(initial=0.0) > APART)


def is_no_explanation(
    told: Error | None,
    errors: Errors,
    statistics: Sequence[Statistic],
    before: State,
    state: State,
    missing: bool,
) -> bool:
    """Whether the last effect explains nothing: a large error remains, covered by added variance or where the effect acts.

    Args:
        told: the error with the effect.
        before: the state without it.
        state: the state with it.
        missing: whether the camera with the effect is not adequate.
    """
    if told is None or told.low <= STAYS:
        return False
    if missing and owes(statistics, before, state):
        return True
    without, with_it = before.fitted, state.fitted
    was, now = errors.found(without, with_it), errors.found(with_it, without)
    hardly_falls = was is not None and now is not None and now.value > COVERS * was.value
    return hardly_falls and only_covers(without, with_it, np.abs(before.z) > OFF)


def residue(
    told: Error | None,
    errors: Errors,
    measured: Fingerprint,
    state: State,
    missing: bool,
    nearest: str | None,
) -> Residue | None:
    """Describes the difference that no effect explains; None if there is nothing to report.

    Args:
        told: the error of the state.
        measured: statistics of all frames.
        missing: whether the camera is not adequate.
        nearest: an effect that reduces the error but does not explain it.
    """
    excess = _excess(measured, state.fitted.whole_residual)
    if missing and is_worth_telling(errors, state):
        return describe(measured.statistics, state.whole_z, nearest, excess)
    return describe(measured.statistics, _plain_z(state), excess=excess) if is_far_off(told, state) else None


def is_far_off(told: Error | None, state: State) -> bool:
    """Whether the error is large although the camera is adequate: added variance that covers everything explains little.

    The same holds for a form that is far from the catalogue's and hidden by the model discrepancy of the effect. It requires a
    significant deviation: the error of faint effects is mostly noise.
    """
    return bool(state.accepted) and told is not None and told.low > MUCH and _stands_out(state)


def form(statistics: Sequence[Statistic], state: State) -> str | None:
    """Describes residuals, over all frames, of statistics on which accepted effects act; None if there are none."""
    acts = state.whole_allowance >= state.fitted.reference.whole_null.scale
    plain = np.where(acts, np.abs(_plain_z(state)), 0.0)
    if not state.accepted or plain.max() <= _by_chance(state):
        return None
    i = int(plain.argmax())
    s = statistics[i]
    return (
        f"The remaining difference is in the form of {' and '.join(state.accepted)}, which deviates slightly from the "
        f"catalogue: mostly {s.name} of {s.frames} ({s.view.replace('_', ' ')}), by {plain[i]:.1f} standard deviations."
    )


def cannot_show(signs: Signatures, first: Reference) -> tuple[str, ...]:
    """Effects that these frames cannot show: no trial strength changes any statistic enough to be detected."""
    seen: dict[str, float] = {}
    for trial, signature, variance in zip(signs.trials, signs.values, signs.variances, strict=True):
        moves, spread = (standardised(v, first.null_scale) for v in (signature, np.sqrt(variance)))
        seen[trial.effect] = max(seen.get(trial.effect, 0.0), float((np.abs(moves) + spread).max()))
    return tuple(effect for effect, z in seen.items() if z < SHOWN)


def _excess(measured: Fingerprint, residual: np.ndarray) -> np.ndarray:
    """(statistics,) measured minus modelled, in linear units also for logarithmic statistics."""
    logarithmic = np.array([s.unit.startswith("log ") for s in measured.statistics])
    values = np.where(logarithmic, measured.values, 0.0)
    return np.where(logarithmic, np.exp(values) - np.exp(values - residual), residual)


def _plain_z(state: State) -> np.ndarray:
    """Residuals of all frames in standard deviations, without model discrepancy."""
    return standardised(state.fitted.whole_residual, state.fitted.reference.whole_null.scale)


def _stands_out(state: State) -> bool:
    """Whether some statistic deviates more than for a complete camera, without model discrepancy."""
    return float(np.abs(_plain_z(state)).max()) > _by_chance(state)


def _by_chance(state: State) -> float:
    """Largest deviation, in standard deviations, expected by chance for a complete camera."""
    return float(np.quantile(state.fitted.reference.largest, 1 - SIGNIFICANT))
