"""Checks of a frame set in one pass over its pixels; each problem has a name."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from visaug.core.constants import MAD
from visaug.core.wording import first_of

if TYPE_CHECKING:
    from visaug.frames.frameset import FrameSet

SATURATED_SHARE = 0.001  # of a flat's pixels at the converter's top: no signal piles up so many by itself
_CLIPPED_SHARE = 0.01
# Share of pixels at the largest value that indicates saturation, if the converter's range is unknown: no noise has it.
PILED_SHARE = 0.02
_FEW = 4  # groups of copies that are listed
_CONSTANT_KINDS = ("bias", "dark", "flat", "scene")


def check(frames: FrameSet) -> list[str]:
    """Named warnings, each ``name: sentence``; an empty list where nothing is suspicious.

    ``duplicate_frames``, ``constant_frame``, ``saturated_flat``, ``clipped_at_zero``, ``bias_saw_light``,
    ``few_frames``. Holds one frame at a time.
    """
    means = np.empty(len(frames))
    spreads = np.empty(len(frames))
    hashes: dict[bytes, list[int]] = {}
    constant, saturated, clipped = [], [], []
    top = None if frames.bit_depth is None else (1 << frames.bit_depth) - 1
    for i, record in enumerate(frames.records):
        frame = frames.read(i)
        means[i], spreads[i] = frame.mean(dtype=np.float64), frame.std(dtype=np.float64)
        hashes.setdefault(hashlib.blake2b(frame.tobytes(), digest_size=16).digest(), []).append(i)
        largest = frame.max()
        if record.kind == "flat" and (frame == largest).mean() > (
            SATURATED_SHARE if largest == top else PILED_SHARE if spreads[i] > 0 else np.inf
        ):
            saturated.append(i)
        elif spreads[i] == 0 and record.kind in _CONSTANT_KINDS:
            constant.append(i)
        elif record.kind in ("bias", "dark") and (frame <= 0).mean() > _CLIPPED_SHARE:
            clipped.append(i)

    def name(indices) -> str:
        return first_of((frames.records[i].sequence for i in indices), 8)

    copies = [
        name(same) for same in hashes.values() if len(same) > 1 and not set(same) <= {*constant, *saturated}
    ]
    found = []
    if copies:
        more = f" and {len(copies) - _FEW} more such groups" if len(copies) > _FEW else ""
        found.append(
            f"duplicate_frames: frames {'; '.join(copies[:_FEW])}{more} are identical to the last bit: copies, not exposures"
        )
    if constant:
        values = sorted({float(means[i]) for i in constant})
        listed = f"{values[0]:.10g} DN" if len(values) == 1 else f"{values[0]:.10g} to {values[-1]:.10g} DN"
        found.append(f"constant_frame: frames {name(constant)} have one value in all pixels ({listed})")
    if saturated:
        found.append(
            f"saturated_flat: more than {SATURATED_SHARE:.1%} of the pixels of flats {name(saturated)} are "
            "at the converter's top; they determine the saturation, not the gain"
        )
    if clipped:
        found.append(
            f"clipped_at_zero: more than {_CLIPPED_SHARE:.0%} of the pixels of frames {name(clipped)} are 0: "
            "the black level is too low, means and variances of dark frames are clipped"
        )
    lit = _lit_bias(frames, means, spreads)
    if lit:
        found.append(
            f"bias_saw_light: bias frames {name(lit)} are brighter than the others or than the shortest dark "
            "frames; was the lens capped?"
        )
    for group in frames.groups():
        if group.kind in ("bias", "dark", "flat") and len(group.indices) == 1:
            found.append(
                f"few_frames: {group.kind} frame {name(group.indices)} is the only one with its settings; "
                "temporal noise needs two or more"
            )
    return found


def _lit_bias(frames: FrameSet, means: np.ndarray, spreads: np.ndarray) -> list[int]:
    """Bias frames far above the others of their group, or a whole group above the shortest darks like it.

    Far: 6 robust standard deviations of the frame means and a quarter of a frame's own pixel spread, so
        that a
    drift of the black level, small against the read noise, is no light.
    """
    lit: list[int] = []
    for group in frames.groups():
        if group.kind != "bias":
            continue
        indices = np.array(group.indices)
        level, spread = np.median(means[indices]), np.median(spreads[indices])
        scatter = MAD * np.median(np.abs(means[indices] - level))
        if len(indices) > 2:
            lit += [int(i) for i in indices if means[i] - level > max(6 * scatter, 0.25 * spread, 0.5)]
        darks = [
            g
            for g in frames.groups()
            if g.kind == "dark"
            and g.gain_db == group.gain_db
            and g.temperature_c == group.temperature_c
            and g.window == group.window
            and g.exposure_s >= group.exposure_s
        ]
        if darks:
            shortest = min(darks, key=lambda g: g.exposure_s)
            dark_level = np.median(means[list(shortest.indices)])
            if level - dark_level > max(spread, np.median(spreads[list(shortest.indices)]), 1.0):
                lit += [int(i) for i in indices if int(i) not in lit]
    return sorted(lit)
