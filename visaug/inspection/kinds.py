"""Frames of which only the pixels are wanted, and the kind of each: by tables, headers and names, else by level and structure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.frames import FrameSet
from visaug.frames.dark_folder import named_kinds, shows_a_scene
from visaug.frames.stores import FileStore
from visaug.frames.survey import survey
from visaug.statistics.reduction import block_means, edges


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


def kinds_of(frames: FrameSet, shift: int) -> tuple[list[str], str]:
    """The kind of each frame, and the sources that told it. Pixel values are shifted left by `shift` bits."""
    told = [None if r.kind == "image" else r.kind for r in frames.records]
    named = named_kinds(frames.records)
    kinds = [kind or name for kind, name in zip(told, named, strict=True)]
    unknown = [i for i, kind in enumerate(kinds) if kind is None]
    sources = []
    if any(told):
        agree = all(kind in (None, name) for kind, name in zip(told, named, strict=True))
        sources.append("the file names" if agree else "the table or headers")
    elif any(named):
        sources.append("the file names")
    if unknown:
        sources.append("level and structure")
    by_level = _by_level(frames, unknown, shift)
    return [str(kind or by_level[i]) for i, kind in enumerate(kinds)], ", else ".join(sources)


def _by_level(frames: FrameSet, unknown: list[int], shift: int) -> dict[int, str]:
    bits = (frames.bit_depth or 16) - shift
    top = float((1 << bits) - 1)
    least = 1023.0 if bits > 8 else 255.0  # a converter of 8 bits fills 8, in files of any type
    found: dict[int, str] = {}
    before: np.ndarray | None = None
    lit = 0.25  # of the largest code, from which uniform frames are taken for flats
    for i in unknown:
        frame = frames.read(i) / np.float32(1 << shift)
        highest = max(float(np.quantile(frame, 0.9999)), 1.0)
        scale = next((b for b in (255.0, 1023.0, 4095.0, 16383.0, 65535.0) if b >= max(highest, least)), top)
        if shows_a_scene(frame):
            still = before is not None and before.shape == frame.shape and _same(before, frame)
            found[i] = "scene" if still else "image"
            if still and found.get(i - 1) == "image":
                found[i - 1] = "scene"
            before = frame
        else:
            found[i] = "flat" if float(np.median(frame)) > lit * scale else "dark"
    return found


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two frames show the same scene: their block means go together."""
    parts = [edges(n, max(n // 8, 2)) for n in one.shape]
    a, b = (block_means(frame, *parts).ravel() for frame in (one, other))
    return bool(np.corrcoef(a, b)[0, 1] > 0.98)
