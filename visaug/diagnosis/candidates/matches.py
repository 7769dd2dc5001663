"""Trials of the catalogue whose signatures best match the residuals of the refitted camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.diagnosis.candidates.signatures import Signatures
from visaug.diagnosis.candidates.trials import Trial
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.law import ROUGH, Metric, metric, scatter_along

CHANCE = (
    5.0  # log likelihood that the best of a hundred directions gains by chance, if their covariance is right
)
SCALES = (0.03, 0.1, 0.3, 0.6, 1.0, 1.6)
NEAR_ENOUGH = 0.4  # logarithm of the scale up to which a signature needs no other strength
ALMOST = 0.8  # share of the gain of an effect's best trial above which another of its trials counts as equal


@dataclass(frozen=True)
class Match:
    """An effect's best trial.

    Attributes:
        gain: log-likelihood gain, see `scatter_along`.
        scale: factor on the signature that maximises it; negative only where the strength may be.
        variance: variance that the effect adds at that scale, per statistic.
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
    forgiving: bool = False,
) -> list[Match]:
    """Matches of every trial, the best first.

    Args:
        form: see `metric`.
        forgiving: whether the discrepancy is a share of the signature too where that is larger than the residual: a flat that
            saturates at the trial's strength and not at the true one says nothing.
    """
    m = metric(fitted, form, allowance)
    nothing = m.log_likelihood(fitted.residual)
    residual = m.white(fitted.residual)
    wide = scatter_along(fitted.reference.null, np.hypot(form * fitted.residual, allowance), signed.values)
    found = [
        _match(m, trial, signature, variance, fitted.residual, residual, share, nothing, form * forgiving)
        for trial, signature, variance, share in zip(
            signed.trials, signed.values, signed.variances, wide, strict=True
        )
        if trial.effect not in without
    ]
    return sorted(found, key=lambda match: -match.gain)


def best_of_each(found: Sequence[Match]) -> list[Match]:
    """The best trial of every effect, and the best one derived from the measured frames, the best first.

    Of trials with almost the same gain the one with a scale nearest to 1 is taken, since shifts are not proportional to
    strengths.
    """
    best: dict[tuple[str, bool], Match] = {}
    for match in found:
        kind = (match.trial.effect, match.trial.looked)
        top = best.setdefault(kind, match)
        alike = match.gain > ALMOST * top.gain and match.trial.form == top.trial.form
        if alike and extrapolation(match) < extrapolation(top):
            best[kind] = match
    return sorted(best.values(), key=lambda match: -match.gain)


def extrapolation(match: Match) -> float:
    return abs(np.log(max(abs(match.scale), 1e-9)))


def _match(
    m: Metric,
    trial: Trial,
    signature: np.ndarray,
    variance: np.ndarray,
    residual: np.ndarray,
    white_residual: np.ndarray,
    wide: float,
    nothing: float,
    of_signature: float,
) -> Match:
    """The match of one trial; `of_signature` is the share of a signature that is discrepancy where it exceeds the residual."""
    spread, by_chance = variance[m.used] / m.scale**2, CHANCE * (wide - 1)
    scales = (1.0,) if trial.is_fixed else SCALES + tuple(-c for c in SCALES) * trial.is_signed

    def widened(added: np.ndarray) -> tuple[float, float]:
        return max(
            (m.widened_log_likelihood(residual - c * signature, c**2 * added) - nothing, c) for c in scales
        )

    if spread.max() < 2 and spread.mean() < 0.1:
        d = m.white(signature)
        scale = 1.0 if trial.is_fixed else float(d @ white_residual) / max(float(d @ d), 1e-12)
        scale = scale if trial.is_signed else max(scale, 0.0)
        gain = scale * float(d @ white_residual) - 0.5 * scale**2 * float(d @ d)
        rough = np.where(np.abs(signature) > np.abs(residual), of_signature * np.abs(signature), 0.0)
        rough[m.used] *= rough[m.used] > m.scale  # few, so that they cost little
        if rough.any():
            gain, scale = max((gain, scale), widened(rough**2))
        return Match(trial, gain - by_chance, scale, np.zeros_like(variance))
    gain, scale = widened(variance)
    return Match(trial, gain, scale, scale**2 * variance)
