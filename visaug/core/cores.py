"""Cores of this machine."""

import os


def cores() -> int:
    """Cores that this process may use, which `taskset` and containers limit."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
