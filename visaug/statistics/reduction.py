"""What the views share: each group of frames reduced once to its mean frame, its noise, and their rows and columns."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from visaug.frames import FrameRecord, FrameSet, Group
from visaug.statistics.statistic import Statistic

MAX_GROUPS = {"bias": 2, "dark": 8, "flat": 9, "scene": 6}  # of each kind, spread evenly over the conditions


ALONE = 8.0  # robust standard deviations from its neighbours from which a pixel is one by itself
TOLD_BY = 100_000  # pixels of a large frame that tell that scale, to half a percent

UNNAMED = Statistic("", "", "", ())


class GroupData:
    """Frames of equal conditions: the mean frame and the noise about it, in DN.

    Args:
        group: the conditions; its indices are the frames in use.
        frames: (n, H, W) float32.
        reference: the bias group, whose mean frame is taken off for `pattern`; None for the bias itself.
        label: of the conditions, in words; without one statistics have no descriptions, where only their values are wanted.
    """

    def __init__(self, group: Group, frames: np.ndarray, reference: "GroupData | None", label: str = ""):
        self.label = label
        self.group = group
        self.kind = group.kind
        self.frames = frames
        self.reference = reference
        self.count = len(frames)

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

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean frame, (H, W)."""
        return self.frames.mean(0)

    @cached_property
    def level(self) -> float:
        return float(self.mean.mean(dtype=np.float64))

    @property
    def signal(self) -> float:
        """Mean DN above the bias."""
        return self.level - (self.reference.level if self.reference else 0.0)

    @cached_property
    def pattern(self) -> np.ndarray:
        """Fixed pattern, (H, W), mean 0: the mean frame, without the bias' where there is one."""
        pattern = self.mean - self.reference.mean if self.reference else self.mean.copy()
        return _centred(pattern)

    @cached_property
    def calm(self) -> np.ndarray:
        """The fixed pattern without pixels that stand alone, (H, W), mean 0: one dead pixel can outweigh its whole row."""
        return _centred(without_lone_pixels(self.pattern))

    @cached_property
    def pattern_rows(self) -> np.ndarray:
        """Of the calm pattern, (H,)."""
        return self.calm.mean(1)

    @cached_property
    def pattern_columns(self) -> np.ndarray:
        return self.calm.mean(0)

    @cached_property
    def pattern_pixels(self) -> np.ndarray:
        """The fixed pattern without its rows, columns and slow parts, (H, W); the pixels that stand alone are in it."""
        lines = self.pattern_rows[:, None] + self.pattern_columns[None, :]
        slow = _blocks_expanded(self.calm - lines)
        flat = self.pattern - lines
        flat -= slow
        return _centred(flat)

    @cached_property
    def residual(self) -> np.ndarray:
        """Temporal noise, (n, H, W), scaled so that its mean square is the variance of one frame. Needs n > 1."""
        residual = self.frames - self.mean
        residual *= np.float32(np.sqrt(self.count / (self.count - 1)))
        return residual

    @cached_property
    def frame_means(self) -> np.ndarray:
        return self.frames.mean((1, 2), dtype=np.float64)

    @cached_property
    def noise_rows(self) -> np.ndarray:
        """Row means of the temporal noise, (n, H)."""
        return self.residual.mean(2)

    @cached_property
    def noise_columns(self) -> np.ndarray:
        return self.residual.mean(1)

    @cached_property
    def noise_pixels(self) -> np.ndarray:
        """The temporal noise without its row and column means, (n, H, W)."""
        whole = self.noise_rows.mean(1)[:, None, None]
        noise = self.residual - self.noise_rows[:, :, None]
        noise -= self.noise_columns[:, None, :]
        noise += whole
        return noise

    @cached_property
    def noise_variance(self) -> float:
        """Variance of the pixel part of the temporal noise, DN^2; never below a hundredth of quantisation's."""
        noise = self.noise_pixels.ravel()
        return max(float(np.dot(noise, noise)) / noise.size, 1 / 1200)

    @cached_property
    def pattern_variance(self) -> float:
        pattern = self.pattern_pixels.ravel()
        return max(float(np.dot(pattern, pattern)) / pattern.size, 1 / 1200)

    @cached_property
    def pattern_scale(self) -> float:
        """Robust standard deviation of the pixel part of the fixed pattern, DN."""
        sample = np.abs(self.pattern_pixels.ravel()[::4])
        return max(1.4826 * float(np.median(sample)), 0.03)


class FrameData:
    """A frame set reduced group by group.

    Args:
        frames: the whole set; frames outside `use` are read only as predecessors.
        use: positions that the statistics may be taken from; all by default.
        named: False leaves statistics without their descriptions.
        place: what part of the sensor the frames show, in words, where a fingerprint has several; follows the conditions.
    """

    def __init__(
        self, frames: FrameSet, use: Iterable[int] | None = None, named: bool = True, place: str = ""
    ):
        self.named = named
        self.place = place
        self.frames = frames
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
        data = FrameData(self.frames, dark, self.named, self.place)
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
        stack = self.frames.read_many(group.indices)
        if reference is not None and reference.frames.shape[1:] != stack.shape[1:]:
            reference = None
        return GroupData(group, stack, reference, self._labels[_conditions(group)] if self.named else "")

    @cached_property
    def _labels(self) -> dict[Group, str]:
        """Of the conditions in the whole set, so that every use of its frames calls them alike."""
        found = labels(self.frames.groups())
        return {g: f"{word}, {self.place}" for g, word in found.items()} if self.place else found


def labels(groups: Iterable[Group]) -> dict[Group, str]:
    """A label for each condition: by the fields that usually distinguish them, else by all, else by a number."""
    conditions = [_conditions(g) for g in groups]
    words = [_label(g) for g in conditions]
    words = [
        _label(g, full=True) if words.count(w) > 1 else w for g, w in zip(conditions, words, strict=True)
    ]
    numbers = [f" ({words[: i + 1].count(w)})" if words.count(w) > 1 else "" for i, w in enumerate(words)]
    return {g: w + n for g, w, n in zip(conditions, words, numbers, strict=True)}


def _conditions(group: Group) -> Group:
    return replace(group, indices=())


def _label(group: Group, full: bool = False) -> str:
    g = group
    parts = [g.kind]
    if g.kind == "scene":
        parts.append(str(g.clean).rsplit("/", 1)[-1].split(".")[0])
    if g.kind == "flat" and g.photons is not None:
        parts.append(f"{g.photons:g} ph")
    if g.kind == "dark" or (g.kind == "flat" and g.photons is None) or full:
        parts.append(f"{g.exposure_s:g} s")
    if (g.kind in ("dark", "flat") or full) and g.temperature_c is not None:
        parts.append(f"{g.temperature_c:g} C")
    if g.gain_db:
        parts.append(f"{g.gain_db:g} dB")
    if full and g.window is not None:
        parts.append("at {0},{2}".format(*g.window))
    return " ".join(parts)


def used_groups(frames: FrameSet, use: Iterable[int]) -> list[Group]:
    """The groups of a set with only the frames in `use`; groups that keep none are left out."""
    allowed = set(use)
    kept = [replace(g, indices=tuple(i for i in g.indices if i in allowed)) for g in frames.groups()]
    return [g for g in kept if g.indices]


def spread(items: list, most: int) -> list:
    """At most so many of the items, evenly spread, the first and the last among them."""
    if len(items) <= most:
        return items
    if most == 1:
        return [items[len(items) // 2]]
    return [items[round(i * (len(items) - 1) / (most - 1))] for i in range(most)]


def choose(groups: list[Group], most: int) -> list[Group]:
    """At most so many groups, evenly spread over the conditions, the one with the most frames among them."""
    ordered = sorted(groups, key=by_condition)
    chosen = spread(ordered, most)
    if len(chosen) < len(ordered):
        fullest = max(ordered, key=lambda g: len(g.indices))
        if fullest not in chosen:
            near = min(
                range(len(chosen)), key=lambda k: abs(ordered.index(chosen[k]) - ordered.index(fullest))
            )
            chosen[near] = fullest
    return chosen


def by_condition(group: Group) -> tuple:
    """Sorts groups of a kind: by temperature, light, exposure."""
    return (
        group.temperature_c or 0.0,
        group.photons or 0.0,
        group.exposure_s,
        group.gain_db,
        group.clean or "",
    )


def _centred(image: np.ndarray) -> np.ndarray:
    """The same image, its mean taken off in place."""
    image -= np.float32(image.mean(dtype=np.float64))
    return image


def without_lone_pixels(image: np.ndarray) -> np.ndarray:
    """An image (H, W) in which a pixel far from all its neighbours has the mean of the middle two of the four."""
    around = np.empty((4, *image.shape), image.dtype)
    around[0, 1:], around[0, 0] = (
        image[:-1],
        image[min(2, len(image) - 1)],
    )  # beyond an edge: none that counts already
    around[1, :-1], around[1, -1] = image[1:], image[max(-3, -len(image))]
    across = image.T
    around[2, :, 1:], around[2, :, 0] = image[:, :-1], across[min(2, len(across) - 1)]
    around[3, :, :-1], around[3, :, -1] = image[:, 1:], across[max(-3, -len(across))]
    middle = (around.sum(0) - around.max(0) - around.min(0)) / 2
    off = np.abs(image - middle)
    scale = max(1.4826 * float(np.median(off.ravel()[:: max(4, off.size // TOLD_BY)])), 0.03)
    return np.where(off > ALONE * scale, middle, image)


def _blocks_expanded(image: np.ndarray, size: int = 16) -> np.ndarray:
    """Means of blocks of about `size` pixels, as an image: the slow part of a pattern."""
    row_edges, column_edges = (edges(n, max(1, n // size)) for n in image.shape)
    means = block_means(image, row_edges, column_edges)
    return np.repeat(np.repeat(means, np.diff(row_edges), 0), np.diff(column_edges), 1)


@lru_cache(maxsize=64)
def edges(length: int, parts: int) -> np.ndarray:
    """(parts + 1,) where parts of about equal length begin and end."""
    return np.linspace(0, length, parts + 1).astype(int)


def block_means(image: np.ndarray, row_edges: np.ndarray, column_edges: np.ndarray) -> np.ndarray:
    sums = np.add.reduceat(np.add.reduceat(image, row_edges[:-1], 0), column_edges[:-1], 1)
    return (sums / np.outer(np.diff(row_edges), np.diff(column_edges))).astype(np.float32)
