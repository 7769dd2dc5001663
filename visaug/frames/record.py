"""What is known of one frame before its pixels are read."""

from __future__ import annotations

import math
from dataclasses import dataclass

from visaug.errors import InputError

KINDS = ("bias", "dark", "flat", "scene", "image")
Window = tuple[int, int, int, int]  # r0, r1, c0, c1: rows r0..r1-1 and columns c0..c1-1 of the sensor


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One frame of a set.

    Attributes:
        sequence: order of acquisition, unique in the set.
        file: path relative to the set's folder; ``#key[index]`` picks a frame inside an archive or stack.
        kind: ``bias``, ``dark``, ``flat``, ``scene``, or ``image`` (an ordinary picture of which nothing
            is known).
        exposure_s: exposure time in seconds, 0 or more (0 where unknown for ``bias`` and ``image``).
        temperature_c: sensor temperature in degrees Celsius, None where unknown.
        gain_db: the camera's gain setting in dB.
        photons: mean photons per pixel of a flat, None where the source is not calibrated.
        clean: name of a scene's noiseless target in photons per pixel.
        window: which window of the sensor the file holds, None for the whole sensor.
    """

    sequence: int
    file: str
    kind: str
    exposure_s: float = 0.0
    temperature_c: float | None = None
    gain_db: float = 0.0
    photons: float | None = None
    clean: str | None = None
    window: Window | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"{self.kind!r} is no kind of frame", field="kind", expected=" or ".join(KINDS))
        _check("exposure_s", self.exposure_s, 0.0, 1e6, "seconds, 0 or more")
        _check("gain_db", self.gain_db, -100.0, 100.0, "decibels between -100 and 100")
        if self.temperature_c is not None:
            _check(
                "temperature_c", self.temperature_c, -273.15, 300.0, "degrees Celsius between -273.15 and 300"
            )
        if self.photons is not None:
            _check("photons", self.photons, 0.0, 1e12, "photons per pixel, 0 or more")
        if self.window is not None:
            r0, r1, c0, c1 = self.window
            if not (0 <= r0 < r1 and 0 <= c0 < c1):
                raise InputError(
                    f"{format_window(self.window)} is no window",
                    field="region",
                    expected="r0:r1,c0:c1 with 0 <= r0 < r1 and 0 <= c0 < c1",
                )


@dataclass(frozen=True, slots=True)
class Group:
    """Frames taken under the same conditions; ``indices`` are positions in ``FrameSet.records``."""

    kind: str
    exposure_s: float
    temperature_c: float | None
    gain_db: float
    photons: float | None
    clean: str | None
    window: Window | None
    indices: tuple[int, ...]


def group_records(records: tuple[FrameRecord, ...]) -> tuple[Group, ...]:
    """Groups of same kind, exposure, temperature, gain, photons, clean and window, by first appearance."""
    found: dict[tuple, list[int]] = {}
    for i, r in enumerate(records):
        key = (r.kind, r.exposure_s, r.temperature_c, r.gain_db, r.photons, r.clean, r.window)
        found.setdefault(key, []).append(i)
    return tuple(Group(*key, indices=tuple(indices)) for key, indices in found.items())


def parse_window(text: str) -> Window:
    """``r0:r1,c0:c1`` as four numbers."""
    try:
        rows, columns = text.replace(" ", "").split(",")
        r0, r1 = (int(n) for n in rows.split(":"))
        c0, c1 = (int(n) for n in columns.split(":"))
    except ValueError:
        raise InputError(f"{text!r} is no window", field="region", expected="r0:r1,c0:c1") from None
    return r0, r1, c0, c1


def format_window(window: Window) -> str:
    return "{}:{},{}:{}".format(*window)


def _check(field: str, value: float, low: float, high: float, expected: str) -> None:
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{value:g} is out of range", field=field, expected=expected)
