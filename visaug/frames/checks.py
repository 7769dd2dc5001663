"""Checks of one frame as it is read, and of a whole set in one pass over its pixels."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from visaug.core.constants import MAD
from visaug.core.errors import InputError
from visaug.core.wording import first_of
from visaug.frames.record import FrameRecord

if TYPE_CHECKING:
    from visaug.frames.frameset import FrameSet

SATURATED_SHARE = 0.001  # of a flat's pixels at the converter's top: no signal piles up so many by itself
# Share of pixels at the largest value that indicates saturation, if the converter's range is unknown: no noise has it.
PILED_SHARE = 0.02


def check_values(pixels: np.ndarray, bit_depth: int | None, file: str | Path) -> None:
    """Refuse NaN, negative DN and DN above the converter's range."""
    if not pixels.size:
        raise InputError("has no pixels", file=file)
    low, high = pixels.min(), pixels.max()
    if not (np.isfinite(low) and np.isfinite(high)):  # NaN wins in min and max
        bad = np.count_nonzero(~np.isfinite(pixels))
        problem = f"{bad} of {pixels.size} pixels are NaN or infinite"
        raise InputError(problem, file=file, expected="finite DN")
    if high > np.finfo(np.float32).max:
        raise InputError(f"the largest value is {high:g}", file=file, expected="at most 3.4e38")
    if low < 0:
        expected = "DN of 0 or more, nothing subtracted"
        raise InputError(f"the smallest value is {low:g}", file=file, expected=expected)
    if bit_depth is not None and high > (top := (1 << bit_depth) - 1):
        expected = f"at most {top} for {bit_depth} bits"
        raise InputError(f"the largest value is {high:g}", file=file, field="bit_depth", expected=expected)


def other_size(
    file: str | Path, pixels: np.ndarray, size: tuple[int, ...], whose: str, field: str | None = None
) -> InputError:
    """The error of a file whose pixels have not the rows and columns that something else has."""
    rows, columns = pixels.shape
    expected = f"{size[0]} x {size[1]}{whose}"
    return InputError(f"is {rows} x {columns}", file=file, field=field, expected=expected)


def check_frame(record: FrameRecord, pixels: np.ndarray) -> None:
    """Refuse what is no frame of the record: another size than its window, a single line, and in frames of a laboratory
    fractions of full scale or differences that wrapped around.
    """
    if (size := record.window_size) is not None and pixels.shape != size:
        raise other_size(record.file, pixels, size, " as stated by its region", "region")
    if record.kind not in ("bias", "dark", "flat"):
        return
    if min(pixels.shape) < 2:
        problem = "is {} x {}, a single line".format(*pixels.shape)
        expected = "frames of two or more rows and columns; of a line camera, write successive lines as the rows of a frame"
        raise InputError(problem, file=record.file, expected=expected)
    if pixels.dtype.kind == "f" and 0 < pixels.max() <= 1 and np.any(pixels % 1 != 0):
        expected = "the values of the converter: multiply by its full scale (65535 for 16 bits), or write whole numbers"
        raise InputError("holds fractions between 0 and 1, not DN", file=record.file, expected=expected)
    wrapped_share = 0.01  # of a dark frame's pixels: more than hot pixels that saturate
    if record.kind != "flat" and pixels.dtype.kind == "u":
        top = np.iinfo(pixels.dtype).max
        if pixels.max() <= 0.75 * top:
            return
        high, low = (pixels > 0.75 * top).mean(), (pixels < 0.25 * top).mean()
        if min(high, low) > wrapped_share and 1 - high - low < 0.1 * high:
            what = "a subtraction below 0 wrapped around"
            problem = f"has {high:.0%} of its pixels near {top} and the others near 0: {what}"
            raise InputError(problem, file=record.file, expected="raw frames, nothing subtracted")


def check(frames: "FrameSet") -> list[str]:
    """Named warnings, each ``name: sentence``; an empty list where nothing is suspicious.

    ``duplicate_frames``, ``constant_frame``, ``saturated_flat``, ``clipped_at_zero``, ``bias_saw_light``,
    ``few_frames``. Holds one frame at a time.
    """
    means = np.empty(len(frames))
    spreads = np.empty(len(frames))
    hashes: dict[bytes, list[int]] = {}
    constant, saturated, clipped = [], [], []
    clipped_share = 0.01  # of a dark frame's pixels at 0
    top = None if frames.bit_depth is None else (1 << frames.bit_depth) - 1
    for i, record in enumerate(frames.records):
        frame = frames.read(i)
        means[i], spreads[i] = frame.mean(dtype=np.float64), frame.std(dtype=np.float64)
        hashes.setdefault(hashlib.blake2b(frame.tobytes(), digest_size=16).digest(), []).append(i)
        largest = frame.max()
        piled = SATURATED_SHARE if largest == top else PILED_SHARE if spreads[i] > 0 else np.inf
        if record.kind == "flat" and (frame == largest).mean() > piled:
            saturated.append(i)
        elif spreads[i] == 0 and record.kind != "image":
            constant.append(i)
        elif record.kind in ("bias", "dark") and (frame <= 0).mean() > clipped_share:
            clipped.append(i)

    def name(indices) -> str:
        return first_of((frames.records[i].sequence for i in indices), 8)

    even = {*constant, *saturated}
    copies = [name(same) for same in hashes.values() if len(same) > 1 and not set(same) <= even]
    found = []
    if copies:
        listed = first_of(copies, 4, "; ") + (" such groups" if len(copies) > 4 else "")
        what = "are identical to the last bit: copies, not exposures"
        found.append(f"duplicate_frames: frames {listed} {what}")
    if constant:
        values = sorted({float(means[i]) for i in constant})
        listed = " to ".join(f"{value:.10g}" for value in dict.fromkeys([values[0], values[-1]]))
        found.append(f"constant_frame: frames {name(constant)} have one value in all pixels ({listed} DN)")
    if saturated:
        found.append(
            f"saturated_flat: more than {SATURATED_SHARE:.1%} of the pixels of flats {name(saturated)} are "
            "at the converter's top; they determine the saturation, not the gain"
        )
    if clipped:
        found.append(
            f"clipped_at_zero: more than {clipped_share:.0%} of the pixels of frames {name(clipped)} are 0: "
            "the black level is too low, means and variances of dark frames are clipped"
        )
    if lit := _lit_bias(frames, means, spreads):
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


def _lit_bias(frames: "FrameSet", means: np.ndarray, spreads: np.ndarray) -> list[int]:
    """Bias frames far above the others of their group, or a whole group above the shortest darks like it.

    Far: 6 robust standard deviations of the frame means and a quarter of a frame's own pixel spread, so that a drift of the
    black level, small against the read noise, is no light.
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
        same = ("dark", group.gain_db, group.temperature_c, group.window)
        darks = [g for g in frames.groups() if (g.kind, g.gain_db, g.temperature_c, g.window) == same]
        darks = [g for g in darks if g.exposure_s >= group.exposure_s]
        if darks:
            shortest = min(darks, key=lambda g: g.exposure_s)
            dark_level = np.median(means[list(shortest.indices)])
            if level - dark_level > max(spread, np.median(spreads[list(shortest.indices)]), 1.0):
                lit += [int(i) for i in indices if int(i) not in lit]
    return sorted(lit)
