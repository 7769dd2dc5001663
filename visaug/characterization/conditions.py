"""Frames as laboratories have them, made ready to be measured: one setting, raw frames, whole DN of the converter."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import or_
from pathlib import Path

import numpy as np

from visaug.characterization.alike import KINDS, floor_dn, merged_groups
from visaug.characterization.facts import Facts, look, temporal_variances
from visaug.characterization.views import at_bits, shifted
from visaug.core.extras import extra
from visaug.core.wording import first_of
from visaug.frames import FrameSet
from visaug.frames.checks import SATURATED_SHARE
from visaug.frames.units import celsius
from visaug.statistics.findings import Findings

_DEPTHS = (8, 10, 12, 14, 16)


def prepared(frames: FrameSet, found: Findings, told_bits: int | None) -> tuple[FrameSet, list[Facts]]:
    """The frames that can be measured together, and the facts of each.
    Left out, with a warning: frames of other camera settings than the commonest, and master frames.
    `told_bits`: bits of the converter where somebody told them.
    """
    frames = frames.subset([i for i, r in enumerate(frames.records) if r.kind in KINDS])
    frames = _in_celsius(frames, found)
    every, said = {r.sequence for r in frames.records}, len(found.warnings)
    frames = _one_setting(frames, found)
    told = [i for i, r in enumerate(frames.records) if r.combined != 1]
    frames = _leave_out(frames, told, found, "as their headers or the column `combined` say")
    found.set_apart(every - {r.sequence for r in frames.records}, *found.warnings[said:])
    facts = look(frames)
    _check_lossy(frames, facts, found)
    frames, facts = _aligned(frames, facts, found, told_bits)
    frames, facts = _without_copies(frames, facts, found)
    frames, facts = _without_masters(frames, facts, found)
    frames = _without_one_light(frames, facts, found)
    _bit_depth(frames, facts, found, told_bits)
    return at_bits(frames, found.bit_depth or frames.bit_depth), facts


def _in_celsius(frames: FrameSet, found: Findings) -> FrameSet:
    """Temperatures that can only be Kelvin converted, those that are none left out, and both said."""
    made = [None if r.temperature_c is None else celsius(r.temperature_c) for r in frames.records]
    for how, word, said in (
        ("kelvin", "kelvin", "are read as Kelvin and converted"),
        ("none", "unknown", "are those of no sensor and are not used"),
    ):
        if values := {f"{r.temperature_c:g}" for r, m in zip(frames.records, made) if m and m[1] == how}:
            found.warn(f"temperature_{word}: temperatures of {', '.join(sorted(values))} {said}")
    if all(m is None or not m[1] for m in made):
        return frames
    degrees = [m[0] if m else None for m in made]
    return frames.with_records([replace(r, temperature_c=t) for r, t in zip(frames.records, degrees)])


def _one_setting(frames: FrameSet, found: Findings) -> FrameSet:
    """Two settings (a FITS header's GAIN, OFFSET) are two cameras."""
    weights: Counter[str | None] = Counter()
    for r in frames.records:
        weights[r.setting] += 1000 if r.kind == "flat" else 1
    if len(weights) < 2:
        return frames
    usual = weights.most_common(1)[0][0]
    kept = [i for i, r in enumerate(frames.records) if r.setting == usual]
    others = ", ".join(sorted(str(s or "no setting") for s in weights if s != usual))
    found.warn(
        f"settings_mixed: {len(frames) - len(kept)} frames with other settings ({others}) are excluded; "
        f"the measured setting is {usual or 'the frames without a setting'}"
    )
    return frames.subset(kept)


def _without_one_light(frames: FrameSet, facts: Sequence[Facts], found: Findings) -> FrameSet:
    """Without photons where every flat states the same number at levels that differ."""
    flats = [(r.photons, f.mean) for r, f in zip(frames.records, facts) if r.kind == "flat"]
    told = {photons for photons, _ in flats}
    signals = np.array([mean for _, mean in flats]) - floor_dn(frames, facts)
    other_light = 1.25  # factor between signals: no lamp of one setting wanders so far
    if len(told) != 1 or None in told or not signals.max() >= other_light * signals.min() > 0:
        return frames
    found.warn(
        f"photons_contradicted: all flats state {flats[0][0]:g} photons per pixel, and their signals differ by a factor of "
        f"{signals.max() / signals.min():.3g}: the photons are not used"
    )
    found.has_one_light = False
    return frames.with_records([replace(r, photons=None) for r in frames.records])


def _without_copies(frames: FrameSet, facts: list[Facts], found: Findings) -> tuple[FrameSet, list[Facts]]:
    """Each frame once: a copy beside its original has no noise of its own (`FrameSet.check` names it).
    Equal sums over the four places of a 2 x 2, equal extremes and equal noise are a copy; a camera whose frames are mostly alike
    has no noise, and stays as it is.
    """
    looks = [(r.kind, f.mean, f.noise, f.largest, f.bits, f.phases) for r, f in zip(frames.records, facts)]
    first = {look: i for i, look in reversed([*enumerate(looks)])}
    kept = [i for i, look in enumerate(looks) if facts[i].noise == 0 or first[look] == i]
    if len(kept) == len(frames) or 2 * len(kept) < len(frames):
        return frames, facts
    copies = sorted({r.sequence for r in frames.records} - {frames.records[i].sequence for i in kept})
    found.set_apart(
        copies,
        f"duplicate_frames: frames {first_of(copies, 8)} are identical to others to the last bit: copies, not exposures, and are "
        "left out",
    )
    return frames.subset(kept), [facts[i] for i in kept]


def _leave_out(frames: FrameSet, masters: Sequence[int], found: Findings, why: str) -> FrameSet:
    if not masters or len(masters) == len(frames):
        return frames
    numbers = ", ".join(str(frames.records[i].sequence) for i in masters[:8])
    found.warn(
        f"master_frame: frames {numbers}{' and more' if len(masters) > 8 else ''} are averages of several "
        f"exposures, {why}, and are excluded: their noise is not that of single frames"
    )
    return frames.subset([i for i in range(len(frames)) if i not in set(masters)])


def _without_masters(frames: FrameSet, facts: list[Facts], found: Findings) -> tuple[FrameSet, list[Facts]]:
    """Dark frames of half the temporal variance of raw ones, or less; any of fractions among whole DN."""
    whole = sum(f.bits is not None for f in facts)
    masters = [i for i, f in enumerate(facts) if f.bits is None] if whole > 0.5 * len(facts) else []
    variances: dict[int, float] = {}
    usual = np.inf  # of the quietest group: what flickers or lingers makes others noisier
    for group in merged_groups(frames, facts):
        raw = [i for i in group.indices if i not in masters]
        if group.kind == "flat" or len(raw) < 3:  # a lamp that drifts is no master
            continue
        found_here = temporal_variances(frames, raw)
        variances |= dict(zip(raw, found_here))
        usual = min(usual, float(np.median(found_here)))
    if usual > 0.2:  # DN^2: below, rounding hides the noise of a single frame
        masters += [i for i, v in variances.items() if v < 0.55 * usual]  # of two or more: half or less
    kept = _leave_out(frames, sorted(masters), found, "because of their variance (or their gain is lower)")
    return kept, [f for i, f in enumerate(facts) if i not in set(masters)] if kept is not frames else facts


def _aligned(
    frames: FrameSet, facts: list[Facts], found: Findings, told_bits: int | None
) -> tuple[FrameSet, list[Facts]]:
    """Words aligned at the top of 16 bits: the low bits are 0 in every pixel of every frame."""
    if frames.bit_depth != 16 or any(f.bits is None for f in facts):
        return frames, facts
    used = reduce(or_, (f.bits or 0 for f in facts), 0)
    low = 0 if used == 0 else (used & -used).bit_length() - 1
    if low == 0 or 16 - low not in (_DEPTHS if told_bits is None else (told_bits,)):
        return frames, facts
    found.warn(
        f"bits_at_top_assumed: the lowest {low} of 16 bits are 0 in every pixel; the frames are read as "
        f"{16 - low}-bit values at the top of the word"
    )
    scale = 1 << low
    return shifted(frames, low), [
        replace(f, mean=f.mean / scale, noise=f.noise / scale, largest=f.largest / scale,
                bits=(f.bits or 0) >> low,
                phases=tuple(phase / scale for phase in f.phases))  # pyrefly: ignore[bad-argument-type]
        for f in facts
    ]  # fmt: skip


def _bit_depth(frames: FrameSet, facts: list[Facts], found: Findings, told_bits: int | None) -> None:
    """Bits of the converter: as told, as the files' type tells, or by where bright flats pile up."""
    depth = frames.bit_depth
    largest = max(f.largest for f in facts)
    piled = any(f.at_largest > SATURATED_SHARE and f.noise < f.largest == largest for f in facts)
    tops = [n for n in _DEPTHS if piled and largest == (1 << n) - 1]
    if told_bits is not None or (depth is not None and depth < 16):
        found.bit_depth = min(told_bits or 16, depth or 16, 16)
        if tops and tops[0] < found.bit_depth:
            found.warn(
                f"bit_depth_contradicted: frames pile up at {largest:g} DN, the highest code of {tops[0]} bits, "
                f"and {found.bit_depth} bits are stated",
                spoils=("bit_depth",),
            )
        return
    if largest > (1 << 16) - 1:  # sums of frames, or a type of more than 16 bits
        return
    found.bit_depth = next(n for n in _DEPTHS if largest <= (1 << n) - 1)
    if tops:
        return
    found.warn(
        f"bit_depth_assumed: no flat reaches the highest code, so the bit depth is not known; "
        f"{found.bit_depth} bits hold the largest value, {largest:g} DN (give --bit-depth, or take a saturated flat)",
        spoils=("bit_depth",),
    )


def _check_lossy(frames: FrameSet, facts: Sequence[Facts], found: Findings) -> None:
    """Warns of JPEG files, and of compressed FITS files whose steps are coarse beside the noise."""
    spoils = ("gain_e_per_dn", "quantum_efficiency", "read_noise.sigma_e", "read_noise.shape",
              "prnu.*", "dsnu.*", "dark_current.*", "full_well_e", "emva.*", "emva4.*", "temporal.*")  # fmt: skip
    if any(r.file.lower().endswith((".jpg", ".jpeg")) for r in frames.records):
        advice = "measure raw or lossless frames"
        found.warn(f"lossy_frames: JPEG compression removes noise and rounds coarsely; {advice}", spoils)
    steps = [(_compression_step(frames.path(i)), f.noise) for i, f in enumerate(facts)]
    coarsest = 0.35  # step over the noise of a pixel: rounding then adds 1 % to its variance, step^2 / 12
    coarse = [step / noise for step, noise in steps if step and noise and step > coarsest * noise]
    if coarse:
        found.warn(
            f"lossy_frames: {len(coarse)} FITS files were compressed with values rounded to {max(coarse):.2g} of their noise; the "
            "rounding adds to the noise and grows with it (quantize_level 4 or more, or no quantisation, does no harm)",
            spoils=spoils,
        )


def _compression_step(path: Path | None) -> float | None:
    """Median step of the tiles of a compressed FITS image of floats (ZSCALE of the FITS standard 4.0, section 10.2), DN."""
    if path is None or not path.name.lower().endswith(".fz"):
        return None
    with extra(path):
        from astropy.io import fits

    with fits.open(path, disable_image_compression=True) as file:
        for part in (p for p in file if isinstance(p, fits.BinTableHDU)):
            columns = part.columns
            # pyrefly: ignore[missing-attribute]
            if part.header.get("ZIMAGE") and columns is not None and "ZSCALE" in (columns.names or ()):
                return float(np.median(np.abs(np.asarray(part.data["ZSCALE"], np.float64))))
    return None
