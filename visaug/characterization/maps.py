"""Maps of the sensor: dark current of every pixel, pixels that are no part of a pattern, and maps for a camera."""

import copy
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from visaug.characterization.alike import SAME_C, degrees_apart
from visaug.characterization.groups import Measured
from visaug.characterization.moments import GroupMoments, Place, largest_place, mean_map, pixel_variances
from visaug.characterization.nonuniformity import surface, two_way
from visaug.core.constants import MAD
from visaug.core.errors import InputError
from visaug.statistics.findings import Findings
from visaug.statistics.kernels import median_of

if TYPE_CHECKING:
    from visaug.characterization.result import Characterization


DEFECTS = {"hot": 1, "dead": 2, "unsteady": 4}  # bits of the map of defects


def add_maps(found: Findings, measured: Measured) -> None:
    """Add `dark_current` (e-/s; DN/s where the gain is unknown) and `defects` (bits of `DEFECTS`)."""
    marked: list[tuple[str, np.ndarray, Place | None]] = []
    warmest = _warmest(measured)
    odd = 8.0  # robust standard deviations
    if warmest:
        rate, error = _rates(measured, warmest)
        marked.append(("hot", _stands_out(rate) > odd, warmest[0].place))
        scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
        found.maps["dark_current"] = (rate * scale).astype(np.float32)
        found.dark_current_error = error * scale
        known = [t for m in warmest if (t := m.group.temperature_c) is not None]
        found.dark_current_at_c = float(np.mean(known)) if known else None
    still = measured.still
    if still is not None and still.n >= 8:
        first = measured.frames.read(still.group.indices[0]).astype(np.float64)
        variances = pixel_variances(measured.frames, still.group.indices, lambda _: first)
        deviation = np.log(np.sqrt(variances + 1 / 12))  # rounding added
        marked.append(("unsteady", _stands_out(deviation) > odd, still.place))
    if (response := found.maps.get("response")) is not None:
        marked.append(("dead", np.abs(_stands_out(response)) > odd, found.response_place))
    if found.stuck is not None:
        marked.append(("dead", found.stuck, measured.moments[0].place))  # of sets of one window alone
    if marked:
        defects = found.maps["defects"] = np.zeros(marked[0][1].shape, np.uint8)
        for name, which, place in marked:
            # the window of the first map; others of the same size show other pixels
            if place == marked[0][2]:
                defects[which] |= DEFECTS[name]
        counts = {name: np.count_nonzero(defects & bit) for name, bit in DEFECTS.items()}
        if any(counts.values()):
            found.warn("defect_pixels: " + ", ".join(f"{c} {n}" for n, c in counts.items() if c))


def map_headers(found: Findings) -> dict[str, dict[str, str | float]]:
    """FITS cards of the maps that have a unit; dark current has the temperature of its frames beside it."""
    charge = "adu" if found.gain is None else "electron"
    units = {"master_bias": "adu", "read_noise": charge, "dark_current": f"{charge}/s"}
    headers: dict[str, dict[str, str | float]] = {
        name: {"BUNIT": unit} for name, unit in units.items() if name in found.maps
    }
    if "dark_current" in headers and found.dark_current_at_c is not None:
        headers["dark_current"]["CCD-TEMP"] = round(found.dark_current_at_c, 3)
    return headers


def _stands_out(values: np.ndarray) -> np.ndarray:
    middle = median_of(values)
    spread = MAD * median_of(np.abs(values - middle))
    return (values - middle) / max(float(spread), 1e-12)


def _warmest(measured: Measured) -> list[GroupMoments]:
    """Dark groups at the highest temperature that has two exposures, on the largest window; unknown ones come last."""
    place = largest_place(measured.darks)
    groups = [m for m in (*measured.darks, *measured.biases) if m.place == place]
    known = sorted({m.group.temperature_c for m in groups if m.group.temperature_c is not None}, reverse=True)
    for t in (*known, None):  # None is a temperature of its own
        alike = [m for m in groups if (m.group.temperature_c is None) == (t is None)]
        same = [m for m in alike if degrees_apart(m.group.temperature_c, t) <= SAME_C]
        if len({m.group.exposure_s for m in same}) > 1:
            return same
    return []


def _rates(measured: Measured, groups: list[GroupMoments]) -> tuple[np.ndarray, float]:
    """Slope of every pixel's mean against exposure, and a usual pixel's standard error of it, DN/s."""
    n = np.array([m.n for m in groups], float)
    t = np.array([m.group.exposure_s for m in groups])
    lever = n * (t - (n * t).sum() / n.sum())
    rate, square = np.zeros(groups[0].shape), 0.0
    several = [m for m in groups if m.n > 1]
    for m, weight in zip(groups, lever / (lever * t).sum()):
        rate += weight * mean_map(measured.frames, m.group.indices)
        # one frame has the variance of the group that is nearest in signal
        like = m if m.n > 1 else min(several, key=lambda s: abs(s.mean - m.mean), default=m)
        square += weight**2 * float(np.median(like.row_variances)) / m.n
    return rate, float(np.sqrt(square))


def camera_maps(result: "Characterization") -> dict[str, np.ndarray]:
    """Maps in the units of a camera file, by effect, (H, W) float32.

    `prnu` is K, the smooth course of light and lens taken out; `dsnu` e- about their mean; `read_noise` e-, where every
    pixel has its own; `dark_current_nonuniformity` a factor, where the dark current of single pixels is measured to
    half of it or better. Temporal noise that the mean of n frames keeps would make every pattern stronger than it is: the
    pixel parts of `prnu`, `dsnu` and `dark_current_nonuniformity` are scaled to the deviation without it, and the last is left
    out where nothing remains. Frames cut at 0, or coarser than their noise, give no `dsnu`.

    Raises:
        InputError: no gain, or a map of another shape than the sensor.
    """
    content = result.to_camera_dict()
    words = {w.word for w in result.warning_details}
    maps = result.maps
    found: dict[str, np.ndarray] = {}
    if "response" in maps:
        fraction = maps["response"] / maps["response"].mean(dtype=np.float64) - 1
        found["prnu"] = with_pixel_spread(fraction - surface(fraction), content["prnu"]["pixel"])
    if "master_bias" in maps and not words & {"clipped_at_zero", "coarse_converter"}:
        master = maps["master_bias"].astype(np.float64)
        offsets_e = (master - master.mean()) * content["gain_e_per_dn"]
        found["dsnu"] = with_pixel_spread(offsets_e, content["dsnu"]["pixel_e"])
    if "read_noise" in maps and "read_noise_nonuniform" in words:
        found["read_noise"] = maps["read_noise"]
    rate = maps.get("dark_current")
    # Of a rate whose error is half the mean rate 2.3 % come out negative.
    if rate is not None and (rate < 0).mean() < 0.023 and "dark_current" in content:
        factor = np.maximum(rate, 0) / rate.mean(dtype=np.float64)
        factor = without_noise(factor, result.dark_current_error / float(rate.mean(dtype=np.float64)))
        if factor is not None:
            found["dark_current_nonuniformity"] = factor
    for name, values in found.items():
        if values.shape != tuple(content["resolution"]):
            size = "the map of {} is {} x {}".format(name, *values.shape)
            expected = "frames of the whole sensor, {} x {}".format(*content["resolution"])
            raise InputError(size, field="resolution", expected=expected)
    return {name: values.astype(np.float32) for name, values in found.items()}


def with_pixel_spread(values: np.ndarray, deviation: float) -> np.ndarray:
    """The map with its pixel part, defects left out, drawn to `deviation` where it is wider; (H, W)."""
    residual, width = _pixel_part(values)[:2]
    return values - (1 - deviation / width) * residual if width > deviation else values


def without_noise(values: np.ndarray, error: float) -> np.ndarray | None:
    """The map with its pixel part drawn to the deviation that it has without noise of `error`.
    Returns None if noise of `error` explains the deviation of the pixels and no pixel is defective.
    """
    residual, width, free, defects = _pixel_part(values)
    by_chance = 2 * error**2 * np.sqrt(2 / free)  # two standard errors of the variance of noise alone
    if width**2 - error**2 > by_chance:
        return values - (1 - np.sqrt(1 - (error / width) ** 2)) * residual
    return values - residual if defects else None


def _pixel_part(values: np.ndarray) -> tuple[np.ndarray, float, int, int]:
    """What rows and columns leave, without defects; its deviation, its degrees of freedom, and the number of defects."""
    _, _, residual, defects = two_way(values)
    free = max((values.shape[0] - 1) * (values.shape[1] - 1) - defects, 1)
    return residual, float(np.sqrt((residual**2).sum() / free)), free, defects


def with_maps(content: Mapping[str, Any], files: Mapping[str, Path]) -> dict[str, Any]:
    """The content of a camera.yaml that names a map of each effect, relative to the working folder."""
    named: dict[str, Any] = copy.deepcopy(dict(content))
    for effect, file in files.items():
        name = str(file) if file.is_absolute() else os.path.relpath(file)
        if effect in ("prnu", "dsnu", "read_noise"):
            named[effect] = {**named.get(effect, {}), "map": name}
        else:
            others = [e for e in named.get("effects", []) if e["name"] != effect]
            named["effects"] = [*others, {"name": effect, "map": name}]
    return named
