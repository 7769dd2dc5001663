"""Frames for an inspection: loaded whatever is known of them, in groups of one kind and level.

Far-out pixels are drawn in, so that no single pixel can look like a line.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from visaug.core.constants import MAD
from visaug.core.errors import InputError
from visaug.core.wording import counted
from visaug.frames import FrameSet, Group
from visaug.frames.stores import FileStore
from visaug.frames.survey import survey
from visaug.statistics import GroupData


def load_pixels(path: str | Path, bit_depth: int | None = None) -> FrameSet:
    """The frame set at a path as `FrameSet.load` reads it, or without exposures and kinds where it refuses to for lack of them.

    A file or folder of stacks (`.npy`, TIFF, FITS, `.npz`, HDF5) gives all frames of the stacks; frames of unknown kind
    are of kind `image`, and unknown exposures are 0.
    """
    path = Path(path)
    try:
        frames = FrameSet.load(path, None, bit_depth)
        if frames.is_pictures and len(frames):
            frames.shape(0)
        return frames
    except InputError as refused:
        stacked = refused.problem.startswith(("has shape", "does not describe its frames"))
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


FAR = 8.0  # robust standard deviations beyond which a pixel does not take part in the statistics of lines


@dataclass(frozen=True)
class FrameGroup:
    """Frames of equal conditions, read as they are."""

    kind: str  # `bias`, `dark`, `flat`, `scene` or `image`
    group: Group  # their conditions and positions in the set
    frames: np.ndarray  # (n, H, W) float32 DN, copies of one exposure left out
    copies: int = 0  # number of frames left out as copies
    bits: int | None = None  # of the converter as the files state it, None where they do not
    guessed: bool = False  # whether the kind was inferred from the signal level
    coloured: bool = False  # whether neighbours share noise, so that its spectrum is not white

    @property
    def count(self) -> int:
        return len(self.frames)

    @property
    def shape(self) -> tuple[int, int]:
        return self.frames.shape[1], self.frames.shape[2]

    @property
    def is_uniform(self) -> bool:
        """Whether the frames show no scene, so that what is fixed belongs to the camera."""
        return self.kind in ("bias", "dark", "flat")

    @property
    def is_lit(self) -> bool:
        return self.kind not in ("bias", "dark")

    @property
    def fixed(self) -> str | None:
        """The kind of a fixed pattern; None where one frame alone cannot tell it from a new one."""
        return "fixed" if self.count > 1 else None

    @property
    def new(self) -> str | None:
        """The kind of a pattern that is new in each frame, in the same way."""
        return "per_frame" if self.count > 1 else None

    @cached_property
    def raw(self) -> GroupData:
        """The frames as they are."""
        return GroupData.of_frames(self.group, self.frames)

    @cached_property
    def data(self) -> GroupData:
        """The frames with pixels beyond FAR drawn in to it, in the mean frame and about it."""
        frames = self.frames - _beyond(self.raw.pattern_pixels)
        if self.count > 1:
            frames -= _beyond(GroupData.of_frames(self.group, frames).noise_pixels)
        return GroupData.of_frames(self.group, frames)

    @cached_property
    def noise_dn(self) -> float:
        """Standard deviation of the temporal noise of a pixel; of one frame alone that of its pixels."""
        return float(np.sqrt(self.noise_variance))

    @cached_property
    def noise_variance(self) -> float:
        if self.count == 1:
            return self.pattern_variance
        height, width = self.shape
        return self.data.noise_variance / ((1 - 1 / height) * (1 - 1 / width))

    @cached_property
    def pattern_variance(self) -> float:
        """Variance of the pixels of the mean frame, their temporal noise included, lines and slow parts removed, DN^2."""
        height, width = self.shape
        block = 16  # px, of the slow part of the pattern
        slow = max(1, height // block) * max(1, width // block) / (height * width)
        return self.data.pattern_variance / (1 - 1 / height - 1 / width - slow)

    @cached_property
    def colour(self) -> np.ndarray:
        """(H/2,) power of the pixels' noise at 1 .. H/2 cycles per frame down and few across, over that of white noise.

        Row means have it too, but for what rows share, which has no cycles across.
        """
        half = self.shape[0] // 2
        if not self.coloured:
            return np.ones(half)
        noise = self.data.noise_pixels if self.count > 1 else self.data.pattern_pixels[None]
        across = 8  # cycles across the frame, whose power stands for that of none
        power = np.abs(np.fft.fft(np.fft.rfft(noise, axis=2)[:, :, 2:across], axis=1)) ** 2
        found = power.mean((0, 2))[1 : half + 1] / noise[0].size / np.mean(noise**2, dtype=np.float64)
        reach = max(half // 16, 2)
        padded = np.pad(found, reach, mode="reflect")
        return np.convolve(padded, np.full(2 * reach + 1, 1 / (2 * reach + 1)), mode="valid")

    def transposed(self) -> "FrameGroup":
        """Columns in place of rows."""
        turned = replace(self, frames=np.ascontiguousarray(self.frames.transpose(0, 2, 1)))
        if "data" in self.__dict__:
            data = GroupData.of_frames(self.group, np.ascontiguousarray(self.data.frames.transpose(0, 2, 1)))
            turned.__dict__["data"] = data
        return turned

    def without_lines(self, bad: np.ndarray) -> "FrameGroup":
        """The same with the given rows replaced by their nearest good neighbours."""
        good = np.flatnonzero(~bad)
        nearest = good[np.abs(np.arange(len(bad))[:, None] - good[None, :]).argmin(1)]
        return replace(self, frames=self.frames[:, nearest])


def _beyond(pixels: np.ndarray) -> np.ndarray:
    """How far pixels lie beyond FAR robust standard deviations."""
    sample = np.abs(pixels.ravel()[:: max(1, pixels.size // 200_000)])
    limit = np.float32(FAR * max(MAD * float(np.median(sample)), 0.3))
    return pixels - np.clip(pixels, -limit, limit)


def looks(
    frames: FrameSet, kinds: list[str], guessed: bool, shift: int
) -> tuple[list[FrameGroup], list[str]]:
    """The frames by kind, conditions, size and level, the largest group first; and notes on what was left out.

    `guessed`: some kinds were inferred from the signal level. `shift`: number of bits by which values are shifted left.
    """
    notes: list[str] = []
    records = [replace(r, kind=kind) for r, kind in zip(frames.records, kinds, strict=True)]
    told = frames.with_records(records)
    found: list[FrameGroup] = []
    # pixels of all frames of a group, of which up to twenty copies are held at once: 3 GB
    most_values = 40_000_000
    least_side = 16  # lines: fewer tell no spectrum
    full_scale = 65535.0  # DN of 1.0 in frames of fractions: 16 bits
    for group in told.groups():
        by_shape: dict[tuple[int, int], list[int]] = {}
        for i in group.indices:
            by_shape.setdefault(told.shape(i), []).append(i)
        for shape, indices in by_shape.items():
            if min(shape) < least_side:
                frames_of = counted(len(indices), "frame")
                notes.append(f"small_frames: left out as too small: {frames_of} of {shape[0]} x {shape[1]}")
                continue
            most = max(most_values // (shape[0] * shape[1]), 2)
            if len(indices) > most:
                notes.append(f"part_of_the_frames: {most} of {len(indices)} {group.kind} frames are used")
                indices = indices[:most]
            stack = told.read_many(indices)
            if shift:
                stack = stack / np.float32(1 << shift)
            if frames.bit_depth is None and 0 < stack.max() <= 1:
                stack *= np.float32(full_scale)
                notes.append(
                    f"fractions: the frames hold fractions of 1; sizes are given for {full_scale:.0f} DN"
                )
            for part in _levels(stack, group.kind):
                own = replace(group, indices=tuple(indices[k] for k in part))
                first = {frame.tobytes(): k for k, frame in reversed(list(enumerate(stack[part])))}
                kept = stack[part][sorted(first.values())]  # without copies of an earlier frame
                copies = len(part) - len(kept)
                found.append(FrameGroup(group.kind, own, kept, copies, frames.told_bits, guessed))
    return sorted(found, key=lambda look: -look.count), notes


def _levels(stack: np.ndarray, kind: str) -> list[list[int]]:
    """Frames of one level of light each: flats part where the mean jumps by more than a drift of the lamp would."""
    means = stack.mean((1, 2), dtype=np.float64)
    if kind not in ("flat", "dark", "bias") or len(means) < 3:
        return [list(range(len(means)))]
    order = np.argsort(means)
    spread = float(stack[0].std(dtype=np.float64))
    jump = max(0.1 * float(np.median(means)), 3 * spread) if kind == "flat" else 20 * spread + 20
    parts = np.split(order, np.flatnonzero(np.diff(means[order]) > jump) + 1)
    return [sorted(int(k) for k in part) for part in parts]
