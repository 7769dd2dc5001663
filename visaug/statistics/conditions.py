"""Conditions of groups of frames: their names, and which of many are looked at."""

from collections.abc import Iterable
from dataclasses import replace

from visaug.frames import Group

MAX_GROUPS = {"bias": 2, "dark": 8, "flat": 9, "scene": 6}  # of each kind, spread evenly over the conditions


def labels(groups: Iterable[Group]) -> dict[Group, str]:
    """A label for each condition: by the fields that usually distinguish them, else by all, else by a number."""
    conditions = [replace(g, indices=()) for g in groups]
    words = [_label(g) for g in conditions]
    words = [
        _label(g, full=True) if words.count(w) > 1 else w for g, w in zip(conditions, words, strict=True)
    ]
    numbers = [f" ({words[: i + 1].count(w)})" if words.count(w) > 1 else "" for i, w in enumerate(words)]
    return {g: w + n for g, w, n in zip(conditions, words, numbers, strict=True)}


def _label(group: Group, full: bool = False) -> str:
    g = group
    parts = [g.kind]
    if g.kind == "scene":
        parts.append(str(g.clean).rsplit("/", 1)[-1].split(".")[0])
    if g.kind == "flat" and g.photons is not None:
        parts.append(f"{g.photons:g} ph")
    if g.kind == "dark" or (g.kind == "flat" and g.photons is None) or full:
        parts.append(f"{g.exposure_s:g} s")
    if (g.kind in ("dark", "flat") or full) and g.temperature_c is not None:
        parts.append(f"{g.temperature_c:g} C")
    if g.gain_db:
        parts.append(f"{g.gain_db:g} dB")
    if full and g.window is not None:
        parts.append("at {0},{2}".format(*g.window))
    return " ".join(parts)


def spread(items: list, most: int) -> list:
    """At most so many of the items, evenly spread, the first and the last among them."""
    if len(items) <= most:
        return items
    if most == 1:
        return [items[len(items) // 2]]
    return [items[round(i * (len(items) - 1) / (most - 1))] for i in range(most)]


def choose(groups: list[Group], most: int) -> list[Group]:
    """At most so many groups, evenly spread over the conditions, the one with the most frames among them."""
    ordered = sorted(groups, key=by_condition)
    chosen = spread(ordered, most)
    if len(chosen) < len(ordered):
        fullest = max(ordered, key=lambda g: len(g.indices))
        if fullest not in chosen:
            near = min(
                range(len(chosen)), key=lambda k: abs(ordered.index(chosen[k]) - ordered.index(fullest))
            )
            chosen[near] = fullest
    return chosen


def by_condition(group: Group) -> tuple:
    """Sorts groups of a kind: by temperature, light, exposure."""
    return (
        group.temperature_c or 0.0,
        group.photons or 0.0,
        group.exposure_s,
        group.gain_db,
        group.clean or "",
    )
