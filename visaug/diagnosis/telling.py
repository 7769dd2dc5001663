"""Decides what is reported at the end of a search: unexplained residuals, and residuals in the form of accepted effects."""

from collections.abc import Sequence

import numpy as np

from visaug.diagnosis.candidates.signatures import SHOWN, Signatures
from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.fitting.reference import Reference
from visaug.diagnosis.fitting.robust import standardised
from visaug.diagnosis.residue import Residue, describe
from visaug.diagnosis.state import State
from visaug.diagnosis.verdict import Verdict
from visaug.statistics import Fingerprint, Statistic
from visaug.statistics.tail import SIGNIFICANT


def residue(measured: Fingerprint, state: State, is_left: bool, nearest: str | None) -> Residue | None:
    """Describes the difference that no effect explains; None where there is none.

    Args:
        measured: statistics of all frames.
        is_left: whether the camera is not adequate, or a cause outside the catalogue likelier than its effects.
        nearest: an effect that reduces the error but does not explain it.
    """
    if not is_left:
        return None
    excess = _excess(measured, state.fitted.whole_residual)
    return describe(measured.statistics, state.whole.z, nearest, excess)


def form(statistics: Sequence[Statistic], state: State) -> str | None:
    """Describes residuals, over all frames, of statistics on which accepted effects act; None if there are none."""
    use, by_chance = state.whole, float(np.quantile(state.fitted.reference.largest, 1 - SIGNIFICANT))
    # in other statistics of the view, what the tolerance does not cover is no matter of the form
    is_covered = (use.allowance >= use.null.scale) & (np.abs(use.z) <= by_chance)
    acts = (FORM * state.explained[2] >= use.null.scale) | is_covered
    plain = np.where(acts, np.abs(standardised(use.residual, use.null.scale)), 0.0)
    if not state.accepted or plain.max() <= by_chance:
        return None
    i = int(plain.argmax())
    s = statistics[i]
    return (
        f"The remaining difference is in the form of {' and '.join(state.accepted)}, which deviates slightly from the "
        f"catalogue: mostly {s.name} of {s.frames} ({s.view.replace('_', ' ')}), by {plain[i]:.1f} standard deviations."
    )


def cannot_show(signs: Signatures, first: Reference, judged: Sequence[Verdict] = ()) -> tuple[str, ...]:
    """Effects that these frames cannot show: those that are not testable by their verdict.

    Of an effect without a verdict, no trial strength changes any statistic enough to be detected.
    """
    verdicts = {one.effect: one.verdict for one in judged}
    seen: dict[str, float] = {}
    for trial, signature, variance in zip(signs.trials, signs.values, signs.variances, strict=True):
        moves, spread = (standardised(v, first.null_scale) for v in (signature, np.sqrt(variance)))
        seen[trial.effect] = max(seen.get(trial.effect, 0.0), float((np.abs(moves) + spread).max()))
    return tuple(
        effect
        for effect, z in seen.items()
        if (verdicts[effect] == "not testable" if effect in verdicts else z < SHOWN)
    )


def _excess(measured: Fingerprint, residual: np.ndarray) -> np.ndarray:
    """(statistics,) measured minus modelled, in linear units also for logarithmic statistics."""
    logarithmic = np.array([s.unit.startswith("log ") for s in measured.statistics])
    values = np.where(logarithmic, measured.values, 0.0)
    return np.where(logarithmic, np.exp(values) - np.exp(values - residual), residual)
