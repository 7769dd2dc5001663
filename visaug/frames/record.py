"""What is known of one frame before its pixels are read."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from numbers import Integral, Real

from visaug.core.errors import InputError

KINDS = ("bias", "dark", "flat", "scene", "image")
MOSAICS = ("RGGB", "BGGR", "GRBG", "GBRG")
Window = tuple[int, int, int, int]  # r0, r1, c0, c1: rows r0..r1-1 and columns c0..c1-1 of the sensor
# Least and largest value, and what is expected.
_LIMITS: dict[str, tuple[float, float, str]] = {
    "exposure_s": (1e-12, 1e6, "seconds: 0, or 1e-12 to 1e6"),
    "gain_db": (-100.0, 120.0, "decibels between -100 and 120"),
    "temperature_c": (-273.15, 300.0, "degrees Celsius between -273.15 and 300"),
    "photons": (0.0, 1e12, "photons per pixel, 0 to 1e12"),
    "combined": (0, 1e6, "how many exposures were averaged, 1 for a raw frame"),
    "bit_depth": (1, 32, "1 to 32 bits"),
}


_NEVER_BLANK = ("exposure_s", "gain_db", "combined")


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """One frame of a set.

    Attributes:
        sequence: order of acquisition, unique in the set.
        file: path relative to the set's folder; ``#key[index]`` picks a frame inside an archive or stack.
        kind: ``bias``, ``dark``, ``flat``, ``scene``, or ``image`` (an ordinary picture of which nothing
            is known).
        exposure_s: exposure time in seconds, 1e-12 or more (0 where unknown for ``bias`` and ``image``).
        temperature_c: sensor temperature in degrees Celsius, None where unknown.
        gain_db: the camera's gain setting in dB.
        photons: mean photons per pixel of a flat, None where the source is not calibrated.
        clean: name of a scene's noiseless target in photons per pixel.
        window: which window of the sensor the file holds, None for the whole sensor.
        setting: the camera's settings that are not in decibels, as ``GAIN=200 OFFSET=10`` (a FITS header's
            GAIN, OFFSET, READOUTM; a photograph's ISO). Frames of different settings are different cameras.
        filter: what stood in the light of a flat or scene: a filter's name, a wavelength, a lamp.
        combined: number of exposures averaged into the frame: 1 for a raw frame, 0 for a master frame of
            an unknown number of exposures.
        bayer: colours of the mosaic at the frame's own pixel (0, 0), one of ``MOSAICS``; None for a
            monochrome sensor.
        bit_depth: bits of the converter, None where not known. One for the whole set.
        time_s: time of acquisition in seconds since any fixed moment, None where not known.
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
    setting: str | None = None
    filter: str | None = None
    combined: int = 1
    bayer: str | None = None
    bit_depth: int | None = None
    time_s: float | None = None

    def __post_init__(self) -> None:
        for field, wanted, expected in (
            ("sequence", Integral, "a whole number, the place in the order of acquisition"),
            ("file", str, "the name of a file as text"),
        ):
            if not isinstance(value := getattr(self, field), wanted):
                raise InputError(f"{value!r} is not valid", field=field, expected=expected)
        if self.kind not in KINDS:
            problem = f"{self.kind!r} is not a kind of frame"
            raise InputError(problem, field="kind", expected=" or ".join(KINDS))
        for field, (low, high, expected) in _LIMITS.items():
            value = getattr(self, field)
            if (value is None and field not in _NEVER_BLANK) or (field == "exposure_s" and value == 0):
                continue
            if not isinstance(value, Real):
                raise InputError(f"{value!r} is not a number", field=field, expected=expected)
            if not (math.isfinite(value) and low <= float(value) <= high):
                raise InputError(f"{value:g} is out of range", field=field, expected=expected)
        if self.bayer not in (None, *MOSAICS):
            problem = f"{self.bayer!r} is not a colour filter pattern"
            raise InputError(problem, field="bayer", expected=" or ".join(MOSAICS))
        if self.window is not None:
            window = self.window
            whole = isinstance(window, Sequence) and all(isinstance(n, Integral) for n in window)
            four = whole and len(window) == 4
            if not (four and 0 <= window[0] < window[1] and 0 <= window[2] < window[3]):
                said = format_window(window) if four else repr(window)
                expected = "r0:r1,c0:c1 with 0 <= r0 < r1 and 0 <= c0 < c1"
                raise InputError(f"{said} is not a window", field="region", expected=expected)

    @property
    def window_size(self) -> tuple[int, int] | None:
        """Rows and columns of the window; None for the whole sensor."""
        return self.window and (self.window[1] - self.window[0], self.window[3] - self.window[2])


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
    setting: str | None = None
    filter: str | None = None
    combined: int = 1
    bayer: str | None = None


_CONDITIONS = tuple(field.name for field in fields(Group) if field.name != "indices")


def group_records(records: tuple[FrameRecord, ...]) -> tuple[Group, ...]:
    """Groups of frames alike in all conditions (every field but order, file, bit depth and time), by first appearance."""
    found: dict[tuple, list[int]] = {}
    for i, record in enumerate(records):
        found.setdefault(tuple(getattr(record, name) for name in _CONDITIONS), []).append(i)
    return tuple(
        Group(**dict(zip(_CONDITIONS, key, strict=True)), indices=tuple(indices))
        for key, indices in found.items()
    )


def parse_window(text: str) -> Window:
    """``r0:r1,c0:c1`` as four numbers."""
    try:
        rows, columns = text.replace(" ", "").split(",")
        r0, r1 = (int(n) for n in rows.split(":"))
        c0, c1 = (int(n) for n in columns.split(":"))
    except ValueError:
        raise InputError(f"{text!r} is not a window", field="region", expected="r0:r1,c0:c1") from None
    return r0, r1, c0, c1


def format_window(window: Window) -> str:
    return "{}:{},{}:{}".format(*window)
