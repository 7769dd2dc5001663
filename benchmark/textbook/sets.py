"""Which sets the benchmark asks of this camera, and their writing."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..sets import Recipe, write_taken
from .cameras import CAMERAS, plan
from .chain import take
from .draws import CATALOGUED, UNKNOWN, numbers_of
from .targets import targets


class Look(NamedTuple):
    """What a careful observer would say of an effect that no catalogue has.

    `axis` holds the words of which one must be told first, `grows` those that must be told, `may_grow` those that may.
    """

    axis: tuple[str, ...]
    grows: tuple[str, ...] = ()
    may_grow: tuple[str, ...] = ()


_LIGHT, _DARK = ("signal",), ("exposure", "temperature")  # what acts on all signal acts on dark current too
LOOKS: dict[str, Look] = {
    # the first columns of a flat lack the echo; edges and the pixels' response come twice
    "own_video_echo": Look(("column", "row", "pixel", "smooth"), _LIGHT, _DARK),
    # all rows sag with the signal and keep their variance, the first ones of a flat less, rows after bright ones more
    "own_row_droop": Look(("row", "level", "smooth"), _LIGHT, _DARK),
    "own_adc_step": Look(("level",), _LIGHT),  # no dark frame comes so far
    "own_dust": Look(("smooth", "pixel"), _LIGHT),
    # new in every frame; a stripe may lie along rows or columns
    "own_moving_fringes": Look(("time", "smooth", "row", "column"), _LIGHT),
    "own_pickup_stripes": Look(("time", "smooth", "row", "column")),
}


def pair_of(seed: int, camera: int) -> tuple[str, ...]:
    """Two different effects of the catalogue drawn at random."""
    rng = np.random.default_rng([seed, camera, 4711])
    return tuple(str(name) for name in rng.choice(list(CATALOGUED), 2, replace=False))


def taken(
    seed: int, camera: int, names: Sequence[str]
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, dict[str, Any]]]:
    """The frames of a set that hides these effects, its targets, and the numbers of the effects."""
    which = CAMERAS[camera]
    rng = np.random.default_rng([seed, camera, zlib.crc32(",".join(sorted(names)).encode())])
    hidden = {name: numbers_of(name, which, rng) for name in names}
    scenes = targets(which, rng)
    return take(which, plan(which), scenes, hidden, rng), scenes, hidden


def recipes(seed: int, camera: int) -> Iterator[Recipe]:
    """Nothing hidden, every effect of the catalogue alone, a pair, and those that no catalogue has alone."""
    yield Recipe(f"textbook-nothing-{seed}", "textbook", "none", seed, camera)
    for names in (*((name,) for name in CATALOGUED), pair_of(seed, camera)):
        yield Recipe(f"textbook-{'+'.join(names)}-{seed}", "textbook", "drawn", seed, camera, expect=names)
    for name in UNKNOWN:
        look = LOOKS[name]
        yield Recipe(
            f"textbook-{name}-{seed}", "foreign", "drawn", seed, camera, expect=(name,),
            axis=look.axis, grows=look.grows, may_grow=look.may_grow,
        )  # fmt: skip


def told(numbers: dict[str, Any]) -> str:
    """The numbers of an effect in one line, for the answer."""
    return ", ".join(
        f"{key}={value:.4g}" if isinstance(value, float) else f"{key}={value}"
        for key, value in numbers.items()
    )


def write_sets(seed: int, camera: int, wanted: set[str] | None, folder: Path, answers: Path) -> int:
    """One set for each recipe, of one of the five cameras; the count."""
    number, made = camera % len(CAMERAS), 0
    for recipe in recipes(seed, number):
        if wanted and not wanted & set(recipe.expect):
            continue
        frames, scenes, hidden = taken(seed, number, recipe.expect)
        recipe = replace(recipe, hidden=tuple((name, 1.0, told(numbers)) for name, numbers in hidden.items()))
        write_taken(recipe, frames, plan(CAMERAS[number]), scenes, CAMERAS[number], folder, answers)
        made += 1
    return made
