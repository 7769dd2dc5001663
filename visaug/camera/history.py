"""The state of a camera before a frame: what its effects keep in `Context.memory`, over frames that are not simulated.

A share of a measured set starts in the middle of the camera's history. Nothing is assumed of an effect: how its state looks and
how long the camera remembers is found by taking a few small frames, so an effect of a user's own is treated like the catalogue's.

- A state that is one number for the whole frame (the drift of a lamp or of the black level) is stepped exactly: frames that are
  left out are taken with their own random numbers in a window of 2 x 2 pixels.
- A state of single pixels (held charge, traps) needs the frames before in full. So many of them are simulated that two
  histories, which differ in light and in chance, lead to the same frames within `FORGOTTEN`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from visaug.camera import Camera
from visaug.core.sampling import Stream, derive_key

SMALL = 2  # rows and columns of the window in which states of whole frames are stepped
FORGOTTEN = 1e-3  # share of the difference between two histories that may be left: of a lag of 5 % less than its noise in any mean
DEEPEST = 16  # frames before a used one that are simulated at most

Memory = dict[str, Tensor]


@dataclass(frozen=True)
class Reach:
    """What a camera remembers.

    Attributes:
        whole_frames: some state is one number for a whole frame.
        depth: frames before a used one that its pixels remember, 0 to `DEEPEST`.
    """

    whole_frames: bool
    depth: int

    @classmethod
    def of(cls, camera: Camera) -> "Reach":
        """Found by taking a few small frames with the camera, once for each."""
        if camera not in _found:
            _found[camera] = cls._by_trial(camera)
        return _found[camera]

    @classmethod
    def _by_trial(cls, camera: Camera) -> "Reach":
        memory: Memory = {}
        _take(camera, memory, [0.5], 0, min(SMALL, *camera.resolution))
        states = [is_of_whole_frame(state) for state in memory.values()]
        depth = 0
        if not all(states):
            depth = max(_forgotten_after(camera, level) for level in (0.0, 0.5))
        return cls(any(states), depth)

    def simulated(self, keep: Iterable[int], deepest: int = DEEPEST) -> list[int]:
        """The positions `keep`, and those before each that its pixels remember."""
        depth = min(self.depth, deepest)
        return sorted({i for k in keep for i in range(max(0, k - depth), k + 1)})


NOTHING = Reach(False, 0)  # of a camera without memory
_found: WeakKeyDictionary[Camera, Reach] = WeakKeyDictionary()


def is_of_whole_frame(state: Tensor) -> bool:
    """Whether a state is one number for all pixels of a frame."""
    return tuple(state.shape[-2:]) == (1, 1)


def _forgotten_after(camera: Camera, level: float) -> int:
    """Frames after which two histories, a bright one and a dark one, have led to the same frames."""
    probe = 48  # rows and columns of the window in which it is tried how long pixels remember
    size = min(probe, *camera.resolution)
    frames = []
    for before, seed in ((1.0, 1), (0.0, 2)):
        memory: Memory = {}
        _take(camera, memory, [before] * 2, seed, size)
        memory = {name: state for name, state in memory.items() if not is_of_whole_frame(state)}
        frames.append(_take(camera, memory, [level] * (DEEPEST + 1), 3, size))
    apart = (frames[0] - frames[1]).abs().mean((1, 2, 3))
    if float(apart.max()) == 0:
        return 0
    left = torch.flip(torch.cummax(torch.flip(apart, [0]), 0).values, [0])  # the most that is still to come
    return int((left > FORGOTTEN * apart.max()).sum().clamp(max=DEEPEST))


def _take(camera: Camera, memory: Memory, levels: Sequence[float], seed: int, size: int) -> Tensor:
    """Consecutive frames (n, 1, size, size), DN, of evenly lit pixels at shares of the camera's saturation."""
    keys = [derive_key(seed, "history", k) for k in range(len(levels))]
    stream = Stream(keys, [derive_key("history")] * len(keys), 1, (range(size), range(size)))
    light = torch.tensor(levels, dtype=torch.float32).view(-1, 1, 1, 1) * camera.spec.saturation_photons
    return camera.expose(light.expand(-1, 1, size, size), stream, sequence=True, memory=memory)
