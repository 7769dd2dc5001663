"""Which groups of a frame set play which part in a characterization."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.characterization.alike import SAME_C, degrees_apart, merged_groups
from visaug.characterization.dark_current import Slope, mean_points, slopes, wanders
from visaug.characterization.facts import Facts
from visaug.characterization.moments import GroupMoments, measure, nearness
from visaug.frames import FrameSet

COLLAPSE = 0.7  # variance below this share of the shot noise's tells clipping


@dataclass(frozen=True)
class FlatLevel:
    """A flat and the dark frames that belong to it."""

    flat: GroupMoments
    dark: GroupMoments
    dark_signal: float = 0.0  # what dark current adds beyond the dark frames, whose exposure may differ, DN
    dark_rate_error: float | None = None  # standard error of its rate, DN/s; None where that is not known
    band_variance: float = 0.0  # what rows share in flats alone, DN^2
    shared_variance: float = 0.0  # sum of the covariances of the light's noise with eight neighbours, DN^2
    shared_error: float = 0.0  # its standard error

    @property
    def photons(self) -> float | None:
        return self.flat.group.photons

    @property
    def exposure_gap_s(self) -> float:
        """Exposure of the flat less that of its dark frames, as far as more than a log's rounding."""
        flat_s, dark_s = self.flat.group.exposure_s, self.dark.group.exposure_s
        return 0.0 if abs(flat_s - dark_s) <= 0.02 * max(flat_s, dark_s) else flat_s - dark_s

    @property
    def degrees_apart(self) -> float:
        """Between the flat and its dark frames; 0 where a temperature is not known."""
        return degrees_apart(self.flat.group.temperature_c, self.dark.group.temperature_c)

    @property
    def signal(self) -> float:
        """Mean above the dark frames, DN."""
        return self.flat.mean - self.dark.mean

    @property
    def light(self) -> float:
        """Mean signal of the light alone, DN."""
        return self.signal - self.dark_signal

    @property
    def variance_of_all(self) -> float:
        return self.noise_of(np.ones(self.flat.shape[0]))

    def signal_of(self, weights: np.ndarray) -> float:
        """Mean signal over the rows with weight 1, DN."""
        return float(((self.flat.row_means - self.dark.row_means) * weights).sum() / weights.sum())

    def variance_of(self, weights: np.ndarray) -> float:
        """Temporal variance above the dark one over the rows with weight 1, DN^2, as EMVA 1288 defines it."""
        rows = (self.flat.row_variances - self.dark.row_variances) * weights
        return float(rows.sum() / weights.sum()) - self.flat.frame_variance + self.dark.frame_variance

    def noise_of(self, weights: np.ndarray) -> float:
        """The same without what a lamp that changes adds, and with what neighbours share of it."""
        return self.variance_of(weights) - self.lamp_variance - self.band_variance + self.shared_variance

    @property
    def variance_error(self) -> float:
        """Standard error of the level's variance of white normal noise and of what was added to it, DN^2.
        Light that is uneven over the pixels makes their variances uneven, and their mean the less certain.
        """
        light = max(1 - self.dark.variance / self.flat.variance, 0.0) if self.flat.variance > 0 else 0.0
        uneven = (1 + self.unevenness * light**2, self.flat), (1.0, self.dark)
        parts = [2 * u * m.variance**2 / max((m.n - 1) * m.shape[0] * m.shape[1], 1) for u, m in uneven]
        return math.sqrt(sum(parts) + self.shared_error**2)

    @property
    def unevenness(self) -> float:
        """Variance of the light over the pixels in units of its squared mean."""
        noise = float(self.flat.row_variances.mean()) / self.flat.n
        return max(self.flat.spatial_variance - noise, 0.0) / max(self.signal, 1e-9) ** 2

    @property
    def lamp_variance(self) -> float:
        """A change of the light by a share moves every pixel by that share of its own signal, DN^2."""
        return self.flat.frame_variance * self.unevenness if self.signal > 0 else 0.0


@dataclass(frozen=True)
class Measured:
    """A frame set's groups, measured and sorted by their part."""

    frames: FrameSet
    moments: tuple[GroupMoments, ...]
    biases: tuple[GroupMoments, ...]  # at the base gain
    darks: tuple[GroupMoments, ...]  # at the base gain
    levels: tuple[FlatLevel, ...]  # flats at the base gain with a dark partner, by photons or signal
    other_gains: dict[float, tuple[FlatLevel, ...]]  # those at other gains
    gain_db: float
    temperature_c: float | None

    @property
    def sweep(self) -> tuple[FlatLevel, ...]:
        """Levels of the photon transfer, without big stacks where a sweep stands beside them."""
        levels = [v for v in self.levels if v.flat.n > 1 and v.dark.n > 1]
        usual = np.median([v.flat.n for v in levels]) if levels else 0
        small = [v for v in levels if v.flat.n <= 4 * usual]  # one of more is a stack for spatial figures
        return tuple(small if len(small) >= 3 else levels)

    @property
    def wanders(self) -> bool:
        """Whether the temperature drifts among the dark frames."""
        taken = [self.frames.records[i] for m in self.darks for i in m.group.indices]
        known = [(r.temperature_c, r.exposure_s) for r in taken if r.temperature_c is not None]
        return bool(known) and wanders(*np.array(known, float).T)

    def with_dark_signal(self) -> "Measured":
        """Levels that know what dark current adds beyond their dark frames, where dark frames tell its rate."""
        if self.wanders:
            return self
        lines = slopes(mean_points((*self.darks, *self.biases)))
        return replace(self, levels=tuple(_with_rate(v, lines) for v in self.levels)) if lines else self

    @property
    def still(self) -> GroupMoments | None:
        """Frames for master bias and read noise: most frames first, then the shortest exposure."""
        # the largest window, to which spatial figures belong
        largest = max((m.shape for m in self.moments), key=math.prod, default=None)
        return max(
            (m for m in (*self.biases, *self.darks) if m.n > 1 and m.shape == largest),
            key=lambda m: (m.group.kind == "bias", m.n, -m.group.exposure_s, nearness(m.group.window)),
            default=None,
        )


def measure_groups(frames: FrameSet, facts: Sequence[Facts], step_dn: float = 1.0) -> Measured:
    """Every group measured in one pass over the frames, whose codes are `step_dn` apart."""
    moments = tuple(measure(frames, g, step_dn) for g in merged_groups(frames, facts))
    gains = Counter()
    for m in moments:
        gains[m.group.gain_db] += m.n * (1000 if m.group.kind == "flat" else 1)
    gain_db = min(gains, key=lambda g: (-gains[g], g)) if gains else 0.0
    levels = {g: _pair([m for m in moments if m.group.gain_db == g]) for g in gains}
    base = levels.pop(gain_db, ())
    known = [(m.group.temperature_c, m.n) for m in moments if m.group.kind in ("flat", "bias")]
    temperatures = sorted(t for t, n in known for _ in range(n) if t is not None)
    return Measured(
        frames=frames,
        moments=moments,
        biases=tuple(m for m in moments if m.group.kind == "bias" and m.group.gain_db == gain_db),
        darks=tuple(m for m in moments if m.group.kind == "dark" and m.group.gain_db == gain_db),
        levels=base,
        other_gains={g: found for g, found in levels.items() if found},
        gain_db=gain_db,
        temperature_c=temperatures[(len(temperatures) - 1) // 2] if temperatures else None,
    )


def _with_rate(level: FlatLevel, lines: Sequence[Slope]) -> FlatLevel:
    """With the rate of the temperature nearest to the flat's, if it is the flat's."""
    here = level.flat.group.temperature_c
    line = min(lines, key=lambda line: degrees_apart(here, line.temperature_c))
    if degrees_apart(here, line.temperature_c) > SAME_C or not level.exposure_gap_s:
        return level
    return replace(level, dark_signal=line.value * level.exposure_gap_s, dark_rate_error=line.error)


def _pair(moments: list[GroupMoments]) -> tuple[FlatLevel, ...]:
    """Each flat with the dark or bias frames of nearest temperature and exposure in the same window.
    Of a flat of unknown temperature the exposure alone decides. Of several windows the one with the most levels is taken, the
    largest of those: rows of one window are not those of another.
    """
    levels = []
    for flat in (m for m in moments if m.group.kind == "flat"):
        dark = min(
            (m for m in moments if m.group.kind != "flat" and m.place == flat.place),
            key=lambda m: (
                max(degrees_apart(m.group.temperature_c, flat.group.temperature_c) - SAME_C, 0.0),
                m.group.temperature_c is None and flat.group.temperature_c is not None,
                m.n < 2,
                abs(m.group.exposure_s - flat.group.exposure_s),
                m.group.kind == "bias",
            ),
            default=None,
        )
        if dark is not None:
            levels.append(FlatLevel(flat, dark))
    windows = Counter(v.flat.place for v in levels)
    chosen = max(windows, key=lambda p: (windows[p], math.prod(p[0]), nearness(p[1])), default=None)
    levels = [v for v in levels if v.flat.place == chosen]
    return tuple(sorted(levels, key=lambda v: (v.photons if v.photons is not None else v.signal, v.signal)))
