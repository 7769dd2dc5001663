"""What of a search's end is a finding: which rest is told as unexplained, which as the form of what was named."""

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

TRACE = 0.03  # error beside an accepted effect that is a finding, if it is surely so much
MUCH = 0.1  # error beside an accepted effect that is a finding, if it may be so much; and if it surely is, though the camera holds
STAYS = 0.2  # error that surely stays beside a name that explains nothing
APART = 10.0  # standard deviations of what no accepted effect acts on, from which it is a finding however small the error
SHOWN = 3.0  # standard deviations that some statistic must move for frames to show an effect


def is_worth_telling(errors: Errors, state: State) -> bool:
    """Whether what is left is more than a small share of what was: beside an accepted effect a trace is no finding.

    Unless it stands far out where no accepted effect acts: it is a trace of their error, and none of their forms.
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
    """Whether the last effect explains nothing: much surely stays, under a spread or, beside a rest, where the effect acts.

    Args:
        told: the error with the effect.
        before, state: without it and with it.
        missing: whether something is missing with it.
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
    """What no effect explains, described; None where nothing of it is a finding.

    Args:
        told: the error of the state.
        measured: in all frames together.
        missing: whether something is missing.
        nearest: an effect that lowers the error and does not explain it.
    """
    excess = _excess(measured, state.fitted.whole_residual)
    if missing and is_worth_telling(errors, state):
        return describe(measured.statistics, state.whole_z, nearest, excess)
    return describe(measured.statistics, _plain_z(state), excess=excess) if is_far_off(told, state) else None


def is_far_off(told: Error | None, state: State) -> bool:
    """Whether the error surely stays large though the camera holds: a spread that covers anything explains little.

    Nor does a form that is far from the catalogue's, which the effect's own allowance would hide. Not where nothing stands out:
    of faint effects the error is mostly noise.
    """
    return bool(state.accepted) and told is not None and told.low > MUCH and _stands_out(state)


def form(statistics: Sequence[Statistic], state: State) -> str | None:
    """What the forms of accepted effects leave over in all frames, in words; of what they do not act on nothing is their form's."""
    acts = state.whole_allowance >= state.fitted.reference.whole_null.scale
    plain = np.where(acts, np.abs(_plain_z(state)), 0.0)
    if not state.accepted or plain.max() <= _by_chance(state):
        return None
    i = int(plain.argmax())
    s = statistics[i]
    return (
        f"What is left belongs to the form of {' and '.join(state.accepted)}, which is not quite the catalogue's: "
        f"most of all {s.name} of {s.frames} ({s.view.replace('_', ' ')}), {plain[i]:.1f} standard deviations off."
    )


def cannot_show(signs: Signatures, first: Reference) -> tuple[str, ...]:
    """Effects that move no statistic of these frames far enough to be seen, however strong they are tried."""
    seen: dict[str, float] = {}
    for trial, signature, variance in zip(signs.trials, signs.values, signs.variances, strict=True):
        moves, spread = (standardised(v, first.null_scale) for v in (signature, np.sqrt(variance)))
        seen[trial.effect] = max(seen.get(trial.effect, 0.0), float((np.abs(moves) + spread).max()))
    return tuple(effect for effect, z in seen.items() if z < SHOWN)


def _excess(measured: Fingerprint, residual: np.ndarray) -> np.ndarray:
    """(statistics,) measured less modelled, of what is measured as a logarithm the thing itself."""
    logarithmic = np.array([s.unit.startswith("log ") for s in measured.statistics])
    values = np.where(logarithmic, measured.values, 0.0)
    return np.where(logarithmic, np.exp(values) - np.exp(values - residual), residual)


def _plain_z(state: State) -> np.ndarray:
    """What is left in all frames in standard deviations, nothing allowed for forms."""
    return standardised(state.fitted.whole_residual, state.fitted.reference.whole_null.scale)


def _stands_out(state: State) -> bool:
    """Whether some statistic is further off than a camera that lacks nothing would leave it, nothing allowed for forms."""
    return float(np.abs(_plain_z(state)).max()) > _by_chance(state)


def _by_chance(state: State) -> float:
    """Standard deviations to which the furthest statistic of a camera that lacks nothing comes."""
    return float(np.quantile(state.fitted.reference.largest, 1 - SIGNIFICANT))
