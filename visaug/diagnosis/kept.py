"""Simulated sets of a camera that are kept, so that of similar cameras only what differs is simulated.

The random numbers of an effect depend on the seed, the effect's name and the place alone. Two cameras therefore give the same
signal up to the first effect in which they differ, and again after the last, in every frame in which that effect left all
pixels as they were. Nothing is assumed of an effect: what it reads of the conditions is recorded while the first camera is
simulated, and frames are compared bit by bit.

A camera whose effects remember frames, or ask whether frames follow each other, is simulated as a whole.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from visaug.camera import Camera, chain
from visaug.camera.chain import parameters_of
from visaug.camera.simulation import batches, conditions, light, simulate, window_of
from visaug.effects import Context, Effect, Stage
from visaug.frames import FrameSet
from visaug.statistics import Stacks

MEMORY = 512 * 2**20  # bytes of all kept sets
NUMBERS = 8  # sets of one camera that are kept: as many as a trial or a derivative is simulated with
BASES = 4  # kept cameras that are looked at for the one from which least is to be simulated
STAGES = (Stage.CHARGE, Stage.READOUT, Stage.DIGITAL)  # the signal before each is kept

Fields = dict[str, set[str]]


class _Read(Context):
    """Conditions that note which of them are read."""

    def __getattribute__(self, name: str) -> Any:
        if not name.startswith("__"):
            object.__getattribute__(self, "__dict__")["_noted"].add(name)
        return object.__getattribute__(self, name)


class Remembers(Exception):
    """Some effect depends on other frames."""


class KeptSet:
    """One simulated set of a camera: its frames, and the signal before some of the stages.

    Attributes:
        frames: (H, W) uint16 DN by position in the plan.
        signals: by the number of effects that have acted and by position, (H, W).
        reads: fields of `Context` that each effect reads.
        stacks: sums of the frames.
        maps: random numbers of the camera itself.
        remembers: whether some effect depends on other frames; nothing else is kept then.
    """

    def __init__(self, camera: Camera):
        self.camera = camera
        self.effects = sensor_chain(camera)
        self.frames: dict[int, np.ndarray] = {}
        self.signals: dict[int, dict[int, np.ndarray]] = {}
        self.reads: Fields = {effect.name: set() for effect in self.effects}
        self.stacks: Stacks | None = None
        self.maps: dict[tuple, Tensor] = {}
        self.remembers = False

    @cached_property
    def size(self) -> int:
        """Bytes, once the set has been simulated."""
        parts = [self.frames, *self.signals.values()]
        maps = sum(m.numel() * m.element_size() for m in self.maps.values())
        return sum(a.nbytes for part in parts for a in part.values()) + maps

    def take(
        self, plan: FrameSet, seed: int, keep: Sequence[int], deepest: int, strict: bool = False
    ) -> FrameSet:
        """Simulates the frames `keep` of the plan as `simulate` does, and keeps them.

        Args:
            strict: raises Remembers where frames depend on others; else all are simulated and none is kept.
        """
        marks = {n for stage in STAGES if 0 < (n := _before(self.effects, stage)) < len(self.effects)}
        self.signals = {n: {} for n in marks}
        try:
            for positions in batches(self.camera, plan, keep):
                self._batch(plan, seed, positions)
        except Remembers:
            self.__init__(self.camera)
            self.remembers = True
            if strict:
                raise
            return simulate(self.camera, plan, seed, keep=keep, deepest=deepest)
        return _as_set(self.camera, plan, keep, self.frames)

    def _batch(self, plan: FrameSet, seed: int, positions: Sequence[int]) -> None:
        run = _Run(self.camera, plan, seed, positions, self.maps)
        acted = 0

        def watch(effect: Effect, signal: Tensor) -> None:
            nonlocal acted
            acted += 1
            self.reads[effect.name] |= run.noted()
            if acted in self.signals:
                exact = _compact(signal)
                self.signals[acted] |= dict(zip(positions, exact, strict=True))

        dn = run.through(self.effects, light(plan, positions, run.window), watch)
        self.frames |= dict(zip(positions, dn[:, 0].numpy().astype(np.uint16), strict=True))

    def shared(self, camera: Camera) -> int:
        """How many effects at the beginning of the chain another camera has alike, by its parameters."""
        count = 0
        for one, other in zip(self.effects, sensor_chain(camera), strict=False):
            if not _alike(one, self.camera, other, camera):
                break
            count += 1
        return count

    def changed(
        self,
        camera: Camera,
        plan: FrameSet,
        seed: int,
        keep: Sequence[int],
        deepest: int,
        strict: bool = False,
    ) -> tuple[FrameSet, set[int]]:
        """The frames `keep` as another camera takes them with the same seed, and the positions where these differ.

        Args:
            strict: raises Remembers where frames depend on others; else all are simulated.
        """
        known = [i for i in keep if i in self.frames]
        try:
            frames = self._changed(camera, plan, seed, known)
        except Remembers:
            if strict:
                raise
            return simulate(camera, plan, seed, keep=keep, deepest=deepest), set(keep)
        if len(known) < len(keep):
            missing = [i for i in keep if i not in self.frames]
            taken = simulate(camera, plan, seed, keep=missing, deepest=deepest)
            frames |= {i: taken.stack([k])[0] for k, i in enumerate(missing)}
        touched = set(frames)
        return _as_set(camera, plan, keep, self.frames | frames), touched

    def _changed(
        self, camera: Camera, plan: FrameSet, seed: int, keep: Sequence[int]
    ) -> dict[int, np.ndarray]:
        """The frames that differ, by position."""
        found: dict[int, np.ndarray] = {}
        for positions in batches(camera, plan, keep):
            found |= self._changed_batch(camera, plan, seed, positions)
        return found

    def _changed_batch(
        self, camera: Camera, plan: FrameSet, seed: int, positions: Sequence[int]
    ) -> dict[int, np.ndarray]:
        maps = dict(self.maps)
        run = _Run(camera, plan, seed, positions, maps)
        given = _Run(self.camera, plan, seed, positions, maps)
        effects = sensor_chain(camera)
        first, last = self._difference(camera, effects, run, given)
        if first == len(effects) == len(self.effects):
            return {}
        longer = len(effects) - len(self.effects)
        start = max((n for n in self.signals if n <= first), default=0)
        at = _stacked(self.signals[start], positions) if start else light(plan, positions, run.window)
        signal = run.through(effects[start:first], at)
        if last == first + 1 and longer == 1:  # one effect more: what it leaves as it is goes on as before
            added = run.through(effects[first:last], signal)
            positions, signal = _apart(positions, added, signal)
        else:
            signal = run.through(effects[first:last], signal)
        done = last
        for mark in sorted(n + longer for n in self.signals if n + longer >= last):
            if not positions:
                return {}
            run = run.of(positions)
            signal = run.through(effects[done:mark], signal)
            if effects[mark - 1].stage < Stage.READOUT:  # noise of the read-out hides no difference
                positions, signal = _apart(
                    positions, signal, _stacked(self.signals[mark - longer], positions)
                )
            done = mark
        if not positions:
            return {}
        dn = run.of(positions).through(effects[done:], signal)[:, 0].numpy().astype(np.uint16)
        return {
            i: frame
            for i, frame in zip(positions, dn, strict=True)
            if not np.array_equal(frame, self.frames[i])
        }

    def _difference(
        self, camera: Camera, effects: Sequence[Effect], run: _Run, given: _Run
    ) -> tuple[int, int]:
        """Of the other camera's chain, the first effect that acts differently here, and the one behind the last."""

        def same(own: Effect, other: Effect) -> bool:
            read = self.reads[own.name]
            return _alike(own, self.camera, other, camera) and all(run.has(given, field) for field in read)

        first = 0
        while first < min(len(effects), len(self.effects)) and same(self.effects[first], effects[first]):
            first += 1
        behind = 0
        most = min(len(effects), len(self.effects)) - first
        while behind < most and same(self.effects[-1 - behind], effects[-1 - behind]):
            behind += 1
        return first, len(effects) - behind


class _Run:
    """A camera, and the conditions and random numbers of some frames of the plan."""

    def __init__(
        self, camera: Camera, plan: FrameSet, seed: int, positions: Sequence[int], maps: dict[tuple, Tensor]
    ):
        self._of = camera, plan, seed, maps
        self.positions = list(positions)
        self.window = window_of(camera, plan.records[positions[0]])
        self.stream, values = conditions(camera, plan, positions, seed, self.window, maps)
        self.memory: dict[str, Tensor] = {}
        self.numbers, self.context = camera.prepared(self.stream, values, sequence=True, memory=self.memory)
        self.choices = camera.choices()
        self._noted: set[str] = set()
        vars(self.context)["_noted"] = self._noted
        self.context.__class__ = _Read

    def of(self, positions: Sequence[int]) -> _Run:
        """The same for some of the frames."""
        if list(positions) == self.positions:
            return self
        camera, plan, seed, maps = self._of
        return _Run(camera, plan, seed, positions, maps)

    def noted(self) -> set[str]:
        """What was read of the conditions since the last call."""
        noted = {name for name in self._noted if name in Context.__dataclass_fields__}
        self._noted.clear()
        return noted

    def has(self, other: _Run, field: str) -> bool:
        """Whether another camera has the same of a condition."""
        return _equal(vars(self.context)[field], vars(other.context)[field])

    def through(
        self,
        effects: Sequence[Effect],
        signal: Tensor,
        watch: Callable[[Effect, Tensor], None] | None = None,
    ) -> Tensor:
        """The signal after some of the effects."""
        if not effects:
            return signal
        with torch.no_grad():
            signal = chain.expose(
                list(effects), signal, self.numbers, self.choices, self.stream, self.context, watch
            )
        if self.memory or "sequence" in self._noted:
            raise Remembers
        return signal


class KeptSets:
    """The sets that are kept, by camera, number of the simulation and part.

    Args:
        memory: bytes of all of them at most.
    """

    def __init__(self, memory: int = MEMORY) -> None:
        self.memory = memory
        self._sets: dict[Camera, dict[tuple[int, int], KeptSet]] = {}
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple:
        return KeptSets, (self.memory,)  # another process keeps its own

    def wants(self, camera: Camera, number: int) -> bool:
        """Whether a set of this camera is to be kept."""
        return number < NUMBERS and camera in self._sets

    def announce(self, camera: Camera) -> None:
        """Sets of this camera will be kept, in place of those that have not been used for longest."""
        with self._lock:
            self._sets[camera] = self._sets.pop(camera, {})
            for old in list(self._sets)[:-BASES]:
                del self._sets[old]

    def nearest(self, camera: Camera, number: int, part: int) -> KeptSet | None:
        """The kept set of this number from which least is to be simulated."""
        with self._lock:
            there = [sets[number, part] for sets in self._sets.values() if (number, part) in sets]
            found = max(there, key=lambda kept: kept.shared(camera), default=None)
            if found is not None:  # the last is given up last
                self._sets[found.camera] = self._sets.pop(found.camera)
        return found

    def add(self, kept: KeptSet, number: int, part: int) -> None:
        """Keeps a set that was filled, if there is room for it."""
        with self._lock:
            if kept.remembers:
                self._sets.pop(kept.camera, None)
            mine = self._sets.get(kept.camera)
            if mine is None:
                return
            total = kept.size + sum(one.size for sets in self._sets.values() for one in sets.values())
            for camera, sets in self._sets.items():
                if total > self.memory and camera is not kept.camera:
                    total -= sum(one.size for one in sets.values())
                    sets.clear()
            if total <= self.memory:
                mine[number, part] = kept


def sensor_chain(camera: Camera) -> list[Effect]:
    """The effects that frames have gone through."""
    return [effect for effect in camera.effects if effect.stage != Stage.PICTURE]


def _before(effects: Sequence[Effect], stage: Stage) -> int:
    """How many effects act before all that remain are of a stage or of later ones."""
    earlier = [n for n, effect in enumerate(effects) if effect.stage < stage]
    return max(earlier, default=-1) + 1


def _alike(one: Effect, own: Camera, other: Effect, camera: Camera) -> bool:
    """Whether two cameras have the same effect with the same parameters."""
    if type(one) is not type(other):
        return False
    mine, yours = (
        vars(parameters_of(effect, _Numbers(of), of.choices()))
        for effect, of in ((one, own), (other, camera))
    )
    return mine == yours


class _Numbers(dict):
    """The numbers of a camera by path."""

    def __init__(self, camera: Camera):
        super().__init__(camera.values())


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, Tensor):
        return isinstance(other, Tensor) and torch.equal(one, other)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(_equal(one[key], other[key]) for key in one)
    return one == other


def _apart(positions: Sequence[int], signal: Tensor, given: Tensor) -> tuple[list[int], Tensor]:
    """The frames whose signal differs in any bit that counts, and that signal."""
    differ = [k for k in range(len(positions)) if not torch.equal(signal[k], given[k])]
    return [positions[k] for k in differ], signal if len(differ) == len(positions) else signal[differ]


def _compact(signal: Tensor) -> np.ndarray:
    """(B, H, W), uint16 where that holds every value exactly."""
    values = signal[:, 0].numpy()
    if signal.numel() and values.min() >= 0 and values.max() < 2**16:
        whole = values.astype(np.uint16)
        if np.array_equal(whole, values) and not np.signbit(values).any():
            return whole
    return values.copy()


def _stacked(kept: Mapping[int, np.ndarray], positions: Sequence[int]) -> Tensor:
    return torch.from_numpy(np.stack([kept[i] for i in positions]).astype(np.float32))[:, None]


def _as_set(
    camera: Camera, plan: FrameSet, keep: Sequence[int], frames: Mapping[int, np.ndarray]
) -> FrameSet:
    cleans = {
        str(plan.records[i].clean): plan.clean(i)
        for i in keep
        if plan.records[i].kind == "scene" and plan.records[i].clean
    }
    records = [plan.records[i] for i in keep]
    return FrameSet.from_arrays(records, [frames[i] for i in keep], cleans, bit_depth=camera.bit_depth)
