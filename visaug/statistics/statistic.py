"""A named number of a frame set, and many of them in a fixed order."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

AXES = ("time", "row", "column", "pixel", "smooth", "level")


@dataclass(frozen=True)
class Statistic:
    """What one number of the fingerprint is; its value stands beside it in a `Fingerprint`.

    Args:
        view: the view that it belongs to.
        name: of the measured quantity, e.g. "rows".
        frames: the frames that it is measured on, e.g. "flat 800 ph".
        axes: along which it varies, from `AXES`.
        unit: of the value.
        kind, exposure_s, temperature_c: of those frames.
        signal: their mean DN above the bias, from which growth with the signal is judged. Not part of the identity.

    A count is given as its square root, whose spread is 1/2 whatever the count.
    """

    view: str
    name: str
    frames: str
    axes: tuple[str, ...]
    unit: str = "1"
    kind: str = ""
    exposure_s: float = 0.0
    temperature_c: float = 0.0
    signal: float = field(default=0.0, compare=False)

    @property
    def least_spread(self) -> float:
        """The smallest standard deviation that is taken seriously: half a count; none for the rest."""
        return 0.5 if self.unit == "sqrt count" else 0.0

    @property
    def label(self) -> str:
        return f"{self.view}/{self.name}/{self.frames}"


@dataclass(frozen=True)
class Fingerprint:
    """The statistics of a frame set and their values, (n,) float64, in one order for all sets of the same plan."""

    statistics: tuple[Statistic, ...]
    values: np.ndarray

    @classmethod
    def of(cls, measured: Iterable[tuple[Statistic, float]]) -> "Fingerprint":
        """From single statistics and their values; a value that is no finite number counts as 0."""
        parts = list(measured)
        return cls(tuple(statistic for statistic, _ in parts), finite([value for _, value in parts]))

    @property
    def views(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(statistic.view for statistic in self.statistics))

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(statistic.label for statistic in self.statistics)

    def __getitem__(self, label: str) -> float:
        return float(self.values[self.labels.index(label)])


def finite(values: Sequence[float]) -> np.ndarray:
    """The values as an array; one that is no finite number counts as 0."""
    return np.nan_to_num(np.array(values, float), nan=0.0, posinf=0.0, neginf=0.0)
