"""Shares of an oracle's gain: the oracle's arm knows the test cameras, the others do not."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from visaug_train import tables
from visaug_train.statistics import paired_interval

if TYPE_CHECKING:
    from visaug_train.results import Ablation

MEASURE = "keypoint_ap_coco"
SHARES = np.linspace(-10, 10, 4001)  # that are tried: steps of half a percent


@dataclass(frozen=True)
class ArmGain:
    """What an arm and the oracle gain over the baseline in keypoint AP50-95 (COCO's), on one domain or the mean of several.

    `gain` and `oracle` are (mean, low, high). `share` is their ratio; its ends are None where it is not determined.
    """

    arm: str
    domains: tuple[str, ...]
    baseline: float
    gain: tuple[float, float, float]
    oracle: tuple[float, float, float]
    share: float
    low: float | None
    high: float | None

    def __str__(self) -> str:
        if self.low is None or self.high is None:
            return "not determined: the oracle's gain is not clear of 0"
        return f"{100 * self.share:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]"


def share_interval(
    gains: np.ndarray, oracle: np.ndarray, by_images: np.ndarray, images: int
) -> tuple[float, float] | None:
    """The 95 % interval of mean gain over mean oracle's gain, after E. C. Fieller (J. R. Stat. Soc. B 16 (1954) 175).

    It holds the shares s at which gain - s oracle, whose interval `paired_interval` gives, does not differ from 0.

    Args:
        gains, oracle: of each seed, (seeds).
        by_images: (resamples, 2), both means over seeds on resampled images.
        images: how many there are.

    Returns:
        Its ends; None where it is not bounded, for the oracle's gain does not differ from 0, or is a loss.
    """
    left = gains[:, None] - SHARES * oracle[:, None]
    moved = by_images[:, :1] - SHARES * by_images[:, 1:]
    low, high = paired_interval(left, moved.var(axis=0, ddof=1), images)
    inside = np.flatnonzero((low <= 0) & (high >= 0))
    if oracle.mean() <= 0 or not len(inside) or inside[0] == 0 or inside[-1] == len(SHARES) - 1:
        return None
    return float(SHARES[inside[0]]), float(SHARES[inside[-1]])


def gains(ablation: "Ablation") -> list[ArmGain]:
    """Of every arm but baseline and oracle: on each domain of the cameras that were made, and on their mean."""
    config = ablation.config
    if config.oracle is None or config.oracle not in ablation.means or config.baseline not in ablation.means:
        return []
    domains = target_sets(ablation)
    groups = [(each,) for each in domains] + ([tuple(domains)] if len(domains) > 1 else [])
    arms = [arm for arm in ablation.means if arm not in (config.baseline, config.oracle)]
    found = [_gain(ablation, arm, group) for arm in arms for group in groups]
    return [each for each in found if each is not None]


def target_sets(ablation: "Ablation") -> list[str]:
    """The test sets of the domains whose cameras were made; all of them where none was."""
    made = {camera.domain for camera in ablation.study.cameras}
    sources = ablation.config.data.test
    return [
        name
        for name in ablation.study.tests
        if not made or (name in sources and sources[name].domain in made)
    ]


def _gain(ablation: "Ablation", arm: str, domains: tuple[str, ...]) -> ArmGain | None:
    baseline, oracle = ablation.config.baseline, ablation.config.oracle
    assert oracle is not None
    seeds = [s for s in ablation.seeds(arm) if s in ablation.seeds(oracle) and s in ablation.seeds(baseline)]
    if not seeds:
        return None
    column = list(tables.MEASURES).index(MEASURE)

    def mean_over_domains(name: str) -> tuple[np.ndarray, np.ndarray]:
        """Scores of each seed, (seeds); on resampled images, (resamples, seeds)."""
        pairs = [ablation.scores((name, domain), seeds) for domain in domains]
        return (
            np.mean([s[:, column] for s, _ in pairs], axis=0),
            np.mean([r[:, :, column] for _, r in pairs], axis=0),
        )

    at_baseline, resampled = mean_over_domains(baseline)
    images = min(len(ablation.study.tests[domain]) for domain in domains)
    won, moved = [], []
    for name in (arm, oracle):
        scores, again = mean_over_domains(name)
        won.append(scores - at_baseline)
        moved.append((again - resampled).mean(axis=1))
    by_images = np.stack(moved, axis=1)
    low, high = paired_interval(np.stack(won, axis=1), by_images.var(axis=0, ddof=1), images)
    means = [float(each.mean()) for each in won]
    share = share_interval(won[0], won[1], by_images, images)
    return ArmGain(
        arm,
        domains,
        float(at_baseline.mean()),
        (means[0], float(low[0]), float(high[0])),
        (means[1], float(low[1]), float(high[1])),
        means[0] / means[1] if means[1] else float("nan"),
        *(share or (None, None)),
    )


def gain_table(found: list[ArmGain], baseline: str, oracle: str) -> tables.ResultTable:
    """A row for each arm and domain."""
    won, share = f"change by {oracle}", f"share of what {oracle} gains"
    head = ["arm", "test set", baseline, "change by the arm", won, share]
    signed = tables.signed
    rows = [
        [g.arm, " and ".join(g.domains), f"{g.baseline:.3f}", signed(*g.gain), signed(*g.oracle), str(g)]
        for g in found
    ]
    title = "Keypoint AP50-95 (COCO's): what knowing the camera gains, and the share of it"
    return tables.ResultTable(title, head, rows)
