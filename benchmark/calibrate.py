"""How strong is plain? Turn an effect up until its strongest statistic is eight standard deviations off.

Off from the refitted base model: fourteen base parameters are refitted by weighted least squares to the
statistics that a laboratory would take them from (photon transfer, dark ladder, map variances, the clipped
spot) before the residual is taken, with slopes from simulations that share their random numbers. The
standard deviations are those of the residuals of forty base sets, refitted alike, each of a specimen with
maps of its own.

    python -m benchmark calibrate 0 1 2 [--only NAME,NAME]     (adds to strengths.json)

strengths.json is for two specimens. Where a seam or a band lies differs between specimens, and with it how far
an effect stands out, so a set gets the strength that is plain on its own (`for_specimen`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from . import cameras, foreign, further, statistics
from .camera import Hidden, Sensor, take
from .effects import KINDS, Kind
from .sets import Recipe
from .strengths import FACTOR, KNOWN, TABLE, times

BASE_SETS, SLOPE_SEEDS = 40, 3
TARGET, TOLERANCE, TRIES = 8.0, 0.08, 12
_FIRST_SEED = 500_000  # far from the seeds that sets are made with
SEEDS = (_FIRST_SEED, _FIRST_SEED + 1)  # the specimens of strengths.json
NOTE = (
    f"Strength at which the strongest statistic of statistics.py stands {TARGET:g} standard deviations off "
    f"the refitted base model; {BASE_SETS} base sets for the spread, root mean square over {len(SEEDS)} "
    f"specimens, found to {100 * TOLERANCE:g} % by calibrate.py. null: not reached in the parameter's range."
)


def _varied(sensor: Sensor) -> list[tuple[Sensor, Sensor, float]]:
    """Pairs of sensors a small step up and down, one pair for each base parameter."""
    pairs = []

    def add(step: float, **changes) -> None:
        up, down = ({k: v(sign) for k, v in changes.items()} for sign in (1, -1))
        pairs.append((replace(sensor, **up), replace(sensor, **down), step))

    for name in ("e_per_dn", "efficiency", "read_e", "dark_e_per_s", "dark_per_c", "well_e"):
        value = getattr(sensor, name)
        add(0.01, **{name: lambda sign, value=value: value * (1 + 0.01 * sign)})
    add(0.5, pedestal_dn=lambda sign: sensor.pedestal_dn + 0.5 * sign)
    add(0.03, tail=lambda sign: sensor.tail + 0.03 * sign)
    for name in ("prnu", "dsnu_e"):
        triple = getattr(sensor, name)
        for part in range(3):

            def scale(sign: int, triple=triple, part=part) -> tuple[float, ...]:
                return tuple(v * (1 + 0.1 * sign) if i == part else v for i, v in enumerate(triple))

            add(0.1, **{name: scale})
    return pairs


# What the parameters are refitted to; every other statistic is left to tell the effect.
_REFITTED_TO = re.compile(
    r"bias (mean|variance|tails|shoulder)$|dark .* mean$|flat \d+ (mean|variance)$|spot top$"
    r"|(bias map|flat \d+ map) (row|column|pixel) variance$"
)


class Yardstick:
    """The refitted base model of one camera.

    Tells how many standard deviations an effect moves each statistic.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.stated = cameras.sensor(number)
        base = [self._measure(self.stated, _FIRST_SEED + i) for i in range(BASE_SETS)]
        self.names = list(base[0])
        self.base = np.array([[s[n] for n in self.names] for s in base])
        self.middle = self.base.mean(0)
        floor = np.array([1.0 if statistics.is_count(n) else 1e-9 for n in self.names])
        self.spread0 = np.maximum(self.base.std(0, ddof=1), floor)
        slopes = []
        for up, down, step in _varied(self.stated):
            rise = [
                self._vector(up, _FIRST_SEED + i) - self._vector(down, _FIRST_SEED + i)
                for i in range(SLOPE_SEEDS)
            ]
            slopes.append(np.mean(rise, axis=0) / (2 * step))
        self.slopes = np.array(slopes).T
        heard = np.array([bool(_REFITTED_TO.match(name)) for name in self.names])
        weight = np.where(heard, 1 / self.spread0, 0.0)
        self.solver = np.linalg.pinv(self.slopes * weight[:, None], rcond=1e-4) * weight
        residuals = np.array([self.residual(row) for row in self.base])
        self.spread = np.maximum(residuals.std(0, ddof=1), np.maximum(0.3 * self.spread0, floor))

    def _measure(self, sensor: Sensor, seed: int, hidden: tuple[Hidden, ...] = ()) -> statistics.Stats:
        plan, targets = cameras.plan(self.number), cameras.targets(self.number)
        return statistics.measure(take(sensor, plan, targets, seed, hidden), plan, targets, self.stated)

    def _vector(self, sensor: Sensor, seed: int, hidden: tuple[Hidden, ...] = ()) -> np.ndarray:
        measured = self._measure(sensor, seed, hidden)
        return np.array([measured.get(name, np.nan) for name in self.names])

    def residual(self, vector: np.ndarray) -> np.ndarray:
        """What is left of a measurement after the base parameters were refitted."""
        off = np.nan_to_num(vector - self.middle)
        return off - self.slopes @ (self.solver @ off)

    @lru_cache  # noqa: B019 -- a yardstick lives as long as the program
    def _without(self, seed: int) -> np.ndarray:
        return self.residual(self._vector(self.stated, seed))

    def shift(self, hidden: tuple[Hidden, ...], seeds: Sequence[int] = SEEDS) -> tuple[float, str]:
        """Standard deviations by which the strongest statistic moves on these specimens, and its name."""
        moved = []
        for seed in seeds:
            with_effect = self.residual(self._vector(self.stated, seed, hidden))
            moved.append((with_effect - self._without(seed)) / self.spread)
        size = np.sqrt(np.mean(np.square(moved), axis=0))
        best = int(np.argmax(size))
        return float(size[best]), self.names[best]

    def plain(
        self, kind: Kind, form: str, start: float, seeds: Sequence[int] = SEEDS
    ) -> tuple[float | None, str]:
        """Search the strength that is plain on these specimens: secants in log-log, kept inside the bracket."""
        if kind.unit == "bits":
            return 1.0, "one bit is the least"
        low: tuple[float, float] | None = None
        high: tuple[float, float] | None = None
        strength, best = start, (np.inf, start, "")
        for _ in range(TRIES):
            size, name = self.shift((kind.at(strength, form),), seeds)
            size = max(size, 1e-3)
            if abs(size - TARGET) < best[0]:
                best = (abs(size - TARGET), strength, name)
            if abs(size / TARGET - 1) < TOLERANCE:
                break
            if size < TARGET:
                if strength >= kind.largest:
                    return None, name
                low = (strength, size)
            else:
                high = (strength, size)
            if low and high:
                share = np.log(TARGET / low[1]) / np.log(max(high[1] / low[1], 1.01))
                strength = low[0] * (high[0] / low[0]) ** float(np.clip(share, 0.15, 0.85))
            else:
                strength *= float(np.clip(TARGET / size, 0.1, 6))
            strength = min(strength, kind.largest)
        return best[1], best[2]


yardstick = lru_cache(Yardstick)


def for_specimen(recipe: Recipe) -> Recipe | None:
    """The recipe with the strengths that its word means on the specimen that its seed draws.

    None where an effect cannot be made that plain. What is no multiple of plain stays, as do sets of real size: their
    strengths are stated, forty base sets of each would take hours.
    """
    if recipe.strength not in FACTOR or recipe.camera in cameras.LARGE:
        return recipe
    hidden = []
    for name, nearly, form in recipe.hidden:
        start = nearly / FACTOR[recipe.strength]
        strength, _ = yardstick(recipe.camera).plain(KNOWN[name], form, start, (recipe.seed,))
        if strength is None:
            return None
        hidden.append((name, times(strength, name, recipe.strength), form))
    return replace(recipe, hidden=tuple(hidden))


def calibrate(number: int, kinds: Sequence[Kind]) -> dict[str, dict[str, float | None]]:
    """Plain strengths of every effect and form on one camera; prints which statistic each moves most."""
    others = json.loads(TABLE.read_text())["cameras"].values() if TABLE.exists() else ()
    table: dict[str, dict[str, float | None]] = {}
    for kind in kinds:
        table[kind.name] = {}
        for form in filter(None, ("default", kind.other_form)):
            known = [found for other in others if (found := other.get(kind.name, {}).get(form))]
            strength, name = yardstick(number).plain(
                kind, form, float(np.median(known)) if known else kind.start
            )
            table[kind.name][form] = None if strength is None else float(f"{strength:.4g}")
            print(f"camera {number}, {kind.name}, {form}: {table[kind.name][form]} ({name})", flush=True)
    return table


def update(numbers: Sequence[int], only: Sequence[str] = ()) -> None:
    """Calibrate the effects on these cameras, or `only` some of them, and add the strengths to strengths.json."""
    kinds = [kind for kind in (*KINDS, *further.KINDS, *foreign.KINDS) if not only or kind.name in only]
    for number in numbers:
        table = calibrate(number, kinds)
        kept = json.loads(TABLE.read_text()) if TABLE.exists() else {"how": NOTE, "cameras": {}}
        kept["cameras"].setdefault(str(number), {}).update(table)
        kept["cameras"] = dict(sorted(kept["cameras"].items(), key=lambda item: int(item[0])))
        TABLE.write_text(json.dumps(kept, indent=1) + "\n")
