"""Verdicts on effects, and mistakes in a camera file, in words."""

from typing import Any

Content = dict[str, Any]
FALLING = ("read_noise.shape", "full_well_e")  # parameters that an effect makes smaller


def amount(value: float | None, unit: str | None) -> str:
    return "" if value is None else f"{value:.3g} {'' if unit in (None, '1') else unit}".strip()


def verdict_row(entry: Content) -> list[str]:
    """Effect, verdict, strength or limit, and frames that would tell, of one entry of `effects`."""
    unit, key = entry["unit"], (entry["parameter"] or "").rsplit(".", 1)[-1]
    if entry["verdict"] == "named":
        strength = f"{key} = {amount(entry['value'], unit)}"
        if entry["low"] is not None:
            strength += f" [{entry['low']:.3g}, {entry['high']:.3g}]"
    elif entry["limit"] is None:
        strength = ""
    else:
        below = ">" if entry["parameter"] in FALLING else "<"
        sign = below if entry["verdict"] == "absent" else "shown from"
        strength = f"{key} {sign} {amount(entry['limit'], unit)}"
    word = entry["verdict"]
    if entry["from"]:
        word += f" from {', '.join(entry['from'])}"
    return [entry["effect"], word, strength, "; ".join(entry["frames"] or [])]


def planned_text(entry: Content) -> str:
    """What a plan of frames would show of an effect."""
    key = (entry["parameter"] or "").rsplit(".", 1)[-1]
    if entry["verdict"] == "not testable":
        return f"{entry['effect']}: not testable by any frames of the plan at the strengths that a diagnosis tries"
    text = f"{entry['effect']}: shown from {key} = {amount(entry['limit'], entry['unit'])}"
    if entry["frames"]:
        text += f", at the least by {entry['frames'][0]}"
    if entry["from"]:
        text += f"; not separable from {', '.join(entry['from'])} by these frames"
    return text
