"""Memory of this process that was freed is kept for the next array."""

import contextlib
import ctypes
import sys


def keep_freed() -> None:
    """Lets glibc keep freed memory instead of returning it to the system, for a process of visaug's own.

    A simulated set makes thousands of arrays of up to some MB, and every page of an array that the system hands out anew is
    cleared first: a tenth to a quarter of the time of a set. Other systems are left as they are.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # musl has no mallopt
            mallopt = ctypes.CDLL(None).mallopt
            trim_threshold, mmap_threshold = -1, -3  # parameters of mallopt(3)
            # bytes of the largest block that is taken from the heap, and of the heap that stay unused at most
            mallopt(mmap_threshold, 32 * 2**20)
            mallopt(trim_threshold, 128 * 2**20)
