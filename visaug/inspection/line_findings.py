"""What was found in the lines of frames, as findings: banding, offsets, 1/f noise, halves, odd and even lines."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from visaug.core.wording import number
from visaug.inspection.finding import Finding, about, deviation, needed, needed_z
from visaug.inspection.lines import RowMeans, Wave
from visaug.inspection.spectra import WINDOWED, Continuum
from visaug.statistics.views.spectrum import power as spectrum


def line_findings(lines: RowMeans) -> list[Finding]:
    """Everything that was found in the rows."""
    return [*_wave_findings(lines), *_offset_findings(lines, *lines.continua()), *_step_findings(lines)]


def _wave_findings(lines: RowMeans) -> Iterator[Finding]:
    """Sines of multiples of one frequency and of one kind are one banding."""
    left = sorted(lines.waves, key=lambda wave: wave.frequency)
    while left:
        first, *rest = left

        def is_harmonic(wave: Wave, first: Wave = first) -> bool:
            times = wave.frequency / first.frequency
            is_near = abs(times - round(times)) * first.frequency < 0.5
            return wave.new == first.new and round(times) > 1 and is_near

        left = [wave for wave in rest if not is_harmonic(wave)]
        found = _banding(lines, first, [wave for wave in rest if is_harmonic(wave)])
        if found.amplitude_dn:
            yield found


def _banding(lines: RowMeans, wave: Wave, harmonics: list[Wave]) -> Finding:
    axis, n, length = lines.axis, lines.count, lines.length
    noise, offsets = wave.variance
    if wave.new:
        square = float((np.abs(wave.amplitudes) ** 2).mean()) - noise - offsets
    else:
        square = abs(wave.amplitudes.mean()) ** 2 - noise / n - offsets
    value, period = math.sqrt(max(square, 0.0)), length / wave.frequency
    behaviour, advance = _phases(wave, n)
    details: dict[str, Any] = {"frequency_cycles_per_line": wave.frequency / length}
    if advance is not None:
        details["phase_advance_periods_per_frame"] = advance
    tail = ""
    if harmonics:
        details["harmonics"] = [round(w.frequency / wave.frequency) for w in harmonics]
        tail = f"; harmonics {', '.join(map(str, details['harmonics']))} too"
    return Finding(
        f"{axis}_banding",
        lines.look.new if wave.new else lines.look.fixed,
        f"Along the {axis}s runs a sine with a period of {period:.4g} {axis}s and a peak of {number(value)} DN; {behaviour}{tail}.",
        f"{axis} banding of {period:.3g} {axis}s, {value:.2g} DN, {behaviour}",
        wave.gain + sum(w.gain for w in harmonics),
        **about(value, math.sqrt((noise / n + offsets) / 2)),
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
    # Rayleigh's 2 n R^2, that random directions exceed in 1 % (chi-square of 2 degrees of freedom)
    directed = 9.21
    if n >= 6:
        turn = (unit[1:] * unit[:-1].conj()).mean()
        if abs(turn) ** 2 * 2 * (n - 1) > directed:
            advance = float(np.angle(turn) / (2 * math.pi))
            return f"its phase moves on by {advance:+.2g} periods per frame", advance
        if abs(unit.mean()) ** 2 * 2 * n > directed:
            return "changing in each frame, with a preferred phase", None
    return "new phase in each frame", None


def _offset_findings(lines: RowMeans, fixed: Continuum, temporal: Continuum | None) -> Iterator[Finding]:
    axis, n, length = lines.axis, lines.count, lines.length

    def offset(kind: str | None, part: Continuum, freedom: float, text: str, how: str) -> Finding:
        size = deviation(part.level, freedom, part.floor)
        value = size["amplitude_dn"]
        short = f"{axis} offsets of {value:.2g} DN, {how}"
        text = f"Each {axis} {text.format(f'with a standard deviation of {number(value)} DN')}."
        more = {"axis": axis, "shown": {"lines": lines}}
        return Finding(f"{axis}_offset", kind, text, short, part.gain_white, **size, **more)

    if temporal is not None:
        if temporal.rise > 0 and temporal.gain_rise > needed(5, 2):
            yield _flicker(lines, temporal)
        # bound on 1/f noise faster than the rows
        alias = 2 * float(temporal.beyond(length / 2) - temporal.white)
        freedom = 2 * temporal.bins * temporal.shape
        if temporal.gain_white > needed() and temporal.white > alias:
            text = "has a new random offset in every frame, {}"
            yield offset("per_frame", temporal, freedom, text, "new in each frame")
    if not lines.look.is_uniform:
        return
    freedom = 2 * fixed.bins
    error = math.sqrt(2 / freedom)
    if temporal is not None and fixed.floor > 0:
        share = float(temporal.beyond(length / 4)) / n / fixed.floor
        error = math.hypot(error, share * math.sqrt(1 / (temporal.bins * temporal.shape)))
    # The window keeps the ends of smooth changes out.
    narrow, _ = lines.continua(windowed=True)
    levels = (fixed.level, error), (narrow.level, error * math.sqrt(1 / WINDOWED))
    z = math.inf
    if fixed.floor > 0:
        z = min(math.log(max(level / fixed.floor, 1.0)) / e for level, e in levels)
    if fixed.gain_white > needed() and z > needed_z():
        how = "fixed" if n > 1 else "fixed or new cannot be told from one exposure"
        yield offset(lines.look.fixed, fixed, freedom, f"has its own offset {{}}, {how}", how)


def _flicker(lines: RowMeans, temporal: Continuum) -> Finding:
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
    return Finding(
        "flicker_noise",
        "per_frame",
        f"Noise that rises towards low frequencies over the {axis}s as f^-{temporal.exponent:.1f}, with a standard deviation of "
        f"{number(value)} DN, new in each frame{'; it goes on within a ' + axis if clear else ''}.",
        f"1/f noise over the {axis}s, {value:.2g} DN, new in each frame",
        temporal.gain_rise,
        **about(value, error),
        axis=axis,
        details={"exponent": temporal.exponent},
        shown={"lines": lines},
    )


def _step_findings(lines: RowMeans) -> Iterator[Finding]:
    axis, kind = lines.axis, lines.look.fixed
    if not lines.look.is_uniform:
        return
    for place, (height, error, gain) in lines.steps.items():
        if height**2 < error**2 * needed(3):  # it was a part of what was found after it
            continue
        size = f"{number(abs(height))} DN"
        if place == lines.length // 2:
            what, (first, second) = "halves", ("upper", "lower") if axis == "row" else ("left", "right")
            text = f"The {second} half lies {size} {'above' if height > 0 else 'below'} the {first}"
            short = f"{first} and {second} halves"
        else:
            what, short = "step", f"a step at {axis} {place}"
            text = f"From {axis} {place} on the level is {size} {'higher' if height > 0 else 'lower'}"
        share = 1 - place / lines.length
        spread = math.sqrt(share * (1 - share))
        yield Finding(
            what,
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
