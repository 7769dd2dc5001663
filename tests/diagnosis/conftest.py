"""The small camera as its maker tells it, and a cache of its own."""

import os

import pytest

from tests.diagnosis.small import SENSOR
from visaug import Camera


@pytest.fixture(scope="session")
def stated() -> Camera:
    """The camera as its maker tells it, without what is hidden."""
    s = SENSOR
    return Camera.load(
        {
            "name": s.name,
            "resolution": [s.rows, s.columns],
            "bit_depth": s.bits,
            "quantum_efficiency": s.efficiency,
            "gain_e_per_dn": s.e_per_dn,
            "black_level_dn": s.pedestal_dn,
            "full_well_e": s.well_e,
            "read_noise": {"sigma_e": s.read_e, "shape": s.tail},
            "dark_current": {"a_e_per_s": s.dark_e_per_s, "b_per_c": s.dark_per_c},
            "prnu": dict(zip(("column", "row", "pixel"), s.prnu, strict=True)),
            "dsnu": dict(zip(("column_e", "row_e", "pixel_e"), s.dsnu_e, strict=True)),
        }
    )


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """What one test simulates of the camera the next may use, and nothing of an earlier run."""
    os.environ["VISAUG_CACHE"] = str(tmp_path_factory.mktemp("cache"))
