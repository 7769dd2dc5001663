"""What the views share: each group of frames reduced once to its mean frame, its noise, and their rows and columns."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache, partial
from itertools import combinations

import numpy as np

from visaug.core.constants import MAD
from visaug.core.recurrent import Recurrent
from visaug.frames import FrameRecord, FrameSet, Group
from visaug.statistics import kernels
from visaug.statistics.conditions import MAX_GROUPS, by_condition, choose, labels
from visaug.statistics.fixed import block_offsets, centre, profile_numbers
from visaug.statistics.stack import (
    LEAST_SCALE,
    LEAST_VARIANCE,
    Noise,
    NoiseProducts,
    Stack,
    correlations,
)
from visaug.statistics.statistic import Statistic

SLOW = 16  # px, of the blocks whose means are the slow part of a pattern
UNNAMED = Statistic("", "", "", ())


class GroupData:
    """Frames of equal conditions: the mean frame and the noise about it, in DN.

    Args:
        group: the conditions; its indices are the frames in use.
        noise: of these frames.
        reference: the bias group, whose mean frame is taken off for `pattern`; None for the bias itself.
        label: of the conditions, in words; without one statistics have no descriptions, where only their values are wanted.
    """

    def __init__(self, group: Group, noise: Noise, reference: "GroupData | None", label: str = ""):
        self.label = label
        self.group = group
        self.kind = group.kind
        self.noise = noise
        self.reference = reference
        self.count = noise.count

    @classmethod
    def of_frames(cls, group: Group, frames: np.ndarray) -> "GroupData":
        """Of frames in memory, (n, H, W), without a bias group."""
        return cls(group, Noise([Stack(frames)]), None)

    def statistic(self, view: str, name: str, axes: Iterable[str], unit: str = "1") -> Statistic:
        """The description of a statistic of these frames."""
        if not self.label:
            return UNNAMED
        g = self.group
        return Statistic(
            view,
            name,
            self.label,
            tuple(axes),
            unit,
            g.kind,
            g.exposure_s,
            g.temperature_c or 0.0,
            self.signal,
        )

    @property
    def frames(self) -> np.ndarray:
        """(n, H, W) float32."""
        return self.noise.frames

    @property
    def mean(self) -> np.ndarray:
        """Mean frame, (H, W)."""
        return self.noise.mean

    @property
    def level(self) -> float:
        return self.noise.level

    @property
    def signal(self) -> float:
        """Mean DN above the bias."""
        return self.level - (self.reference.level if self.reference else 0.0)

    @cached_property
    def pattern(self) -> np.ndarray:
        """Fixed pattern, (H, W), mean 0: the mean frame, without the bias' where there is one."""
        pattern = self.mean - self.reference.mean if self.reference else self.mean.copy()
        return _centred(pattern)

    @property
    def calm(self) -> np.ndarray:
        """The fixed pattern without pixels that stand alone, (H, W), mean 0: one dead pixel can outweigh its whole row."""
        return self._calm[0]

    @cached_property
    def _calm(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """That, and the means of its rows and of its columns."""
        calm = _centred(without_lone_pixels(self.pattern))
        return calm, *kernels.line_means(calm)

    @property
    def pattern_rows(self) -> np.ndarray:
        """Of the calm pattern, (H,)."""
        return self._calm[1]

    @property
    def pattern_columns(self) -> np.ndarray:
        return self._calm[2]

    @cached_property
    def profile_numbers(self) -> dict[str, tuple[float, ...]]:
        """Of the rows and of the columns of the calm pattern, see `fixed.profile_numbers`."""
        found = {}
        for name, profile in (("row", self.pattern_rows), ("column", self.pattern_columns)):
            numbers = np.empty(5)
            profile_numbers(profile, cubics(len(profile)), reach_of_steps(len(profile)), numbers)
            found[name] = tuple(numbers.tolist())
        return found

    @property
    def pattern_pixels(self) -> np.ndarray:
        """The fixed pattern without its rows, columns and slow parts, (H, W); the pixels that stand alone are in it."""
        return self._pixels[0]

    @cached_property
    def _pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """These pixels, and sums of their products."""
        down, across = (edges(n, max(1, n // SLOW)) for n in self.pattern.shape)
        calm, rows, columns = self._calm
        slow, pixels = np.zeros((len(down) - 1, len(across) - 1)), np.empty_like(self.pattern)
        kernels.block_sums(calm, down, across, slow)
        block_offsets(slow, rows, columns, down, across)
        rows, columns, slow = (x.astype(np.float32) for x in (rows, columns, slow))
        kernels.pixel_part(self.pattern, rows, columns, slow, down, across, pixels)
        found = NoiseProducts.empty((0, 0))
        none = [np.zeros((1, n), np.float32) for n in pixels.shape]
        found.add(pixels[None], np.zeros_like(pixels), *none)
        return pixels, found.products

    @cached_property
    def pattern_variance(self) -> float:
        return max(float(self._pixels[1][0]) / self.pattern.size, LEAST_VARIANCE)

    @cached_property
    def pattern_correlations(self) -> dict[tuple[int, int], float]:
        """Mean product of pixels of the fixed pattern so many rows and columns apart, over its variance."""
        height, width = self.pattern.shape
        return correlations(self._pixels[1], (height, width), self.pattern_variance)

    @cached_property
    def pattern_scale(self) -> float:
        """Robust standard deviation of the pixel part of the fixed pattern, DN."""
        sample = np.abs(self.pattern_pixels.ravel()[::4])
        return max(MAD * kernels.median_of_sizes(sample), LEAST_SCALE)

    @property
    def noise_variance(self) -> float:
        """Variance of the pixel part of the temporal noise, DN^2; never below a hundredth of quantisation's."""
        return self.noise.variance

    @property
    def frame_means(self) -> np.ndarray:
        return self.noise.frame_means

    @property
    def noise_rows(self) -> np.ndarray:
        """Row means of the temporal noise, (n, H)."""
        return self.noise.rows

    @property
    def noise_columns(self) -> np.ndarray:
        return self.noise.columns

    @cached_property
    def residual(self) -> np.ndarray:
        """Temporal noise, (n, H, W), scaled so that its mean square is the variance of one frame. Needs n > 1."""
        residual = self.frames - self.mean
        residual *= np.float32(self.noise.bessel)
        return residual

    @cached_property
    def noise_pixels(self) -> np.ndarray:
        """The temporal noise without its row and column means, (n, H, W) float32."""
        rows, columns = (lines.astype(np.float32) for lines in (self.noise_rows, self.noise_columns))
        lines = rows[:, :, None] + columns[:, None, :]
        lines -= rows.mean(1)[:, None, None]
        return self.residual - lines


class Stacks:
    """The frames of a set in groups, each reduced once: frames that find and frames that confirm together are all frames.

    Args:
        frames: the set.
        shared: reductions of frames that several sets have in common, bit for bit.
    """

    def __init__(self, frames: FrameSet, shared: Recurrent | None = None):
        self._frames, self._shared = frames, Recurrent(0) if shared is None else shared
        self._known: dict[tuple[int, ...], Stack] = {}
        self._noise: dict[tuple[int, ...], Noise] = {}

    def noise(self, indices: Sequence[int]) -> Noise:
        """Of the frames at these positions."""
        key = tuple(indices)
        if key not in self._noise:
            parts = self._parts(key)
            place = {i: k for k, i in enumerate(i for part in parts for i in part)}
            stacks, order = [self._known[part] for part in parts], [place[i] for i in key]
            noise, size = partial(Noise, stacks, order), _images(3, stacks[0].shape)
            self._noise[key] = self._shared.derived(key, noise, size, *stacks)
        return self._noise[key]

    def group(self, group: Group, reference: GroupData | None, label: str) -> GroupData:
        """The frames of a group with their noise; see `GroupData`."""
        noise = self.noise(group.indices)
        if reference is not None and reference.mean.shape != noise.shape:
            reference = None
        data = partial(GroupData, group, noise, reference, label)
        return self._shared.derived((group, label), data, _images(3, noise.shape), noise, reference)

    def frame(self, i: int) -> np.ndarray:
        """One frame, (H, W)."""
        return self._frames.stack([i])[0]

    def _parts(self, key: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
        """The known stacks that hold these frames, one or two; they are made into one where there are none."""
        wanted = set(key)
        if key not in self._known:
            within = [part for part in self._known if wanted.issuperset(part)]
            for one, other in combinations(within, 2):
                if len(one) + len(other) == len(key) and not set(one) & set(other):
                    return one, other
            self._known[key] = self._stack(key)
        return (key,)

    def _stack(self, key: tuple[int, ...]) -> Stack:
        frames = self._frames.stack(key)
        some = hash(frames[:, ::16].tobytes())  # a part tells nearly always whether frames are others
        with_sums = frames.nbytes + _images(2, frames.shape)
        stack = self._shared.get((key, frames.shape, some), partial(Stack, frames), with_sums)
        return stack if np.array_equal(stack.frames, frames) else Stack(frames)


def _images(count: int, shape: Sequence[int]) -> int:
    """Bytes of so many float32 images of the size of a frame."""
    return 4 * count * shape[-2] * shape[-1]


class FrameData:
    """A frame set reduced group by group.

    Args:
        frames: the whole set; frames outside `use` are read only as predecessors.
        use: positions that the statistics may be taken from; all by default.
        named: False leaves statistics without their descriptions.
        place: what part of the sensor the frames show, in words, where a fingerprint has several; follows the conditions.
        stacks: sums of the frames, where several uses share them.
    """

    def __init__(
        self,
        frames: FrameSet,
        use: Iterable[int] | None = None,
        named: bool = True,
        place: str = "",
        stacks: "Stacks | None" = None,
    ):
        self.named = named
        self.place = place
        self.frames = frames
        self.stacks = stacks or Stacks(frames)
        self.use = frozenset(range(len(frames)) if use is None else use)
        self.records: tuple[FrameRecord, ...] = frames.records

    @cached_property
    def bias(self) -> GroupData | None:
        """The shortest dark condition: bias frames, or darks where there are none."""
        groups = [g for g in self._used_groups if g.kind == "bias"]
        if groups:
            return self._load(max(groups, key=lambda g: len(g.indices)), None)
        darks = sorted((g for g in self._used_groups if g.kind == "dark"), key=by_condition)
        return self._load(darks[0], None) if darks else None

    @cached_property
    def _used_groups(self) -> list[Group]:
        return used_groups(self.frames, self.use)

    @cached_property
    def groups(self) -> list[GroupData]:
        """The groups that the statistics are taken from."""
        chosen: list[Group] = []
        for kind, most in MAX_GROUPS.items():
            chosen += choose([g for g in self._used_groups if g.kind == kind], most)
        bias = self.bias
        return [bias if bias and g == bias.group else self._load(g, bias) for g in chosen]

    @cached_property
    def unlit(self) -> "FrameData":
        """The bias and dark frames alone, with what was reduced of them."""
        dark = [i for i in self.use if self.records[i].kind in ("bias", "dark")]
        data = FrameData(self.frames, dark, self.named, self.place, self.stacks)
        data.bias, data.groups = self.bias, [g for g in self.groups if g.kind in ("bias", "dark")]
        return data

    @cached_property
    def darks(self) -> list[GroupData]:
        """The bias frames and the dark ladder, each once: where there are no bias frames the shortest darks stand for them."""
        return list(dict.fromkeys(g for g in (self.bias, *self.of("dark")) if g is not None))

    @property
    def dark_ends(self) -> list[GroupData]:
        """The bias frames and the longest darks; one alone where there is no other."""
        return self.darks[:1] + self.darks[1:][-1:]

    def of(self, kind: str, at_least: int = 1) -> list[GroupData]:
        return [g for g in self.groups if g.kind == kind and g.count >= at_least]

    def _load(self, group: Group, reference: GroupData | None) -> GroupData:
        label = self._labels[replace(group, indices=())] if self.named else ""
        return self.stacks.group(group, reference, label)

    @cached_property
    def _labels(self) -> dict[Group, str]:
        """Of the conditions in the whole set, so that every use of its frames calls them alike."""
        found = labels(self.frames.groups())
        return {g: f"{word}, {self.place}" for g, word in found.items()} if self.place else found


def used_groups(frames: FrameSet, use: Iterable[int]) -> list[Group]:
    """The groups of a set with only the frames in `use`; groups that keep none are left out."""
    allowed = set(use)
    kept = [replace(g, indices=tuple(i for i in g.indices if i in allowed)) for g in frames.groups()]
    return [g for g in kept if g.indices]


def _centred(image: np.ndarray) -> np.ndarray:
    """The same image, its mean taken off in place."""
    centre(image)
    return image


def without_lone_pixels(image: np.ndarray) -> np.ndarray:
    """An image (H, W) in which a pixel far from all its neighbours has the mean of the middle two of the four."""
    alone = 8.0  # robust standard deviations from its neighbours from which a pixel is one by itself
    told_by = 100_000  # pixels of a large frame that tell that scale, to half a percent
    step = max(4, image.size // told_by)
    far, calm = np.empty((image.size + step - 1) // step, np.float32), np.empty_like(image)
    kernels.apart(image, step, far)
    scale = max(MAD * kernels.median_of_sizes(far), LEAST_SCALE)
    kernels.without_apart(image, alone * scale, calm)
    return calm


@lru_cache(maxsize=16)
def cubics(length: int) -> np.ndarray:
    """(length, up to 4) orthonormal polynomials up to the third degree."""
    powers = np.vander(np.linspace(-1, 1, length), min(4, length))
    return np.linalg.qr(powers)[0]


def reach_of_steps(length: int) -> int:
    """Lines on either side of a step in a profile."""
    step_reach = 12  # lines on either side of a step, at most
    return min(step_reach, max(1, length // 4))


@lru_cache(maxsize=64)
def edges(length: int, parts: int) -> np.ndarray:
    """(parts + 1,) where parts of about equal length begin and end."""
    return np.linspace(0, length, parts + 1).astype(int)


def block_means(image: np.ndarray, row_edges: np.ndarray, column_edges: np.ndarray) -> np.ndarray:
    sums = np.zeros((len(row_edges) - 1, len(column_edges) - 1))
    kernels.block_sums(image, row_edges, column_edges, sums)
    sums /= (row_edges[1:] - row_edges[:-1])[:, None]
    sums /= column_edges[1:] - column_edges[:-1]
    return sums
