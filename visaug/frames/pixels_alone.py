"""Frames of which only the pixels are wanted: stacks in one file, and frames whose exposure nothing tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from visaug.core.errors import InputError
from visaug.frames.frameset import FrameSet
from visaug.frames.stores import FileStore
from visaug.frames.survey import survey


def load_pixels(path: str | Path, bit_depth: int | None = None) -> FrameSet:
    """The frame set at a path as `FrameSet.load` reads it, or without exposures and kinds where it refuses to for lack of them.

    A file or folder of stacks (`.npy`, TIFF, FITS, `.npz`, HDF5) gives all frames of the stacks; frames of unknown kind
    are of kind `image`, and unknown exposures are 0.

    Raises:
        InputError: there are no frames, or they cannot be read.
    """
    path = Path(path)
    try:
        frames = FrameSet.load(path, None, bit_depth)
        if frames.is_pictures and len(frames):
            frames.shape(0)
        return frames
    except InputError as refused:
        stacked = refused.problem.startswith("has shape")
        # Without a kind or an exposure a frame set cannot be measured, but can be looked at.
        if path.suffix.lower() == ".csv" or not (stacked or refused.field in ("exposure_s", "kind")):
            raise
        root, files = (path.parent, [path]) if path.is_file() else (path, None)
        seen = survey(root, {"exposure_s": 1.0}, files=files)
        for row in seen.rows:
            row["kind"] = row["kind"] or "image"
        records = [replace(record, exposure_s=0.0) for record in seen.records()]
        if stacked and len(records) < 2:
            raise
    found = FrameSet(records, FileStore(records, root, None, bit_depth, None, None, []))
    found.loaded_from = path
    return found
