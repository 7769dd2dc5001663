"""Whatever the camera, the frames and an effect's texts hold, the lab shows it as text."""

import dataclasses
import json

import pytest
from PIL import Image
from starlette.testclient import TestClient

from tests.app.serving import see_everything, served
from tests.app.test_server import OWN, found
from tests.diagnosis.small import stated_camera
from tests.hostile import MARK, TEXT, check_page
from tests.hostile_pages import LONG, NASTY, WIDTHS, check_file, overflow, watched
from visaug import Camera, FrameSet
from visaug.app.lab import Bench, application
from visaug.diagnosis.session import session as session_module

expect = pytest.importorskip("playwright.sync_api").expect


@pytest.fixture
def bench(frames, compared, monkeypatch):
    monkeypatch.setattr(session_module, "compare", lambda *_, **__: compared)
    camera = Camera.load({**stated_camera().to_dict(), "name": NASTY, "source": NASTY})
    records = [dataclasses.replace(r, file=NASTY, setting=NASTY, filter=NASTY) for r in frames.records]
    named = FrameSet.from_arrays(records, [frames.read(i) for i in range(len(frames))], bit_depth=14)
    bench = Bench(camera, named, sets=60)
    monkeypatch.setattr(session_module, "diagnose", lambda *_, **__: found(bench))
    return bench


@pytest.fixture
def client(bench):
    app = application(bench, "a-token")
    with TestClient(app, base_url="http://127.0.0.1:8000") as client:
        client.params = {"token": "a-token"}
        app.state.jobs.wait()
        client.wait = app.state.jobs.wait
        yield client


def own_effect() -> str:
    """The file of an effect with hostile texts."""
    told = OWN.replace('"what I think it is"', json.dumps(NASTY))
    return told.replace('unit="e-"', f"unit={json.dumps(NASTY)}")


def test_every_page_shows_hostile_texts_as_text(client):
    assert client.post("/load/mine.py", content=own_effect()).status_code == 202
    client.wait()
    assert client.get("/state").json()["message"].startswith("loaded mine")
    check_page(client.get("/").text)
    bench = client.get("/bench").text
    assert "Add mine" in bench
    check_page(bench, shown=False)
    check_page(client.get("/report.html").text)
    assert "<evil" not in client.get("/lab.js").text


def test_a_message_and_a_name_of_a_file_stay_text(client):
    client.post(
        f"/load/{TEXT.replace('/', '').replace('%', '').replace('#', '').replace('?', '')}.py", content="1/0"
    )
    client.wait()
    answer = client.get("/state")
    assert answer.headers["content-type"].startswith("application/json")
    assert MARK in answer.json()["message"]
    script = client.get("/lab.js").text
    assert (
        script.count("innerHTML") == script.count("bench.innerHTML = newer") == 1
    )  # the answer tested above
    assert 'newer = stale ? await (await ask("bench")).text()' in script


def test_nothing_runs_and_the_layout_holds_in_a_browser(browser, bench, tmp_path):
    """The whole page with hostile names of camera, frames, effect, its file and a picture; then the report of it."""
    file = tmp_path / "<img src=x onerror=evil()> \u202e.py"
    file.write_text(own_effect() + f"# {NASTY}\n")
    picture = tmp_path / f"<b onclick=evil()> {LONG[:200]}.png"
    Image.new("L", (40, 30), 128).save(picture)
    report = tmp_path / "report.html"
    with served(bench) as address:
        for width in WIDTHS:
            with watched(browser, width) as page:
                page.goto(address)
                page.wait_for_selector("#bench[data-taken]")
                page.locator("#file").set_input_files(file)
                expect(page.locator("#chosen-lines")).to_contain_text("class Mine")
                assert overflow(page) == 0
                page.get_by_role("button", name="Load effect").click()
                expect(page.locator("#notice")).to_contain_text("loaded mine")
                with page.expect_file_chooser() as chooser:
                    page.get_by_role("button", name="Choose a picture").click()
                chooser.value.set_files(picture)
                page.get_by_role("button", name="Diagnose").click()
                expect(page.get_by_test_id("verdict")).to_contain_text("row_noise")
                see_everything(page)
                assert overflow(page) == 0
                with page.expect_download() as download:
                    page.get_by_role("button", name="Save report").click()
                download.value.save_as(report)
    check_file(browser, report)
