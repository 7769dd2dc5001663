"""Which groups of a frame set play which part in a characterization."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from visaug.characterization.dark_current import Slope, mean_points, slopes, wanders
from visaug.characterization.facts import Facts
from visaug.characterization.moments import GroupMoments, measure
from visaug.frames import FrameSet, Group

KINDS = ("bias", "dark", "flat")
SAME_C = 0.6  # a sensor's reading wanders by that much
_SAME_EXPOSURE = 1e-3  # shutters and headers round
_SAME_LIGHT = 0.01
_SAME_LEVEL = 0.1  # a lamp that flickers less stays one level: the share of its change is taken out
_FALLING = 0.4
_SAME_GAP = 0.02
_STACK = 4  # a flat with that many times more frames than the sweep's is a stack for spatial figures


@dataclass(frozen=True)
class Level:
    """A flat and the dark frames that belong to it.

    `dark_signal` is what dark current adds in the flat beyond its dark frames, whose exposure may differ
    (DN); `dark_rate_error` the standard error of its rate (DN/s), None where the rate is not known.
    """

    flat: GroupMoments
    dark: GroupMoments
    dark_signal: float = 0.0
    dark_rate_error: float | None = None

    @property
    def photons(self) -> float | None:
        return self.flat.group.photons

    @property
    def exposure_gap_s(self) -> float:
        """Exposure of the flat less that of its dark frames, as far as more than a log's rounding."""
        flat_s, dark_s = self.flat.group.exposure_s, self.dark.group.exposure_s
        return 0.0 if abs(flat_s - dark_s) <= _SAME_GAP * max(flat_s, dark_s) else flat_s - dark_s

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
        """The same without what a lamp that changes adds where the light is uneven."""
        return self.variance_of(weights) - self.lamp_variance

    @property
    def lamp_variance(self) -> float:
        """A change of the light by a share moves every pixel by that share of its own signal, DN^2."""
        noise = float(self.flat.row_variances.mean()) / self.flat.n
        uneven = max(self.flat.spatial_variance - noise, 0.0) / max(self.signal, 1e-9) ** 2
        return self.flat.frame_variance * uneven if self.signal > 0 else 0.0


@dataclass(frozen=True)
class Measured:
    """A frame set's groups, measured and sorted by their part.

    `levels` (by photons or signal) are the flats at the base gain that have a dark partner, `other_gains`
    those at other gains; `darks` and `biases` are those at the base gain.
    """

    frames: FrameSet
    moments: tuple[GroupMoments, ...]
    biases: tuple[GroupMoments, ...]
    darks: tuple[GroupMoments, ...]
    levels: tuple[Level, ...]
    other_gains: dict[float, tuple[Level, ...]]
    gain_db: float
    temperature_c: float | None
    calibrated: bool

    @property
    def sweep(self) -> tuple[Level, ...]:
        """Levels of the photon transfer, without big stacks where a sweep stands beside them."""
        levels = [v for v in self.levels if v.flat.n > 1 and v.dark.n > 1]
        usual = np.median([v.flat.n for v in levels]) if levels else 0
        small = [v for v in levels if v.flat.n <= _STACK * usual]
        return tuple(small if len(small) >= 3 else levels)

    @property
    def wanders(self) -> bool:
        """Whether the temperature drifts among the dark frames."""
        taken = [self.frames.records[i] for m in self.darks for i in m.group.indices]
        known = [(r.temperature_c, r.exposure_s) for r in taken if r.temperature_c is not None]
        return bool(known) and wanders(*np.array(known, float).T)

    def with_dark_signal(self) -> Measured:
        """Levels that know what dark current adds beyond their dark frames, where dark frames tell its rate."""
        if self.wanders:
            return self
        lines = slopes(mean_points((*self.darks, *self.biases)))
        return replace(self, levels=tuple(_with_rate(v, lines) for v in self.levels)) if lines else self

    @property
    def still(self) -> GroupMoments | None:
        """Frames for master bias and read noise: most frames first, then the shortest exposure."""
        return max(
            (m for m in (*self.biases, *self.darks) if m.n > 1 and m.shape == self._shape),
            key=lambda m: (m.group.kind == "bias", m.n, -m.group.exposure_s),
            default=None,
        )

    @property
    def _shape(self) -> tuple[int, int]:
        """The largest window, to which spatial figures belong."""
        return max((m.shape for m in self.moments if m.group.kind != "image"), key=lambda s: s[0] * s[1])


def measure_groups(frames: FrameSet, facts: Sequence[Facts]) -> Measured:
    """Every group measured in one pass over the frames."""
    moments = tuple(measure(frames, g) for g in merged_groups(frames, facts))
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
        biases=_of(moments, "bias", gain_db),
        darks=_of(moments, "dark", gain_db),
        levels=base,
        other_gains={g: found for g, found in levels.items() if found},
        gain_db=gain_db,
        temperature_c=temperatures[(len(temperatures) - 1) // 2] if temperatures else None,
        calibrated=bool(base) and all(v.photons is not None for v in base),
    )


def merged_groups(frames: FrameSet, facts: Sequence[Facts]) -> list[Group]:
    """Frames taken alike: settings that differ by less than a log wanders count as one, and flats of one
    setting whose light was changed are apart.

    Dark frames right after a lit one are apart from the others: the lit one may linger in them.
    """
    found: dict[tuple, list[int]] = {}
    for i, r in enumerate(frames.records):
        if r.kind in KINDS:
            light = r.filter if r.kind == "flat" else None
            found.setdefault((r.kind, r.gain_db, r.window, light), []).append(i)
    groups = []
    floor = _floor(frames, facts)
    for (kind, *_), members in found.items():
        for same in _clusters(members, lambda i: frames.records[i].exposure_s, _same_exposure):
            for alike in _by_temperature(frames, same):
                parts = _by_light(frames, alike, facts, floor) if kind == "flat" else [alike]
                groups += [_group(frames, part) for part in parts]
    return sorted(_rested(frames, groups), key=lambda g: g.indices[0])


def _same_exposure(a: float, b: float) -> bool:
    return b - a <= _SAME_EXPOSURE * b


def _by_temperature(frames: FrameSet, members: list[int]) -> list[list[int]]:
    unknown = [i for i in members if frames.records[i].temperature_c is None]
    known = [i for i in members if frames.records[i].temperature_c is not None]
    clusters = _clusters(
        known, lambda i: frames.records[i].temperature_c or 0.0, lambda a, b: b - a <= SAME_C
    )
    return [*([unknown] if unknown else []), *clusters]


def _by_light(frames: FrameSet, members: list[int], facts: Sequence[Facts], floor: float) -> list[list[int]]:
    """Flats of one exposure by their photons, and by their own level where the lamp was changed."""
    by_photons: dict[float | None, list[int]] = {}
    for i in members:
        by_photons.setdefault(frames.records[i].photons, []).append(i)
    lone = [i for p, same in by_photons.items() if len(same) == 1 and p for i in same]
    groups = [same for same in by_photons.values() if same[0] not in lone]
    groups += _clusters(
        lone, lambda i: frames.records[i].photons or 0.0, lambda a, b: b <= (1 + _SAME_LIGHT) * a
    )
    noise = float(np.median([facts[i].noise for i in members]))

    def level(i: int) -> float:
        return facts[i].mean - floor

    found = []
    for group in groups:
        steps = _clusters(group, level, lambda a, b: b - a <= _SAME_LEVEL * max(b, 0.0) + 0.1 * noise)
        single = [i for step in steps if len(step) == 1 for i in step] if len(steps) > 1 else []
        found += [step for step in steps if step[0] not in single]
        # Falling light: neighbours still tell the noise, for the change of the light is taken out.
        found += _clusters(single, level, lambda a, b: b - a <= _FALLING * max(b, 0.0))
    return found


def _floor(frames: FrameSet, facts: Sequence[Facts]) -> float:
    """Level without light, DN: of the darkest frames there are."""
    return min((f.mean for r, f in zip(frames.records, facts) if r.kind in ("bias", "dark")), default=0.0)


def _clusters(
    members: list[int], value: Callable[[int], float], alike: Callable[[float, float], bool]
) -> list[list[int]]:
    """Members in order of a value, joined while they are alike to the first of their cluster."""
    clusters: list[list[int]] = []
    for i in sorted(members, key=value):
        if clusters and alike(value(clusters[-1][0]), value(i)):
            clusters[-1].append(i)
        else:
            clusters.append([i])
    return clusters


def _rested(frames: FrameSet, groups: list[Group]) -> list[Group]:
    """Without dark frames that follow a lit one, where enough others are there."""
    lit = {
        i
        for i in range(1, len(frames))
        if frames.records[i].kind in ("dark", "bias") and frames.records[i - 1].kind in ("flat", "scene")
    }
    settings = {
        (g.gain_db, g.temperature_c) for g in groups if g.kind in ("dark", "bias") and set(g.indices) - lit
    }
    kept = []
    for group in groups:
        rested = tuple(i for i in group.indices if i not in lit)
        if len(rested) >= 2:
            kept.append(replace(group, indices=rested))
        elif rested or group.kind == "flat" or (group.gain_db, group.temperature_c) not in settings:
            kept.append(group)
    return kept


def _group(frames: FrameSet, members: list[int]) -> Group:
    records = [frames.records[i] for i in members]

    def mean(values: list[float | None]) -> float | None:
        known = [v for v in values if v is not None]
        if len(known) < len(values):
            return None
        return known[0] if len(set(known)) == 1 else float(np.mean(known))

    first = records[0]
    return Group(
        kind=first.kind,
        exposure_s=float(np.median([r.exposure_s for r in records])),
        temperature_c=mean([r.temperature_c for r in records]),
        gain_db=first.gain_db,
        photons=mean([r.photons for r in records]),
        clean=first.clean,
        window=first.window,
        indices=tuple(sorted(members)),
        setting=first.setting,
        filter=first.filter,
    )


def _with_rate(level: Level, lines: Sequence[Slope]) -> Level:
    """With the rate of the temperature nearest to the flat's, if it is the flat's."""
    here = level.flat.group.temperature_c

    def apart(line: Slope) -> float:
        return 0.0 if here is None or line.temperature_c is None else abs(line.temperature_c - here)

    line = min(lines, key=apart)
    if apart(line) > SAME_C or not level.exposure_gap_s:
        return level
    return replace(level, dark_signal=line.value * level.exposure_gap_s, dark_rate_error=line.error)


def _of(moments, kind: str, gain_db: float) -> tuple[GroupMoments, ...]:
    return tuple(m for m in moments if m.group.kind == kind and m.group.gain_db == gain_db)


def _pair(moments: list[GroupMoments]) -> tuple[Level, ...]:
    """Each flat with the dark or bias frames of nearest exposure and temperature in the same window."""
    levels = []
    for flat in (m for m in moments if m.group.kind == "flat"):
        dark = min(
            (
                m
                for m in moments
                if m.group.kind != "flat" and m.shape == flat.shape and m.group.window == flat.group.window
            ),
            key=lambda m: (
                abs((m.group.temperature_c or 0.0) - (flat.group.temperature_c or 0.0)),
                m.n < 2,
                abs(m.group.exposure_s - flat.group.exposure_s),
                m.group.kind == "bias",
            ),
            default=None,
        )
        if dark is not None:
            levels.append(Level(flat, dark))
    return tuple(sorted(levels, key=lambda v: (v.photons if v.photons is not None else v.signal, v.signal)))
