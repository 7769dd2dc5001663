"""What a camera's pictures tell beside the noise curve: patterns, row and column noise, JPEG and the spectrum of the noise."""

import math
from collections.abc import Sequence

import numpy as np

from visaug.core.intervals import Interval
from visaug.pictures.blocks import NOISE, Blocks, Levels, Rounding, U, V, is_flat
from visaug.pictures.curve import Sky
from visaug.pictures.files import PictureSet, quality_of
from visaug.pictures.pattern import Pattern, VariancePart
from visaug.pictures.readings import Reading
from visaug.pictures.texture import Texture
from visaug.statistics.findings import Findings


def add(found: Findings, name: str, interval: Sequence[float], unit: str, assumes: str = "") -> None:
    found.add(name, interval, unit, "pictures", assumes=assumes)


def add_patterns(
    found: Findings, pictures: PictureSet, best: Reading, pattern: Pattern, sky: Sky | None
) -> None:
    per_unit = 1 / best.law.shot  # electrons per 1/255 of full scale
    where = "the black sky" if sky else "flat regions"

    def part(name: str, value: VariancePart | None, needs: str, effect: str | None = None) -> None:
        if value is None:
            found.miss(name, needs)
            return
        interval = _with_gain(_root(value, per_unit), best.gain)
        assumes = where if name == "dsnu.pixel_e" else f"{where}; white from line to line"
        add(found, name, interval, "e-", assumes)
        if effect and value.found:
            found.effects.append({"name": effect, "sigma_e": float(f"{interval[0]:.4g}")})

    lines = "four or more pictures with flat rows of blocks"
    for axis in ("row", "column"):
        whole, fixed = getattr(pattern, axis), getattr(pattern, f"{axis}_fixed")
        part(f"dsnu.{axis}_e", fixed, lines)
        fresh = whole.minus(fixed) if whole else None
        part(f"{axis}_noise.sigma_e", fresh, lines, f"{axis}_noise")
        if whole is not None:
            add(found, f"image.{axis}_noise_dn", _root(whole, pictures.scale), "DN", where)
        else:
            found.miss(f"image.{axis}_noise_dn", lines)
    part("dsnu.pixel_e", pattern.pixel, "four or more pictures with a black sky at the same places")
    if pattern.prnu is None:
        found.miss("prnu.pixel", "pictures that are lit at the same places")
    else:
        assumes = "lit flat regions, the dark pattern taken off"
        add(found, "prnu.pixel", _root(pattern.prnu, 1.0), "1", assumes)


def _with_gain(interval: Interval, gain: Interval) -> Interval:
    """The interval of a figure in electrons, with the error of the gain that made them of DN."""
    value, low, high = interval
    if value == 0:
        return value, low, high * gain[2] / gain[0]
    down = math.hypot(math.log(value / low), math.log(gain[0] / gain[1])) if low > 0 else math.inf
    up = math.hypot(math.log(high / value), math.log(gain[2] / gain[0]))
    return value, value * math.exp(-down), value * math.exp(up)


def _root(part: VariancePart, factor: float) -> Interval:
    """Standard deviation with its interval; 0 where it is not found, and then up to what a variance of 0 or more allows."""
    value = math.sqrt(max(part.variance, 0.0)) * factor
    low = math.sqrt(max(part.variance - 1.96 * part.error, 0.0)) * factor
    high = math.sqrt(max(part.variance, 0.0) + 1.96 * part.error) * factor
    return (value, low, high) if part.found else (0.0, 0.0, high)


def add_processing(
    found: Findings, blocks: Blocks, levels: Levels, rounding: Rounding, texture: Texture
) -> None:
    """JPEG quality from the file; spectrum of the noise."""
    if rounding.is_jpeg:
        quality = quality_of(rounding.steps)
        add(found, "jpeg.quality", quality, "1", "the file's own table; compressed once")
        found.effects.append({"name": "jpeg", "quality": round(quality[0]), "chroma": "full"})
        return
    commonest = int(np.argmax(levels.blocks.sum(0)))
    coefficients = blocks.coefficients[np.abs(blocks.level - levels.level[commonest]) < 1]
    coefficients = coefficients[is_flat(coefficients, levels.variance[commonest], rounding)]
    fine, coarse = (np.median(coefficients[:, NOISE & which] ** 2) for which in (U + V > 9, U + V < 8))
    if coarse <= 0:
        return
    ratio = fine / coarse
    error = 2.3 * ratio * math.sqrt(2 / (coefficients.shape[0] * 10))
    interval = ratio, ratio - 1.96 * error, ratio + 1.96 * error
    add(found, "image.noise_fine_to_coarse", interval, "1", "1 where noise is white")
    allowed = 0.1 + texture.excess(2)[commonest]  # texture that is left makes coarse noise stronger
    if abs(ratio - 1) > max(allowed, 4 * error):
        found.warn(
            f"correlated_noise: fine noise has {ratio:.2g} times the power of coarse noise, as after denoising, sharpening or "
            "demosaicing, or of texture that covers all regions; gain and read noise are those of the noise as it is",
            spoils=("gain_e_per_dn", "read_noise.sigma_e"),
        )
