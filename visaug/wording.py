"""Numbers as text: two significant digits of the interval, p-values that do not pretend to be exact."""

import math


def number(value: float | None) -> str:
    """Four significant digits; a dash where the value is not known."""
    return "–" if value is None else f"{value:.4g}"


def p_text(p: float | None) -> str:
    """A p-value: "p = 0.43", or "p < 0.01" where simulated sets cannot resolve it further.

    Example:
        >>> p_text(0.0099), p_text(0.4273)
        ('p < 0.01', 'p = 0.43')
    """
    if p is None:
        return "p not known"
    return "p < 0.01" if p < 0.01 else f"p = {p:.2g}"


def probability_text(probability: float) -> str:
    """A posterior probability with two digits, never 0 or 1.

    Example:
        >>> probability_text(0.9994), probability_text(0.76)
        ('> 0.99', '0.76')
    """
    if probability > 0.99:
        return "> 0.99"
    return "< 0.01" if probability < 0.01 else f"{probability:.2f}"


def with_interval(value: float | None, low: float | None, high: float | None, unit: str = "") -> str:
    """A value with its 95 % interval and unit, rounded to two significant digits of the interval.

    Args:
        value, low, high: None where not known.
        unit: "1" and "" are not printed.

    Example:
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
    if place < -5 or biggest >= 1e6:
        digits = max(math.floor(math.log10(biggest)) - place, 1)
        return f"{value:.{digits}e} [{low:.{digits}e}, {high:.{digits}e}]{tail}"
    decimals = max(-place, 0)
    shown = [f"{round(x, -place):.{decimals}f}" for x in (value, low, high)]
    return f"{shown[0]} [{shown[1]}, {shown[2]}]{tail}"
