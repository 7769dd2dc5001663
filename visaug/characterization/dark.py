"""Dark current in the units of a camera file."""

import math
import sys

import numpy as np
from scipy import stats

from visaug.characterization import dark_current
from visaug.characterization.groups import Measured
from visaug.characterization.light import NEEDS_FLATS
from visaug.characterization.moments import GroupMoments
from visaug.core.constants import BOLTZMANN_EV_PER_K, ZERO_C_K
from visaug.core.intervals import symmetric, t_quantile, widen
from visaug.statistics.findings import FALSE_ALARM, Findings

_NEEDS_LADDER = "dark frames at two or more exposures and two or more temperatures"


def dark_law(found: Findings, measured: Measured, frames: GroupMoments | None = None) -> float:
    """Dark current and its law; returns the dark signal of `frames` in DN (0 where it is not known)."""
    groups = (*measured.darks, *measured.biases)
    share = max((m.clipped_high for m in groups if m.shape and not math.isnan(m.mean)), default=0.0)
    if share > 0:
        found.warn(
            f"saturated_dark: {share:.2%} of the pixels of dark frames are at the highest code; the mean "
            "dark current excludes the clipped charge",
            spoils=("dark_current.*", "emva.dark_current_*"),
        )
    if measured.wanders and (law := _of_frames(measured, groups)) is not None:
        found.warn(
            "temperature_drift: the temperature changed during the dark frames; dark current is estimated "
            "by one fit with the temperature and exposure of each frame, and one black level",
            spoils=("emva.dark_current_*",),
        )
        _add_law(found, law, "one fit over the temperatures and exposures of all dark frames")
        if frames is None or frames.group.temperature_c is None:
            return 0.0
        return _exp(law.log_a + law.b_per_c * frames.group.temperature_c) * frames.group.exposure_s
    lines = dark_current.slopes(dark_current.mean_points(groups))
    found_law(found, lines)
    if frames is None or not lines:
        return 0.0
    same = [s for s in lines if s.temperature_c == frames.group.temperature_c] or lines
    line = min(same, key=lambda s: abs((s.temperature_c or 0) - (frames.group.temperature_c or 0)))
    return line.value * frames.group.exposure_s


def _of_frames(measured: Measured, groups: tuple[GroupMoments, ...]) -> dark_current.DarkCurrentLaw | None:
    records = measured.frames.records
    levels = [(records[i], level) for m in groups for i, level in zip(m.group.indices, m.frame_means)]
    rows = [(r.temperature_c, r.exposure_s, level) for r, level in levels if r.temperature_c is not None]
    return dark_current.joint_law(*np.array(rows, float).reshape(-1, 3).T)


def _add_law(found: Findings, law: dark_current.DarkCurrentLaw, source: str, assumes: str = "") -> None:
    """The law in electrons where the gain is known."""
    scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
    relative = 0.0 if found.gain is None else found.gain.relative_error
    t = t_quantile(law.df)
    error = math.hypot(math.sqrt(law.covariance[0, 0]), relative)
    a, low, high = (_exp(law.log_a + t * s) * scale for s in (0.0, -error, error))
    if not math.isfinite(high):
        miss_law(found)
        return
    name, unit = ("a_e_per_s", "e-/s") if found.gain is not None else ("a_dn_per_s", "DN/s")
    found.add(f"dark_current.{name}", (a, low, high), unit, source)
    if found.gain is None:
        found.miss("dark_current.a_e_per_s", NEEDS_FLATS)
    interval = symmetric(law.b_per_c, math.sqrt(law.covariance[1, 1]), law.df)
    found.add("dark_current.b_per_c", interval, "1/degC", source, assumes=assumes)


def miss_law(found: Findings, needs: str = _NEEDS_LADDER) -> None:
    found.miss("dark_current.a_e_per_s", needs)
    found.miss("dark_current.b_per_c", needs)


def _exp(logarithm: float) -> float:
    """Infinite where a float cannot hold it: a law that its frames leave open."""
    return math.exp(logarithm) if logarithm < math.log(sys.float_info.max) else math.inf


def found_law(found: Findings, lines: list[dark_current.Slope]) -> None:
    """Dark current in electrons per second where the gain is known, else in DN per second."""
    if not lines:
        miss_law(found)
        return
    scale = 1.0 if found.gain is None else 1 / found.gain.dn_per_e
    law = dark_current.law(lines)
    found.curves["dark_current"] = {
        "temperature_c": np.array([math.nan if s.temperature_c is None else s.temperature_c for s in lines]),
        "slope": np.array([s.value * scale for s in lines]),
        "error": np.array([s.error * scale for s in lines]),
        "law": np.array([] if law is None else [_exp(law.log_a) * scale, law.b_per_c]),
        "in_electrons": np.array(found.gain is not None),
    }
    if law is not None:
        untested = "dark current follows a exp(b T), which two temperatures do not test"
        source = f"mean dark signal against exposure at {len(lines)} temperatures"
        _add_law(found, law, source, untested if len(lines) == 2 else "")
        _too_flat(found, lines, law)
        if law.misfit > stats.f.ppf(0.999, max(len(lines) - 2, 1), min(law.df, 1e6)):
            said = "dark_current_law: the dark current does not follow a exp(b T) within its uncertainty"
            found.warn(said, spoils=("dark_current.*", "emva.dark_current_*"))
    else:
        _one_temperature(found, lines)
        needs = "dark frames at two or more known temperatures, warm or long enough for a dark signal"
        miss_law(found, needs)


def _too_flat(found: Findings, lines: list[dark_current.Slope], law: dark_current.DarkCurrentLaw) -> None:
    """Warns of a dark signal that grows less than that of silicon, d ln I / dT = E / k T^2: part of it does not depend on
    temperature.
    """
    mean_k = float(np.mean([s.temperature_c for s in lines if s.temperature_c is not None])) + ZERO_C_K
    # Half of silicon's band gap is 0.56 eV, measured energies are 0.55 to 1.1 (R. Widenhorn et al., Proc. SPIE 4669 (2002) 193).
    least = 0.5 / (BOLTZMANN_EV_PER_K * mean_k**2)
    margin = float(stats.t.isf(FALSE_ALARM, min(law.df, 1e6))) * math.sqrt(law.covariance[1, 1])
    if law.b_per_c + margin < least:
        found.warn(
            f"dark_current_flat: the dark signal grows by exp({law.b_per_c:.3g} T), that of silicon by exp({least:.3g} T) or "
            "more at these temperatures: light leaks in, the sensor glows, or a temperature is wrong",
            spoils=("dark_current.*", "emva.dark_current_*"),
        )


def _one_temperature(found: Findings, lines: list[dark_current.Slope]) -> None:
    """The rate where only one temperature tells it: no law, but a figure."""
    if found.gain is None or len(lines) != 1:
        return
    line, scale = lines[0], 1 / found.gain.dn_per_e
    interval = tuple(v * scale for v in symmetric(line.value, line.error, line.df))
    if interval[0] > 0:
        interval = widen(interval, found.gain.relative_error) if interval[1] > 0 else interval
    at = "" if line.temperature_c is None else f" at {line.temperature_c:g} degC"
    found.add("dark_current.rate_e_per_s", interval, "e-/s", f"mean dark signal against exposure{at}")
    found.dark_rate = (line.value * scale, line.temperature_c) if interval[1] > 0 else None
