"""Whether pixels are a frame of a camera: finite DN of the converter's range, of the size that is stated, raw."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from visaug.core.errors import InputError
from visaug.frames.record import FrameRecord


def check_values(pixels: np.ndarray, bit_depth: int | None, file: str | Path) -> None:
    """Refuse NaN, negative DN and DN above the converter's range."""
    if not pixels.size:
        raise InputError("has no pixels", file=file)
    low, high = pixels.min(), pixels.max()
    if not (np.isfinite(low) and np.isfinite(high)):  # NaN wins in min and max
        bad = int(np.count_nonzero(~np.isfinite(pixels)))
        raise InputError(
            f"{bad} of {pixels.size} pixels are NaN or infinite", file=file, expected="finite DN"
        )
    if high > np.finfo(np.float32).max:
        raise InputError(f"the largest value is {high:g}", file=file, expected="at most 3.4e38")
    if low < 0:
        raise InputError(
            f"the smallest value is {low:g}", file=file, expected="DN of 0 or more, nothing subtracted"
        )
    if bit_depth is not None and high > (1 << bit_depth) - 1:
        raise InputError(
            f"the largest value is {high:g}",
            file=file,
            field="bit_depth",
            expected=f"at most {(1 << bit_depth) - 1} for {bit_depth} bits",
        )


def check_frame(record: FrameRecord, pixels: np.ndarray) -> None:
    """Refuse what is no frame of the record: another size than its window, a single line, and in frames of a laboratory
    fractions of full scale or differences that wrapped around.
    """
    if record.window is not None:
        r0, r1, c0, c1 = record.window
        if pixels.shape != (r1 - r0, c1 - c0):
            raise InputError(
                f"is {pixels.shape[0]} x {pixels.shape[1]}",
                file=record.file,
                field="region",
                expected=f"{r1 - r0} x {c1 - c0} as stated by its region",
            )
    if record.kind not in ("bias", "dark", "flat"):
        return
    if min(pixels.shape) < 2:
        raise InputError(
            f"is {pixels.shape[0]} x {pixels.shape[1]}, a single line",
            file=record.file,
            expected="frames of two or more rows and columns; of a line camera, write successive lines as the rows of a frame",
        )
    if pixels.dtype.kind == "f" and 0 < pixels.max() <= 1 and np.any(pixels % 1 != 0):
        raise InputError(
            "holds fractions between 0 and 1, not DN",
            file=record.file,
            expected="the values of the converter: multiply by its full scale (65535 for 16 bits), or write whole numbers",
        )
    wrapped_share = 0.01  # of a dark frame's pixels: more than hot pixels that saturate
    if record.kind != "flat" and pixels.dtype.kind == "u":
        top = np.iinfo(pixels.dtype).max
        if pixels.max() <= 0.75 * top:
            return
        high, low = (pixels > 0.75 * top).mean(), (pixels < 0.25 * top).mean()
        if min(high, low) > wrapped_share and 1 - high - low < 0.1 * high:
            raise InputError(
                f"has {high:.0%} of its pixels near {top} and the others near 0: a subtraction below 0 wrapped around",
                file=record.file,
                expected="raw frames, nothing subtracted",
            )
