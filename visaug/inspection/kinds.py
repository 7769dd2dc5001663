"""The kind of each frame: by tables, headers and names, else by level and structure.

What a sensor adds to a uniform frame is of rows, of columns, of single pixels, or smooth and small. Anything else is a
scene, of which no pattern of the camera is read.
"""

from dataclasses import dataclass

import numpy as np

from visaug.core.constants import MAD
from visaug.frames import FrameSet
from visaug.frames.dark_folder import named_kinds, shows_a_scene


def kinds_of(frames: FrameSet, shift: int) -> tuple[list[str], str]:
    """The kind of each frame, and the sources that told it. Pixel values are shifted left by `shift` bits."""
    told = [None if r.kind == "image" else r.kind for r in frames.records]
    named = named_kinds(frames.records)
    kinds = [kind or name for kind, name in zip(told, named, strict=True)]
    unknown = [i for i, kind in enumerate(kinds) if kind is None]
    sources = []
    if any(told):
        path = frames.loaded_from
        has_table = path is not None and (path.suffix.lower() == ".csv" or (path / "frames.csv").is_file())
        agree = all(kind in (None, name) for kind, name in zip(told, named, strict=True)) and not has_table
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
    scene: np.ndarray | None = None  # the first
    still = True
    uniforms: dict[int, _Blocks] = {}
    before: int | None = None
    lit = 0.25  # of the largest code, from which uniform frames are taken for flats
    for i in unknown:
        frame = frames.read(i) / np.float32(1 << shift)
        highest = max(float(np.quantile(frame, 0.9999)), 1.0)
        scale = next((b for b in (255.0, 1023.0, 4095.0, 16383.0, 65535.0) if b >= max(highest, least)), top)
        blocks = _Blocks.of(frame)
        kind = "flat" if blocks.level > lit * scale else "dark"
        if shows_a_scene(frame) or blocks.show_a_scene(kind, scale):
            found[i] = "scene"
            scene = frame if scene is None else scene
            still = still and _same(scene, frame)
            continue
        found[i] = kind
        if before is not None and uniforms[before].is_other_scene(blocks, scale):
            found[before] = found[i] = "image"
        uniforms[i], before = blocks, i
    if "scene" in found.values() or "image" in found.values():
        # Beside scenes, smooth structure is not taken for a glow.
        found |= {i: "image" for i, blocks in uniforms.items() if blocks.is_structured}
    # Of scenes that change, or of which there is one, what changes is not the camera's.
    still = still and sum(kind == "scene" for kind in found.values()) > 1
    return found if still else {i: "image" if kind == "scene" else kind for i, kind in found.items()}


@dataclass(frozen=True)
class _Blocks:
    """Means of blocks of a frame, in which no single pixel counts much."""

    means: np.ndarray  # (rows, columns) of blocks, DN
    error: float  # standard deviation of a mean by the noise of its pixels, DN
    level: float  # median of the frame, DN

    @classmethod
    def of(cls, frame: np.ndarray) -> "_Blocks":
        side = max(8, min(frame.shape) // 32)  # px
        rows, columns = (n // side for n in frame.shape)
        part = frame[: rows * side, : columns * side].astype(np.float64)
        if not part.size:
            return cls(np.zeros((1, 1)), 1.0, float(np.median(frame)))
        steps = np.abs(np.diff(part, axis=1))
        noise = max(MAD * float(np.median(steps)) / np.sqrt(2), 0.5)
        pixels = part.reshape(rows, side, columns, side).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
        middle = np.median(pixels, 2, keepdims=True)
        near = 2.5  # standard deviations, to which pixels are drawn in
        means = middle[..., 0] + np.clip(pixels - middle, -near * noise, near * noise).mean(2)
        return cls(means, float(noise / side), float(np.median(frame)))

    @property
    def contrast(self) -> float:
        """Range of what is neither of rows nor of columns, DN."""
        return float(np.ptp(_interaction(self.means)))

    @property
    def is_structured(self) -> bool:
        """Whether the contrast is beyond that of noise, and neighbouring blocks have it in common."""
        beyond = 16  # standard errors: the range of noise alone is 7
        return self.contrast > beyond * self.error and not _is_white(_interaction(self.means))

    @property
    def has_edges(self) -> bool:
        """Whether there are edges that neither rows nor columns explain, inside the frame, where no glow begins.

        Four neighbours tell: their two diagonals have the same sum if the frame is one of rows plus one of columns. A glow changes
        little from block to block, noise that is coarser than pixels and waves across the frame change it everywhere.
        """
        inside = self.means[1:-1, 1:-1]
        if min(inside.shape) < 2:
            return False
        across = np.diff(np.diff(inside, axis=0), axis=1)
        scatter = max(2 * self.error, MAD * float(np.median(np.abs(across))))
        largest = float(np.abs(across).max())
        beyond = 6.0  # standard deviations, which one of a million normal numbers exceeds in 500 frames
        sharp = 0.4  # of the contrast within one block: a glow with a reach of two blocks has 0.15
        return largest > beyond * scatter and largest > sharp * self.contrast

    def show_a_scene(self, kind: str, scale: float) -> bool:
        """Whether a frame of this level, `dark` or `flat`, and largest code shows more than a sensor adds to uniform light.

        Flats may have edges: of dust, which takes a part of the light.
        """
        much = 0.4  # of the level, or of a third of the largest code
        return self.contrast > much * max(self.level, scale / 3) or (kind == "dark" and self.has_edges)

    def is_other_scene(self, other: "_Blocks", scale: float) -> bool:
        """Whether two frames of the same level and largest code differ by what neither rows nor columns explain: by edges, or by
        as much as there is. What a sensor adds does not move.
        """
        alike = 0.02  # relative difference of levels, by which dust shows as little
        if self.means.shape != other.means.shape or abs(self.level - other.level) > alike * self.level + 1:
            return False
        both = float(np.hypot(self.error, other.error))
        change = _Blocks(other.means - self.means, both, self.level)
        half = 0.5 * max(self.contrast, other.contrast)
        faint = 0.02 * scale  # waves of interference
        return change.has_edges or (change.is_structured and change.contrast > max(half, faint))


def _interaction(means: np.ndarray) -> np.ndarray:
    return means - means.mean(0) - means.mean(1, keepdims=True) + means.mean()


def _is_white(blocks: np.ndarray) -> bool:
    """Whether means of 2 x 2 neighbours have no more than a fourth of the variance, as where noise is not coarser than a block."""
    rows, columns = (n // 2 for n in blocks.shape)
    part = blocks[: 2 * rows, : 2 * columns]
    if rows * columns < 4 or not part.any():
        return True
    pairs = part.reshape(rows, 2, columns, 2).mean((1, 3))
    beyond = 6.0  # standard errors
    return bool(4 * (pairs**2).mean() / (part**2).mean() < 1 + beyond * np.sqrt(2 / pairs.size))


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two frames show the same scene: noise, rows and columns explain by how much their block means differ.

    The noise is that of the block, from neighbouring pixels, since it grows with the light. What is coarser than pixels raises
    all blocks, another content or brightness some of them.
    """
    if one.shape != other.shape:
        return False
    change = other.astype(np.float64) - one
    side = 8  # px
    rows, columns = (n // side for n in change.shape)
    blocks = change[: rows * side, : columns * side].reshape(rows, side, columns, side).transpose(0, 2, 1, 3)
    steps = [np.abs(np.diff(blocks, axis=axis)).reshape(rows, columns, -1) for axis in (2, 3)]
    noise = MAD * np.median(np.concatenate(steps, 2), 2) / np.sqrt(2)
    rounding = 0.4  # DN, standard deviation of the difference of two codes
    apart = _interaction(blocks.mean((2, 3))) / np.maximum(noise, rounding) * side
    coarse = max(float(np.median(np.abs(apart))) * MAD, 1.0)
    coarsest, beyond, few = 3.0, 5.0, 0.005  # filters of noise reach the first; share of the blocks
    return coarse < coarsest and float((np.abs(apart) > beyond * coarse).mean()) < few and _is_white(apart)
