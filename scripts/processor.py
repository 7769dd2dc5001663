"""Processor time of a program and the processes that it has begun."""

import psutil


def processor_s() -> float:
    """User and system seconds of this process, of those that it has begun, and of those that have ended."""
    own = psutil.Process()
    total = 0.0
    for one in (own, *own.children(recursive=True)):
        try:
            times = one.cpu_times()
        except psutil.NoSuchProcess:  # it has just ended
            continue
        total += times.user + times.system
        total += getattr(times, "children_user", 0.0) + getattr(times, "children_system", 0.0)
    return total
