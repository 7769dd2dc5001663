"""What a diagnosis leaves unexplained, measured as a component that a camera can have although its cause is not known.

Each part is what the discovery frames have beyond simulated sets of the same frames by the refitted camera: the power of the
mean dark frame by spatial frequency, the power of line means in differences of consecutive dark frames by frequency, and the
variance of pixels in differences by the level. Noise of unknown cause is in the mean of few frames too: to the simulated mean
frames the deviations of the measured frames from their mean are added, with random signs.

One rule decides what is kept: powers are taken for gamma variables with the mean and the variance of the simulated sets, and
the ratio of a power and their mean for an F variable. Single frequencies (levels) whose power is improbable at `RATE` over all
of the part are kept first, and of the others bands of 2, 4, 8 ... neighbours, with the mean excess of the band. The rest is 0.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.special import fdtrc

from visaug.camera import Camera
from visaug.camera.maps import moved
from visaug.camera.spec import check_spec
from visaug.core.files import whole_file
from visaug.core.sampling import derive_key
from visaug.diagnosis.fitting.errors import Errors
from visaug.diagnosis.fitting.fit import Fitted
from visaug.diagnosis.fitting.reference import Report, make_reference
from visaug.diagnosis.part import MeasuredFrames
from visaug.effects.readout.unexplained import Unexplained
from visaug.frames import FrameSet
from visaug.statistics.distance import Error

RATE = 0.01  # probability that a complete camera gets a part, for each part
SETS = 40  # simulated sets that a power is compared with,
SETS_OF_ERROR = 120  # and that the error with the component is computed from
MOST = 16  # frames of one condition that are used
OVERLAP = 1.5  # of the variance of a mean over consecutive differences, which share frames, and over independent ones
ALIKE = 0.01  # of the highest level: levels of flats and darks that become one point of the curve
PARTS = {
    "map_e": "fixed map",
    "row_power_e2": "row spectrum",
    "column_power_e2": "column spectrum",
    "variance_e2": "variance curve",
}
Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Component:
    """A measured component.

    Attributes:
        camera: the camera of the diagnosis with the component; as it was where no part is significant.
        arrays: the significant parts, as `visaug.effects.Unexplained` describes them.
        error_before, error_after: on the hold-out frames, without and with it; None where the diagnosis tells no error.
        file: where it was written; None if it was not.
    """

    camera: Camera = field(repr=False)
    arrays: Arrays = field(repr=False)
    error_before: Error | None = None
    error_after: Error | None = None
    file: Path | None = None

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts in words."""
        return tuple(word for name, word in PARTS.items() if name in self.arrays)

    @property
    def helps(self) -> bool:
        """Whether there is any part, and the error does not rise with it."""
        before, after = self.error_before, self.error_after
        return bool(self.arrays) and (before is None or after is None or after.value < before.value)

    def saved(self, path: str | Path) -> "Component":
        """Writes the camera with the component, and the component's file beside it, where it helps.

        Args:
            path: of the camera.yaml; the file beside it is `file_beside(path)`.

        Returns:
            The component with its file, or as it is where it does not help and nothing is written.
        """
        if not self.helps:
            return self
        path, file = Path(path), file_beside(path)
        with whole_file(file) as temporary, open(temporary, "wb") as whole:
            np.savez(whole, allow_pickle=False, **self.arrays)
        content = self.camera.to_dict()
        content["effects"][-1]["map"] = moved(file.name, file.parent, self.camera.folder or Path())
        Camera(check_spec(content), self.camera.folder, self.camera.maps).save(path)
        return replace(self, file=file)

    def to_json(self) -> dict[str, Any]:
        error = self.error_after
        return {
            "parts": list(self.parts),
            "file": None if self.file is None else str(self.file),
            "lowers": self.helps,
            "error_before": None if self.error_before is None else self.error_before.value,
            "error_after": None if error is None else error.value,
            "interval_after": None if error is None else [error.low, error.high],
        }


def file_beside(path: str | Path) -> Path:
    """The component's file of a camera file: `better_unexplained.npz` beside better.yaml."""
    return Path(path).with_name(f"{Path(path).stem}_{Unexplained.name}.npz")


def component(camera: Camera, errors: Errors, before: Error | None, report: Report) -> Component:
    """The component of what a camera leaves unexplained; without any part where none is significant.

    Args:
        camera: the refitted camera with the accepted effects.
        errors: of the diagnosis, with its laboratory.
        before: the error of the camera as the diagnosis reports it.
        report: progress.
    """
    lab = errors.lab
    plain, part = camera.without_effect(Unexplained.name), lab.parts[-1]
    arrays = _measured(plain, part, lab.seed, report) if isinstance(part, MeasuredFrames) else {}
    if not arrays:
        return Component(camera, {}, before)
    better = _with(plain, arrays)
    if before is None:
        return Component(better, arrays)
    fitted = Fitted.unfitted(lab, make_reference(lab, better, (), SETS_OF_ERROR, report))
    return Component(better, arrays, before, errors.told(fitted))


def _with(camera: Camera, arrays: Arrays) -> Camera:
    content = camera.to_dict()
    content.setdefault("effects", []).append({"name": Unexplained.name, "map": f"{Unexplained.name}.npz"})
    own = {f"{Unexplained.name}.{name}": torch.from_numpy(values) for name, values in arrays.items()}
    return Camera(check_spec(content), camera.folder, camera.maps | own)


class _Groups(NamedTuple):
    """The frames that are used: places in the part, and of each condition positions among these."""

    places: list[int]
    dark: tuple[tuple[int, ...], ...]
    all: tuple[tuple[int, ...], ...]
    shortest: tuple[int, ...]  # places of the darks or biases at the shortest exposure

    @property
    def pairs(self) -> int:
        """Differences of consecutive dark frames."""
        return sum(len(group) - 1 for group in self.dark)


class _Powers(NamedTuple):
    """Powers of what changes from frame to frame, e-^2: of lines by frequency, of pixels by condition."""

    rows: np.ndarray
    columns: np.ndarray
    levels: np.ndarray  # e-
    variances: np.ndarray


def _measured(camera: Camera, part: MeasuredFrames, seed: int, report: Report) -> Arrays:
    """The significant parts, by name."""
    groups = _groups_of(part, camera.resolution)
    if not groups.all:
        return {}
    arrays = _temporal(camera, part, groups, seed, report)
    if groups.shortest:
        stack = _stack_e(camera, part.frames, groups.shortest).astype(np.float64)
        every, count = range(len(stack)), len(stack)
        signs = np.random.default_rng(derive_key(seed, "signs")).choice([-1.0, 1.0], (SETS, count))
        signs /= np.sqrt(
            count * (count - 1)
        )  # the mean of frames has 1 / n of their variance, deviations (n - 1) / n
        left = stack - stack.mean(0)
        sets = [
            _stack_e(camera, one, every).mean(0, dtype=np.float64) + np.tensordot(sign, left, 1)
            for one, sign in zip(_simulated(camera, part, groups.shortest, seed, report), signs, strict=True)
        ]
        arrays |= _map(stack.mean(0), sets, count - 1)
    return arrays


def _temporal(camera: Camera, part: MeasuredFrames, groups: _Groups, seed: int, report: Report) -> Arrays:
    """The significant parts of what changes from frame to frame."""
    own = _powers(camera, part.frames.subset(groups.places), groups)
    sets = [_powers(camera, one, groups) for one in _simulated(camera, part, groups.places, seed, report)]
    arrays = _curve(own, sets, camera.resolution, groups)
    for name in ("rows", "columns") if groups.dark else ():
        there = np.array([getattr(one, name) for one in sets])
        arrays |= _spectrum(f"{name[:-1]}_power_e2", getattr(own, name), there, groups.pairs)
    return arrays


def _simulated(
    camera: Camera, part: MeasuredFrames, places: Sequence[int], seed: int, report: Report
) -> Iterator[FrameSet]:
    for k in range(SETS):
        yield part.take(camera, derive_key(seed, "empirical", k), places)
        report("measuring what is unexplained", k + 1, SETS)


def _groups_of(part: MeasuredFrames, resolution: tuple[int, int]) -> _Groups:
    """Discovery frames that show the whole sensor, two or more of a condition, in order of time."""
    find, records = set(part.folds.find), part.frames.records
    whole = (None, (0, resolution[0], 0, resolution[1]))
    groups = [
        (group, own)
        for group in part.frames.groups()
        if group.kind in ("bias", "dark", "flat")
        and records[group.indices[0]].window in whole
        and len(own := tuple(sorted(find & set(group.indices))[:MOST])) >= 2
    ]
    places = sorted(i for _, own in groups for i in own)
    at = {i: k for k, i in enumerate(places)}
    dark = [(g.exposure_s or 0.0, -len(own), own) for g, own in groups if g.kind != "flat"]
    return _Groups(
        places,
        tuple(tuple(at[i] for i in own) for *_, own in dark),
        tuple(tuple(at[i] for i in own) for _, own in groups),
        min(dark)[2] if dark else (),
    )


def _stack_e(camera: Camera, frames: FrameSet, positions: Sequence[int]) -> np.ndarray:
    """Frames of one condition in electrons, (n, rows, columns)."""
    gain = camera.gain_at(frames.records[positions[0]].gain_db)
    return (frames.read_many(positions) - camera.spec.black_level_dn) * gain


def _powers(camera: Camera, frames: FrameSet, groups: _Groups) -> _Powers:
    rows, columns = np.zeros(camera.resolution[0]), np.zeros(camera.resolution[1])
    levels, variances = [], []
    for group in groups.all:
        stack = _stack_e(camera, frames, group)
        halves = np.diff(stack, axis=0) / np.sqrt(2)  # of which the variance is that of one frame
        of_rows, of_columns = (halves.mean(axis, dtype=np.float64) for axis in (2, 1))
        level = of_rows.mean(1, keepdims=True)
        left = halves - of_rows[:, :, None] - (of_columns - level)[:, None, :]
        freedom = len(left) * (left.shape[1] - 1) * (left.shape[2] - 1)
        levels.append(float(stack.mean(dtype=np.float64)))
        variances.append(float((left.astype(np.float64) ** 2).sum() / freedom))
        if group in groups.dark:
            rows += _power(of_rows).sum(0) / groups.pairs
            columns += _power(of_columns).sum(0) / groups.pairs
    columns[0] = 0.0  # the level of a frame is left to the rows
    return _Powers(rows, columns, np.array(levels), np.array(variances))


def _power(lines: np.ndarray) -> np.ndarray:
    """|DFT|^2 / n of records (..., n): of white noise its variance at every frequency."""
    return np.abs(np.fft.fft(lines)) ** 2 / lines.shape[-1]


class _Excess(NamedTuple):
    """Of each power, the mean excess of its band, and the share of the excess in the band's power; 0 where not significant."""

    value: np.ndarray
    share: np.ndarray


def excess(power: np.ndarray, sets: np.ndarray, freedom: float, independent: int = SETS) -> _Excess:
    """What powers (n,) have beyond simulated ones (R, n), neighbours side by side and of similar size; see the module.

    Args:
        freedom: shape of the gamma law of one power, half its degrees of freedom. The simulated sets may show a smaller one; by
            chance they show a larger one.
        independent: how many of the sets are.
    """
    count = len(power)
    found = _Excess(np.zeros(count), np.zeros(count))
    left, width = np.arange(count), 1
    while width < 2 * len(left):
        starts = np.arange(0, len(left), width)
        own, there = (np.add.reduceat(of[..., left], starts, axis=-1) for of in (power, sets))
        mean, sizes = there.mean(0), np.diff(np.append(starts, len(left)))
        with np.errstate(divide="ignore", invalid="ignore"):
            shape = np.minimum(mean**2 / there.var(0, ddof=1), freedom * sizes)
            chance = fdtrc(2 * shape, 2 * shape * independent, own / mean)
        # Bonferroni: fewer than 2 n bands are tested
        beyond = np.where(mean > 0, chance < RATE / (2 * count), own > 0)
        kept = np.repeat(beyond, sizes)
        found.value[left[kept]] = np.repeat((own - mean) / sizes, sizes)[kept]
        found.share[left[kept]] = np.repeat(1 - mean / np.maximum(own, 1e-300), sizes)[kept]
        left, width = left[~kept], 2 * width
    return found


def _spectrum(name: str, power: np.ndarray, sets: np.ndarray, pairs: int) -> Arrays:
    """The excess power of lines at every frequency; empty if there is none."""
    half = len(power) // 2 + 1
    found = excess(power[:half], sets[:, :half], pairs / OVERLAP if pairs > 1 else 1.0).value
    if not found.any():
        return {}
    both = np.concatenate([found, found[1 : len(power) - half + 1][::-1]])
    return {name: both.astype(np.float32)}


def _map(mean_frame: np.ndarray, sets: Sequence[np.ndarray], independent: int) -> Arrays:
    """The pattern beyond what the camera explains; empty if there is none.

    Its mean over simulated cameras is subtracted. What the sets scatter about it, drawn patterns and temporal noise, is the
    noise of a Wiener filter in bands of spatial frequency. The root of the filter is taken, so that the power of the pattern,
    with that of a drawn one, is the measured power.
    """
    rows, columns = mean_frame.shape
    middle = np.mean(sets, axis=0)
    own = np.fft.fft2(mean_frame - middle)
    y, x = np.indices(own.shape)
    mirrored = ((-y % rows) * columns + (-x % columns)).ravel()
    half = np.arange(own.size) <= mirrored
    half[0] = False  # the mean is the black level
    distance = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns)[None, :])
    fewer = len(sets) / (len(sets) - 1)  # for the mean, which is that of the same sets
    there = fewer * np.array([np.abs(np.fft.fft2(one - middle)).ravel()[half] ** 2 for one in sets])
    place = np.cumsum(half) - 1  # in `there`
    share = np.zeros(own.size)
    for kind in (y == 0, x == 0, (y > 0) & (x > 0)):  # patterns of columns, of rows, and all others
        of = np.flatnonzero(half & kind.ravel())
        of = of[np.argsort(distance.ravel()[of], kind="stable")]
        if len(of):
            share[of] = excess(np.abs(own).ravel()[of] ** 2, there[:, place[of]], 1.0, independent).share
    if not share.any():
        return {}
    share[mirrored[half]] = share[half]
    return {"map_e": np.fft.ifft2(own * np.sqrt(share).reshape(own.shape)).real.astype(np.float32)}


def _curve(own: _Powers, sets: Sequence[_Powers], resolution: tuple[int, int], groups: _Groups) -> Arrays:
    """The variance of pixels beyond that of the camera by level; empty if there is none."""
    order = np.argsort(own.levels, kind="stable")
    pairs = np.array([len(group) - 1 for group in groups.all])[order]
    there = np.array([one.variances for one in sets])[:, order]
    freedom = 0.5 * float(pairs.min()) * (resolution[0] - 1) * (resolution[1] - 1)
    found = excess(own.variances[order], there, freedom).value
    if not found.any():
        return {}
    levels = own.levels[order]
    point = np.concatenate([[0], np.cumsum(np.diff(levels) > ALIKE * max(levels[-1], 0.0))])
    level, variance = (np.bincount(point, pairs * of) / np.bincount(point, pairs) for of in (levels, found))
    return {"level_e": level.astype(np.float32), "variance_e2": variance.astype(np.float32)}
