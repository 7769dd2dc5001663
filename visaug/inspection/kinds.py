"""What kind each frame is: by headers and tables, by names, else by its level and structure."""

from __future__ import annotations

import numpy as np

from visaug.frames import FrameSet
from visaug.frames.dark_folder import named_kinds, shows_a_scene
from visaug.statistics.reduction import block_means, edges


def kinds_of(frames: FrameSet, shift: int = 0) -> tuple[list[str], str]:
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
            if still:
                found.update({k: "scene" for k in found if found[k] == "image" and k == i - 1})
            before = frame
        else:
            found[i] = "flat" if float(np.median(frame)) > lit * scale else "dark"
    return found


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two frames show the same scene: their block means go together."""
    parts = [edges(n, max(n // 8, 2)) for n in one.shape]
    a, b = (block_means(frame, *parts).ravel() for frame in (one, other))
    return bool(np.corrcoef(a, b)[0, 1] > 0.98)
