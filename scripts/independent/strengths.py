"""The calibrated plain strengths.

How far each effect must be turned up to stand out by eight standard deviations.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from statistics import median

from . import effects, foreign

TABLE = Path(__file__).with_name("strengths.json")
FACTOR = {"strong": 4.0, "plain": 1.0, "half": 0.5, "quarter": 0.25, "tenth": 0.1}
KNOWN = effects.BY_NAME | {kind.name: kind for kind in foreign.KINDS}


@lru_cache
def _table() -> dict[str, dict[str, dict[str, float | None]]]:
    return json.loads(TABLE.read_text())["cameras"] if TABLE.exists() else {}


def plain(camera: int, name: str, form: str = "default") -> float | None:
    """Plain strength of an effect on one of the ten cameras.

    None where no strength moves anything that far.
    """
    kind = KNOWN[name]
    own = _table().get(str(camera), {}).get(name, {})
    if form in own:
        return own[form]
    others = [found for table in _table().values() if (found := table.get(name, {}).get(form))]
    return median(others) if others else kind.start


def scaled(camera: int, name: str, form: str, word: str) -> float | None:
    """Strength for a word such as `half`, inside the parameter's range.

    Bits come whole, so they stay at one.
    """
    value = plain(camera, name, form)
    if value is None:
        return None
    return min(value * FACTOR[word], KNOWN[name].largest)
