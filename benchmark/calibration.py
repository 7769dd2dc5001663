"""Whether stated probabilities and intervals hold: of all names that were told, and of the strengths that were hidden."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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


def expected_error(pairs: list[tuple[float, bool]]) -> float:
    """Expected calibration error: mean distance of probability and frequency in bins of equal width, weighted by their counts."""
    values = np.array(pairs, float).reshape(-1, 2)
    place = np.minimum((values[:, 0] * BINS).astype(int), BINS - 1)
    gaps = [abs(np.diff(values[place == k].mean(0))[0]) * np.mean(place == k) for k in np.unique(place)]
    return float(np.sum(gaps))


def report(folders: list[Path]) -> str:
    """Markdown: probabilities beside frequencies, and the coverage of 95 % intervals by effect."""
    pairs: list[tuple[float, bool]] = []
    intervals: dict[str, list[bool]] = {}
    for _, answer, result in judge.answered(folders):
        pairs += told(answer, result)
        for name, is_inside in covered(answer, result):
            intervals.setdefault(name, []).append(is_inside)
    lines = ["### Probabilities", "", "| stated | mean | right (95 %) |", "| --- | --- | --- |"]
    place = [min(int(p * BINS), BINS - 1) for p, _ in pairs]
    for k in sorted(set(place)):
        here = [pair for at, pair in zip(place, pairs, strict=True) if at == k]
        mean = np.mean([p for p, _ in here])
        lines.append(
            f"| {k / BINS:.1f} to {(k + 1) / BINS:.1f} | {mean:.3f} | {judge.share(sum(r for _, r in here), len(here))} |"
        )
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
