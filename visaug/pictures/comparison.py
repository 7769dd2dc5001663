"""Pictures beside pictures: differences between the cameras of two sets, independent of their scenes.

Every statistic is of flat blocks at a stated level, of lines through them, of what recurs at a place, or a ratio whose parts grow
alike with what the scene shows (`visaug.pictures.looks`), so how much sky a picture shows or how large its target is
does not enter. A level counts only where both sets have flat blocks without structure. The spread of each statistic is that from
picture to picture (jackknife); pictures are the sample, not pixels.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import torch
from scipy import stats

from visaug.camera import Camera
from visaug.core.errors import InputError
from visaug.core.reporting import Reported
from visaug.frames import FrameRecord, FrameSet
from visaug.pictures.blocks import Blocks, Levels, Rounding, noise_by_level, sample
from visaug.pictures.curve import VarianceLaw
from visaug.pictures.files import PictureSet, largest_group
from visaug.pictures.looks import measured
from visaug.pictures.pattern import VariancePart, recurring
from visaug.pictures.regions import find_regions
from visaug.pictures.scenes import chosen_of, read_windows
from visaug.pictures.sets import find_sky, jackknife
from visaug.statistics.places import Place, Places, data_frame, verdict_json
from visaug.statistics.tail import SIGNIFICANT

_COLUMNS = ["view", "statistic", "unit", "measured", "modelled", "standard_deviation", "z"]


@dataclass(frozen=True)
class StatisticDifference:
    """One statistic of both sets: value in the target, in the other set, and the standard error of the difference."""

    view: str
    statistic: str
    unit: str
    measured: float
    modelled: float
    standard_deviation: float
    degrees: float

    @property
    def p_value(self) -> float:
        return float(2 * stats.t.sf(abs(self.t), self.degrees))

    @property
    def t(self) -> float:
        return (self.measured - self.modelled) / self.standard_deviation

    @property
    def z(self) -> float:
        """The standard deviations of a normal variable that are as improbable."""
        return float(math.copysign(stats.norm.isf(max(self.p_value, 1e-300) / 2), self.t))


@dataclass(frozen=True)
class PictureComparison(Reported):
    """What `compare_pictures` found.

    Attributes:
        p_value: of the largest difference, corrected for the number of statistics (Bonferroni).
        all_differences: every statistic that both sets determine.
        where: views that differ at the corrected level, the least probable first.
        curves: level, noise and standard error (8-bit DN) of `target` and `renders`.
        pictures: number of `renders` and of `target`.
        target: the pictures of the target domain.
        camera, transfer: what gave the other pictures their noise, None where nothing did.
    """

    p_value: float
    all_differences: tuple[StatisticDifference, ...]
    where: Places
    curves: dict[str, dict[str, np.ndarray]]
    warnings: tuple[str, ...]
    pictures: tuple[int, int]
    target: FrameSet | None = field(default=None, repr=False, compare=False)
    camera: Camera | None = field(default=None, repr=False, compare=False)
    transfer: Literal["linear", "srgb"] = "linear"

    @property
    def adequate(self) -> bool:
        """Whether nothing differs beyond chance at a false-alarm rate of 2 %."""
        return self.p_value > SIGNIFICANT

    def differences(self, most: int = 40) -> list[dict[str, Any]]:
        ordered = sorted(self.all_differences, key=lambda d: -abs(d.z))[:most]
        return [{name: getattr(d, name) for name in _COLUMNS} for d in ordered]

    def to_json(self) -> dict[str, Any]:
        return {
            **verdict_json(self.p_value, self.adequate, self.where),
            "differences": self.differences(),
            "pictures": {"renders": self.pictures[0], "target": self.pictures[1]},
            "warnings": list(self.warnings),
        }

    def to_frame(self) -> Any:
        """All statistics as a pandas DataFrame."""
        return data_frame(self.differences(len(self.all_differences)), _COLUMNS)

    def __repr__(self) -> str:
        return f"PictureComparison({len(self.all_differences)} statistics, p = {self.p_value:.3g})"


@dataclass(frozen=True)
class _Set:
    pictures: PictureSet
    blocks: Blocks
    levels: Levels
    rounding: Rounding


def compare_pictures(
    renders: FrameSet,
    target: FrameSet,
    camera: Camera | None = None,
    transfer: Literal["linear", "srgb"] = "linear",
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> PictureComparison:
    """What the camera of the target's pictures does that the other pictures lack.

    Args:
        renders: the pictures to train with, with or without noise.
        target: pictures of the target domain.
        camera: gives the other pictures its noise first, with its black level kept.
        transfer: how the pictures' values follow from light, for the camera.
        seed: of the blocks that are looked at, and of the camera's noise.
        progress: called with (description, done, total).

    Raises:
        InputError: fewer than five pictures of one size, or no flat region in common.
    """
    say = progress or (lambda *_: None)
    warnings: list[str] = []
    sets, parts = [], []
    for k, (name, frames) in enumerate((("FRAMES", renders), ("--target", target))):
        say("reading pictures", k, 2)
        one = _prepared(name, frames, seed, warnings)
        if camera is not None and k == 0:
            one = _prepared(name, _noisy(one.pictures, camera, transfer, seed), seed, warnings)
        sets.append(one)
        parts.append(_parts(one))
    say("reading pictures", 2, 2)
    if not (noise := _noise(*sets)):
        warnings.append(
            "noise_not_compared: the two sets have no flat regions at a common level; noise that neighbours share, as after "
            "denoising or demosaicing, cannot be told from texture"
        )
    found = [*noise, *_lines(*parts), *look_differences(*(one.pictures for one in sets))]
    if not found:
        problem = "the two sets have no flat regions at a common level"
        raise InputError(problem, field="--target", expected="pictures of like brightness")
    p = min(1.0, len(found) * min(d.p_value for d in found))
    curves = {name: s.levels.curve() for name, s in zip(("renders", "target"), sets)}
    sizes, said = (len(sets[0].pictures), len(sets[1].pictures)), tuple(warnings)
    return PictureComparison(p, tuple(found), _places(found), curves, said, sizes, target, camera, transfer)


def _noisy(pictures: PictureSet, camera: Camera, transfer: Literal["linear", "srgb"], seed: int) -> FrameSet:
    """8-bit pictures as the camera would have taken them, with one sensor's fixed pattern."""
    from visaug.augment import VISNoise

    noise = VISNoise(camera, fixed_pattern="camera", transfer=transfer, black_level="keep")
    torch.manual_seed(seed)
    taken = []
    for n in range(len(pictures)):
        clean = torch.from_numpy(pictures.read(n).astype(np.float32) / 255)[None, None]
        taken.append(np.rint(255 * noise(clean)[0, 0].numpy()).astype(np.uint8))
    files = [pictures.frames.records[i].file for i in pictures.indices]
    return FrameSet.from_arrays([FrameRecord(n, file, "image") for n, file in enumerate(files)], taken)


def _prepared(name: str, frames: FrameSet, seed: int, warnings: list[str]) -> _Set:
    if not any(r.kind == "image" for r in frames.records):
        raise InputError("holds no ordinary pictures", field=name, expected="a folder of pictures")
    pictures = largest_group(frames, lambda text: warnings.append(f"{text} ({name})"))
    if len(pictures) < 5:
        problem = f"too few pictures of one kind: {len(pictures)}"
        raise InputError(problem, field=name, expected="5 or more of one size")
    blocks, _ = sample(pictures, seed)
    rounding = Rounding(pictures.steps, pictures.is_jpeg)
    return _Set(pictures, blocks, noise_by_level(blocks, rounding, len(pictures)), rounding)


def _noise(renders: _Set, target: _Set) -> list[StatisticDifference]:
    """Standard deviation of pixels at each level that both sets have."""
    sides = []
    for one in (renders, target):

        def figures(weights: np.ndarray, one: _Set = one) -> np.ndarray:
            return np.sqrt(one.levels.of_pictures(weights, one.rounding)[1])

        value, spread, degrees = jackknife(figures, len(one.pictures))
        levels = one.levels
        # A level counts where low coefficients hardly exceed the noise.
        counts = [j for j, s in enumerate(levels.structure) if s < 0.1 and np.isfinite(spread[j])]
        errors = {j: math.hypot(spread[j], value[j] * levels.structure[j] / 4) for j in counts}
        sides.append({int(levels.number[j]): (value[j], errors[j], degrees, levels.level[j]) for j in counts})
    both = [(b, sides[0][k]) for k, b in sorted(sides[1].items()) if k in sides[0]]
    return [difference("noise_level", f"noise at level {b[3]:.0f}", "DN", b[:3], a[:3]) for b, a in both]


def _parts(one: _Set) -> dict[str, VariancePart | None]:
    """Variances in the pictures as they are: no tone curve and no black level is taken off."""
    if not len(one.levels.level):
        return {}
    sky = find_sky(one.blocks, one.levels)
    pattern = recurring(one.pictures, one.levels, one.rounding, VarianceLaw("linear", 1e-3, 0.1), sky)
    return {name: getattr(pattern, name) for name in ("row", "column", "row_fixed", "column_fixed", "pixel")}


_LINES = {
    "row": ("picture_lines", "row offsets"),
    "column": ("picture_lines", "column offsets"),
    "row_fixed": ("recurring_pattern", "rows that recur"),
    "column_fixed": ("recurring_pattern", "columns that recur"),
    "pixel": ("recurring_pattern", "pixels that recur"),
}


def _lines(
    renders: dict[str, VariancePart | None], target: dict[str, VariancePart | None]
) -> list[StatisticDifference]:
    found = []
    for name, (view, text) in _LINES.items():
        a, b = renders.get(name), target.get(name)
        if a is not None and b is not None:
            degrees = 11.0  # of a spread over a dozen or more pictures or places; a normal would be too sure
            sides = [(p.variance, p.error, degrees) for p in (b, a)]
            found.append(difference(view, f"variance of {text}", "DN^2", *sides))
    return found


def _places(found: list[StatisticDifference]) -> Places:
    """Views with a difference beyond chance, with their share of the sum of squares."""
    excess = {d: max(d.z**2 - 1, 0.0) for d in found if d.p_value < SIGNIFICANT / len(found)}
    total = sum(excess.values())
    places = []
    for view in dict.fromkeys(d.view for d in excess):
        here = [d for d in excess if d.view == view]
        worst = max(here, key=lambda d: abs(d.z))
        places.append(Place(view, sum(excess[d] for d in here) / total, worst.statistic, worst.z))
    return Places(sorted(places, key=lambda p: -p.share))


def difference(
    view: str, statistic: str, unit: str, of_target: Sequence[float], of_others: Sequence[float]
) -> StatisticDifference:
    """Of a value, its standard error and the degrees of freedom of that, in the target and in the other pictures."""
    (b, eb, db), (a, ea, da) = of_target, of_others
    variance = ea**2 + eb**2 + 1e-12
    degrees = float(max(variance**2 / (ea**4 / da + eb**4 / db + 1e-24), 2.0))  # Welch
    return StatisticDifference(view, statistic, unit, float(b), float(a), math.sqrt(variance), degrees)


def look_differences(renders: PictureSet, target: PictureSet) -> list[StatisticDifference]:
    """What the cameras of two sets make of black, bright and flat areas and of edges: statistics that both sets tell."""
    sides = []
    for pictures in (target, renders):
        chosen, window = chosen_of(pictures, 8_000_000)
        taken = read_windows(pictures, chosen, window)
        regions = find_regions(taken, 255.0, Rounding(pictures.steps, pictures.is_jpeg))
        sides.append({look.name: (look, figures) for look, *figures in measured(taken, regions)})
    both = [(*sides[0][name], sides[1][name][1]) for name in sides[0] if name in sides[1]]
    return [difference(look.view, look.name, look.unit, one, other) for look, one, other in both]
