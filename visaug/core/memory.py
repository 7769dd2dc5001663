"""Memory of this process that was freed is kept for the next array."""

import contextlib
import ctypes
import sys

# parameters of mallopt(3), and how far: blocks of up to 32 MiB from the heap, of which at most 128 MiB stay unused
_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1
LARGEST, UNUSED = 32 * 2**20, 128 * 2**20  # bytes


def keep_freed() -> None:
    """Lets glibc keep freed memory instead of returning it to the system, for a process of visaug's own.

    A simulated set makes thousands of arrays of up to some MB, and every page of an array that the system hands out anew is
    cleared first: a tenth to a quarter of the time of a set. Other systems are left as they are.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # musl has no mallopt
            mallopt = ctypes.CDLL(None).mallopt
            mallopt(_MMAP_THRESHOLD, LARGEST)
            mallopt(_TRIM_THRESHOLD, UNUSED)
