"""Which groups of a frame set play which part in a characterization."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from visaug.characterization.moments import GroupMoments, measure
from visaug.frames import FrameSet, Group

_SAME_C = 0.6
_SAME_LIGHT = 0.01
_STACK = 4  # a flat with that many times more frames than the sweep's is a stack for spatial figures


@dataclass(frozen=True)
class Level:
    """A flat and the dark frames that belong to it."""

    flat: GroupMoments
    dark: GroupMoments

    @property
    def photons(self) -> float | None:
        return self.flat.group.photons

    @property
    def signal(self) -> float:
        return self.flat.mean - self.dark.mean

    @property
    def variance_of_all(self) -> float:
        return self.flat.variance - self.dark.variance

    def signal_of(self, weights: np.ndarray) -> float:
        """Mean signal over the rows with weight 1, DN."""
        return float(((self.flat.row_means - self.dark.row_means) * weights).sum() / weights.sum())

    def variance_of(self, weights: np.ndarray) -> float:
        """Temporal variance above the dark one over the rows with weight 1, DN^2."""
        rows = (self.flat.row_variances - self.dark.row_variances) * weights
        return float(rows.sum() / weights.sum()) - self.flat.frame_variance + self.dark.frame_variance


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


def measure_groups(frames: FrameSet) -> Measured:
    """Every group measured in one pass over the frames."""
    groups = [g for g in merged_groups(frames) if g.kind in ("bias", "dark", "flat")]
    moments = tuple(measure(frames, g) for g in groups)
    gains = Counter()
    for m in moments:
        gains[m.group.gain_db] += m.n * (1000 if m.group.kind == "flat" else 1)
    gain_db = min(gains, key=lambda g: (-gains[g], g)) if gains else 0.0
    levels = {g: _pair([m for m in moments if m.group.gain_db == g]) for g in gains}
    base = levels.pop(gain_db, ())
    temperatures = Counter(m.group.temperature_c for m in moments if m.group.kind in ("flat", "bias"))
    return Measured(
        frames=frames,
        moments=moments,
        biases=_of(moments, "bias", gain_db),
        darks=_of(moments, "dark", gain_db),
        levels=base,
        other_gains={g: found for g, found in levels.items() if found},
        gain_db=gain_db,
        temperature_c=temperatures.most_common(1)[0][0] if temperatures else None,
        calibrated=bool(base) and all(v.photons is not None for v in base),
    )


def merged_groups(frames: FrameSet) -> list[Group]:
    """Groups whose temperatures differ by less than a sensor's reading wanders count as one.

    Dark frames right after a lit one are apart from the others: the lit one may linger in them.
    """
    found: dict[tuple, list[Group]] = {}
    for group in _split_after_light(frames):
        key = (group.kind, group.exposure_s, group.gain_db, group.photons, group.clean, group.window)
        found.setdefault(key, []).append(group)
    merged = []
    for same in found.values():
        known = sorted((g for g in same if g.temperature_c is not None), key=lambda g: g.temperature_c or 0.0)
        merged += [g for g in same if g.temperature_c is None]
        merged += _clusters(
            known, lambda a, b: (b.temperature_c or 0.0) - (a.temperature_c or 0.0) <= _SAME_C
        )
    return sorted(_merge_lone_flats(merged), key=lambda g: g.indices[0])


def _merge_lone_flats(groups: list[Group]) -> list[Group]:
    """Flats whose light was measured for each frame are one level where it differs by a percent at most."""
    lone = [g for g in groups if g.kind == "flat" and len(g.indices) == 1 and g.photons]
    found: dict[tuple, list[Group]] = {}
    for g in sorted(lone, key=lambda g: g.photons or 0.0):
        found.setdefault((g.exposure_s, g.gain_db, g.temperature_c, g.window), []).append(g)
    joined = [
        g
        for same in found.values()
        for g in _clusters(same, lambda a, b: (b.photons or 0.0) <= (1 + _SAME_LIGHT) * (a.photons or 0.0))
    ]
    return [g for g in groups if g not in lone] + joined


def _clusters(ordered: list[Group], alike: Callable[[Group, Group], bool]) -> list[Group]:
    """Neighbours that are alike to the first of their cluster, joined."""
    clusters: list[list[Group]] = []
    for group in ordered:
        if clusters and alike(clusters[-1][0], group):
            clusters[-1].append(group)
        else:
            clusters.append([group])
    return [_join(cluster) for cluster in clusters]


def _split_after_light(frames: FrameSet) -> list[Group]:
    lit = {
        i
        for i in range(1, len(frames))
        if frames.records[i].kind in ("dark", "bias") and frames.records[i - 1].kind in ("flat", "scene")
    }
    settings = {
        (r.gain_db, r.temperature_c)
        for i, r in enumerate(frames.records)
        if r.kind in ("dark", "bias") and i not in lit
    }
    groups = []
    for group in frames.groups():
        rested = tuple(i for i in group.indices if i not in lit)
        if len(rested) >= 2:
            groups.append(replace(group, indices=rested))
        elif (
            rested
            or group.kind not in ("dark", "bias")
            or (group.gain_db, group.temperature_c) not in settings
        ):
            groups.append(group)
    return groups


def _join(cluster: list[Group]) -> Group:
    if len(cluster) == 1:
        return cluster[0]
    counts = [len(g.indices) for g in cluster]

    def mean(values: list[float | None]) -> float | None:
        return None if values[0] is None else float(np.average([v or 0.0 for v in values], weights=counts))

    return replace(
        cluster[0],
        temperature_c=mean([g.temperature_c for g in cluster]),
        photons=mean([g.photons for g in cluster]),
        indices=tuple(sorted(i for g in cluster for i in g.indices)),
    )


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
