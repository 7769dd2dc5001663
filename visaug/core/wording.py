"""Numbers and names as text: two significant digits of the interval, p-values that do not pretend to be exact."""

import math
import re
from collections.abc import Iterable

_FRAMES = re.compile(r"(bias|dark|flat|scene \S*[^\s:])( [-+.\de]+ (ph|s|C|dB))*( \(\d+\))?")

_KINDS = ("bias", "dark", "flat")
_PLAINER = (
    (r"\bband (\d)", r"frequency band \1"),
    (r"^bit (\d) set$", r"how often bit \1 is set"),
    (r"^one (row|column) on$", r"next \1"),
    (r"^(two|[0-9]+) (rows|columns) on$", r"\1 \2 apart"),
)


def printable(text: str) -> str:
    """The text with an escape for every character that a reader cannot see: control characters, those that turn the direction of
    what follows, and what is no Unicode. Line feeds stay.

    >>> print(printable("a\\x1b[1mb\\u202ec"))
    a\\x1b[1mb\\u202ec
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text)


def first_of(items: Iterable[object], most: int = 6, between: str = ", ") -> str:
    """The first of a list and how many more there are.

    >>> first_of([3, 5, 8], 2), first_of([3, 5], 2)
    ('3, 5 and 1 more', '3, 5')
    """
    texts = [str(item) for item in items]
    return between.join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def listed(items: Iterable[object], most: int) -> str:
    """The first of a list, and dots where there are more.

    >>> listed([3, 5, 8], 2), listed([3, 5], 2)
    ('3, 5, ...', '3, 5')
    """
    texts = [str(item) for item in items]
    return ", ".join([*texts[:most], *(["..."] if len(texts) > most else [])])


def counted(count: int, noun: str) -> str:
    """A number and a noun, which gets an s unless the number is 1.

    >>> counted(1, "run"), counted(3, "run")
    ('1 run', '3 runs')
    """
    return f"{count} {noun}{'' if count == 1 else 's'}"


def number(value: float | None) -> str:
    """Four significant digits; a dash where the value is not known."""
    return "–" if value is None else f"{value:.4g}"


def p_text(p: float | None) -> str:
    """A p-value: "p = 0.43", or "p < 0.01" where simulated sets cannot resolve it further.

    >>> p_text(0.0099), p_text(0.4273)
    ('p < 0.01', 'p = 0.43')
    """
    if p is None:
        return "p not known"
    return "p < 0.01" if p < 0.01 else f"p = {p:.2g}"


def probability_text(probability: float) -> str:
    """A posterior probability with two digits, never 0 or 1.

    >>> probability_text(0.9994), probability_text(0.76)
    ('> 0.99', '0.76')
    """
    if probability > 0.99:
        return "> 0.99"
    return "< 0.01" if probability < 0.01 else f"{probability:.2f}"


def with_interval(value: float | None, low: float | None, high: float | None, unit: str = "") -> str:
    """A value with its 95 % interval and unit, rounded to two significant digits of the interval. What is not known is None; the
    units "1" and "" are not printed.

    >>> with_interval(1.18734, 1.1032, 1.2971, "e-")
    '1.19 [1.10, 1.30] e-'
    """
    if value is None:
        return "not known"
    tail = "" if unit in ("", "1") else f" {unit}"
    if low is None or high is None or not math.isfinite(high - low) or high <= low:
        return f"{value:.3g}{tail}"
    place = math.floor(math.log10(high - low)) - 1  # power of ten of the last digit that is printed
    biggest = max(abs(value), abs(low), abs(high))
    if (place < -5 and biggest < 1e-3) or biggest >= 1e6:
        digits = max(math.floor(math.log10(biggest)) - place, 1)
        return f"{value:.{digits}e} [{low:.{digits}e}, {high:.{digits}e}]{tail}"
    decimals = max(-place, 0)
    shown = [f"{round(x, -place):.{decimals}f}" for x in (value, low, high)]
    return f"{shown[0]} [{shown[1]}, {shown[2]}]{tail}"


def deviation_text(z: float) -> str:
    """A number of standard deviations, in two digits.

    >>> [deviation_text(z) for z in (0.517, -14.23, 143.2)]
    ['0.52', '-14', '140']
    """
    return f"{float(f'{z:.2g}'):g}"


def share_text(share: float) -> str:
    """A share in per cent, never 0.

    >>> share_text(0.617), share_text(0.0004)
    ('62 %', '< 1 %')
    """
    return "< 1 %" if share < 0.005 else f"{share:.0%}".replace("%", " %")


def statistic_text(name: str) -> str:
    """The plain name of a statistic that a comparison's `where` has as "WHAT, FRAMES": what is measured, in which frames.

    >>> statistic_text("rows, bias"), statistic_text("dark rows, band 6, dark 2 s 30 C")
    ('rows in bias frames', 'rows, frequency band 6 in dark frames (2 s, 30 °C)')
    >>> statistic_text("bias frames, bias"), statistic_text("dark: bit 3 set, dark 8 s")
    ('level of bias frames', 'how often bit 3 is set in dark frames (8 s)')
    """
    what, _, frames = name.rpartition(", ")
    plain = frames_text(frames) if what else frames
    if plain == frames:
        what, plain = name, ""
    kind = plain.split(" ")[0]
    if kind in _KINDS and what.startswith((f"{kind} ", f"{kind}: ")):  # the frames say it again
        what = what[len(kind) :].lstrip(": ")
    if what.startswith("frames"):
        return f"{'relative ' * what.endswith('relative')}level of {plain}"
    for pattern, words in _PLAINER:
        what = re.sub(pattern, words, what)
    return f"{what} in {plain}" if plain else what


def label_text(label: str) -> str:
    """The plain name of a curve or a map: its frames in plain words, wherever they stand in it.

    >>> label_text("rows of one frame, flat 800 ph 22 C"), label_text("bias, DN")
    ('rows of one frame, flat frames (800 photons, 22 °C)', 'bias frames, DN')
    """
    return ", ".join(frames_text(part) if _FRAMES.fullmatch(part) else part for part in label.split(", "))


def frames_text(label: str) -> str:
    """Frames of one condition in plain words.

    >>> frames_text("flat 800 ph 22 C")
    'flat frames (800 photons, 22 °C)'
    """
    kind, _, conditions = label.partition(" ")
    if kind not in ("bias", "dark", "flat", "scene"):
        return label
    found = re.findall(r"[-+.\de]+ (?:ph|s|C|dB)\b|\S+", conditions)
    words = [re.sub(r" ph$", " photons", re.sub(r" C$", " °C", part)) for part in found]
    return f"{kind} frames" + (f" ({', '.join(words)})" if words else "")
