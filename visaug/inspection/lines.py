"""Patterns of whole rows; columns are the rows of transposed frames."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from visaug.inspection import spectra
from visaug.inspection.finding import needed, needed_f, needed_t
from visaug.inspection.material import FrameGroup
from visaug.inspection.spectra import FINER, WINDOWED, Continuum, continuum
from visaug.statistics.views.pattern import _detrended as smoothed_off
from visaug.statistics.views.spectrum import power as spectrum

LEAST_PERIODS = 3  # in a frame, of a fixed banding; slower changes are slopes and bumps


@dataclass(frozen=True)
class Wave:
    """A sine of the row number."""

    frequency: float  # cycles per frame
    amplitudes: np.ndarray  # (n,) complex, one for each frame
    new: bool  # whether it changes from frame to frame
    gain: float  # twice the log likelihood ratio
    variance: tuple[float, float]  # of an amplitude by temporal noise of the rows, and by fixed offsets, DN^2


@dataclass
class RowMeans:
    """Row means of frames, of which `axis` is `column` where they are transposed, and the regular parts that were found in them.

    `profiles` are (n, H) row means of each frame less the frame's, DN; regular parts are taken off as they are found.
    """

    look: FrameGroup
    axis: str
    profiles: np.ndarray
    waves: list[Wave] = field(default_factory=list)
    steps: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    parity: tuple[float, float, float] | None = None

    @property
    def count(self) -> int:
        return len(self.profiles)

    @property
    def length(self) -> int:
        return self.profiles.shape[1]

    @property
    def breadth(self) -> int:
        return self.look.shape[1]

    @property
    def fixed(self) -> np.ndarray:
        """(H,) of the mean frame."""
        return self.profiles.mean(0)

    @property
    def new(self) -> np.ndarray:
        """(n, H) about it, scaled to the variance of one frame."""
        return (self.profiles - self.fixed) * math.sqrt(self.count / max(self.count - 1, 1))

    def continua(self, windowed: bool = False) -> tuple[Continuum, Continuum | None]:
        """Of the fixed rows, and of those that change; None of one frame.

        The fixed ones contain 1/n of what changes. `windowed` keeps oscillations that are still there apart.
        """
        window = spectra.tapered if windowed else np.asarray
        look = self.look
        j = np.arange(1, self.length // 2 + 1)
        temporal = None
        floors = look.pattern_variance / self.breadth * look.colour
        if self.count > 1:
            pixel = look.noise_variance / self.breadth * look.colour
            temporal = continuum(spectrum(window(self.new)), self.count - 1, pixel)
            floors = floors + temporal.beyond(j) / self.count
        fixed = continuum(spectrum(window(smoothed_off(self.fixed)[None])), 1, floors, LEAST_PERIODS)
        return fixed, temporal


def rows_of(look: FrameGroup, axis: str) -> RowMeans:
    """The rows of frames, their regular parts taken off one after another, the clearest first."""
    means = look.data.frames.mean(2, dtype=np.float64)
    found = RowMeans(look, axis, means - means.mean(1, keepdims=True))
    most = 8  # regular parts taken off one after another
    for _ in range(most):
        fixed, temporal = found.continua(windowed=True)
        options = *_steps(found, fixed), _parity(found, fixed), _wave(found, fixed, temporal)
        if not any(options):
            break
        _, take = max(filter(None, options), key=lambda option: option[0])
        take()
        _refine_steps(found)
    return found


def _refine_steps(lines: RowMeans) -> None:
    """Steps by the means of the parts, which are more precise than steps beside a cubic, where nothing else is slow."""
    if not lines.steps:
        return
    steps, profiles = dict(lines.steps), lines.profiles
    at = np.arange(lines.length)
    sides = np.stack([(at >= place) - 0.5 for place in steps] + [np.ones(len(at))], 1)
    profile = lines.fixed + sides[:, :-1] @ [height for height, _, _ in steps.values()]
    heights = np.linalg.lstsq(sides, profile, rcond=None)[0]
    spread = np.diag(np.linalg.inv(sides.T @ sides))
    for k, (place, (before, _, _)) in enumerate(steps.items()):
        lines.profiles = lines.profiles - (heights[k] - before) * ((at >= place) - 1 + place / lines.length)
    fixed, _ = lines.continua(windowed=True)
    if fixed.rise > 0:
        lines.profiles = profiles
        return
    for k, (place, (_, _, gain)) in enumerate(steps.items()):
        lines.steps[place] = (float(heights[k]), math.sqrt(spread[k] * max(fixed.level, 1e-12)), gain)


def _steps(lines: RowMeans, fixed: Continuum) -> Iterator:
    """A step of the fixed rows at a quarter, beside a cubic about it."""
    if not lines.look.is_uniform:
        return
    profile, length = lines.fixed, lines.length
    slow = 4  # cycles per frame, whose power a step is held against
    quarters = (1, 2, 3)  # of the frame, at which another part of the readout may begin
    for quarter in quarters:
        place = length * quarter // 4
        reach = min(length // 4, 96)
        here = np.arange(place - reach, min(place + reach, length))
        x = (here - place) / reach
        design = np.stack([(here >= place) - 0.5, np.ones(len(x)), x, x**2, x**3], 1)
        height = float(np.linalg.lstsq(design, profile[here], rcond=None)[0][0])
        covariance = np.linalg.inv(design.T @ design)
        variance = covariance[0, 0] * max(float(fixed.floors[slow - 1]) + fixed.white, 1e-12)
        gain = float(height**2 / variance)
        if place not in lines.steps and gain > needed_t(len(quarters), fixed.bins):
            step = height, math.sqrt(variance), gain

            def take(place=place, step=step) -> None:
                height, lines.steps[place] = step[0], step
                above = (np.arange(length) >= place) - 1 + place / length  # mean 0
                lines.profiles = lines.profiles - height * above

            yield gain, take


def _parity(lines: RowMeans, fixed: Continuum):
    sign = np.where(np.arange(lines.length) % 2, 1.0, -1.0)
    about_mean = smoothed_off(lines.fixed)
    half = float((about_mean * sign).mean())
    variance = max(float(fixed.at(lines.length / 2)), 1e-12) / lines.length
    gain = half**2 / variance
    if lines.parity is not None or not lines.look.is_uniform or gain < needed_t(1, fixed.bins):
        return None

    def take() -> None:
        lines.parity = (half, math.sqrt(variance), gain)
        lines.profiles = lines.profiles - half * sign

    return gain, take


def _wave(lines: RowMeans, fixed: Continuum, temporal: Continuum | None):
    """The strongest sine, fixed or new in each frame, if clean rows have none as strong."""
    n, length = lines.count, lines.length
    parts = [(smoothed_off(lines.fixed)[None], fixed)] if lines.look.is_uniform else []
    parts += [] if temporal is None else [(lines.new, temporal)]
    found = None
    least_new = 1.5  # in a frame, of one that is new in each
    shortest = 2.05  # lines; shorter periods are odd against even lines
    nothing = 1e-12  # DN^2, below which frames are of one value
    above = 3.0  # times the power two cycles per frame lower: a line stands above both sides
    for profiles, level in parts:
        frequency, power = spectra.fine_spectrum(profiles)
        least = LEAST_PERIODS if level is fixed else least_new
        allowed = (frequency >= least) & (frequency <= length / shortest)
        for wave in lines.waves:  # what a sine leaves beside itself is no other one
            allowed &= np.abs(frequency - wave.frequency) > 1.25  # cycles per frame
        narrow = spectra.fine_spectrum(spectra.tapered(profiles))[1]
        below = np.concatenate([np.zeros(2 * FINER), narrow[: -2 * FINER]])
        allowed &= narrow > above * below  # a smooth bump has more at lower frequencies
        degree = 3 if level is fixed else 0  # slopes and bumps are fixed
        raw = lines.fixed[None] if level is fixed else profiles
        for strength in (power / np.maximum(level.at(frequency), 1e-12), power):
            top = int(np.where(allowed, strength, 0.0).argmax())
            if not allowed[top] or power[top] <= nothing:
                continue
            exact = spectra.sharpened(raw, float(frequency[top]), least - 0.25, degree)
            # Judged against what is left without it, which its own power does not raise.
            rest = raw - spectra.sines(spectra.phasors(raw, exact, degree), exact, length)
            rest = spectra.tapered(smoothed_off(rest.T).T if degree else rest)
            left = continuum(spectrum(rest), level.shape, level.floors, LEAST_PERIODS if degree else 1)
            gain = 2 * level.shape * float(power[top] / np.maximum(left.at(frequency[top]), 1e-12))
            clear = gain > needed_f(FINER * int(allowed.sum()), 2 * level.shape, WINDOWED * left.bins)
            if clear and (found is None or gain > found[0]):
                found = gain, exact, degree
    if found is None:
        return None
    gain, frequency, degree = found
    amplitudes = spectra.phasors(lines.profiles, frequency, degree)
    noise = 0.0 if temporal is None else float(temporal.at(frequency)) * 4 / length
    offsets = max(float(fixed.at(frequency)) * 4 / length - noise / n, 0.0)
    scatter = float((np.abs(amplitudes - amplitudes.mean()) ** 2).sum())
    # What stands out of the differences between frames is new; of the mean frame it may be the mean of what is new.
    new = temporal is not None and (degree == 0 or 2 * scatter > noise * needed(1, 2 * (n - 1)))

    def take() -> None:
        kept = amplitudes if new else np.full(n, amplitudes.mean())
        lines.waves.append(Wave(frequency, kept, new, gain, (noise, offsets)))
        lines.profiles = lines.profiles - spectra.sines(kept, frequency, length)

    return gain, take


def regular(lines: RowMeans) -> np.ndarray:
    """(H,) the fixed regular parts that were taken off the rows, DN."""
    means = lines.look.data.frames.mean(2, dtype=np.float64)
    return (means - means.mean(1, keepdims=True)).mean(0) - lines.fixed
