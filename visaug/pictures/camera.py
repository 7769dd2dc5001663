"""From pictures to an effective camera: the noise curve under a tone curve, patterns, and what stays open."""

import math

import numpy as np

from visaug.core.intervals import t_quantile
from visaug.frames import FrameSet
from visaug.pictures.blocks import Blocks, Levels, Rounding, noise_by_level, sample
from visaug.pictures.curve import TONES, Sky, VarianceLaw, fit
from visaug.pictures.files import PictureSet, largest_group
from visaug.pictures.pattern import recurring
from visaug.pictures.patterns import add, add_patterns, add_processing
from visaug.pictures.readings import NoiseCurve, Reading, readings_of
from visaug.pictures.sets import find_sky, is_rendered, jackknife, no_noise, rounded_away
from visaug.pictures.texture import Texture, texture_in
from visaug.statistics.findings import Findings

NEEDS = {
    "quantum_efficiency": "flats with known photons per pixel",
    "dark_current.a_e_per_s": "dark frames at several exposures and temperatures",
    "full_well_e": "flats beyond saturation; the highest code of the pictures saturates the camera here",
}
_NO_CAMERA = (
    "gain_e_per_dn", "read_noise.sigma_e", "black_level_dn", "dsnu.pixel_e", "dsnu.row_e", "dsnu.column_e", "prnu.pixel",
)  # fmt: skip


def camera_of_pictures(found: Findings, frames: FrameSet, seed: int) -> tuple[int, int] | None:
    """Adds what the pictures tell of their camera; returns their size where there is a camera, else None."""
    for name, needs in NEEDS.items():
        found.miss(name, needs)

    def warn(text: str) -> None:
        in_doubt = ("gain_e_per_dn", "*noise*", "dsnu.*", "prnu.*") if text.startswith("colour_jpeg:") else ()
        found.warn(text, in_doubt)

    pictures = largest_group(frames, warn)
    blocks, left_out = sample(pictures, seed)
    rounding = Rounding(pictures.steps, pictures.is_jpeg)
    levels = noise_by_level(blocks, rounding, len(pictures))
    if is_rendered(blocks, levels, rounding):
        said = f"no_sensor_noise: {no_noise(pictures)}; there is no camera"
        _no_camera(found, "pictures with sensor noise", said)
        found.miss("image.noise_dn", "pictures with sensor noise")
        return None
    if not len(levels.level):
        return _no_flat_regions(found, blocks, left_out)
    _noise_in_dn(found, pictures, levels, rounding)
    if left_out > 0.5:
        said = f"{left_out:.0%} of the regions are saturated or all black and tell nothing"
        found.warn(f"clipped_pictures: {said}")
    if len(pictures) < 3:
        said = f"few_pictures: {len(pictures)} of one kind; spreads and patterns need three or more"
        return _no_camera(found, "three or more pictures", said)
    return _camera(found, pictures, blocks, levels, rounding)


def _no_flat_regions(found: Findings, blocks: Blocks, left_out: float) -> None:
    needs = "flat regions of 8 x 8 pixels that do not clip"
    if not len(blocks.level):
        said = "clipped_pictures: every region is saturated or all black; nothing can be measured"
    else:
        said = f"no_flat_regions: the pictures hold hardly any region without structure ({left_out:.0%} of all regions clip)"
    _no_camera(found, needs, said)
    found.miss("image.noise_dn", needs)


def _no_camera(found: Findings, needs: str, said: str = "") -> None:
    for name in _NO_CAMERA:
        found.miss(name, needs)
    if said:
        found.warn(said)


def _noise_in_dn(found: Findings, pictures: PictureSet, levels: Levels, rounding: Rounding) -> None:
    """The noise curve and its straight line in DN, whatever made it."""
    scale = pictures.scale
    found.curves["noise_level"] = levels.curve(scale)

    def figures(weights: np.ndarray) -> np.ndarray:
        level, variance = levels.of_pictures(weights, rounding)
        blocks = np.tensordot(weights, levels.blocks, 1)
        good = np.isfinite(variance) & (blocks > 0)
        typical = float(np.sqrt((blocks * np.nan_to_num(variance)).sum() / blocks.sum()))
        if np.count_nonzero(good) < 2 or np.ptp(level[good]) < 4 * typical:
            return np.array([typical, np.nan, np.nan])
        line = np.polyfit(level[good], variance[good], 1, w=1 / (variance * levels.error)[good])
        return np.array([typical, *line])

    value, spread, degrees = jackknife(figures, len(pictures))
    units = (("image.noise_dn", "DN", scale), ("image.noise_slope_dn", "DN", scale),
             ("image.noise_floor_dn2", "DN^2", scale**2))  # fmt: skip
    for k, (name, unit, factor) in enumerate(units):
        if np.isfinite(value[k]):
            half = t_quantile(degrees) * spread[k] if np.isfinite(spread[k]) else math.inf
            if len(pictures) == 1:
                half = 1.96 * float(np.median(levels.error)) * abs(value[k])
            add(found, name, [v * factor for v in (value[k], value[k] - half, value[k] + half)], unit)
        else:
            found.miss(name, "flat regions at different levels")


def _camera(
    found: Findings, pictures: PictureSet, blocks: Blocks, levels: Levels, rounding: Rounding
) -> tuple[int, int] | None:
    needs, fewest_levels = "flat regions at several levels", 4
    if len(levels.level) < fewest_levels or np.ptp(levels.level) < 20:
        said = "flat regions lie at one level only; without a slope there is no gain, and no camera"
        return _no_camera(found, needs, f"one_level: {said}")
    if sky := find_sky(blocks, levels):
        near = sky.level - sky.reach, sky.level + sky.reach
        levels = noise_by_level(blocks, rounding, len(pictures), near)
    cut = 3.0  # standard deviations of noise above code 0
    if pictures.is_jpeg and sky and sky.level < cut * math.sqrt(levels.variance[0]):
        # A decoder cuts what JPEG has moved below 0, so noise there follows no law of the sensor.
        levels, sky = levels.where(levels.level > cut * np.sqrt(levels.variance)), None
        said = "black lies at code 0 and JPEG cuts its noise again; noise near black is left out"
        found.warn(f"black_cut_by_jpeg: {said}")
        if len(levels.level) < fewest_levels:
            return _no_camera(found, needs)
    clear, sky = _without_rounded(found, levels, rounding, sky)
    if len(clear.level) < fewest_levels:
        lost = len(clear.level) < len(levels.level)
        return _no_camera(found, needs + " whose noise JPEG has not rounded away" * lost)
    levels = clear
    black, codes = sky.level if sky else 0.0, max(round(pictures.top_dn), 255)
    start = VarianceLaw("linear", 0.05, max(0.8 * float(levels.variance[0]), 0.02), black, codes=codes)
    fits = [fit(tone, levels.level, levels.variance, levels.error, sky, start) for tone in TONES]
    first = min(fits, key=lambda f: f[1])[0]
    pattern = recurring(pictures, levels, rounding, first, sky)
    texture = texture_in(blocks, levels, rounding, sky.level + sky.reach if sky else -math.inf)
    readings = readings_of(NoiseCurve(pictures, levels, rounding, sky, texture, pattern), start)
    if not readings:
        said = "no_shot_noise: the noise does not grow with the level as shot noise does, so there is no gain"
        return _no_camera(found, "noise that grows with the level as shot noise does", said)
    best = readings[0]
    low, high = min(r.gain[1] for r in readings), max(r.gain[2] for r in readings)
    if not (high < 3.0**2 * low and math.isfinite(high)):  # a factor of three either way
        said = f"gain_unknown: the gain lies between {low:.3g} and {high:.3g} e-/DN; that is no measurement"
        return _no_camera(found, "more pictures, or flat regions over a wider range of levels", said)
    _warn_of_fine_texture(found, texture, best)
    if best.misfit > 2.0:
        found.warn(
            f"noise_curve_misfit: noise of flat regions lies {best.misfit:.1f} standard errors from shot noise and a constant, "
            "root mean square; texture in all regions, or processing; errors are enlarged by as much and may still be too small",
            spoils=("gain_e_per_dn", "read_noise.sigma_e"),
        )
    _add_tone(found, readings)
    _add_curve(found, pictures, readings, sky)
    add_patterns(found, pictures, best, pattern, sky)
    add_processing(found, blocks, levels, rounding, texture)
    found.warn(
        "pictures_alone: the camera is an effective one: it gives these pictures' noise, whatever made it (sensor, "
        "compression, denoising); bias, dark and flat frames would tell the parts"
    )
    return pictures.frames.shape(pictures.indices[0])


def _without_rounded(
    found: Findings, levels: Levels, rounding: Rounding, sky: Sky | None
) -> tuple[Levels, Sky | None]:
    """The levels whose noise JPEG has not rounded away, and the sky where it is one of them."""
    rounded = rounded_away(levels, rounding)
    if not rounded.any():
        return levels, sky
    found.warn(
        f"noise_rounded_away: JPEG has rounded away the noise of {np.count_nonzero(rounded)} of {len(rounded)} levels; they are "
        "left out, and noise close to its steps is inexact",
        spoils=("gain_e_per_dn", "*noise*"),
    )
    if sky and rounded[np.argmin(np.abs(levels.level - sky.level))]:
        sky = None
    return levels.where(~rounded), sky


def _warn_of_fine_texture(found: Findings, texture: Texture, best: Reading) -> None:
    signs = []
    if texture.is_white:
        share = f"{texture.share:.2g} of its power in fine frequencies (white noise has 1)"
        signs.append(f"structure in flat regions has {share}")
    if best.contrast:
        texture_of = f"texture of a contrast of {best.contrast:.1%}"
        signs.append(f"noise grows with the light itself, as {texture_of} does")
    if signs:
        found.warn(
            f"texture_as_noise: {' and '.join(signs)}: texture of about 2 px, or noise with heavy tails; intervals cover gain and "
            "read noise with and without it",
            spoils=("gain_e_per_dn", "read_noise.sigma_e"),
        )


def _add_tone(found: Findings, readings: list[Reading]) -> None:
    tones = [r.law.tone for r in readings]
    if len(tones) > 1:
        found.warn(
            f"tone_curve_open: a tone curve and gain cannot be separated here: {' and '.join(tones)} fit the noise curve "
            f"alike; {tones[0]} fits best and is taken, the intervals cover the others",
            spoils=("gain_e_per_dn", "read_noise.sigma_e", "black_level_dn"),
        )
    if tones[0] != "linear":
        found.warn(
            f"tone_curve: the noise curve is that of a {tones[0]} tone curve; gain, read noise and black level are those of the "
            "linear picture, in 1/255 of full scale; augment with transfer srgb"
        )


def _add_curve(found: Findings, pictures: PictureSet, readings: list[Reading], sky: Sky | None) -> None:
    tone = readings[0].law.tone
    shared = f"flat regions hold shot noise and a constant; {tone} tone curve; neither denoised nor sharpened"

    def span(part: str) -> tuple[float, float, float]:
        every = [getattr(r, part) for r in readings]
        return every[0][0], min(e[1] for e in every), max(e[2] for e in every)

    add(found, "gain_e_per_dn", span("gain"), "e-/DN", shared)
    black = span("black")
    lowest = f"; black level {black[0]:.3g} DN at best, the lowest with which it is not negative"
    add(found, "read_noise.sigma_e", span("read"), "e-", shared + ("" if sky else lowest))
    if sky is None and black[0] > 0:
        add(found, "black_level_dn", black, "DN", "no black sky: from noise that would be negative below")
        return
    if sky is None:
        found.miss("black_level_dn", "pictures with a black sky; 0 is taken")
        return
    noise = math.sqrt(readings[0].law.read) * pictures.scale
    if black[0] < 3 * math.sqrt(readings[0].law.read) * pictures.scale:
        found.warn(
            f"cut_at_0: black lies {black[0]:.2g} DN above code 0 with noise of {noise:.2g} DN, so part of it is cut off; the law "
            "of the cut is in the fit"
        )
    add(found, "black_level_dn", [max(v, 0.0) for v in black], "DN", "the sky is black")
