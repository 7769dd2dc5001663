"""Freed memory stays with the process."""

import ctypes
import subprocess
import sys

import pytest

FAULTS = """
import resource, sys
import numpy as np
from visaug.core.memory import keep_freed

if sys.argv[1] == "kept":
    keep_freed()

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(5):
        [np.ones(2**19) for _ in range(20)]  # 20 times 4 MiB: 20,480 pages
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults()
print(faults())
"""


def faults(how: str) -> int:
    run = subprocess.run([sys.executable, "-c", FAULTS, how], capture_output=True, text=True, check=True)
    return int(run.stdout)


@pytest.mark.skipif(sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "mallopt"), reason="no glibc")
def test_pages_of_freed_arrays_are_used_again():
    """What the system hands out anew are some of 100,000 pages of 4 KiB, or of 200 of 2 MiB where it has huge ones."""
    assert faults("kept") < 0.1 * faults("returned")
