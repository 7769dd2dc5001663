"""The hypothesis that the cause is outside the catalogue, and that accepted effects resemble it or are a part of it by chance.

What the accepted effects leave in the frames tells the two apart. In a view let q be the mean square of the standardised
residuals with the effects, and m the root mean square of what the effects explain, in standard deviations. A deviation of root
mean square t that is left in the view, in whichever of its statistics, adds t^2 to the expected q. t is unknown and is integrated
out. M being the largest m of all views, the likelihoods of q are

- F, of the form: a real effect does not have exactly the catalogue's form. t / m is half-normal with the scale `FORM`.
- R, of resemblance: an effect that was fitted to the marks of another cause leaves about as much as it explains. t / M is
  half-Cauchy (A. Gelman, Bayesian Anal. 1 (2006) 515).
- C, of a cause of its own: t is log-uniform in `OWN`, whatever the effects explain.
- S, the part of C with t > M: of another cause that it does not resemble an effect explains a small part by chance.

With <.> the mean over the views, since nobody knows beforehand in which view another cause leaves most, and K accepted effects the
odds of a cause outside the catalogue against the effects are

    PRIOR (1 + 2^(K - 1) (<R / F> + <S / F>)) / (1 + PRIOR <C / F>).

The numerator has the three ways in which the cause can be outside: it has just the form of the effects and leaves nothing, they
resemble it, or they are a small part of it. In the denominator the effects are right, alone or beside a further cause outside the
catalogue. Of one effect each of these has the prior odds `PRIOR`. One cause in place of K effects that it does not have the form
of is 2^(K - 1) times as probable: each number of missing causes is half as probable as one less, as in
`visaug.diagnosis.criterion`. The effects are judged together: one cause in place of a part of them is no hypothesis.

Statistics of a view are correlated. q is therefore taken as a chi-squared variable over its degrees of freedom, with the mean and
the variance that it has in simulated sets (F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110).
"""

from collections.abc import Sequence

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from visaug.diagnosis.fitting.law import FORM
from visaug.diagnosis.fitting.robust import standardised
from visaug.diagnosis.state import State
from visaug.statistics import Statistic

PRIOR = 0.05  # odds, before the frames are seen, of each way in which the cause is outside the catalogue
OWN = (0.1, 1e6)  # smallest and largest t of a cause of its own
SIZES = np.geomspace(1e-2, 1e6, 401)  # edges of the steps of t; below the first t counts as 0
LIKELIER = 0.5  # probability of a cause outside the catalogue above which what is left is described, significant or not
LEAST = 1e-6  # smallest mean square and variance that are used


def log_odds_outside(state: State, statistics: Sequence[Statistic]) -> float:
    """Log odds of a cause outside the catalogue against the effects of a state, from what they leave in all frames.

    Args:
        statistics: of all frames.
    """
    use = state.whole
    varies = use.null.scale > 0
    views = np.array([s.view for s in statistics])
    own = [varies & (views == view) for view in np.unique(views[varies])]
    parts = (state.explained[2], use.residual, use.null.residuals)
    explained, left, simulated = (standardised(part, use.null.scale) ** 2 for part in parts)
    shown = np.sqrt([explained[view].mean() for view in own])
    told = [
        log_ratios(float(left[view].mean()), simulated[:, view].mean(1), m, shown.max())
        for view, m in zip(own, shown, strict=True)
    ]
    resembles, small, further = logsumexp(told, axis=0) - np.log(len(told))
    instead = (len(state.accepted) - 1) * np.log(2)
    against = logsumexp([0.0, instead + resembles, instead + small])
    return float(np.log(PRIOR) + against - np.logaddexp(0.0, np.log(PRIOR) + further))


def log_ratios(left: float, simulated: np.ndarray, shown: float, most: float) -> tuple[float, float, float]:
    """Log likelihoods of what is left in a view, by resemblance, of what is explained in small part and by a cause of its own.

    They are relative to the likelihood by the form.

    Args:
        left: mean square of the residuals, in standard deviations.
        simulated: (R,) the same of simulated sets.
        shown: root mean square of what the effects explain,
        most: and the largest of all views.
    """
    mean, variance = max(simulated.mean(), LEAST), max(simulated.var(ddof=1), LEAST)
    freedom = 2 * mean**2 / variance
    sizes = np.concatenate([[0], np.sqrt(SIZES[:-1] * SIZES[1:]), SIZES[-1:]])
    likelihood = stats.gamma.logpdf(max(left, LEAST), freedom / 2, scale=2 * (mean + sizes**2) / freedom)
    own = stats.loguniform(*OWN)
    weights = [
        np.diff(law.cdf(np.maximum(SIZES, least)), prepend=law.cdf(least), append=1.0)
        for law, least in (
            (stats.halfnorm(scale=FORM * max(shown, LEAST)), 0.0),
            (stats.halfcauchy(scale=max(most, LEAST)), 0.0),
            (own, most),
            (own, 0.0),
        )
    ]
    logs = np.array([logsumexp(likelihood, b=b) if b.any() else -np.inf for b in weights])
    resembles, small, further = (logs[1:] - logs[0]).tolist()
    return resembles, small, further
