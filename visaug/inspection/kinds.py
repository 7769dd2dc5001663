"""What kind each frame is: by headers and tables, by names, else by its level and structure."""

from __future__ import annotations

import numpy as np

from visaug.frames import FrameSet
from visaug.frames.names import facts_of_name
from visaug.statistics.reduction import block_means, edges

_CELL = 4  # px
_STRUCTURED = 12.0  # variance of means of cells over that of independent pixels; filters reach 9
_MANY = 0.2  # of the blocks, that show a scene
_LIT = 0.25  # of the largest code, from which uniform frames are taken for flats
_BLOCK = 16  # px


def kinds_of(frames: FrameSet) -> tuple[list[str], str]:
    """The kind of each frame, and by what it was told."""
    if not frames.is_pictures:
        return [r.kind for r in frames.records], "the table or headers"
    named = [facts_of_name(r.file.partition("#")[0]).get("kind") for r in frames.records]
    unknown = [i for i, kind in enumerate(named) if kind is None]
    if not unknown:
        return [str(kind) for kind in named], "the file names"
    by_level = _by_level(frames, unknown)
    kinds = [str(kind or by_level[i]) for i, kind in enumerate(named)]
    return kinds, "level and structure" if len(unknown) == len(
        named
    ) else "file names, else level and structure"


def _by_level(frames: FrameSet, unknown: list[int]) -> dict[int, str]:
    top = float((1 << (frames.bit_depth or 16)) - 1)
    least = 1023.0 if frames.bit_depth == 16 else 255.0  # no converter of 8 bits fills 16
    found: dict[int, str] = {}
    before: np.ndarray | None = None
    for i in unknown:
        frame = frames.read(i)
        highest = max(float(np.quantile(frame, 0.9999)), 1.0)
        scale = next((b for b in (255.0, 1023.0, 4095.0, 16383.0, 65535.0) if b >= max(highest, least)), top)
        if _shows_a_scene(frame):
            still = before is not None and before.shape == frame.shape and _same(before, frame)
            found[i] = "scene" if still else "image"
            if still:
                found.update({k: "scene" for k in found if found[k] == "image" and k == i - 1})
            before = frame
        else:
            found[i] = "flat" if float(np.median(frame)) > _LIT * scale else "dark"
    return found


def _shows_a_scene(frame: np.ndarray) -> bool:
    """Whether many blocks have structure coarser than noise that is neither of a row nor of a column."""
    rows, columns = (n // _BLOCK * _BLOCK for n in frame.shape)
    if not rows or not columns:
        return False
    part = frame[:rows, :columns].astype(np.float64)
    blocks = part.reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK).transpose(0, 2, 1, 3)
    blocks = (
        blocks
        - blocks.mean(3, keepdims=True)
        - blocks.mean(2, keepdims=True)
        + blocks.mean((2, 3), keepdims=True)
    )
    cells = blocks.reshape(*blocks.shape[:2], _BLOCK // _CELL, _CELL, _BLOCK // _CELL, _CELL).mean((3, 5))
    inner = blocks - np.repeat(np.repeat(cells, _CELL, 2), _CELL, 3)
    coarse, fine = cells.var((2, 3)) * _CELL**2, inner.var((2, 3)) + 1 / 12
    return bool((coarse > _STRUCTURED * fine).mean() > _MANY)


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two frames show the same scene: their block means go together."""
    parts = [edges(n, max(n // 8, 2)) for n in one.shape]
    a, b = (block_means(frame, *parts).ravel() for frame in (one, other))
    return bool(np.corrcoef(a, b)[0, 1] > 0.98)
