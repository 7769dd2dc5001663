"""The real frames that come with the package, and what is shown of them."""

import numpy as np
import pytest
from PIL import Image

from visaug_train.studies.story import REAL, real_camera, real_camera_section


def test_shipped_frames_are_small_and_carry_their_licence():
    assert sum(path.stat().st_size for path in REAL.iterdir()) < 8e6
    licence = (REAL / "LICENSE").read_text()
    for piece in ("Basler AG", "Marco Grimm", "ShareAlike 3.0", "creativecommons.org/licenses/by-sa/3.0"):
        assert piece in licence


def test_shipped_frames_are_those_of_the_reference_set(shared_data):
    source = shared_data / "emva1288_ccd12" / "images"
    _, shipped = real_camera()
    first, last = (
        np.asarray(Image.open(source / name)) for name in ("b_000_snap_001.png", "d_s_000_snap_023.png")
    )
    assert (shipped.read(0) == first[144:336, 192:448]).all()
    assert (shipped.read(len(shipped) - 1) == last[144:336, 192:448]).all()


@pytest.mark.slow
def test_the_section_says_what_this_camera_has():
    """The pixels of a row share noise that changes from frame to frame; its published parameters have none of it."""
    section = real_camera_section()
    assert section.blocks[1].text.startswith("The model does not hold")
    assert sum(hasattr(block, "uri") for block in section.blocks) == 4
    [z] = [float(row[3]) for row in section.blocks[-1].rows if row[2].startswith("rows in dark frames")]
    assert z > 10
