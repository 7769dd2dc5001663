"""Frame sets that show the pixels of another one changed: shifted words, one colour of a mosaic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from visaug.frames import FrameRecord, FrameSet


class _View:
    """A store of frames that changes each frame as it is read."""

    def __init__(
        self, frames: FrameSet, change: Callable[[np.ndarray], np.ndarray], bit_depth: int | None
    ) -> None:
        self._frames, self._change, self.bit_depth = frames, change, bit_depth
        self.told_bits = frames.told_bits
        self.warnings = frames.warnings

    def read(self, i: int) -> np.ndarray:
        return self._change(self._frames.read(i))

    def numbers(self, i: int) -> np.ndarray:
        return self.read(i)

    def clean(self, i: int) -> np.ndarray:
        return self._change(self._frames.clean(i))

    def path(self, i: int) -> Path | None:
        return None  # its pixels are in no file

    def shape(self, i: int) -> tuple[int, int]:
        return self._change(np.zeros(self._frames.shape(i), np.float32)).shape[:2]

    def with_bits(self, bit_depth: int) -> _View:
        return _View(self._frames, self._change, bit_depth)


class _Repaired(_View):
    """A store whose change of a frame depends on which frame it is."""

    def __init__(self, frames: FrameSet, change: Callable[[np.ndarray, int], np.ndarray]) -> None:
        super().__init__(frames, lambda frame: frame, frames.bit_depth)
        self._of = change

    def read(self, i: int) -> np.ndarray:
        return self._of(self._frames.read(i), i)

    def with_bits(self, bit_depth: int) -> _View:
        return _View(FrameSet(self._frames.records, self), lambda frame: frame, bit_depth)


def repaired(frames: FrameSet, change: Callable[[np.ndarray, int], np.ndarray]) -> FrameSet:
    """The frames with values put in place by ``change(frame, position)``; shapes stay."""
    return FrameSet(frames.records, _Repaired(frames, change))


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

    view = _View(frames, lambda frame: frame[r0:r1, c0:c1], frames.bit_depth)
    return FrameSet([record(r) for r in frames.records], view)


def shifted(frames: FrameSet, low: int) -> FrameSet:
    """Values without their lowest bits."""
    bits = None if frames.bit_depth is None else frames.bit_depth - low
    return FrameSet(frames.records, _View(frames, lambda frame: frame / np.float32(1 << low), bits))


def colour_plane(frames: FrameSet, row: int, column: int) -> FrameSet:
    """The pixels of a mosaic at (row, column) of every 2 x 2, as a sensor of half the size."""

    def record(r: FrameRecord) -> FrameRecord:
        window = r.window and (r.window[0] // 2, r.window[1] // 2, r.window[2] // 2, r.window[3] // 2)
        return replace(r, bayer=None, window=window)

    view = _View(frames, lambda frame: frame[row::2, column::2], frames.bit_depth)
    return FrameSet([record(r) for r in frames.records], view)


def at_bits(frames: FrameSet, bit_depth: int | None) -> FrameSet:
    """The same pixels with another number of bits of the converter."""
    if bit_depth == frames.bit_depth:
        return frames
    return FrameSet(frames.records, _View(frames, lambda frame: frame, bit_depth))
