"""Statistics do not depend on whether their loops were just compiled or come from the cache on disk."""

import os
import subprocess
import sys

import numpy as np
import pytest

MEASURE = """
import sys
import numpy as np
from tests.diagnosis.small import frame_set, stated_camera
from visaug.diagnosis.laboratory import Laboratory

lab = Laboratory(frame_set(1), stated_camera())
np.save(sys.argv[1], np.concatenate(lab.simulated([(stated_camera(), 0)]), axis=1))
"""


@pytest.mark.slow
def test_a_new_cache_and_a_filled_one_give_the_same_numbers(tmp_path):
    """Loops that sum in free order round otherwise inside another compiled loop, where these come from the cache."""
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    found = []
    for name in ("new.npy", "filled.npy"):
        subprocess.run([sys.executable, "-c", MEASURE, str(tmp_path / name)], check=True, env=environment)
        found.append(np.load(tmp_path / name))
    assert found[0].size > 1000
    np.testing.assert_array_equal(*found)
