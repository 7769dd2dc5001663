"""Describes the residuals that no effect of the catalogue explains: the axes along which they vary and what they grow with."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from visaug.effects import catalogue
from visaug.statistics import AXES, Statistic

FAR = 4.5  # standard deviations above which a statistic deviates significantly
CHANCE = 3.0  # the largest deviation to be expected by chance among a thousand statistics
WANDERS = 0.5  # share of neighbouring levels between which whole frames change sign,
LEVELS = 5  # least number of deviating levels
MORE = 2.5  # ratio of the deviations with light to those without
ALIKE = 1.15  # ratio within which two of them count as equal
WARMS = 2.0  # least ratio of a pattern's variance: dark current that doubles in 10 K gives a ratio of four
CODES = 0.25  # weight of the deviations of code counts: any change of a pixel changes its code
TOLD = 0.4  # share of the clearest axis from which another is reported
ROUND = 2.0  # ratio within which correlations along rows and columns count as isotropic
BESIDE = {
    "curvature along {}s": "pixel",
    "1 to 2 px from bright spots along the {}": "pixel",
    "3 to 8 px from bright spots along the {}": "smooth",
    "9 to 30 px from bright spots along the {}": "smooth",
}
# Ratio of the covariances with the next pixel but one and with the next pixel above which the noise is common to a line. It is
# larger for 1/f noise, small for a kernel of nearest neighbours, and a third for one with long arms.
REACH = 0.6
WORDS = {
    "time": "from frame to frame",
    "row": "from row to row",
    "column": "from column to column",
    "pixel": "from pixel to pixel",
    "smooth": "smoothly over the sensor",
    "level": "with the level",
}


@dataclass(frozen=True)
class Residue:
    """A remaining difference between the refitted camera and the frames.

    Attributes:
        description: the difference in words.
        axis: axes along which it varies, from `visaug.statistics.AXES`, the clearest first.
        grows_with: a subset of "signal", "exposure", "temperature".
        worst: the statistics with the largest deviations, in standard deviations.
        nearest: an effect of the catalogue that reduces the error but does not explain the difference.
    """

    description: str
    axis: tuple[str, ...]
    grows_with: tuple[str, ...]
    worst: tuple[tuple[str, float], ...]
    nearest: str | None = None

    def to_json(self) -> dict[str, Any]:
        return {
            "description": self.description,
            "axis": list(self.axis),
            "grows_with": list(self.grows_with),
            "worst": [{"statistic": label, "z": round(z, 2)} for label, z in self.worst],
            "nearest": self.nearest,
        }


def describe(
    statistics: Sequence[Statistic],
    z: np.ndarray,
    nearest: str | None = None,
    excess: np.ndarray | None = None,
) -> Residue:
    """Describes standardised residuals (statistics,).

    Args:
        nearest: an effect that reduces the error but does not explain it.
        excess: (statistics,) residuals in the unit of the statistic, DN^2 and not its logarithm. If None, the growth of a pattern
            is judged from z alone.
    """
    size = np.abs(z)
    limit = min(FAR, float(size.max()))
    far = [i for i in np.argsort(-size) if size[i] >= limit]
    spans, around = _spans(statistics, z), _around(statistics, z)
    axes = [around.get(i) or _along(statistics[i], spans) for i in far]
    axis = _axes(statistics, size, dict(zip(far, axes, strict=True)), wanders=_wanders(statistics, z))
    pattern = None if excess is None or "time" in axis else excess
    grows = _growth(statistics, size, pattern)
    worst = tuple((statistics[i].label, float(z[i])) for i in far[:8])
    first = statistics[far[0]]
    ways = [WORDS[each] for each in axis]
    along = ", ".join(ways[:-1]) + " and " * (len(ways) > 1) + ways[-1]
    growth = (
        f"grows with {' and '.join(grows)}"
        if grows
        else "does not clearly grow with signal, exposure or temperature"
    )
    description = (
        f"The remaining difference varies {along}, and {growth}. The largest deviation is {first.name} of {first.frames} "
        f"({first.view.replace('_', ' ')}), by {size[far[0]]:.1f} standard deviations."
    )
    if nearest:
        others = sorted({other for _, other in catalogue()[nearest].special_cases})
        apart = "".join(f", or only without what sets it apart from {other}" for other in others)
        description += f" {nearest} reduces the error but does not explain it{apart}."
    return Residue(description, axis, grows, worst, nearest)


def _wanders(statistics: Sequence[Statistic], z: np.ndarray) -> bool:
    """Whether whole frames differ under one condition, or deviate with alternating sign as the level rises: a temporal effect."""
    if any(s.view == "drift" and s.name.endswith(" frames") and z[i] > FAR for i, s in enumerate(statistics)):
        return True
    off = [i for i, s in enumerate(statistics) if s.view == "level" and abs(z[i]) > FAR]
    signs = [z[i] > 0 for i in sorted(off, key=lambda i: statistics[i].signal)]
    turns = sum(a != b for a, b in pairwise(signs))
    return len(off) >= LEVELS and turns >= WANDERS * (len(off) - 1)


def _spans(statistics: Sequence[Statistic], z: np.ndarray) -> frozenset[str]:
    """The directions, "row" and "column", in which noise is correlated beyond the next pixel.

    The noise of a stripe is common to many pixels; noise from charge spreading is common to two.
    """
    shared = {
        (s.frames, s.name): float(x)
        for s, x in zip(statistics, z, strict=True)
        if s.view == "noise_covariance"
    }
    return frozenset(
        direction
        for direction in ("row", "column")
        for (frames, name), next_one in shared.items()
        if name == f"one {direction} on" and next_one > FAR
        if shared.get((frames, f"two {direction}s on"), 0.0) > REACH * next_one
    )


def _along(statistic: Statistic, spans: frozenset[str]) -> tuple[str, ...]:
    """The axes along which a statistic varies, if noise is correlated beyond the next pixel in the directions `spans`.

    Noise that is common to neighbouring columns, but not rows, varies from row to row; noise that is common to both varies
    smoothly over the sensor. Means of few frames keep a part of it, as a pattern common to neighbours.
    """
    both = len(spans) == 2
    neighbours = statistic.name.endswith(" on") and any(line in statistic.name for line in spans)
    tells = neighbours or (both and statistic.name == "diagonal")
    if statistic.view not in ("noise_covariance", "fixed_pattern") or not tells:
        return statistic.axes
    wide = "smooth" if both else "row" if spans == {"column"} else "column"
    return ("time", wide) if statistic.view == "noise_covariance" else (wide,)


def _around(statistics: Sequence[Statistic], z: np.ndarray) -> dict[int, tuple[str, ...]]:
    """Axes of deviations beside edges and spots that are equal along rows and columns: pixel to pixel, or smooth further out."""
    place = {(s.frames, s.name): i for i, s in enumerate(statistics) if s.view == "scene"}
    found = {}
    for shape, axis in BESIDE.items():
        for frames in {frames for frames, _ in place}:
            pair = [place.get((frames, shape.format(line))) for line in ("row", "column")]
            if None not in pair:
                small, large = sorted((float(z[i]) for i in pair), key=abs)
                if small * large > 0 and abs(large) < ROUND * abs(small):
                    found |= dict.fromkeys(pair, (axis,))
    return found


def _axes(
    statistics: Sequence[Statistic], size: np.ndarray, far: dict[int, tuple[str, ...]], wanders: bool
) -> tuple[str, ...]:
    """Axes by the statistic of each with the largest deviation, the clearest first.

    A difference along one axis shows a little in the statistics of the others too (a glow in the halves of rows and columns), so
    those stay undetermined. A statistic along several axes belongs to each by its share.

    Args:
        far: the axes of each statistic that is far off, by its index.
    """
    weight: dict[str, float] = dict.fromkeys(AXES, 0.0)
    for i, axes in far.items():
        if wanders and axes == ("level",):
            axes = ("time", "level")
        share = CODES if statistics[i].view == "codes" else 1.0
        for axis in axes:
            weight[axis] = max(weight[axis], share * float(size[i]) / len(axes))
    top = max(weight.values())
    return tuple(axis for axis in sorted(weight, key=lambda a: -weight[a]) if weight[axis] >= TOLD * top)


def _growth(statistics: Sequence[Statistic], size: np.ndarray, pattern: np.ndarray | None) -> tuple[str, ...]:
    """With what it grows, from the same statistics in frames of different conditions.

    Args:
        pattern: (statistics,) excess, of what is the same in all frames.
    """
    grows = []
    by_kind = {
        kind: [i for i, s in enumerate(statistics) if s.kind == kind]
        for kind in ("bias", "dark", "flat", "scene")
    }

    def strength(indices: Sequence[int]) -> float:
        """Of the furthest tenth of these statistics, at least five of them."""
        values = np.sort(size[list(indices)])[::-1]
        return float(values[: max(5, len(values) // 10)].mean()) if len(values) else 0.0

    dark = max(strength(by_kind["bias"]), 0.0)
    exposures = sorted({statistics[i].exposure_s for i in by_kind["dark"]})
    light = max(strength(by_kind["flat"]), strength(by_kind["scene"]))
    stands_out = light > MORE * max(dark, 1.5) and light > FAR
    if stands_out or _is_off_with_light_alone(statistics, size) or _grows_with_signal(statistics, size):
        grows.append("signal")
    if len(exposures) > 1:
        shortest = [i for i in by_kind["dark"] if statistics[i].exposure_s <= exposures[0]] + by_kind["bias"]
        both = {
            (statistics[i].view, statistics[i].name) for i in shortest
        }  # what all darks share tells no growth
        longest = [
            i
            for i in by_kind["dark"]
            if statistics[i].exposure_s >= exposures[-1] and (statistics[i].view, statistics[i].name) in both
        ]
        if strength(longest) > 2 * max(strength(shortest), 1.5) and strength(longest) > FAR:
            grows.append("exposure")
            warms = pattern is not None and _pattern_grows_with_temperature(statistics, size, pattern)
            if warms or _grows_with_temperature(statistics, size):
                grows.append("temperature")
    return tuple(grows)


def _is_off_with_light_alone(statistics: Sequence[Statistic], size: np.ndarray) -> bool:
    """Whether the largest deviation of frames with light is much larger than that of frames without.

    A step of the converter affects few levels, fewer than a tenth of the statistics with light.
    """
    lit = np.array([s.kind in ("flat", "scene") for s in statistics])
    unlit = np.array([s.kind in ("bias", "dark") for s in statistics])
    if not (lit.any() and unlit.any()):
        return False
    return bool(size[lit].max() > MORE * max(size[unlit].max(), CHANCE))


def _grows_with_signal(statistics: Sequence[Statistic], size: np.ndarray) -> bool:
    """Whether nearly all statistics that deviate in flats deviate much less without light.

    A pattern that only light shows may affect fewer than a tenth of the statistics of flats.
    """
    furthest: dict[tuple[str, str], dict[str, float]] = {}
    for s, z in zip(statistics, size, strict=True):
        if s.kind in ("bias", "flat") and s.axes != ("level",):  # the black level is refitted to the bias
            of = furthest.setdefault((s.view, s.name), {})
            of[s.kind] = max(of.get(s.kind, 0.0), float(z))
    off = [of for of in furthest.values() if len(of) == 2 and of["flat"] > FAR]
    grown = sum(of["flat"] > MORE * max(of["bias"], 1.5) for of in off)
    return grown >= 2 and grown >= 4 * (len(off) - grown)


def _grows_with_temperature(statistics: Sequence[Statistic], size: np.ndarray) -> bool:
    """Whether nearly all statistics of dark frames of one exposure deviate more at the highest temperature.

    Pixel counts saturate, so the number of statistics that grow is more informative than the growth of the largest.
    """
    darks = [i for i, s in enumerate(statistics) if s.kind == "dark"]
    temperatures = sorted({statistics[i].temperature_c for i in darks})
    if len(temperatures) < 2:
        return False
    at = {
        t: {
            (s.view, s.name, s.exposure_s): float(size[i])
            for i in darks
            if (s := statistics[i]).temperature_c == t
        }
        for t in (temperatures[0], temperatures[-1])
    }
    cold, warm = at.values()
    pairs = [(cold[key], warm[key]) for key in cold.keys() & warm.keys()]
    pairs = [pair for pair in pairs if max(pair) > FAR]
    more = sum(w > ALIKE * c for c, w in pairs)
    less = sum(c > ALIKE * w for c, w in pairs)
    return more >= max(2, 4 * less)


def _pattern_grows_with_temperature(
    statistics: Sequence[Statistic], size: np.ndarray, excess: np.ndarray
) -> bool:
    """Whether the excess pixel variance of dark frames of one exposure grows with the temperature, at all exposures.

    The statistic is the logarithm of the variance, whose standard deviations hardly grow for very large ratios.
    """
    pixels = {
        (s.exposure_s, s.temperature_c): i
        for i, s in enumerate(statistics)
        if (s.view, s.name, s.kind) == ("fixed_pattern", "pixels", "dark")
    }
    celsius = sorted({t for _, t in pixels})
    equally_long = [
        (pixels.get((e, celsius[0])), pixels.get((e, celsius[-1]))) for e in {e for e, _ in pixels}
    ]
    pairs = [
        (excess[cold], excess[warm])
        for cold, warm in equally_long
        if cold is not None and warm is not None and max(size[cold], size[warm]) > FAR
    ]
    return len(celsius) > 1 and bool(pairs) and all(warm > WARMS * cold > 0 for cold, warm in pairs)
