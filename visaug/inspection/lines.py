"""Patterns of whole rows; columns are the rows of transposed frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from visaug.core.wording import number
from visaug.inspection.finding import Finding, about, deviation, needed, needed_t, needed_z
from visaug.inspection.material import Look
from visaug.inspection.spectra import (
    FINER,
    Continuum,
    continuum,
    fine_spectrum,
    phasors,
    sharpened,
    sines,
    spectrum,
    tapered,
)

LEAST_PERIODS = 3  # in a frame, of a banding; slower changes are slopes
_SHORTEST = 2.05  # lines; shorter periods are odd against even lines
_ABOVE = 3.0  # times the power two cycles per frame lower: a line stands above both sides
_SLOW = 4  # cycles per frame, whose power a step is held against
_MOST = 8  # regular parts taken off one after another
_QUARTERS = (1, 2, 3)  # of the frame, at which another part of the readout may begin


@dataclass(frozen=True)
class Wave:
    """A sine of the row number.

    Attributes:
        frequency: cycles per frame.
        amplitudes: (n,) complex, one for each frame.
        new: whether it changes from frame to frame.
        gain: twice the log likelihood ratio.
        variance: of one frame's amplitude by the temporal noise of the rows, and by their fixed offsets, DN^2.
    """

    frequency: float
    amplitudes: np.ndarray
    new: bool
    gain: float
    variance: tuple[float, float]


@dataclass
class Lines:
    """Row means of frames, and what was found in them.

    Attributes:
        look: the frames.
        axis: `row`, or `column` where the frames are transposed.
        profiles: (n, H) row means of each frame less the frame's, DN; regular parts are taken off as they are found.
        waves, steps, parity: the regular parts.
    """

    look: Look
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
        window = tapered if windowed else np.asarray
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


def rows_of(look: Look, axis: str) -> Lines:
    """The rows of frames, their regular parts taken off one after another, the clearest first."""
    means = look.data.frames.mean(2, dtype=np.float64)
    found = Lines(look, axis, means - means.mean(1, keepdims=True))
    for _ in range(_MOST):
        fixed, temporal = found.continua(windowed=True)
        options = [
            o for o in (*_steps(found, fixed), _parity(found, fixed), _wave(found, fixed, temporal)) if o
        ]
        if not options:
            break
        _, take = max(options, key=lambda option: option[0])
        take()
    return found


def smoothed_off(profile: np.ndarray) -> np.ndarray:
    """Less the cubic that fits it best."""
    from visaug.statistics.views.pattern import _detrended

    return _detrended(profile)


def _steps(lines: Lines, fixed: Continuum) -> Iterator:
    """A step of the fixed rows at a quarter, beside a cubic about it."""
    if not lines.look.is_uniform:
        return
    profile, length = lines.fixed, lines.length
    for quarter in _QUARTERS:
        place = length * quarter // 4
        reach = min(length // 4, 96)
        here = np.arange(place - reach, min(place + reach, length))
        x = (here - place) / reach
        design = np.stack([(here >= place) - 0.5, np.ones(len(x)), x, x**2, x**3], 1)
        solved, covariance = (
            np.linalg.lstsq(design, profile[here], rcond=None)[0],
            np.linalg.inv(design.T @ design),
        )
        variance = covariance[0, 0] * max(float(fixed.floors[_SLOW - 1]) + fixed.white, 1e-12)
        gain = float(solved[0] ** 2 / variance)
        if place not in lines.steps and gain > needed_t(len(_QUARTERS), fixed.bins):

            def take(place=place, height=float(solved[0]), error=math.sqrt(variance), gain=gain) -> None:
                lines.steps[place] = (height, error, gain)
                lines.profiles = lines.profiles - height * ((np.arange(length) >= place) - place / length)

            yield gain, take


def _parity(lines: Lines, fixed: Continuum):
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


def _wave(lines: Lines, fixed: Continuum, temporal: Continuum | None):
    """The strongest sine, fixed or new in each frame, if clean rows have none as strong."""
    n, length = lines.count, lines.length
    spectra = [(smoothed_off(lines.fixed)[None], fixed)] if lines.look.is_uniform else []
    spectra += [] if temporal is None else [(lines.new, temporal)]
    found = None
    for profiles, level in spectra:
        frequency, power = fine_spectrum(profiles)
        allowed = (frequency >= LEAST_PERIODS) & (frequency <= length / _SHORTEST)
        narrow = fine_spectrum(tapered(profiles))[1]
        below = np.concatenate([np.zeros(2 * FINER), narrow[: -2 * FINER]])
        allowed &= narrow > _ABOVE * below  # a smooth bump has more at lower frequencies
        relative = np.where(allowed, power / np.maximum(level.at(frequency), 1e-12), 0.0)
        top = int(relative.argmax())
        gain = 2 * level.shape * float(relative[top])
        clear = gain > needed(FINER * int(allowed.sum()), 2 * level.shape)
        if clear and (found is None or gain > found[0]):
            found = gain, sharpened(profiles, float(frequency[top]), LEAST_PERIODS - 0.5)
    if found is None:
        return None
    gain, frequency = found
    amplitudes = phasors(lines.profiles, frequency)
    noise = 0.0 if temporal is None else float(temporal.at(frequency)) * 4 / length
    offsets = max(float(fixed.at(frequency)) * 4 / length - noise / n, 0.0)
    scatter = float((np.abs(amplitudes - amplitudes.mean()) ** 2).sum())
    new = temporal is not None and 2 * scatter > noise * needed(1, 2 * (n - 1))

    def take() -> None:
        kept = amplitudes if new else np.full(n, amplitudes.mean())
        lines.waves.append(Wave(frequency, kept, new, gain, (noise, offsets)))
        lines.profiles = lines.profiles - sines(kept, frequency, length)

    return gain, take


def line_findings(lines: Lines) -> list[Finding]:
    """Everything that was found in the rows."""
    fixed, temporal = lines.continua()
    return [
        *_wave_findings(lines),
        *_offset_findings(lines, fixed, temporal),
        *_step_findings(lines),
    ]


def _wave_findings(lines: Lines) -> Iterator[Finding]:
    """Sines of multiples of one frequency and of one kind are one banding."""
    left = sorted(lines.waves, key=lambda wave: wave.frequency)
    while left:
        first, *rest = left
        harmonics = [
            w
            for w in rest
            if w.new == first.new
            and round(w.frequency / first.frequency) > 1
            and abs(w.frequency / first.frequency - round(w.frequency / first.frequency)) * first.frequency
            < 0.5
        ]
        left = [w for w in rest if not any(w is h for h in harmonics)]
        found = _banding(lines, first, harmonics)
        if found.amplitude_dn:
            yield found


def _banding(lines: Lines, wave: Wave, harmonics: list[Wave]) -> Finding:
    axis, n, length = lines.axis, lines.count, lines.length
    noise, offsets = wave.variance
    if wave.new:
        square = float((np.abs(wave.amplitudes) ** 2).mean()) - noise - offsets
        value = math.sqrt(max(square, 0.0))
        error = math.sqrt((noise / n + offsets) / 2)
    else:
        value = math.sqrt(max(abs(wave.amplitudes.mean()) ** 2 - noise / n - offsets, 0.0))
        error = math.sqrt((noise / n + offsets) / 2)
    period = length / wave.frequency
    kind = None if n == 1 else "per_frame" if wave.new else "fixed"
    behaviour, advance = _phases(wave, n)
    details = {"frequency_cycles_per_line": wave.frequency / length}
    if advance is not None:
        details["phase_advance_periods_per_frame"] = advance
    if harmonics:
        details["harmonics"] = [round(w.frequency / wave.frequency) for w in harmonics]
    size = about(value, error)
    tail = f"; harmonics {', '.join(map(str, details['harmonics']))} too" if harmonics else ""
    return Finding(
        f"{axis}_banding",
        kind,
        f"Along the {axis}s runs a sine with a period of {period:.4g} {axis}s and a peak of {number(value)} DN; {behaviour}{tail}.",
        f"{axis} banding of {period:.3g} {axis}s, {value:.2g} DN, {behaviour}",
        wave.gain + sum(w.gain for w in harmonics),
        **size,
        period=period,
        axis=axis,
        details=details,
        shown={"lines": lines, "wave": wave},
    )


def _phases(wave: Wave, n: int) -> tuple[str, float | None]:
    """How the phase goes on from frame to frame, in words; and the advance, where it is regular."""
    if n == 1:
        return "fixed or new cannot be told from one exposure", None
    if not wave.new:
        return "the same phase in every frame", None
    unit = wave.amplitudes / np.maximum(np.abs(wave.amplitudes), 1e-12)
    if n >= 5:
        turn = (unit[1:] * unit[:-1].conj()).mean()
        if abs(turn) ** 2 * 2 * (n - 1) > needed(1, 2):  # Rayleigh's test of directions
            advance = float(np.angle(turn) / (2 * math.pi))
            return f"its phase moves on by {advance:+.2g} periods per frame", advance
        if abs(unit.mean()) ** 2 * 2 * n > needed(1, 2):
            return "changing in each frame, with a preferred phase", None
    return "new phase in each frame", None


def _offset_findings(lines: Lines, fixed: Continuum, temporal: Continuum | None) -> Iterator[Finding]:
    axis, n, length = lines.axis, lines.count, lines.length
    if temporal is not None:
        if temporal.rise > 0 and temporal.gain_rise > needed(5, 2):
            yield _flicker(lines, temporal)
        alias = 2 * float(
            temporal.beyond(length / 2) - temporal.white
        )  # bound on 1/f noise faster than the rows
        freedom = 2 * temporal.bins * temporal.shape
        if temporal.gain_white > needed() and temporal.white > alias:
            size = deviation(temporal.level, freedom, temporal.floor)
            yield Finding(
                f"{axis}_offset",
                "per_frame",
                f"Each {axis} has a new random offset in every frame, with a standard deviation of "
                f"{number(size['amplitude_dn'])} DN.",
                f"{axis} offsets of {size['amplitude_dn']:.2g} DN, new in each frame",
                temporal.gain_white,
                **size,
                axis=axis,
                shown={"lines": lines},
            )
    if not lines.look.is_uniform:
        return
    freedom = 2 * fixed.bins
    error = math.sqrt(2 / freedom)
    if temporal is not None and fixed.floor > 0:
        share = float(temporal.beyond(length / 4)) / n / fixed.floor
        error = math.hypot(error, share * math.sqrt(1 / (temporal.bins * temporal.shape)))
    # The window keeps the ends of smooth changes out; it has the information of 18/35 of the lines.
    narrow, _ = lines.continua(windowed=True)
    levels = (fixed.level, error), (narrow.level, error * math.sqrt(35 / 18))
    z = (
        min(math.log(max(level / fixed.floor, 1.0)) / e for level, e in levels)
        if fixed.floor > 0
        else math.inf
    )
    if fixed.gain_white > needed() and z > needed_z():
        size = deviation(fixed.level, freedom, fixed.floor)
        how = "fixed" if n > 1 else "fixed or new cannot be told from one exposure"
        yield Finding(
            f"{axis}_offset",
            "fixed" if n > 1 else None,
            f"Each {axis} has its own offset with a standard deviation of {number(size['amplitude_dn'])} DN, {how}.",
            f"{axis} offsets of {size['amplitude_dn']:.2g} DN, {how}",
            fixed.gain_white,
            **size,
            axis=axis,
            shown={"lines": lines},
        )


def _flicker(lines: Lines, temporal: Continuum) -> Finding:
    """1/f noise: what the spectrum of the rows, and that along the rows, has above its level at high frequencies."""
    look, axis = lines.look, lines.axis
    j = np.arange(1, lines.length // 2 + 1)
    between = 2 * float((temporal.beyond(j) - temporal.white).sum()) / lines.length
    noise = look.data.residual - look.data.residual.mean(2, keepdims=True)
    along = spectrum(noise.reshape(-1, noise.shape[2]))
    level = float(along[len(along) // 2 :].mean())
    within = 2 * float(np.maximum(along[: len(along) // 2] - level, 0.0).sum()) / noise.shape[2]
    clear = along[0] - level > 6 * level / math.sqrt(noise.shape[0] * noise.shape[1])
    value = math.sqrt(between + (within if clear else 0.0))
    error = value / math.sqrt(2 * max(temporal.shape, 1) * 3)  # a few low frequencies have most of the power
    size = about(value, error)
    return Finding(
        "flicker_noise",
        "per_frame",
        f"Noise that rises towards low frequencies over the {axis}s as f^-{temporal.exponent:.1f}, with a standard deviation of "
        f"{number(value)} DN, new in each frame{'; it goes on within a ' + axis if clear else ''}.",
        f"1/f noise over the {axis}s, {value:.2g} DN, new in each frame",
        temporal.gain_rise,
        **size,
        axis=axis,
        details={"exponent": temporal.exponent},
        shown={"lines": lines},
    )


def _step_findings(lines: Lines) -> Iterator[Finding]:
    axis, n = lines.axis, lines.count
    kind = "fixed" if n > 1 else None
    if not lines.look.is_uniform:
        return
    for place, (height, error, gain) in lines.steps.items():
        half = place == lines.length // 2
        first, second = ("upper", "lower") if axis == "row" else ("left", "right")
        text = (
            f"The {second} half lies {number(abs(height))} DN {'above' if height > 0 else 'below'} the {first}"
            if half
            else f"From {axis} {place} on the level is {number(abs(height))} DN {'higher' if height > 0 else 'lower'}"
        )
        short = f"{first} and {second} halves" if half else f"a step at {axis} {place}"
        share = 1 - place / lines.length
        spread = math.sqrt(share * (1 - share))
        yield Finding(
            "halves" if half else "step",
            kind,
            f"{text}, the same in every frame; the standard deviation over the frame is {number(abs(height) * spread)} DN.",
            f"{short} {abs(height):.2g} DN apart, fixed",
            gain,
            **about(abs(height) * spread, error * spread),
            axis=axis,
            share=share,
            details={f"at_{axis}": place, "difference_dn": height},
            shown={"lines": lines},
        )
    if lines.parity is not None:
        half, error, gain = lines.parity
        yield Finding(
            "parity",
            kind,
            f"Odd {axis}s (counted from 0) lie {number(abs(2 * half))} DN {'above' if half > 0 else 'below'} even ones, the same "
            f"in every frame: {number(abs(half))} DN about their mean.",
            f"odd and even {axis}s {abs(2 * half):.2g} DN apart, fixed",
            gain,
            **about(abs(half), error),
            period=2.0,
            axis=axis,
            details={"difference_dn": 2 * half},
            shown={"lines": lines},
        )


def regular(lines: Lines) -> np.ndarray:
    """(H,) the fixed regular parts that were taken off the rows, DN."""
    means = lines.look.data.frames.mean(2, dtype=np.float64)
    return (means - means.mean(1, keepdims=True)).mean(0) - lines.fixed
