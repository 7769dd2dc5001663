"""Frame sets that show the pixels of another one changed: shifted words, one colour of a mosaic."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from visaug.frames import FrameRecord, FrameSet


class _View:
    """A store of frames, and their clean targets, that changes each as it is read; `repair` sees the frames alone, and where
    they stand.
    """

    def __init__(
        self,
        frames: FrameSet,
        bit_depth: int | None,
        change: Callable[[np.ndarray], np.ndarray] = lambda frame: frame,
        repair: Callable[[np.ndarray, int], np.ndarray] = lambda frame, _: frame,
    ) -> None:
        self._frames, self.bit_depth, self._change, self._repair = frames, bit_depth, change, repair
        self.told_bits, self.warnings = frames.told_bits, frames.warnings

    def read(self, i: int) -> np.ndarray:
        return self._repair(self._change(self._frames.read(i)), i)

    numbers = read

    def clean(self, i: int) -> np.ndarray:
        return self._change(self._frames.clean(i))

    def path(self, i: int) -> Path | None:
        return None  # its pixels are in no file

    def shape(self, i: int) -> tuple[int, int]:
        return self._change(np.zeros(self._frames.shape(i), np.float32)).shape[:2]

    def with_bits(self, bit_depth: int) -> "_View":
        return _View(self._frames, bit_depth, self._change, self._repair)


def repaired(frames: FrameSet, repair: Callable[[np.ndarray, int], np.ndarray]) -> FrameSet:
    """The frames with values put in place by ``repair(frame, position)``; shapes stay."""
    return FrameSet(frames.records, _View(frames, frames.bit_depth, repair=repair))


def replaced(frame: np.ndarray, at: tuple[np.ndarray, ...], source: tuple[np.ndarray, ...]) -> np.ndarray:
    """The frame with the values of other pixels, at `source`, in the places `at`."""
    frame = frame.copy()
    frame[at] = frame[source]
    return frame


def cropped(frames: FrameSet, window: tuple[int, int, int, int]) -> FrameSet:
    """Rows r0 to r1 and columns c0 to c1 of every frame; even r0 and c0 leave the phase of a mosaic as it is."""
    r0, r1, c0, c1 = window

    def record(r: FrameRecord) -> FrameRecord:
        if r.window is None:
            return r
        top, _, left, _ = r.window
        return replace(r, window=(top + r0, top + r1, left + c0, left + c1))

    view = _View(frames, frames.bit_depth, lambda frame: frame[r0:r1, c0:c1])
    return FrameSet([record(r) for r in frames.records], view)


def shifted(frames: FrameSet, low: int) -> FrameSet:
    """Values without their lowest bits."""
    bits = None if frames.bit_depth is None else frames.bit_depth - low
    return FrameSet(frames.records, _View(frames, bits, lambda frame: frame / np.float32(1 << low)))


def colour_plane(frames: FrameSet, row: int, column: int) -> FrameSet:
    """The pixels of a mosaic at (row, column) of every 2 x 2, as a sensor of half the size."""

    def record(r: FrameRecord) -> FrameRecord:
        window = r.window and (r.window[0] // 2, r.window[1] // 2, r.window[2] // 2, r.window[3] // 2)
        return replace(r, bayer=None, window=window)

    view = _View(frames, frames.bit_depth, lambda frame: frame[row::2, column::2])
    return FrameSet([record(r) for r in frames.records], view)


def at_bits(frames: FrameSet, bit_depth: int | None) -> FrameSet:
    """The same pixels with another number of bits of the converter."""
    return frames if bit_depth == frames.bit_depth else FrameSet(frames.records, _View(frames, bit_depth))
