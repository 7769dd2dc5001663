"""Maps of the sensor: dark current of every pixel, and pixels that are no part of a pattern."""

from __future__ import annotations

import numpy as np

from visaug.characterization.findings import Findings
from visaug.characterization.groups import Measured
from visaug.characterization.moments import GroupMoments, mean_map

HOT, DEAD, UNSTEADY = 1, 2, 4
_ODD = 8.0  # robust standard deviations


def add_maps(found: Findings, measured: Measured) -> None:
    """Add `dark_current` (e-/s; DN/s where the gain is unknown) and `defects` (bits HOT, DEAD, UNSTEADY)."""
    defects: np.ndarray | None = None

    def mark(which: np.ndarray, bit: int) -> None:
        nonlocal defects
        if defects is None:
            defects = np.zeros(which.shape, np.uint8)
        if defects.shape == which.shape:
            defects[which] |= bit

    warmest = _warmest(measured)
    if warmest:
        rate = _rates(measured, warmest)
        mark(_stands_out(rate) > _ODD, HOT)
        scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
        found.maps["dark_current"] = (rate * scale).astype(np.float32)
    still = measured.still
    if still is not None and still.n >= 8:
        mark(_stands_out(_deviation(measured, still)) > _ODD, UNSTEADY)
    response = found.maps.get("response")
    if response is not None:
        mark(np.abs(_stands_out(response)) > _ODD, DEAD)
    if defects is not None:
        found.maps["defects"] = defects
        counts = {
            n: int(((defects & b) > 0).sum())
            for n, b in (("hot", HOT), ("dead", DEAD), ("unsteady", UNSTEADY))
        }
        if any(counts.values()):
            found.warn("defect_pixels: " + ", ".join(f"{c} {n}" for n, c in counts.items() if c))


def _stands_out(values: np.ndarray) -> np.ndarray:
    middle = np.median(values)
    spread = 1.4826 * np.median(np.abs(values - middle))
    return (values - middle) / max(float(spread), 1e-12)


def _warmest(measured: Measured) -> list[GroupMoments]:
    """Dark groups at the highest temperature that has two exposures, on the largest window."""
    shapes = [m.shape for m in measured.darks]
    if not shapes:
        return []
    largest = max(shapes, key=lambda s: s[0] * s[1])
    groups = [m for m in (*measured.darks, *measured.biases) if m.shape == largest]
    for t in sorted({m.group.temperature_c or 0.0 for m in groups}, reverse=True):
        same = [m for m in groups if abs((m.group.temperature_c or 0.0) - t) < 0.6]
        if len({m.group.exposure_s for m in same}) > 1:
            return same
    return []


def _rates(measured: Measured, groups: list[GroupMoments]) -> np.ndarray:
    """Slope of every pixel's mean against exposure, DN/s."""
    n = np.array([m.n for m in groups], float)
    t = np.array([m.group.exposure_s for m in groups])
    lever = n * (t - (n * t).sum() / n.sum())
    rate = np.zeros(groups[0].shape)
    for m, weight in zip(groups, lever / (lever * t).sum()):
        rate += weight * mean_map(measured.frames, m.group.indices)
    return rate


def _deviation(measured: Measured, still: GroupMoments) -> np.ndarray:
    """Logarithm of every pixel's standard deviation over the still frames, rounding added."""
    total, squares = np.zeros(still.shape), np.zeros(still.shape)
    first = measured.frames.read(still.group.indices[0])
    for i in still.group.indices:
        difference = measured.frames.read(i).astype(np.float64) - first
        total += difference
        squares += difference**2
    variance = (squares - total**2 / still.n) / (still.n - 1)
    return np.log(np.sqrt(np.maximum(variance, 0.0) + 1 / 12))
