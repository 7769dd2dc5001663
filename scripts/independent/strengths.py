"""The calibrated plain strengths.

How far each effect must be turned up to stand out by eight standard deviations.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from statistics import median

from . import cameras, effects, foreign

TABLE = Path(__file__).with_name("strengths.json")
FACTOR = {"strong": 4.0, "plain": 1.0, "half": 0.5, "quarter": 0.25, "tenth": 0.1}
KNOWN = effects.BY_NAME | {kind.name: kind for kind in foreign.KINDS}


@lru_cache
def _table() -> dict[str, dict[str, dict[str, float | None]]]:
    return json.loads(TABLE.read_text())["cameras"] if TABLE.exists() else {}


def plain(camera: int, name: str, form: str = "default") -> float | None:
    """Plain strength of an effect on one of the ten cameras.

    None where no strength moves anything that far. A camera that was not calibrated gets the median of those
    that were, electrons in units of read noise.
    """
    kind = KNOWN[name]
    own = _table().get(str(camera), {}).get(name, {})
    if form in own:
        return own[form]
    others = []
    for number, table in _table().items():
        found = table.get(name, {}).get(form)
        if found:
            scale = cameras.sensor(camera).read_e / cameras.sensor(int(number)).read_e
            others.append(found * (scale if kind.unit.startswith("e-") else 1.0))
    return median(others) if others else kind.start


def scaled(camera: int, name: str, form: str, word: str) -> float | None:
    """Strength for a word such as `half`, inside the parameter's range.

    Bits come whole, so they stay at one.
    """
    value = plain(camera, name, form)
    if value is None:
        return None
    return min(value * FACTOR[word], KNOWN[name].largest)
