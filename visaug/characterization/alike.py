"""Frames taken alike: by their settings, and by their light where the settings are silent."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from visaug.characterization.facts import Facts
from visaug.frames import FrameSet, Group

KINDS = ("bias", "dark", "flat")
APART = 10.0  # ratio of a step of the lamp and of the differences of frames beside it from which the step is a setting
SAME_C = 0.6  # a sensor's reading wanders by that much; steps of a ladder are wider


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
    floor = floor_dn(frames, facts)
    for (kind, *_), members in found.items():
        exposures = {i: frames.records[i].exposure_s for i in members}
        # Shutters and headers round.
        for same in _clusters(members, exposures.__getitem__, lambda a, b: b - a <= 1e-3 * b):
            for alike in _by_temperature(frames, same):
                parts = _by_light(frames, alike, facts, floor) if kind == "flat" else [alike]
                groups += [_group(frames, part) for part in parts]
    return sorted(_rested(frames, groups), key=lambda g: g.indices[0])


def degrees_apart(a: float | None, b: float | None) -> float:
    """Difference of two temperatures in degrees; 0 where one is not known: it may be the same."""
    return 0.0 if a is None or b is None else abs(a - b)


def _by_temperature(frames: FrameSet, members: list[int]) -> list[list[int]]:
    degrees = {i: t for i in members if (t := frames.records[i].temperature_c) is not None}
    unknown = [i for i in members if i not in degrees]
    clusters = _clusters([*degrees], degrees.__getitem__, lambda a, b: b - a <= SAME_C)
    return [*([unknown] if unknown else []), *clusters]


def _by_light(frames: FrameSet, members: list[int], facts: Sequence[Facts], floor: float) -> list[list[int]]:
    """Flats of one exposure by their photons, and by their own level where the lamp was changed.

    Of flats whose photons are not known the steps of a ladder may be fine; stated photons are those of one setting of the lamp.
    """
    by_photons: dict[float | None, list[int]] = {}
    for i in members:
        by_photons.setdefault(frames.records[i].photons, []).append(i)
    lone = {same[0]: p for p, same in by_photons.items() if len(same) == 1 and p}
    groups = [same for same in by_photons.values() if same[0] not in lone]
    groups += _clusters([*lone], lone.__getitem__, lambda a, b: b <= (1 + 0.01) * a)
    noise = float(np.median([facts[i].noise for i in members]))

    def level(i: int) -> float:
        return facts[i].mean - floor

    unknown = by_photons.get(None)
    if unknown:
        groups.remove(unknown)
        groups += _settings_of_a_lamp(unknown, level, least=0.1 * noise)
    found = []
    for group in groups:
        # A lamp that flickers by less than a tenth stays one level: the share of its change is taken out.
        steps = _clusters(group, level, lambda a, b: b - a <= 0.1 * max(b, 0.0) + 0.1 * noise)
        single = [i for step in steps if len(step) == 1 for i in step] if len(steps) > 1 else []
        found += [step for step in steps if step[0] not in single]
        # Falling light: neighbours still tell the noise, for the change of the light is taken out.
        found += _clusters(single, level, lambda a, b: b - a <= 0.4 * max(b, 0.0))
    return found


def _settings_of_a_lamp(
    members: list[int], level: Callable[[int], float], least: float
) -> Iterator[list[int]]:
    """Frames in order of their level, apart at steps that are wide beside the differences of the frames on both sides.

    A lamp that flickers has such a gap by chance: it is none if it is less than the range of either part. Nor is one between
    states that single frames alternate between: each setting has two frames or more in a row.

    Args:
        least: smallest step, DN.
    """
    order = sorted(members, key=level)
    levels = np.array([level(i) for i in order])
    times = np.argsort(np.argsort(order))  # among the members
    gaps = np.diff(levels)
    beside = np.maximum(gaps[:-2], gaps[2:])
    ends = np.flatnonzero(gaps[1:-1] > np.maximum(APART * beside, least)) + 2
    wide = [
        float(np.ptp(part)) if _is_in_runs(np.sort(time)) else np.inf
        for part, time in zip(np.split(levels, ends), np.split(times, ends), strict=True)
    ]
    ends = [end for end, *sides in zip(ends, wide, wide[1:], strict=False) if gaps[end - 1] > max(sides)]
    for low, high in pairwise([0, *ends, len(order)]):
        yield order[low:high]


def _is_in_runs(times: np.ndarray) -> bool:
    """Whether whole numbers, ascending, come in runs of two or more."""
    return min(len(run) for run in np.split(times, np.flatnonzero(np.diff(times) > 1) + 1)) > 1


def floor_dn(frames: FrameSet, facts: Sequence[Facts]) -> float:
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
    kinds, dark = [r.kind for r in frames.records], ("dark", "bias")
    lit = {i for i in range(1, len(kinds)) if kinds[i] in dark and kinds[i - 1] in ("flat", "scene")}
    others = [g for g in groups if g.kind in dark and set(g.indices) - lit]
    settings = {(g.gain_db, g.temperature_c) for g in others}
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
