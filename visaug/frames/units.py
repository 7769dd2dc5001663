"""Numbers of headers and tables in seconds and degrees Celsius; None where they are no measurement."""

import math
import re
from typing import Any

from visaug.core.constants import ZERO_C_K

SECONDS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "millisec": 1e-3,
            "millisecond": 1e-3, "milliseconds": 1e-3, "us": 1e-6, "usec": 1e-6, "µs": 1e-6, "μs": 1e-6, "microsec": 1e-6,
            "microsecond": 1e-6, "microseconds": 1e-6, "ns": 1e-9, "nanoseconds": 1e-9, "min": 60.0, "mins": 60.0,
            "minute": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hrs": 3600.0, "hour": 3600.0, "hours": 3600.0,
            "d": 86400.0}  # fmt: skip
WARMEST_C = 150.0  # of sensors that take pictures: automotive grade 1 with a margin
_OTHER_DEGREES = re.compile(r"fahrenheit|[\[(]\s*(deg\s*f|f|mk|millikelvin)\s*[\])]")  # rare, and unsure


def number_or_none(value: Any) -> float | None:
    """The number that a value or its text is; None for other text, truth values and NaN."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        return None
    return None if math.isnan(number) else number


def unit_of(comment: str) -> float | None:
    """Seconds in the time unit that a header's comment names, ``[ms] exposure`` or ``exposure in ms``; None for none."""
    word = re.search(r"[\[(]\s*([a-zµμ]+)\s*[\])]|\bin\s+([a-zµμ]+)", comment.lower())
    if word is not None and (word[1] or word[2]) in SECONDS:
        return SECONDS[word[1] or word[2]]
    for name in re.findall("[a-zµμ]+", comment.lower()):
        if len(name) > 1 and name in SECONDS and name not in ("min", "minutes"):  # "min": a minimum as well
            return SECONDS[name]
    return None


def seconds(value: object, comment: str = "", unit: str = "") -> float:
    """Exposure time in seconds from a header value, a number or a text such as ``500 ms`` or ``1/100``.

    The unit is read from the comment, or else from `unit`, the value of the keyword TIMEUNIT. Raises ValueError if the value is
    not a number.
    """
    scale = unit_of(comment) or SECONDS.get(unit.strip().lower(), 1.0)
    if isinstance(value, str):
        match = re.fullmatch(r"\s*([-+.\deE]+)\s*(?:/\s*(\d+))?\s*([a-zµμ]*)\s*", value)
        if match is None or (match[3] and match[3] not in SECONDS):
            raise ValueError(value)
        scale = SECONDS[match[3]] if match[3] else scale
        value = float(match[1]) / float(match[2] or 1)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(value)
    return round(float(value) * scale, 12)


def is_no_temperature(value: float) -> bool:
    """Whether a number stands for a thermometer that is not there: -273.15, 999, -999, 9999, ..., NaN."""
    drivers = (-ZERO_C_K, -273.0, -273.1, -273.2)  # what those of cameras without a thermometer give
    return not math.isfinite(value) or value in drivers or bool(re.fullmatch("999+", f"{abs(value):.0f}"))


def celsius(value: float, comment: str = "") -> tuple[float | None, str]:
    """Degrees Celsius of a header's or table's value, and what was made of it: ``""``, ``kelvin`` or ``none``.

    >>> celsius(-10.0), celsius(263.15), celsius(-999.0)
    ((-10.0, ''), (-10.0, 'kelvin'), (None, 'none'))
    """
    if is_no_temperature(value) or _OTHER_DEGREES.search(comment.lower()):
        return None, "none"
    # A temperature above what sensors have is one in Kelvin where that makes sense, else no measurement.
    coldest_c, warmest_k = -200.0, 400.0  # liquid nitrogen
    kelvin = re.search(r"\bkelvin\b|[\[(]\s*k\s*[\])]", comment.lower()) is not None
    if kelvin or WARMEST_C < value <= warmest_k:
        value, kelvin = round(value - ZERO_C_K, 6), True
    return (value, "kelvin" if kelvin else "") if coldest_c <= value <= WARMEST_C else (None, "none")
