"""Whatever cameras, frames and effects are called, a report shows it as text."""

import numpy as np
import pytest

import visaug
from tests.hostile import TEXT, check_page
from tests.report.test_pages import CAMERA, DIAGNOSIS, Answer
from visaug.frames import FrameRecord, FrameSet
from visaug.report import pages, write_sheet
from visaug.report.preview import write_preview

SAID = {
    **DIAGNOSIS,
    "where": [{"view": "temporal_lines", "share": 0.7, "worst": TEXT, "z": 14.2}],
    "ambiguous": [{"effects": ["a", "b"], "measure": TEXT}],
    "unexplained": {"description": TEXT, "axis": ["row"], "grows_with": ["signal"]},
    "warnings": [TEXT],
}


@pytest.fixture(scope="module")
def camera():
    return visaug.Camera.load({**CAMERA, "name": TEXT, "source": TEXT, "licence": TEXT})


@pytest.fixture(scope="module")
def frames(camera):
    named = {"setting": TEXT, "filter": TEXT}
    plan = [FrameRecord(i, f"{i} {TEXT}.npy", "bias", **named) for i in range(4)]
    plan += [
        FrameRecord(4 + i, f"{i} {TEXT}.npy", "flat", 0.01, photons=500.0 * (1 + i // 2), **named)
        for i in range(8)
    ]
    empty = FrameSet.from_arrays(plan, [np.zeros((32, 40), np.uint16)] * len(plan), bit_depth=12)
    return visaug.simulate(camera, empty, seed=1)


def test_reports_of_the_measuring_commands(camera, frames, tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "all_views", lambda: ["temporal_lines"])
    path = tmp_path / "page.html"
    pages.write_comparison(path, Answer(SAID, camera), camera, frames)
    check_page(path.read_text())
    pages.write_diagnosis(path, Answer(SAID, camera.with_effect("row_noise", sigma_e=1.2)), camera, frames)
    check_page(path.read_text())


def test_characterization_and_data_sheet(camera, frames, tmp_path):
    from visaug.characterization.points import operating_points

    path = tmp_path / "page.html"
    pages.write_characterization(path, visaug.characterize(frames, camera), frames)
    check_page(path.read_text(), shown=False)
    write_sheet(path, operating_points(frames, camera, 0), frames)
    check_page(path.read_text(), shown=False)


def test_contact_sheet(camera, tmp_path):
    from PIL import Image

    Image.fromarray(np.full((48, 64), 90, np.uint8)).save(tmp_path / "a.png")
    name = "$\\bad$ $x_1.png"
    (tmp_path / "a.png").rename(tmp_path / name)
    write_preview(tmp_path / name, [camera], tmp_path / "sheet.png")
    assert Image.open(tmp_path / "sheet.png").size[0] > 100
