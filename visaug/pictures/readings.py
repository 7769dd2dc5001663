"""Gain, read noise and black level from the noise curve of pictures, under each tone curve that it allows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from visaug.core.intervals import Interval, t_quantile
from visaug.pictures.blocks import Levels, Rounding
from visaug.pictures.curve import TONES, Sky, VarianceLaw, fit
from visaug.pictures.files import PictureSet
from visaug.pictures.pattern import Pattern, VariancePart
from visaug.pictures.sets import jackknife
from visaug.pictures.texture import Texture

_SAME = 5.41  # chi-square of 1 degree of freedom at 2 %
_SURE = 1.96  # standard errors of a 95 % interval


@dataclass(frozen=True)
class NoiseCurve:
    """Noise of flat blocks by level, and what else bears on its law."""

    pictures: PictureSet
    levels: Levels
    rounding: Rounding
    sky: Sky | None
    texture: Texture
    pattern: Pattern

    def noise(self, weights: np.ndarray | None = None, share: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Level and variance without texture where the pictures have these weights.
        `share`: standard errors by which the share of texture is moved.
        """
        weights = np.ones(len(self.pictures)) if weights is None else weights
        level, variance = self.levels.of_pictures(weights, self.rounding)
        return level, variance / (1 + self.texture.excess(share))

    def quiet(self, variance: np.ndarray) -> np.ndarray:
        """The variance with that of blocks chosen for being quiet in the sky too."""
        return variance * self.levels.chosen / self.levels.variance

    def fitted(self, law: VarianceLaw, level: np.ndarray, variance: np.ndarray) -> VarianceLaw:
        """The law under the same tone curve, with the same response of the pixels."""
        return fit(law.tone, level, variance, self.levels.error, self.sky, law)[0]


@dataclass(frozen=True)
class Reading:
    """One tone curve that the pictures allow: its law, and gain, read noise and black level with their ends."""

    law: VarianceLaw
    gain: Interval
    read: Interval
    black: Interval
    # of texture that all surfaces seem to have, as fine as noise; 0 where noise grows no faster than the law
    # says
    contrast: float
    misfit: float  # root of chi-square by its degrees of freedom, 1 or more, by which errors are enlarged


def readings_of(curve: NoiseCurve, start: VarianceLaw) -> list[Reading]:
    """The tone curves that the noise curve allows at 2 %, the best first.
    One under which read noise exceeds the shot noise of a saturated pixel is none of a camera: a full well holds more
    electrons than the square of the read noise.
    """
    start = replace(start, prnu=_deviation(curve.pattern.prnu))
    fits = [_fit(tone, curve, start) for tone in TONES]
    if not (fits := [(law, chi) for law, chi in fits if law.read < law.shot * 255]):
        return []
    least = min(chi for _, chi in fits)
    scale = max(least / max(len(curve.levels.level) - 2, 1), 1.0)
    allowed = sorted((f for f in fits if (f[1] - least) / scale < _SAME), key=lambda f: f[1])
    return [_reading(law, chi, curve) for law, chi in allowed]


def _with_contrast(law: VarianceLaw, chi: float, curve: NoiseCurve) -> VarianceLaw | None:
    """The law with a part that grows with the square of light, as texture of one contrast does, beyond the pixels' response.
    None where the noise curve does not ask for it at 2 %.
    """
    level, variance = curve.noise()
    free, least = fit(law.tone, level, variance, curve.levels.error, curve.sky, law, free_response=True)
    scale = max(least / max(len(level) - 3, 1), 1.0)
    beyond = free.prnu > _deviation(curve.pattern.prnu, _SURE)
    return free if beyond and (chi - least) / scale > _SAME else None


def _fit(tone: str, curve: NoiseCurve, start: VarianceLaw) -> tuple[VarianceLaw, float]:
    """The best law under a tone curve and its chi-square.
    Without a sky the black level is the lowest, from 0 on, with which read noise is not negative: only both together show.
    """
    level, variance = curve.noise()
    error = curve.levels.error
    if curve.sky is None:
        darkest = _darkest(tone, level)
        law, _ = fit(tone, level, variance, error, None, replace(start, black=darkest))
        start = replace(start, black=max(darkest - law.read / law.shot, 0.0))
    return fit(tone, level, variance, error, curve.sky, start)


def _darkest(tone: str, level: np.ndarray) -> float:
    """Linear level of the darkest flat region: black does not lie above."""
    return 255 * float(TONES[tone](level[:1] / 255)[0])


def _deviation(part: VariancePart | None, errors: float = 0.0) -> float:
    """Standard deviation of a pattern, moved by standard errors of its variance; 0 at best where it is not found."""
    if part is None or (errors == 0 and not part.found):
        return 0.0
    return math.sqrt(max(part.variance + errors * part.error, 0.0))


def _figures(law: VarianceLaw, fixed: float) -> np.ndarray:
    """Logarithms of gain and read noise, and the black level; `fixed` is the variance of the pixels' pattern."""
    read = max(law.read - fixed, 1e-4 * law.read)
    return np.array([-math.log(law.shot), 0.5 * math.log(read) - math.log(law.shot), law.black])


def _reading(law: VarianceLaw, chi: float, curve: NoiseCurve) -> Reading:
    scale, fixed = curve.pictures.scale, _deviation(curve.pattern.pixel) ** 2
    freedom = max(len(curve.levels.level) - (3 if curve.sky else 2), 1)
    textured, misfit = _with_contrast(law, chi, curve), math.sqrt(max(chi / freedom, 1.0))
    contrast = textured.prnu if textured else 0.0
    gain, read, black = _with_ends(law, curve, fixed, misfit, textured)
    if curve.sky is not None:
        return Reading(law, _scaled(gain, 1 / scale), read, _scaled(black, scale), contrast, misfit)
    # Any black level up to the darkest region is possible: read noise is least at the lowest and most at the highest.
    darkest = _darkest(law.tone, curve.levels.level)
    raised = curve.fitted(replace(law, black=darkest), *curve.noise())
    other_gain, most, _ = _with_ends(raised, curve, fixed, misfit)
    gain = gain[0], min(gain[1], other_gain[1]), max(gain[2], other_gain[2])
    read = min(read[0], most[2]), (0.0 if law.black > 0 else min(read[1], most[1])), most[2]
    lowest = max(min(law.black, darkest - raised.shot * most[2] ** 2), 0.0)
    black = _scaled((law.black, lowest, darkest), scale)
    return Reading(law, _scaled(gain, 1 / scale), read, black, contrast, misfit)


def _with_ends(
    law: VarianceLaw, curve: NoiseCurve, fixed: float, misfit: float, textured: VarianceLaw | None = None
) -> tuple[Interval, Interval, Interval]:
    """Gain, read noise and black level of a law in 1/255 of full scale: value and 95 % interval, which hold `textured` too."""

    def figures(weights: np.ndarray) -> np.ndarray:
        return _figures(curve.fitted(law, *curve.noise(weights)), fixed)

    value, spread, degrees = jackknife(figures, len(curve.pictures))
    parts = [misfit * t_quantile(degrees) * spread]
    parts += [np.abs(others - value).max(0) for others in _open(law, curve, fixed)]
    parts += [np.abs(_figures(textured, fixed) - value)] if textured else []
    half = np.sqrt(np.square(parts).sum(0))
    if curve.sky is not None:
        half[2] = math.hypot(half[2], t_quantile(degrees) * curve.sky.error)
    gain, read = (tuple(math.exp(value[k] + sign * half[k]) for sign in (0, -1, 1)) for k in (0, 1))
    return gain, read, (value[2], value[2] - half[2], value[2] + half[2])  # type: ignore[return-value]


def _scaled(interval: Interval, factor: float) -> Interval:
    value, low, high = interval
    return value * factor, low * factor, high * factor


def _open(law: VarianceLaw, curve: NoiseCurve, fixed: float) -> Iterator[np.ndarray]:
    """Figures (ways, 3) at the ends of what is not known exactly: the share of texture, response and offsets of pixels.
    Noise that JPEG has rounded together with texture does not add up as variances do, and texture as fine as noise cannot be told
    from it: there the noise with all of the texture is one of the ends. Where the sky's noise has heavy tails, or faint stars,
    the noise of its quiet blocks is one: lit levels have lost as much by the choice of theirs.
    """
    ends = [curve.noise(share=s) for s in (-_SURE, _SURE)]
    if curve.rounding.is_jpeg or curve.texture.is_white:
        ends.append((ends[0][0], curve.levels.variance))
    yield np.array([_figures(curve.fitted(law, *end), fixed) for end in ends])
    level, variance = curve.noise()
    if curve.sky is not None:
        yield _figures(curve.fitted(law, level, curve.quiet(variance)), fixed)[None]
    prnu = [replace(law, prnu=_deviation(curve.pattern.prnu, s)) for s in (-_SURE, _SURE)]
    yield np.array([_figures(curve.fitted(p, level, variance), fixed) for p in prnu])
    pixel = [_deviation(curve.pattern.pixel, s) ** 2 for s in (-_SURE, _SURE)]
    yield np.array([_figures(law, p) for p in pixel])
