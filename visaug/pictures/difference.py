"""One statistic of two sets of pictures, and what both sets look like apart from their noise."""

import math
from dataclasses import dataclass

from scipy import stats

from visaug.pictures.blocks import Rounding
from visaug.pictures.files import PictureSet
from visaug.pictures.looks import measured
from visaug.pictures.regions import find_regions
from visaug.pictures.scenes import chosen_of, read_windows


@dataclass(frozen=True)
class StatisticDifference:
    """One statistic of both sets: value in the target, in the other set, and the standard error of the difference."""

    view: str
    statistic: str
    unit: str
    measured: float
    modelled: float
    standard_deviation: float
    degrees: float

    @property
    def p_value(self) -> float:
        return float(2 * stats.t.sf(abs(self.t), self.degrees))

    @property
    def t(self) -> float:
        return (self.measured - self.modelled) / self.standard_deviation

    @property
    def z(self) -> float:
        """The standard deviations of a normal variable that are as improbable."""
        return float(math.copysign(stats.norm.isf(max(self.p_value, 1e-300) / 2), self.t))


def difference(
    view: str,
    statistic: str,
    unit: str,
    measured: tuple[float, float, float],
    modelled: tuple[float, float, float],
) -> StatisticDifference:
    (b, eb, db), (a, ea, da) = measured, modelled
    variance = ea**2 + eb**2 + 1e-12
    degrees = variance**2 / (ea**4 / da + eb**4 / db + 1e-24)  # Welch
    return StatisticDifference(
        view, statistic, unit, float(b), float(a), math.sqrt(variance), float(max(degrees, 2.0))
    )


def look_differences(renders: PictureSet, target: PictureSet) -> list[StatisticDifference]:
    """What the cameras of two sets make of black, bright and flat areas and of edges: statistics that both sets tell."""
    sides = []
    budget = 8_000_000  # pixels of a set that are looked at
    for pictures in (target, renders):
        chosen, window = chosen_of(pictures, budget)
        taken = read_windows(pictures, chosen, window)
        regions = find_regions(taken, 255.0, Rounding(pictures.steps, pictures.is_jpeg))
        found = measured(taken, regions)
        sides.append({look.name: (look, (value, error, degrees)) for look, value, error, degrees in found})
    return [
        difference(look.view, look.name, look.unit, one, sides[1][name][1])
        for name, (look, one) in sides[0].items()
        if name in sides[1]
    ]
