"""Frames, or a window of them, that are measured, and simulated as a part of the sequence in which they were taken."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from visaug.camera import Camera
from visaug.camera.history import DEEPEST, NOTHING, Reach
from visaug.camera.simulation import exposures, has_clean
from visaug.core.errors import InputError
from visaug.core.recurrent import Recurrent
from visaug.diagnosis.names import digest
from visaug.diagnosis.unknown_light import UnmeasuredLight, levels_of, photons_of
from visaug.frames import FrameRecord, FrameSet
from visaug.frames.frameset import simulated_set
from visaug.statistics import (
    IN_A_WINDOW,
    OF_FULL_FRAMES,
    VIEWS,
    Fingerprint,
    View,
    fingerprint,
    fingerprint_values,
)
from visaug.statistics.reduction import used_groups
from visaug.statistics.split import CONFIRM, FIND, WHOLE, Folds, share_out
from visaug.statistics.subsample import MARGIN, Selection, Window

Report = Callable[[str, int, int], None]
LIGHT = 0  # seed of the simulations from which unknown light follows
FULL_DEEPEST = 3  # full frames that are simulated before one that is used, at most: each costs as much as it


class Shared(NamedTuple):
    """What simulated sets of one seed have in common: they share random numbers, so that cameras that differ in one effect
    differ from the stage on where it acts, in the frames that it touches.

    Attributes:
        signals: of frames on their way through the camera.
        stacks: what frames of equal conditions are reduced to.
    """

    signals: Recurrent
    stacks: Recurrent

    @classmethod
    def empty(cls) -> Shared:
        most = 32 * 2**20  # bytes of each
        return cls(Recurrent(most), Recurrent(most))


@dataclass(frozen=True)
class MeasuredFrames:
    """Measured frames, and the plan of the sequence to simulate them from.

    Attributes:
        frames: the measured frames.
        folds: which of them do what.
        plan: the frames of the sequence, without pixels; each with the window that is simulated, a margin wider than the frames.
        keep: positions in the plan of the frames.
        views: through which both are looked at.
        place: part of the sensor that the frames show, as text; empty if there is only one.
        deepest: frames before a used one that are simulated at most.
        levels: flats whose photons are not known.
    """

    frames: FrameSet
    folds: Folds
    plan: FrameSet
    keep: tuple[int, ...]
    views: tuple[View, ...]
    place: str = ""
    deepest: int = DEEPEST
    levels: tuple[UnmeasuredLight, ...] = ()

    def positions(self, use: str) -> tuple[int, ...]:
        """Of the discovery frames, of the hold-out frames, or of all."""
        return {
            FIND: self.folds.find,
            CONFIRM: self.folds.confirm,
            WHOLE: tuple(range(len(self.frames))),
        }[use]

    @property
    def halves(self) -> bool:
        """Whether the statistics of all frames are the means of those that find and those that confirm.

        Full frames cost most, so that they are not measured a third time. Both must have the same statistics: the same
        conditions, and noise of each where the other has it.
        """
        find, confirm = (
            [
                (replace(g, indices=()), len(g.indices) > 1)
                for g in used_groups(self.frames, self.positions(use))
            ]
            for use in (FIND, CONFIRM)
        )
        return bool(self.place) and find == confirm

    def measured(self, use: str) -> Fingerprint:
        if use == WHOLE and self.halves:
            find, confirm = self.measured(FIND), self.measured(CONFIRM)
            return replace(find, values=(find.values + confirm.values) / 2)
        return fingerprint(self.frames, self.positions(use), self.views, self.place)

    def simulated(self, camera: Camera, seed: int, uses: Sequence[str], shared: Shared) -> list[np.ndarray]:
        """Fingerprint values of one simulated set, for each use of its frames.

        Args:
            shared: what sets of this seed have in common.
        """
        own = [use for use in uses if use != WHOLE or not self.halves]
        positions = [self.positions(use) for use in own]
        frames = self._taken(camera, seed, sorted(self._looked_at(own)), shared.signals)
        found = fingerprint_values(frames, positions, self.views, shared.stacks)
        values = dict(zip(own, found, strict=True))
        if WHOLE in uses and self.halves:
            values[WHOLE] = (values[FIND] + values[CONFIRM]) / 2
        return [values[use] for use in uses]

    def _looked_at(self, uses: Sequence[str]) -> frozenset[int]:
        """Positions that statistics are taken from, and those before them under other conditions (see the view of memory)."""
        used = frozenset().union(*(self.positions(use) for use in uses))
        if self.place or len(used) == len(self.frames):  # no view of full frames looks at the frame before
            return used
        group = {i: k for k, g in enumerate(self.frames.groups()) for i in g.indices}
        place = {record.sequence: i for i, record in enumerate(self.frames.records)}
        before = {i: place.get(self.frames.records[i].sequence - 1) for i in used}
        return used | {b for i, b in before.items() if b is not None and group[b] != group[i]}

    def _taken(self, camera: Camera, seed: int, wanted: Sequence[int], signals: Recurrent) -> FrameSet:
        """The set with simulated frames at some positions and no pixels at others."""
        every = range(len(self.frames))
        if len(wanted) < len(every) and Reach.of(camera) != NOTHING and not self.place:
            wanted = every  # frames depend on those before
        frames = [np.zeros((1, 1), np.uint16)] * len(self.frames)
        for k, frame in zip(wanted, self._pixels(camera, seed, wanted, signals), strict=True):
            frames[k] = frame
        in_range = not camera.has_own_effects
        return simulated_set(self.frames.records, frames, self._cleans(every), camera.bit_depth, in_range)

    def take(self, camera: Camera, seed: int, only: Iterable[int] | None = None) -> FrameSet:
        """The frames, or those of them at some positions in rising order, as a camera would take them."""
        wanted = list(range(len(self.frames)) if only is None else only)
        records = [self.frames.records[k] for k in wanted]
        frames = self._pixels(camera, seed, wanted)
        in_range = not camera.has_own_effects
        return simulated_set(records, frames, self._cleans(wanted), camera.bit_depth, in_range)

    def _pixels(
        self, camera: Camera, seed: int, wanted: Sequence[int], signals: Recurrent | None = None
    ) -> list[np.ndarray]:
        """Simulated frames, (H, W) uint16, without the margin around their windows."""
        return self._exposed(camera, self._lit(camera), seed, wanted, signals)

    def _exposed(
        self,
        camera: Camera,
        plan: FrameSet,
        seed: int,
        wanted: Sequence[int],
        signals: Recurrent | None = None,
    ) -> list[np.ndarray]:
        """The same of another plan."""
        keep = [self.keep[k] for k in wanted]
        blocks = exposures(camera, plan, seed, keep, self.deepest, signals)
        frames = [frame for _, block in blocks for frame in block.squeeze(1).numpy().astype(np.uint16)]
        shown = [
            (self.plan.records[i].window, self.frames.records[k].window)
            for i, k in zip(keep, wanted, strict=True)
        ]
        return [
            frame if wider == window else _cut(frame, wider or (0, frame.shape[0], 0, frame.shape[1]), window)
            for frame, (wider, window) in zip(frames, shown, strict=True)
        ]

    def _lit(self, camera: Camera) -> FrameSet:
        """The plan with the photons of a camera where they are not known."""
        if not self.levels:
            return self.plan
        name = digest(
            camera.to_dict(), [(key, values.numpy().tobytes()) for key, values in camera.maps.items()]
        )
        if name not in self._lights:
            self._lights[name] = photons_of(camera, self.levels, self._simulated_levels)
        return self._with_light(self._lights[name])

    @cached_property
    def _lights(self) -> dict[str, list[float]]:
        """Photons of the levels, by camera."""
        return {}

    def _simulated_levels(self, camera: Camera, photons: Sequence[float]) -> np.ndarray:
        wanted = sorted({k for level in self.levels for k in level.shown})
        frames = self._exposed(camera, self._with_light(photons), LIGHT, wanted)
        means = {k: float(frame.mean(dtype=np.float64)) for k, frame in zip(wanted, frames, strict=True)}
        return np.array([np.mean([means[k] for k in level.shown]) for level in self.levels])

    def _with_light(self, photons: Sequence[float]) -> FrameSet:
        lit = {i: p for level, p in zip(self.levels, photons, strict=True) for i in level.planned}
        records = self.plan.records
        return self.plan.with_records(
            [replace(r, photons=lit[i]) if i in lit else r for i, r in enumerate(records)]
        )

    def _cleans(self, positions: Iterable[int]) -> dict[str, np.ndarray]:
        records = self.frames.records
        return {
            str(records[k].clean): self.frames.clean(k)
            for k in positions
            if records[k].kind == "scene" and records[k].clean
        }

    def identity(self) -> tuple:
        """What a simulation depends on, as something that prints as what it is."""
        return _identity(self.frames), _identity(self.plan), self.keep, self.deepest, self.folds, self.levels

    def without_pixels(self) -> MeasuredFrames:
        """The same for simulations alone, which may go to another machine."""
        every = range(len(self.frames))
        unread = [np.zeros((1, 1), np.uint16)] * len(self.frames)
        planned = FrameSet.from_arrays(
            self.frames.records, unread, self._cleans(every), bit_depth=self.frames.bit_depth
        )
        return replace(self, frames=planned)


def parts_of(
    frames: FrameSet,
    selection: Selection,
    folds: bool = True,
    report: Report | None = None,
    unknown: frozenset[int] = frozenset(),
) -> tuple[MeasuredFrames, ...]:
    """What is measured of a set: its frames, or windows of them and full frames.

    Args:
        folds: False takes all frames as ones that find.
        report: called with (description, done, total) while frames are read.
        unknown: sequence numbers of the flats whose photons are not known; their records have those that were assumed.
    """

    def part(
        shown: FrameSet, folds: Folds, plan: FrameSet, keep: tuple[int, ...], views: tuple[View, ...]
    ) -> MeasuredFrames:
        return MeasuredFrames(shown, folds, plan, keep, views, levels=levels_of(shown, plan, keep, unknown))

    if selection.is_all:
        kept = tuple(range(len(frames)))
        shared = share_out(frames) if folds else Folds(kept, (), ())
        return (part(_held(frames, report), shared, _plan(frames, kept, kept, None, 0), kept, VIEWS),)
    sequence = _known(frames, selection)
    place = {i: k for k, i in enumerate(sequence)}
    keep = tuple(place[i] for i in selection.frames)
    taken = _read(frames, selection.frames, selection.window, report)
    shared = share_out(taken) if folds else Folds(tuple(range(len(taken))), (), ())
    wider = selection.window and _wider(selection.window, *selection.size)
    first = part(
        taken,
        shared,
        _plan(frames, sequence, keep, wider, DEEPEST),
        keep,
        VIEWS if wider is None else IN_A_WINDOW,
    )
    if selection.window is None:
        return (first,)
    keep = tuple(place[i] for i in selection.full_frames)
    own = {i: k for k, i in enumerate(selection.full_frames)}
    shared = Folds(
        tuple(own[i] for i in selection.full.fit), (), tuple(own[i] for i in selection.full.confirm)
    )
    full = part(
        _read(frames, selection.full_frames, None, report),
        shared if folds else Folds(tuple(range(len(keep))), (), ()),
        _plan(frames, sequence, keep, None, FULL_DEEPEST),
        keep,
        OF_FULL_FRAMES,
    )
    return first, replace(full, place="full frames", deepest=FULL_DEEPEST)


def _identity(frames: FrameSet) -> tuple:
    cleans = {}
    for i, record in enumerate(frames.records):
        if record.kind == "scene" and record.clean not in cleans and has_clean(frames, i):
            pixels = np.ascontiguousarray(frames.clean(i)).tobytes()
            cleans[record.clean] = hashlib.blake2b(pixels, digest_size=8).hexdigest()
    shapes = tuple(frames.shape(i) for i in range(len(frames)))
    records = tuple(
        (r.sequence, r.kind, r.exposure_s, r.temperature_c, r.gain_db, r.photons, r.clean, r.window)
        for r in frames.records
    )
    return records, shapes, cleans


def _known(frames: FrameSet, selection: Selection) -> list[int]:
    """The frames of the sequence that can be simulated: of the window that is used, with light that is known."""
    window = frames.records[selection.frames[0]].window
    return [
        i
        for i, r in enumerate(frames.records)
        if r.window == window and r.kind != "image" and (r.kind != "scene" or r.clean)
    ]


def _held(frames: FrameSet, report: Report | None) -> FrameSet:
    """All frames in memory, as they are looked at several times."""
    pixels, cleans = [], {}
    for i, record in enumerate(frames.records):
        pixels.append(_compact(frames.stack([i])[0]))
        if record.kind == "scene" and record.clean and record.clean not in cleans:
            cleans[record.clean] = frames.clean(i)
        if report is not None:
            report("reading frames", i + 1, len(frames))
    return FrameSet.from_arrays(frames.records, pixels, cleans, bit_depth=frames.bit_depth)


def _compact(frame: np.ndarray) -> np.ndarray:
    """The frame as uint16 where that holds every pixel exactly."""
    if frame.dtype != np.uint16 and frame.max() < 2**16:
        whole = frame.astype(np.uint16)
        return whole if np.array_equal(whole, frame) else frame
    return frame


def _read(
    frames: FrameSet, positions: Sequence[int], window: Window | None, report: Report | None
) -> FrameSet:
    """The measured frames, or a window of each, in memory."""
    size = frames.shape(positions[0])
    records, pixels, cleans = [], [], {}
    word = "reading frames" if window is None else "reading windows of frames"
    for k, i in enumerate(positions):
        record, frame = frames.records[i], _compact(frames.stack([i])[0])
        if report is not None:
            report(word, k + 1, len(positions))
        if frame.shape != size:
            raise InputError(
                "is {} x {}".format(*frame.shape),
                file=record.file,
                field="region",
                expected="{} x {} as the other frames, or a `region` with the window of the sensor".format(
                    *size
                ),
            )
        records.append(_shown(record, window))
        pixels.append(frame if window is None else _cut(frame, (0, size[0], 0, size[1]), window))
        if record.kind == "scene" and record.clean not in cleans:
            cleans[record.clean] = _part(frames.clean(i), window)
    return FrameSet.from_arrays(records, pixels, cleans, bit_depth=frames.bit_depth)


def _plan(
    frames: FrameSet, sequence: Sequence[int], keep: Sequence[int], window: Window | None, deepest: int
) -> FrameSet:
    """The sequence without its pixels; targets only of scenes that may be simulated."""
    near = {k - d for k in keep for d in range(deepest + 1)}
    records, cleans = [], {}
    for k, i in enumerate(sequence):
        record = frames.records[i]
        records.append(_shown(record, window))
        if record.kind == "scene" and record.clean and k in near and record.clean not in cleans:
            cleans[record.clean] = _part(frames.clean(i), window)
    unread = [np.zeros((1, 1), np.uint16)] * len(records)
    return FrameSet.from_arrays(records, unread, cleans, bit_depth=frames.bit_depth)


def _shown(record: FrameRecord, window: Window | None) -> FrameRecord:
    """The record of a window of a frame; the window counts from the frame's own corner."""
    if window is None:
        return record
    top, left = (record.window[0], record.window[2]) if record.window else (0, 0)
    return replace(record, window=(top + window[0], top + window[1], left + window[2], left + window[3]))


def _wider(window: Window, rows: int, columns: int) -> Window:
    r0, r1, c0, c1 = window
    return max(0, r0 - MARGIN), min(rows, r1 + MARGIN), max(0, c0 - MARGIN), min(columns, c1 + MARGIN)


def _part(image: np.ndarray, window: Window | None) -> np.ndarray:
    if window is None:
        return image
    return np.ascontiguousarray(image[window[0] : window[1], window[2] : window[3]])


def _cut(image: np.ndarray, shows: Window, window: Window | None) -> np.ndarray:
    """The window out of an image that shows a wider one."""
    if window is None:
        return image
    r0, r1, c0, c1 = window
    top, _, left, _ = shows
    return np.ascontiguousarray(image[r0 - top : r1 - top, c0 - left : c1 - left])
