"""Dark current in the units of a camera file."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from visaug.characterization import dark_current
from visaug.characterization.findings import Findings
from visaug.characterization.groups import Measured
from visaug.characterization.intervals import t_quantile
from visaug.characterization.light import NEEDS_FLATS
from visaug.characterization.moments import GroupMoments

_NEEDS_LADDER = "dark frames at two or more exposures and two or more temperatures"


def dark_law(found: Findings, measured: Measured, frames: GroupMoments | None = None) -> float:
    """Dark current and its law; returns the dark signal of `frames` in DN (0 where it is not known)."""
    lines = dark_current.slopes(dark_current.mean_points((*measured.darks, *measured.biases)))
    found_law(found, lines)
    return _signal_of(frames, lines) if frames is not None and lines else 0.0


def found_law(found: Findings, lines: list[dark_current.Slope]) -> None:
    """Dark current in electrons per second where the gain is known, else in DN per second."""
    if not lines:
        for name in ("dark_current.a_e_per_s", "dark_current.b_per_c"):
            found.miss(name, _NEEDS_LADDER)
        return
    scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
    relative = 0.0 if found.gain is None else found.gain.relative_error
    unit = "DN/s" if found.gain is None else "e-/s"
    law = dark_current.law(lines)
    found.curves["dark_current"] = {
        "temperature_c": np.array([math.nan if s.temperature_c is None else s.temperature_c for s in lines]),
        "slope": np.array([s.value * scale for s in lines]),
        "error": np.array([s.error * scale for s in lines]),
        "law": np.array([] if law is None else [math.exp(law.log_a) * scale, law.b_per_c]),
        "in_electrons": np.array(found.gain is not None),
    }
    if law is not None:
        t = t_quantile(law.df)
        error = math.hypot(math.sqrt(law.covariance[0, 0]), relative)
        a = math.exp(law.log_a) * scale
        source = f"mean dark signal against exposure at {len(lines)} temperatures"
        name = "dark_current.a_e_per_s" if found.gain is not None else "dark_current.a_dn_per_s"
        found.add(name, (a, a * math.exp(-t * error), a * math.exp(t * error)), unit, source)
        if found.gain is None:
            found.miss("dark_current.a_e_per_s", NEEDS_FLATS)
        half = t * math.sqrt(law.covariance[1, 1])
        found.add(
            "dark_current.b_per_c", (law.b_per_c, law.b_per_c - half, law.b_per_c + half), "1/degC", source
        )
        if law.misfit > stats.f.ppf(0.999, max(len(lines) - 2, 1), min(law.df, 1e6)):
            found.warn("dark_current_law: the dark current does not follow a exp(b T) within its errors")
    else:
        needs = "dark frames at two or more known temperatures, warm or long enough for a dark signal"
        found.miss("dark_current.a_e_per_s", needs)
        found.miss("dark_current.b_per_c", needs)


def _signal_of(frames: GroupMoments, lines: list[dark_current.Slope]) -> float:
    same = [s for s in lines if s.temperature_c == frames.group.temperature_c] or lines
    line = min(same, key=lambda s: abs((s.temperature_c or 0) - (frames.group.temperature_c or 0)))
    return line.value * frames.group.exposure_s
