"""Folders of dark frames that nothing but their names tells: ``dark_00.png``, ``dark_01.png``."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from visaug.frames.names import kind_of_name
from visaug.frames.pixels import split_name
from visaug.frames.record import FrameRecord

if TYPE_CHECKING:
    from visaug.frames.frameset import FrameSet


def named_kinds(records: Sequence[FrameRecord]) -> list[str | None]:
    """The kind that each frame's path names, None where it names none."""
    return [kind_of_name(split_name(record.file)[0]) for record in records]


def as_dark(frames: "FrameSet") -> list[FrameRecord] | None:
    """Pictures as dark frames, of exposure 0, where every name says so and no frame shows a scene; None elsewhere."""
    records = frames.records
    kinds = named_kinds(records)
    if len(records) < 2 or not set(kinds) <= {"dark", "bias"} or any(r.kind != "image" for r in records):
        return None
    looked_at = 3  # frames
    spread = np.unique(np.linspace(0, len(records) - 1, looked_at).astype(int))
    if any(shows_a_scene(frames.read(int(i))) is not False for i in spread):
        return None
    return [replace(r, kind=str(kind)) for r, kind in zip(records, kinds, strict=True)]


def shows_a_scene(frame: np.ndarray) -> bool | None:
    """Whether many blocks have structure coarser than noise that is neither of a row nor of a column; None where the frame
    (H, W) is smaller than two blocks.
    """
    block = 16  # px
    rows, columns = (n // block * block for n in frame.shape)
    if min(rows, columns) < 2 * block:
        return None
    part = frame[:rows, :columns].astype(np.float64)
    blocks = part.reshape(rows // block, block, columns // block, block).transpose(0, 2, 1, 3)
    of_rows, of_columns = blocks.mean(3, keepdims=True), blocks.mean(2, keepdims=True)
    blocks = blocks - of_rows - of_columns + blocks.mean((2, 3), keepdims=True)
    cell = 4  # px
    cells = blocks.reshape(*blocks.shape[:2], block // cell, cell, block // cell, cell).mean((3, 5))
    inner = blocks - np.repeat(np.repeat(cells, cell, 2), cell, 3)
    coarse, fine = cells.var((2, 3)) * cell**2, inner.var((2, 3)) + 1 / 12
    structured = 12.0  # variance of means of cells over that of independent pixels; filters of noise reach 9
    many = 0.2  # of the blocks, that show a scene
    return bool((coarse > structured * fine).mean() > many)
