"""The calibrated plain strengths.

How far each effect must be turned up to stand out by eight standard deviations.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from statistics import median

from . import cameras, effects, foreign, further, local

TABLE = Path(__file__).with_name("strengths.json")
FACTOR = {"strong": 4.0, "plain": 1.0, "half": 0.5, "quarter": 0.25, "tenth": 0.1}
# What laboratories and data sheets find in cameras that have the effect; units as in effects.py.
TYPICAL = {
    "light_drift": 0.01, "vignetting": 0.2, "lens_flare": 0.005, "veiling_glare": 0.02, "point_spread": 0.5,
    "smear": 0.005, "dark_current_nonuniformity": 0.5, "hot_pixels": 0.003, "amplifier_glow": 20,
    "clock_induced_charge": 2, "cosmic_rays": 1, "brighter_fatter": 0.01, "blooming": 0.05, "image_lag": 0.01,
    "charge_transfer_inefficiency": 1e-4, "interpixel_crosstalk": 0.01, "dead_pixels": 0.003, "nonlinearity": 0.02,
    "rts_noise": 0.02, "fixed_pattern_structure": 3, "row_parity": 2, "row_noise": 1, "column_noise": 1,
    "flicker_noise": 1, "periodic_banding": 1, "black_level_drift": 1, "tap_mismatch": 3, "bit_truncation": 2,
    "missing_codes": 0.02, "row_gain_noise": 0.01, "patchwork": 3,
    "row_loading": 0.01, "electronic_ghost": 0.01, "bit_flips": 1e-3, "checkerboard": 1,
    "converter_step": 30, "despeckle": 0.2,
    "lamp_flicker": 0.01, "fringing": 0.01, "dust": 0.05, "parasitic_light": 0.02, "dark_current_rts": 0.01, "uneven_light": 0.01,
    "saturation_nonuniformity": 0.02, "column_parity": 1.5, "read_noise_nonuniformity": 1.5, "line_defects": 0.03,
    "correlated_row_noise": 1, "slanted_interference": 2, "dual_gain": 20, "code_widths": 0.4,
    "corner_glow": 200, "edge_columns": 4, "quarter_taps": 2,
}  # fmt: skip
WORDS = (*FACTOR, "typical")
KNOWN = effects.BY_NAME | {kind.name: kind for kind in (*further.KINDS, *foreign.KINDS, *local.KINDS)}


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

    Bits come whole, so they stay at one; `typical` does not depend on the camera.
    """
    if word == "typical":
        return TYPICAL[name]
    value = plain(camera, name, form)
    return None if value is None else times(value, name, word)


def times(plain: float, name: str, word: str) -> float:
    """A multiple of a plain strength, inside the parameter's range."""
    return min(plain * FACTOR[word], KNOWN[name].largest)
