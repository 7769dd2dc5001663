"""Where model and measurement differ: views by their share of the excess."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from visaug.core.errors import InputError
from visaug.statistics.distance import Distance
from visaug.statistics.statistic import Statistic


@dataclass(frozen=True)
class Place:
    """A view in which model and measurement differ: its share of the excess, and its worst statistic in standard deviations."""

    view: str
    share: float
    worst: str
    z: float

    def to_json(self) -> dict[str, Any]:
        return {"view": self.view, "share": round(self.share, 4), "worst": self.worst, "z": round(self.z, 2)}


class Places(tuple[Place, ...]):
    """Views that differ, the largest share of the excess first. Calling it gives them as plain dictionaries."""

    __slots__ = ()

    def __call__(self) -> list[dict[str, Any]]:
        return [place.to_json() for place in self]


def verdict_json(p_value: float, adequate: bool, where: Places) -> dict[str, Any]:
    """What every comparison has in its JSON: the error, whether the model fits, and where it does not."""
    before = None if adequate else 1.0
    return {
        "schema": 1,
        "error": {"before": before, "after": before, "floor": 0.0, "interval_after": None},
        "fits": {
            "p_value": p_value,
            "p_value_before": p_value,
            "adequate": adequate,
            "adequate_before": adequate,
        },
        "where": [place.to_json() for place in where],
    }


def data_frame(rows: list[dict[str, Any]], columns: list[str]) -> Any:
    """Rows as a pandas DataFrame.

    Raises:
        InputError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ModuleNotFoundError:
        raise InputError("pandas is not installed", field="to_frame", expected="pip install pandas") from None
    return pandas.DataFrame([{name: row.get(name) for name in columns} for row in rows], columns=columns)


def z_scores(residual: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Residuals in standard deviations; 0 for a statistic that never varies."""
    return np.divide(residual, spread, out=np.zeros_like(residual), where=spread > 0)


def places(distance: Distance, statistics: tuple[Statistic, ...], z: np.ndarray) -> Places:
    """Views by their share of the excess, with their worst statistic."""
    found = []
    for view, share in distance.shares().items():
        here = [i for i, s in enumerate(statistics) if s.view == view]
        worst = max(here, key=lambda i: abs(z[i]))
        if abs(z[worst]) > 4:
            found.append(
                Place(view, share, f"{statistics[worst].name}, {statistics[worst].frames}", float(z[worst]))
            )
    return Places(sorted(found, key=lambda place: (-place.share, -abs(place.z))))
