"""Whatever cameras, frames and effects are called, a report shows it as text."""

import numpy as np
import pytest

import visaug
from tests.hostile import TEXT, check_page
from tests.hostile_pages import NASTY, check_file
from tests.report.test_pages import CAMERA, DIAGNOSIS, Answer
from visaug.characterization.points import operating_points
from visaug.frames import FrameRecord, FrameSet
from visaug.report import pages, write_characterization, write_sheet
from visaug.report.preview import write_preview

SAID = {
    **DIAGNOSIS,
    "where": [{"view": "temporal_lines", "share": 0.7, "worst": NASTY, "z": 14.2}],
    "ambiguous": [{"effects": ["a", NASTY], "measure": NASTY}],
    "unexplained": {"description": NASTY, "axis": ["row"], "grows_with": ["signal"]},
    "warnings": [NASTY],
}


@pytest.fixture(scope="module")
def camera():
    return visaug.Camera.load({**CAMERA, "name": NASTY, "source": NASTY, "licence": NASTY})


@pytest.fixture(scope="module")
def frames(camera):
    named = {"setting": NASTY, "filter": NASTY}
    plan = [FrameRecord(i, f"{i} {TEXT}.npy", "bias", **named) for i in range(4)]
    plan += [
        FrameRecord(4 + i, f"{i} {TEXT}.npy", "flat", 0.01, photons=500.0 * (1 + i // 2), **named)
        for i in range(8)
    ]
    empty = FrameSet.from_arrays(plan, [np.zeros((32, 40), np.uint16)] * len(plan), bit_depth=12)
    return visaug.simulate(camera, empty, seed=1)


@pytest.fixture(scope="module")
def reports(camera, frames, tmp_path_factory):
    """The page of each measuring command; True where names stand in it."""
    folder = tmp_path_factory.mktemp("reports")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pages, "all_views", lambda: ["temporal_lines"])
        pages.write_comparison(folder / "compare.html", Answer(SAID, camera), camera, frames)
    better = camera.with_effect("row_noise", sigma_e=1.2)
    pages.write_diagnosis(folder / "diagnose.html", Answer(SAID, better), camera, frames)
    write_characterization(folder / "characterize.html", visaug.characterize(frames, camera), frames)
    write_sheet(folder / "sheet.html", operating_points(frames, camera, 0), frames)
    return {
        folder / "compare.html": True,
        folder / "diagnose.html": True,
        folder / "characterize.html": False,
        folder / "sheet.html": False,
    }


def test_names_are_text(reports):
    for path, shown in reports.items():
        check_page(path.read_text(), shown)


def test_nothing_runs_and_the_layout_holds_in_a_browser(reports, browser):
    for path in reports:
        check_file(browser, path)


def test_contact_sheet(camera, tmp_path):
    from PIL import Image

    Image.fromarray(np.full((48, 64), 90, np.uint8)).save(tmp_path / "a.png")
    name = "$\\bad$ $x_1.png"
    (tmp_path / "a.png").rename(tmp_path / name)
    write_preview(tmp_path / name, [camera], tmp_path / "sheet.png")
    assert Image.open(tmp_path / "sheet.png").size[0] > 100
