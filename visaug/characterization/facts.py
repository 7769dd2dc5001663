"""What one look at each frame's pixels tells before frames are grouped."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visaug.core.constants import MAD
from visaug.core.errors import InputError
from visaug.frames import FrameSet
from visaug.statistics.kernels import median_of

PLACES = ((0, 0), (0, 1), (1, 0), (1, 1))  # of a 2 x 2


@dataclass(frozen=True)
class Facts:
    """Of one frame."""

    mean: float  # mean level, DN
    noise: float  # robust standard deviation of single pixels about their neighbours, DN
    largest: float  # largest value, DN
    at_largest: float  # share of the pixels that have it
    bits: int | None  # bitwise or of all values; None where a value is no whole number
    # mean of the pixels at (0, 0), (0, 1), (1, 0), (1, 1) of every 2 x 2, DN
    phases: tuple[float, float, float, float]


def look(frames: FrameSet) -> list[Facts]:
    """Facts of every frame, in one pass that holds one frame; InputError where sizes differ and no window is stated."""
    found: list[Facts] = []
    first: tuple[tuple[int, ...], str] | None = None
    for i, record in enumerate(frames.records):
        frame = frames.read(i)
        if record.window is None:
            size, whose = first = first or (frame.shape, record.file)
            if frame.shape != size:
                problem = f"frames differ in size: this one is {frame.shape[0]} x {frame.shape[1]}"
                expected = f"{size[0]} x {size[1]} as {whose}, or a window in its record"
                raise InputError(problem, file=record.file, expected=expected)
        largest = float(frame.max())
        whole = frame.astype(np.min_scalar_type(int(largest)))  # small numbers are quick
        colours = [frame[r::2, c::2] for r, c in PLACES]
        found.append(Facts(
            mean=float(frame.mean(dtype=np.float64)),
            noise=_noise(frame),
            largest=largest,
            at_largest=float(np.count_nonzero(frame == largest) / frame.size),
            bits=int(np.bitwise_or.reduce(whole, axis=None)) if (whole == frame).all() else None,
            # pyrefly: ignore[bad-argument-type]
            phases=tuple(float(v.mean(dtype=np.float64)) if v.size else 0.0 for v in colours),
        ))  # fmt: skip
    return found


def _noise(frame: np.ndarray) -> float:
    """From second neighbours, which a mosaic's colours share."""
    if frame.shape[1] < 4:
        return float(frame.std(dtype=np.float64))
    difference = frame[::4, 2:] - frame[::4, :-2]
    return float(MAD * median_of(np.abs(difference - median_of(difference))) / np.sqrt(2))


def temporal_variances(frames: FrameSet, indices: Sequence[int]) -> np.ndarray:
    """Temporal variance of each of three or more frames by itself, DN^2 (n,).
    The variances of the differences of three frames, D_ab = v_a + v_b and so on, tell that of each: v_a = (D_ab + D_ac - D_bc) / 2.
    """
    n = len(indices)
    steps = np.empty(n)  # between neighbours, cyclic
    leaps = np.empty(n)  # between a frame's two neighbours
    before, here = (frames.read(indices[k]).astype(np.float64) for k in (0, 1))
    for k in range(1, n + 1):
        following = frames.read(indices[(k + 1) % n]).astype(np.float64)
        steps[k - 1], leaps[k % n] = np.var(here - before), np.var(following - before)
        before, here = here, following
    return 0.5 * (steps + np.roll(steps, 1) - leaps)
