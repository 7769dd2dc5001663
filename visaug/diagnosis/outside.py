"""The hypothesis that an effect outside the catalogue was the cause, and that an accepted effect merely resembles it.

What an accepted effect leaves in the frames tells the two apart. If the effect is the cause, the standardised residuals z of the
camera with it are those of its simulated sets. An effect that resembles the cause is fitted to its strongest marks and leaves
more in others, in a view that nobody knows beforehand: a variance T^2 beside the expected one, in one view of n statistics, with
T log-uniform in `SPREADS`. Its marginal likelihood relative to no such variance is

    B = mean over views and T of (1 + T^2)^(-n/2) exp(sum of z^2 T^2 / (2 (1 + T^2))).

The formula takes statistics as independent, so B serves as a statistic whose p-value is counted among the simulated sets. Under
the hypothesis the p-value has the density x p^(x - 1) with x uniform in 0 to 1, which gives the Bayes factor of a p-value
(T. Sellke, M. J. Bayarri and J. O. Berger, Am. Stat. 55 (2001) 62). The added variance is that of a robust synthetic likelihood
(D. T. Frazier and C. Drovandi, J. Comput. Graph. Stat. 30 (2021) 958).

Only views are taken in which the effects explain `SHOWN` standard deviations of a statistic, and all where there is no such view.
What is left where the effects change nothing has a cause of its own, and says nothing about them.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.state import State
from visaug.statistics import Statistic
from visaug.statistics.tail import tail_factor

PRIOR = 0.1  # odds, before the frames are seen, of a cause outside the catalogue against one of it
SPREADS = (0.1, 1e4)  # smallest and largest T
STEPS = 60  # of T
SHOWN = 1.0  # standard deviations that an effect explains where it acts
LEAST = 1e-12  # smallest p-value that is used; smaller ones count as this


def log_odds_outside(state: State, statistics: Sequence[Statistic]) -> float:
    """Log odds of a cause outside the catalogue against the effects of a state, from what they leave in all frames.

    Args:
        statistics: of all frames.
    """
    use = state.whole
    views = np.array([s.view for s in statistics])
    used = _where_effects_act(state, views)
    scale, allowed = use.scale[used], use.allowance[used]
    noise = np.random.default_rng(0).standard_normal((len(use.null.residuals), int(used.sum())))
    # the form of an effect may differ from the catalogue's within its tolerance
    simulated = (use.null.residuals[:, used] + allowed * noise) / scale
    measured, counted = (_log_ratio(z, views[used]) for z in ((use.residual[used] / scale)[None], simulated))
    return float(np.log(PRIOR) + log_bayes_factor(_p_value(float(measured[0]), counted)))


def _where_effects_act(state: State, views: np.ndarray) -> np.ndarray:
    """(statistics,) whether a statistic varies and belongs to a view in which the accepted effects explain something."""
    use = state.whole
    varies = use.null.scale > 0
    # the tolerance of a form is that share of what the effect explains
    acts = varies & (use.allowance >= SHOWN * FORM * use.null.scale)
    return varies & np.isin(views, views[acts]) if acts.any() else varies


def log_bayes_factor(p: float) -> float:
    """Log of (1 - p + p ln p) / (p ln^2 p), the integral of x p^(x - 1) over x from 0 to 1; log 1/2 at p = 1.

    Examples:
        >>> round(float(np.exp(log_bayes_factor(0.01))), 1)
        4.5
    """
    p = float(np.clip(p, LEAST, 1 - 1e-4))  # the limit at 1, without its cancellation
    return float(np.log(1 - p + p * np.log(p)) - np.log(p) - 2 * np.log(-np.log(p)))


def _log_ratio(z: np.ndarray, views: np.ndarray) -> np.ndarray:
    """(R,) log of B for residuals (R, statistics)."""
    squares = np.geomspace(*SPREADS, STEPS) ** 2
    found = []
    for view in np.unique(views):
        of_view = z[:, views == view]
        total = 0.5 * (of_view**2).sum(1)[:, None] * squares / (1 + squares)
        found.append(logsumexp(total - 0.5 * of_view.shape[1] * np.log1p(squares), axis=1))
    return logsumexp(found, axis=0) - np.log(STEPS * len(found))


def _p_value(value: float, null: np.ndarray) -> float:
    """Share of the simulated sets with a value as large, the measurement among them; extrapolated beyond the largest."""
    return (1 + np.count_nonzero(null >= value)) / (1 + len(null)) * tail_factor(value, null)
