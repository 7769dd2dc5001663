"""The scenes behind ordinary pictures, and the regions in which the pictures are looked at."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from visaug.augment.exposure import linear_to_srgb, srgb_to_linear
from visaug.camera import Camera
from visaug.core.errors import InputError, NoSensorNoise
from visaug.core.wording import counted
from visaug.frames import FrameSet
from visaug.pictures.blocks import SIDE, Rounding, noise_by_level, sample
from visaug.pictures.files import PictureSet, largest_group, quality_of
from visaug.pictures.regions import Regions, as_pixels, find_regions
from visaug.pictures.sets import is_rendered, no_noise
from visaug.pictures.symmetry import STATISTICS, Sums, symmetry_sums
from visaug.statistics.subsample import Selection


def encoded(light: Tensor, transfer: str) -> Tensor:
    """Picture values of light, both in [0, 1]."""
    return linear_to_srgb(light) if transfer == "srgb" else light


def decoded(values: Tensor, transfer: str) -> Tensor:
    """Light of picture values."""
    return srgb_to_linear(values) if transfer == "srgb" else values


@dataclass(frozen=True)
class Scenes:
    """What a simulation needs of the pictures."""

    light: np.ndarray  # (n, H, W) share of the light that saturates the converter; 0 in the black sky
    regions: Regions  # where both are looked at
    numbers: tuple[int, ...]  # (n,) of the pictures in the set
    window: tuple[int, int, int, int]  # rows and columns of the sensor that are used
    black: float  # level of no light, in 1/255 of full scale
    saturated: float  # level from which a pixel is saturated, in 1/255 of full scale
    transfer: str  # how picture values follow from light
    codes: float  # highest code of the files
    quality: int | None  # of the JPEG files; None where they are none
    symmetry: Sums  # sums of the pictures
    # (3, statistics) what the symmetries' statistics are in pictures of such scenes, its squared standard
    # error and the degrees of freedom of that; NaN where it is not known, and the statistic is not used
    expected: np.ndarray


def scenes_of(
    frames: FrameSet, camera: Camera, transfer: str, scenes: FrameSet | None, warn: Callable[[str], object]
) -> tuple[Scenes, np.ndarray, Selection]:
    """The scenes of a set of pictures, the pictures (n, H, W) in 1/255 of full scale, and which of them and what window are used.

    Args:
        camera: supplies the level at which its pictures saturate, and what is not measured.
        transfer: how picture values follow from light, linear or srgb.
        scenes: other pictures with such scenes, whose symmetries take the place of zero.

    Raises:
        InputError: too few pictures, or none with a black sky or flat regions.
        NoSensorNoise: the pictures are renders or screenshots.
    """
    pictures = largest_group(frames, warn)
    if len(pictures) < 6:
        only = f"only {counted(len(pictures), 'picture')} of this size"
        raise InputError(only, field="frames", expected="at least 6 of one size")
    if pictures.top_dn >= 2**camera.bit_depth:
        raise InputError(
            f"pictures of {int(pictures.top_dn).bit_length()} bits and a camera of {camera.bit_depth}",
            field="frames",
            expected="pictures of no more bits than the camera has; --bit-depth states how many of them are used",
        )
    chosen, window = chosen_of(pictures)
    taken = read_windows(pictures, chosen, window)
    rounding = Rounding(pictures.steps, pictures.is_jpeg)
    _refuse_renders(pictures, chosen, rounding)
    saturated = 0.97 * _saturation(camera, taken, transfer)
    stated = _stated_black(camera, transfer)
    regions = find_regions(taken, saturated, rounding, stated)
    if regions.sky is None and not regions.levels:
        problem = "the pictures hold neither a black sky nor flat regions with noise"
        expected = "regions without texture, with noise that neighbours do not share"
        raise InputError(problem, field="frames", expected=expected)
    if regions.sky is None:
        warn("no_black_sky: the pictures have no black sky; what shows in the dark alone is not seen")
    if not regions.levels:
        said = "the pictures have hardly any lit region without texture; what grows with light is not seen"
        warn(f"no_flat_regions: {said}")
    rows, columns = frames.shape(pictures.indices[0])
    black = regions.sky if regions.sky is not None else stated
    smooth = smooth_scenes(taken, regions)
    place = (regions.lit >= 0, black, saturated, (window[0], window[2]), (rows, columns))
    expected = _expected(scenes, camera, transfer, saturated, warn) if scenes is not None else _unknown()
    numbers = tuple(frames.records[pictures.indices[n]].sequence for n in chosen)
    light = _light(unspilled(smooth, saturated), black, saturated, transfer)
    quality = round(quality_of(pictures.steps)[0]) if pictures.is_jpeg else None
    files = transfer, pictures.top_dn, quality
    symmetry = symmetry_sums(smooth, *place)
    own = Scenes(light, regions, numbers, window, black, saturated, *files, symmetry, expected)
    is_whole = window == (0, rows, 0, columns)
    used = tuple(pictures.indices[n] for n in chosen)
    return own, taken, Selection(len(frames), (rows, columns), (0, 0), used, None if is_whole else window)


def _refuse_renders(pictures: PictureSet, chosen: np.ndarray, rounding: Rounding) -> None:
    step = -(-len(chosen) // 12)  # a dozen pictures tell whether there is any noise
    few = replace(pictures, indices=tuple(pictures.indices[n] for n in chosen[::step]))
    blocks, _ = sample(few, 0)
    if is_rendered(blocks, noise_by_level(blocks, rounding, len(few)), rounding):
        raise NoSensorNoise(f"{no_noise(pictures)}; there is no camera to compare with")


def _stated_black(camera: Camera, transfer: str) -> float:
    """Level of no light that the camera's file states, in 1/255 of full scale."""
    share = torch.tensor(camera.spec.black_level_dn / (2**camera.bit_depth - 1))
    return 255 * float(encoded(share, transfer))


def chosen_of(pictures: PictureSet, budget: int = 1_200_000) -> tuple[np.ndarray, tuple[int, int, int, int]]:
    """Pictures, evenly spaced, and the window in the middle of them that is looked at, whole blocks of the JPEG grid.
    `budget`: pixels of all of them together.
    """
    rows, columns = pictures.frames.shape(pictures.indices[0])
    count = min(len(pictures), 60)
    chosen = np.unique(np.linspace(0, len(pictures) - 1, count).astype(int))
    share = min(1.0, np.sqrt(budget / (count * rows * columns)))
    height, width = (max(int(share * side) // SIDE, 4) * SIDE for side in (rows, columns))
    if min(rows, columns) < 4 * SIDE:
        problem = f"the pictures are {rows} x {columns}"
        raise InputError(problem, field="frames", expected="32 x 32 pixels or more")
    top, left = ((side - part) // 2 // SIDE * SIDE for side, part in ((rows, height), (columns, width)))
    return chosen, (top, top + height, left, left + width)


def read_windows(pictures: PictureSet, chosen: np.ndarray, window: tuple[int, int, int, int]) -> np.ndarray:
    r0, r1, c0, c1 = window
    return np.stack([pictures.read(int(n))[r0:r1, c0:c1] for n in chosen]).astype(np.float32)


def _saturation(camera: Camera, pictures: np.ndarray, transfer: str) -> float:
    """Level at which the camera's file says that pictures saturate, in 1/255 of full scale; 255 where the pictures go beyond."""
    top = 2**camera.bit_depth - 1
    spec = camera.spec
    well = spec.black_level_dn + (spec.full_well_e or np.inf) / spec.gain_e_per_dn
    level = 255 * float(encoded(torch.tensor(min(well / top, 1.0)), transfer))
    beyond = np.count_nonzero(pictures > 1.1 * level) > 1e-3 * np.count_nonzero(pictures > 0.9 * level)
    return 255.0 if beyond else level


def smooth_scenes(pictures: np.ndarray, regions: Regions) -> np.ndarray:
    """The scenes behind pictures: the sky at its level, flat regions smoothed within themselves, the rest nearly as it is."""
    found = ndimage.gaussian_filter(pictures, (0, 0.7, 0.7))
    flat = as_pixels(regions.lit >= 0)
    weight = flat.astype(np.float32)
    parts = [ndimage.gaussian_filter(x, (0, 3.0, 3.0)) for x in (pictures * weight, weight)]
    found[flat] = (parts[0] / np.maximum(parts[1], 1e-6))[flat]
    if regions.sky is not None:
        found[as_pixels(regions.dark)] = regions.sky
    return found


def unspilled(scenes: np.ndarray, saturated: float) -> np.ndarray:
    """Scenes (n, H, W) whose saturated areas are no longer along columns than along rows.
    Scenes have no preferred axis, so what is longer is charge that spilled, and not light. It is replaced by what lies as far along
    the rows from the middle of the light. The middle is where an area is widest; areas that a narrower trail joins have one each.
    """
    found = scenes.copy()
    for picture, scene in zip(scenes, found, strict=True):
        areas, _ = _labelled(picture >= saturated)
        for number, place in enumerate(ndimage.find_objects(areas), 1):
            own = areas[place] == number
            y, x = np.nonzero(own)
            middles = _middles(own)
            nearest = np.argmin([(y - row) ** 2 + (x - column) ** 2 for row, column in middles], axis=0)
            row, column = (np.array(middles)[nearest] + [place[0].start, place[1].start]).T
            y, x = y + place[0].start - row, x + place[1].start - column
            rows = np.clip(row + x, 0, picture.shape[0] - 1)
            columns = np.clip(column + y, 0, picture.shape[1] - 1)
            longer = np.abs(y) > np.abs(x)
            scene[(row + y)[longer], (column + x)[longer]] = picture[rows[longer], columns[longer]]
    return found


def _middles(area: np.ndarray) -> list[tuple[int, int]]:
    """Rows and columns of the middles of the light in a saturated area."""
    cores, half, count = area, int(area.sum(1).max()), 0
    while count == 0:  # the widest row may be in pieces; in the end the area is its own core
        half //= 2
        cores, count = _labelled(ndimage.binary_opening(area, np.ones((1, half + 1))))
    found = []
    for number in range(1, count + 1):
        core = cores == number
        width = core.sum(1)
        row = int(np.median(np.flatnonzero(width == width.max())))
        found.append((row, int(np.median(np.flatnonzero(core[row])))))
    return found


def _labelled(mask: np.ndarray) -> tuple[np.ndarray, int]:
    labels = np.zeros(mask.shape, np.int32)
    ndimage.label(mask, np.ones((3, 3)), output=labels)
    return labels, int(labels.max(initial=0))


def _light(smooth: np.ndarray, black: float, saturated: float, transfer: str) -> np.ndarray:
    share = torch.from_numpy(np.append(smooth.ravel(), np.float32(black)) / 255)
    linear = decoded(share, transfer).numpy()
    light = ((linear[:-1] - linear[-1]).clip(0) / (1 - linear[-1])).reshape(smooth.shape)
    # light of a saturated pixel over what saturates: not known, between 1 and 10 on a logarithmic scale
    return np.where(smooth >= saturated, 10**0.5 * light, light).astype(np.float32)


def _expected(
    scenes: FrameSet, camera: Camera, transfer: str, saturated: float, warn: Callable[[str], object]
) -> np.ndarray:
    """(3, statistics): the symmetries' statistics of other pictures as the camera would take them, see `Scenes.expected`.
    As without other pictures where too few of them tell a statistic.
    With the camera's noise, so that the same regions pass for flat.
    """
    pictures = largest_group(scenes, warn)
    chosen, window = chosen_of(pictures)
    clean = read_windows(pictures, chosen, window)
    dark = find_regions(clean, saturated, Rounding(pictures.steps, pictures.is_jpeg)).sky or 0.0
    taken, black = _taken(_light(clean, dark, 256.0, transfer), camera, transfer)
    regions = find_regions(taken, saturated, Rounding(np.ones((SIDE, SIDE)), False))
    shape = pictures.frames.shape(pictures.indices[0])
    level = regions.sky if regions.sky is not None else black
    sums = symmetry_sums(taken, regions.lit >= 0, level, saturated, (window[0], window[2]), shape)
    unknown = _unknown()
    if not sums.told[np.isnan(unknown[0])].all():
        said = "too few scenes have flat or smooth regions; falloff of light is not compared"
        warn(f"scenes_tell_nothing: {said}")
    return np.where(sums.told, np.stack([sums.ratio, sums.variance, sums.freedom]), unknown)


def _unknown() -> np.ndarray:
    """(3, statistics): without other pictures saturated areas are alike along both axes, and falloff is not known."""
    level = np.where([s.view == "falloff" for s in STATISTICS], np.nan, 0.0)
    return np.stack([level, level, level + 1])


def _taken(light: np.ndarray, camera: Camera, transfer: str) -> tuple[np.ndarray, float]:
    """Light (n, H, W) with shot and read noise of the camera alone, in 1/255 of full scale, and the level of no light."""
    spec, top = camera.spec, 2**camera.bit_depth - 1
    rng = np.random.default_rng(0)
    electrons = light * (top - spec.black_level_dn) * spec.gain_e_per_dn
    noisy = rng.poisson(electrons) + rng.normal(0, spec.read_noise.sigma_e, light.shape)
    share = torch.from_numpy((noisy / spec.gain_e_per_dn + spec.black_level_dn).clip(0, top) / top)
    pictures = np.rint(255 * encoded(share, transfer).numpy()).astype(np.float32)
    return pictures, _stated_black(camera, transfer)
