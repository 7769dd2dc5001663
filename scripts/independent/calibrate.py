"""How strong is plain? Turn an effect up until its strongest statistic is eight standard deviations off.

Off from the refitted base model: fourteen base parameters are refitted by weighted least squares to the
statistics that a laboratory would take them from (photon transfer, dark ladder, map variances, the clipped
spot) before the residual is taken, with slopes from simulations that share their random numbers. The
standard deviations are those of the residuals of forty base sets, refitted alike, each of a specimen with
maps of its own.

    python -m independent.calibrate 0 1 2 [--only NAME,NAME]     (from scripts/; adds to strengths.json)
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from . import cameras, foreign, statistics
from .camera import Hidden, Sensor, take
from .effects import KINDS, Kind
from .strengths import TABLE

BASE_SETS, SLOPE_SEEDS, EFFECT_SEEDS = 40, 3, 2
TARGET, TOLERANCE, TRIES = 8.0, 0.08, 12
_FIRST_SEED = 500_000  # far from the seeds that sets are made with
NOTE = (
    f"Strength at which the strongest statistic of statistics.py stands {TARGET:g} standard deviations off "
    f"the refitted base model; {BASE_SETS} base sets for the spread, root mean square over {EFFECT_SEEDS} "
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
        self.base_residuals = residuals

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

    def shift(self, hidden: tuple[Hidden, ...]) -> tuple[float, str]:
        """Standard deviations by which the strongest statistic moves, and its name."""
        moved = []
        for i in range(EFFECT_SEEDS):
            with_effect = self.residual(self._vector(self.stated, _FIRST_SEED + i, hidden))
            moved.append((with_effect - self.base_residuals[i]) / self.spread)
        size = np.sqrt(np.mean(np.square(moved), axis=0))
        best = int(np.argmax(size))
        return float(size[best]), self.names[best]

    def plain(self, kind: Kind, form: str, start: float) -> tuple[float | None, str]:
        """Search the plain strength: secants in log-log, kept inside the bracket."""
        if kind.unit == "bits":
            return 1.0, "one bit is the least"
        low: tuple[float, float] | None = None
        high: tuple[float, float] | None = None
        strength, best = start, (np.inf, start, "")
        for _ in range(TRIES):
            size, name = self.shift((kind.at(strength, form),))
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


def calibrate(number: int, kinds: Sequence[Kind]) -> dict[str, dict[str, float | None]]:
    """Plain strengths of every effect and form on one camera; prints which statistic each moves most."""
    yardstick = Yardstick(number)
    others = json.loads(TABLE.read_text())["cameras"].values() if TABLE.exists() else ()
    table: dict[str, dict[str, float | None]] = {}
    for kind in kinds:
        table[kind.name] = {}
        for form in filter(None, ("default", kind.other_form)):
            known = [found for other in others if (found := other.get(kind.name, {}).get(form))]
            strength, name = yardstick.plain(kind, form, float(np.median(known)) if known else kind.start)
            table[kind.name][form] = None if strength is None else float(f"{strength:.4g}")
            print(f"camera {number}, {kind.name}, {form}: {table[kind.name][form]} ({name})", flush=True)
    return table


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("cameras", type=int, nargs="*", default=list(range(cameras.COUNT)))
    words.add_argument("--only", default="")
    given = words.parse_args()
    kinds = [k for k in (*KINDS, *foreign.KINDS) if not given.only or k.name in given.only.split(",")]
    for number in given.cameras:
        table = calibrate(number, kinds)
        kept = json.loads(TABLE.read_text()) if TABLE.exists() else {"how": NOTE, "cameras": {}}
        kept["cameras"].setdefault(str(number), {}).update(table)
        kept["cameras"] = dict(sorted(kept["cameras"].items(), key=lambda item: int(item[0])))
        TABLE.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
