"""Whether stated probabilities and intervals hold: of all names that were told, and of the strengths that were hidden."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import cameras, judge

BINS = 10
# Parameters that mean what the strength of the hidden effect means, in the same unit. Signs are free.
COMPARED = {
    "light_drift": "sigma", "vignetting": "corner_loss", "veiling_glare": "share", "point_spread": "sigma_px",
    "smear": "transfer_s", "amplifier_glow": "rate_e_per_s", "clock_induced_charge": "mean_e", "image_lag": "share",
    "blooming": "share", "interpixel_crosstalk": "share", "charge_transfer_inefficiency": "share_per_transfer",
    "dead_pixels": "density", "hot_pixels": "density", "row_parity": "offset_e", "tap_mismatch": "offset_e",
    "row_noise": "sigma_e", "column_noise": "sigma_e", "periodic_banding": "amplitude_e",
    "black_level_drift": "sigma_e",
}  # fmt: skip


def told(answer: dict[str, Any], result: dict[str, Any]) -> list[tuple[float, bool]]:
    """(probability, whether it is right) of each accepted effect."""
    diagnosis = result["diagnosis"] or {"accepted": [], "ranking": []}
    stated = {entry["effect"]: entry["probability"] for entry in diagnosis["ranking"]}
    outside = bool(answer["without"]) or answer["kind"] == "foreign"
    expected = set() if outside else set(answer["expect"])
    return [
        (stated[name], name in expected) for name in diagnosis["accepted"] if stated.get(name) is not None
    ]


def covered(answer: dict[str, Any], result: dict[str, Any]) -> list[tuple[str, bool]]:
    """(effect, whether its interval holds the hidden strength) of each effect that was named and can be compared."""
    diagnosis = result["diagnosis"]
    found = {entry["effect"]: entry["parameters"] for entry in (diagnosis or {}).get("ranking", [])}
    rows = []
    for name, strength, form in answer["hidden"]:
        interval = found.get(name, {}).get(COMPARED.get(name, ""))
        if form != "default" or not interval or name not in diagnosis["accepted"] or interval["low"] is None:
            continue
        if name == "smear":
            strength = strength * cameras.sensor(answer["camera"]).integration_s
        low, high = sorted(abs(interval[end]) for end in ("low", "high"))
        low = 0.0 if interval["low"] * interval["high"] <= 0 else low
        rows.append((name, low <= strength <= high))
    return rows


class Bin(NamedTuple):
    """Names whose stated probability lies in a tenth of its range."""

    low: float
    mean: float  # of the stated probabilities
    right: int
    count: int


def binned(pairs: list[tuple[float, bool]]) -> list[Bin]:
    """The bins of equal width that hold names, in order."""
    values = np.array(pairs, float).reshape(-1, 2)
    place = np.minimum((values[:, 0] * BINS).astype(int), BINS - 1)
    each = [(k, values[place == k]) for k in np.unique(place)]
    return [
        Bin(int(k) / BINS, float(here[:, 0].mean()), int(here[:, 1].sum()), len(here)) for k, here in each
    ]


def expected_error(pairs: list[tuple[float, bool]]) -> float:
    """Expected calibration error: mean distance of probability and frequency in the bins, weighted by their counts."""
    gaps = [one.count * abs(one.right / one.count - one.mean) for one in binned(pairs)]
    return sum(gaps) / max(len(pairs), 1)


def report(folders: list[Path]) -> str:
    """Markdown: probabilities beside frequencies, and the coverage of 95 % intervals by effect."""
    pairs: list[tuple[float, bool]] = []
    intervals: dict[str, list[bool]] = {}
    for _, answer, result in judge.answered(folders):
        pairs += told(answer, result)
        for name, is_inside in covered(answer, result):
            intervals.setdefault(name, []).append(is_inside)
    lines = ["### Probabilities", "", "| stated | mean | right (95 %) |", "| --- | --- | --- |"]
    lines += [
        f"| {one.low:.1f} to {one.low + 1 / BINS:.1f} | {one.mean:.3f} | {judge.share(one.right, one.count)} |"
        for one in binned(pairs)
    ]
    lines += (
        ["", f"Expected calibration error: {expected_error(pairs):.3f} of {len(pairs)} names."]
        if pairs
        else []
    )
    lines += ["", "### Intervals of strengths", "", "| effect | covered (95 %) |", "| --- | --- |"]
    everything = [one for of in intervals.values() for one in of]
    lines.append(f"| **all** | {judge.share(sum(everything), len(everything))} |")
    lines += [f"| {name} | {judge.share(sum(of), len(of))} |" for name, of in sorted(intervals.items())]
    return "\n".join(lines) + "\n"
